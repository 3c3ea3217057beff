"""The guardian: a separate process that stops the actuators if the control process cannot.

    guardian = GuardianProcess(shared, lines, bell, locks)
    guardian.configure(plan)              # opens its buses and starts to watch
    ...                                   # the run
    report = guardian.finish()

The plan, a runtime.robot.guardian.plan_types.Plan, is sent as JSON:

    buses       interfaces of CAN buses
    devices     frames of the safe stop, and the replies that confirm it
    relays      charge pumps, which the guardian holds while it damps a joint
    locks       of its buses, and connections to the processes from which the run has taken them over
    items       names of what a tick can hang in, by the numbers that the loop's watchdog writes to the shared state
    limit       s without a tick after which the loop counts as stalled
    priority    of SCHED_FIFO, or None

The guardian writes the time of its last check to the shared state, and holds a mutex there. If the time is older than
GUARDIAN_SILENCE, or its thread has died, the loop ends the run. The control process then stops the actuators with
`take_over`. What that requires is at hand before anything is armed: the wires that may be opened twice are open, and
for the others there are spare descriptors and every module that the guardian has imported.
"""

from __future__ import annotations

import json
import math
import select
import signal
import subprocess
import time
from contextlib import suppress
from importlib import import_module
from typing import TYPE_CHECKING

from cext.clock.stopwatch import names
from cext.safety.thresholds import GUARDIAN_KILL_LIMIT, LOOP_STALL_MINIMUM, LOOP_STALL_PERIODS
from runtime.host.child_process import ChildProcess
from runtime.host.console.terminal import StopMessages
from runtime.host.descriptors import Descriptors, SpareDescriptors
from runtime.robot.guardian import control_group
from runtime.robot.guardian.handover import Handover
from runtime.robot.guardian.interfaces import Interfaces
from runtime.robot.guardian.lock import name_of
from runtime.robot.guardian.relay import Relay
from runtime.robot.guardian.stop import SafeStop, decoded
from runtime.robot.guardian.wires import SHARED, CannotOpen, open_wire

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from typing import Any

    from cext.memory.shared_state import SharedState
    from cext.ring.rings import Lines
    from graph import DampedStop, ReplyField, StopReply
    from graph.device_data import Frame, Pattern
    from graph.schedule import DeviceSteps, Schedule
    from runtime.robot.guardian.lock import BusLock
    from runtime.robot.guardian.plan_types import (
        EncodedFrame,
        EncodedReply,
        Plan,
        PlanBus,
        PlanCap,
        PlanDamp,
        PlanField,
        PlanLock,
        PlanRelay,
        PlanReply,
        StopReport,
    )


READY_TIMEOUT = 30.0  # s
LEAVE_TIMEOUT = 5.0  # s
MEMORY_LOCKED, REALTIME = "memory locked", "SCHED_FIFO"  # privileges, as text; the second is followed by the priority
GO_ON_PERIOD = 20_000_000  # ns between two checks whether the operator ends a stop
FLAGS = 0xE0000000  # of struct can_frame: extended, remote, error


class GuardianError(Exception):
    """Failure to start the guardian, so nothing may be armed. problems : {bus: reason it cannot be opened}"""

    def __init__(self, text: str, problems: dict[str, str]) -> None:
        super().__init__(text)
        self.problems = problems


class GuardianProcess(ChildProcess):
    """Guardian of one run, spawned at once.

    shared : cext.memory.shared_state.SharedState
    lines : cext.ring.rings.Lines, or None where the loop drives every bus itself
    bell : file descriptor of the eventfd that the loop signals, or -1
    locks : runtime.robot.guardian.lock.BusLock of every bus, which the guardian inherits
    lines_of_relays : file descriptors of the plan's relays

    pid : ID of the process
    granted : privileges that it obtained, as text
    """

    def __init__(
        self,
        shared: SharedState,
        lines: Lines | None,
        bell: int,
        locks: Sequence[BusLock],
        lines_of_relays: Sequence[int] = (),
    ) -> None:
        shared.take_hold()  # before another process waits for it
        self._shared = shared
        inherited = (
            shared.fd,
            *([bell] if bell >= 0 else ()),
            *([lines.fd] if lines is not None else ()),
            *(lock.fileno() for lock in locks),
            *(lock.handover.fileno() for lock in locks if lock.handover is not None),
            *lines_of_relays,
        )
        super().__init__(
            "runtime.robot.guardian.process", (shared.fd, -1 if lines is None else lines.fd, bell), inherited
        )
        self.granted: list[str] = []
        self._group: str | None = None
        self._locks = locks
        self._plan: Plan | None = None
        self._spare: SpareDescriptors | None = None
        self._interfaces: Interfaces | None = None  # for `take_over`

    def configure(self, plan: Plan) -> None:
        """Send the plan and wait until every bus is open. Raises GuardianError, with nothing left open."""
        places = {name_of(bus["interface"], bus["channel"]): index for index, bus in enumerate(plan["buses"])}
        plan = {**plan, "locks": [_lock(lock, places.get(lock.name)) for lock in self._locks]}
        self._plan = plan
        answer: dict[str, Any] | None
        try:
            self._send(json.dumps(self._plan).encode() + b"\n")
            answer = self._answer(READY_TIMEOUT)
        except BrokenPipeError:
            answer = None
        except TimeoutError:
            answer = {"troubles": {}}
        if answer is None or "troubles" in answer:
            how = self.kill()
            raise GuardianError(
                f"the guardian was not ready ({how}); nothing was armed", (answer or {}).get("troubles", {})
            )
        self.granted, self._group = answer["granted"], answer["group"]
        for lock in self._locks:
            if lock.handover is not None:  # the guardian has it
                lock.handover.close()
                lock.handover = None
        for module in answer["modules"]:
            with suppress(Exception):  # the guardian has imported it
                import_module(module)
        devices = [decoded(device) for device in plan["devices"]]
        self._interfaces = Interfaces(plan["buses"], devices, select.poll())
        for index, bus in enumerate(plan["buses"]):
            if bus["interface"] in SHARED:
                with suppress(CannotOpen):
                    self._interfaces.wires[index] = open_wire(bus)
        self._spare = SpareDescriptors(len(plan["buses"]))

    def keep_descriptors(self, descriptors: Descriptors) -> None:
        """Add the pipes to the descriptors of the run."""
        descriptors.keep("the orders to the guardian", self._orders.fileno())
        descriptors.keep("the answers of the guardian", self._answers)

    def finish(self) -> dict[str, Any]:
        """End the guardian after the run. Returns its report.

        stop : the safe stop that it performed, or None: `because` is "died", "stalled", "hung", "suspended", "paused",
            "cut off" or "torque", with `excess`; `silent`, `took` in s; `last_tick`; `block` that hung; `confirmed`,
            `unconfirmed` are names of devices
        troubles : {bus: reason it failed}
        died : how the process ended, if it ended early

        A guardian whose pipes were closed here stops the actuators and then ends without a report.
        """
        answer, grace = None, LEAVE_TIMEOUT
        if self.connected:
            try:
                self._send(b"release\n")
                answer = self._answer(LEAVE_TIMEOUT)
                while answer is not None and "troubles" not in answer:  # of a stop that it was ordered to continue
                    answer = self._answer(LEAVE_TIMEOUT)
            except (OSError, TimeoutError):
                grace = 0.0
        how = self.kill(grace)
        return answer | {"died": None} if answer is not None else {"stop": None, "troubles": {}, "died": how}

    def go_on(self, devices: Sequence[str], lasts: float, ended: Callable[[], bool]) -> StopReport | None:
        """Let the guardian continue a safe stop that devices have not confirmed.

        devices : their names; lasts : s for which it continues; ended : whether the operator ends it

        Returns the report of the stop, None if it was ended before, or the guardian does not answer.
        """
        try:
            self._send(json.dumps({"devices": list(devices), "lasts": lasts}).encode() + b"\n")
            deadline = time.monotonic() + LEAVE_TIMEOUT + lasts
            while not ended() and time.monotonic() < deadline:
                with suppress(TimeoutError):
                    answer = self._answer(GO_ON_PERIOD * 1e-9)
                    return None if answer is None else answer["stop"]
        except OSError:
            pass
        return None

    def kill(self, grace: float = 0.0) -> str:
        """End the process, by force after `grace` s, and return how it ended."""
        if self._orders.closed:
            return _ending(self._child.returncode)
        self._shared.let_go()
        with suppress(OSError):
            self._orders.close()
        try:
            self.wait(grace)
        except subprocess.TimeoutExpired:
            try:
                self._child.kill()
            except PermissionError:  # a block has changed the account of this process
                return "it still runs: this process no longer has permission to end it"
            self._child.wait()
        self._close_answers()
        if self._spare is not None:
            self._spare.close()
        if self._interfaces is not None:
            self._interfaces.close_all()
        if self._group is not None:
            control_group.remove(self._group)
        return _ending(self._child.returncode)

    def take_over(
        self, lasts: float, ended: Callable[[], bool], leave: Callable[[], object]
    ) -> tuple[str, dict[str, str], StopReport]:
        """Open every bus and stop the actuators, if the guardian does not respond.

        Actuators that have not confirmed after STOP_LIMIT are reported on standard error, and get the frames at a
        falling rate for `lasts` s, until the operator ends that or another run has taken over their buses. ended :
        whether the operator does; leave : function that closes all other interfaces then

        Returns (how the guardian ended, {bus: reason it could not be opened}, report of the stop).
        """
        with suppress(PermissionError):  # a block has changed the account of this process
            self._child.kill()  # reaped below, after the actuators are stopped
        plan, interfaces = self._plan, self._interfaces
        assert plan is not None and interfaces is not None and self._spare is not None
        self._spare.release()
        deadline = time.monotonic() + GUARDIAN_KILL_LIMIT * 1e-9
        while not self._shared.guardian_died and time.monotonic() < deadline:
            time.sleep(0.0002)
        problems: dict[str, str] = {}
        for index, bus in enumerate(plan["buses"]):
            try:
                if index not in interfaces.wires:
                    interfaces.wires[index] = open_wire(bus, again=True)
            except CannotOpen as error:
                problems[bus["name"]] = str(error)
        now = time.monotonic_ns()
        relays = [Relay(relay, now) for relay in plan["relays"]]
        stop = SafeStop(
            interfaces.devices, interfaces.wires, now, relays=relays, out=self._shared.out, lasts=round(lasts * 1e9)
        )
        for index in interfaces.wires:
            interfaces.listen(index)
        handover, messages, reported = Handover(plan["locks"], interfaces), StopMessages(), False
        while not stop.over:
            now = time.monotonic_ns()
            stop.step(now)
            if stop.is_due(now) and not stop.over:
                handover.attend(now, stop)  # before the line: who reads it may start the next run at once
                interfaces.open_lost(stop, now)
                if not reported:
                    reported = True
                    messages.write(goes_on_in_words(stop.waiting))
                    leave()
                elif ended():
                    break
            messages.flush()
            for descriptor in interfaces.wait(stop.milliseconds(now, GO_ON_PERIOD), stop):
                for line in handover.handle(descriptor, stop):
                    messages.write(line)
        handover.close()
        for index in interfaces.wires:
            problems.pop(plan["buses"][index]["name"], None)
        return self.kill(), problems, stop.report()


def _lock(lock: BusLock, bus: int | None) -> PlanLock:
    """Return a lock for the plan. bus : index of its CAN bus, else None"""
    return {
        "descriptor": lock.fileno(),
        "name": lock.name.decode(),
        "bus": bus,
        "handover": -1 if lock.handover is None else lock.handover.fileno(),
    }


def goes_on_in_words(names: Sequence[str]) -> str:
    """Return the line on actuators that have not confirmed a stop by this process."""
    return (
        f"the guardian does not respond; the control process stops the motors: NOT confirmed by {', '.join(names)}; "
        "its frames continue at a falling rate. Cut the power; Ctrl-C ends the stop"
    )


def _ending(code: int) -> str:
    """Return how a process ended: the name of its signal, or its exit code."""
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def plan(
    buses: list[PlanBus], schedule: Schedule, priority: int | None, relays: Sequence[PlanRelay] = (), grace: float = 0.0
) -> Plan:
    """Return the guardian's plan.

    buses : CAN buses, in the order of the schedule
    schedule : schedule of the robot on its rig
    priority : SCHED_FIFO priority of the loop, or None
    relays : relays of charge pumps
    grace : s of a delay of the loop that the run tolerates at least
    """
    place = {
        bus: number
        for number, bus in enumerate(index for index, medium in enumerate(schedule.media) if medium == "can")
    }
    return {
        "buses": buses,
        "devices": [
            {
                "name": device.name,
                "number": number,
                "bus": place[device.bus],
                "zero": _encoded_frames(device.zero),
                "disable": _encoded_frames(device.disable),
                "damp": _damping(device.damp),
                "unanswered": device.unanswered,
                "stop_reply": _confirming(device.stop_reply),
                "cap": _cap(device),
            }
            for number, device in enumerate(schedule.devices)
            if device.bus in place
        ],
        "relays": list(relays),
        "locks": [],
        "items": names(schedule),
        "limit": max(LOOP_STALL_PERIODS / schedule.rate, LOOP_STALL_MINIMUM * 1e-9, grace),
        "priority": None if priority is None else priority + 1,
    }


def _damping(stop: DampedStop | None) -> PlanDamp | None:
    """Convert a graph.DampedStop for the plan."""
    if stop is None:
        return None
    return {
        "duration": stop.duration,
        "round": stop.round,
        "acceleration": stop.acceleration,
        "transit": stop.transit,
        "velocity": _encoded_field(stop.velocity),
        "bands": [(None if speed == math.inf else speed, _encoded_frames(frames)) for speed, frames in stop.bands],
    }


def _confirming(reply: StopReply | None) -> PlanReply | None:
    """Convert a graph.StopReply for the plan."""
    if reply is None:
        return None
    return {
        "frames": _encoded_replies(reply.frames),
        "unasked": _encoded_replies(reply.unasked),
        "length": reply.length,
        "torque": _encoded_field(reply.torque),
        "rest": reply.rest,
        "disabled": reply.disabled,
        "enabled": _encoded_field(reply.enabled),
        "echo": reply.echo,
        "reports": reply.reports,
    }


def _cap(device: DeviceSteps) -> PlanCap | None:
    """Return the cap of the torque of a device for the plan."""
    cap, reply = device.cap, device.stop_reply
    if cap is None or math.isinf(cap.torque):
        return None
    measured = _encoded_field(None if reply is None else reply.torque)
    if measured is not None and reply is not None:
        measured["low"], measured["high"] = reply.unit * measured["low"], reply.unit * measured["high"]
    motion = None if device.watch is None else device.watch.watch.motion
    return {
        "torque": cap.torque,
        "accuracy": 0.0 if motion is None else motion.accuracy,
        "source": cap.source,
        "measured": measured,
        "commanded": _encoded_field(device.commanded),
    }


def _encoded_field(field: ReplyField | None) -> PlanField | None:
    """Convert a graph.ReplyField for the plan."""
    if field is None:
        return None
    return {
        "frames": _encoded_replies(field.frames),
        "first": field.first,
        "bits": field.bits,
        "low": field.low,
        "high": field.high,
        "signed": field.signed,
        "little_endian": field.little_endian,
    }


def _encoded_replies(frames: Iterable[Pattern]) -> list[EncodedReply]:
    """Convert the frames of a graph.ReplyField for the plan."""
    return [
        (with_flags(identifier, extended), mask | FLAGS, first.hex()) for identifier, mask, extended, first in frames
    ]


def _encoded_frames(frames: Iterable[Frame]) -> list[EncodedFrame]:
    """Convert frames (arbitration id, is extended, data) for the plan."""
    return [(with_flags(identifier, extended), bytes(data).hex()) for identifier, extended, data in frames]


def with_flags(identifier: int, extended: bool) -> int:
    """Return an arbitration id with the flag bits of struct can_frame."""
    return identifier | 0x80000000 * extended

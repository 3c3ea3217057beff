"""The guardian: a separate process that stops the actuators if the control process cannot.

    guardian = GuardianProcess(page, lines, bell, locks)
    guardian.configure(plan)              # opens its buses and starts to watch
    ...                                   # the run
    report = guardian.finish()

The plan is a dict that can be encoded as JSON:

    buses       for each bus: name, interface, channel, bitrate, fd, options (of python-can), virtual, line (its number;
                None if the loop drives the bus itself)
    devices     for each device: name, bus (index), zero and disable as [id, data], unanswered (number of disable frames
                without a reply), replies as [id, mask, first digits], damp (as below, or None); data in hex digits, ids
                with the flag bits of struct can_frame
    damp        duration and round in s, acceleration in rad/s², bands as [highest speed in rad/s or None, frames as
                above], velocity: the fields of graph.ReplyField with frames like replies, or None
    relays      for each charge pump: descriptor of its line, gpio (whether it is a GPIO line), frames (two in hex
                digits, sent alternately), hold in s
    items       names of what a tick can hang in, by the numbers that the loop's watchdog writes to the shared state
    limit       s without a tick after which the loop counts as stalled
    priority    of SCHED_FIFO, or None

The guardian writes the time of its last check to the shared state, and holds a mutex there. If the time is older than
GUARDIAN_SILENCE, or its thread has died, the loop ends the run. The control process then stops the actuators on the
buses that the guardian carried with `take_over`.
"""

import json
import math
import os
import signal
import subprocess
import time
from contextlib import suppress
from importlib import import_module

from cext.clock.stopwatch import names
from cext.safety.thresholds import GUARDIAN_KILL_LIMIT, LOOP_STALL_MINIMUM, LOOP_STALL_PERIODS
from runtime.base.child_process import ChildProcess
from runtime.guardian import control_group
from runtime.guardian.relay import Relay
from runtime.guardian.stop import SafeStop, decoded
from runtime.guardian.wires import CannotOpen, open_wire

READY_TIMEOUT = 30.0  # s
LEAVE_TIMEOUT = 5.0  # s
FLAGS = 0xE0000000  # of struct can_frame: extended, remote, error


class GuardianError(Exception):
    """Failure to start the guardian, so nothing may be armed. troubles : {bus: reason it cannot be opened}"""

    def __init__(self, words, troubles):
        super().__init__(words)
        self.troubles = troubles


class GuardianProcess(ChildProcess):
    """Guardian of one run, spawned at once.

    page : cext.safety.shared_state.SharedState
    lines : cext.ring.rings.Lines, or None where the loop drives every bus itself
    bell : file descriptor of the eventfd that the loop signals, or -1
    locks : runtime.guardian.lock.BusLock of every bus, which the guardian inherits
    lines_of_relays : file descriptors of the plan's relays

    pid : ID of the process
    granted : privileges that it obtained, as text
    """

    def __init__(self, page, lines, bell, locks, lines_of_relays=()):
        page.take_hold()  # before another process waits for it
        self._page = page
        inherited = (
            page.fd,
            *([bell] if bell >= 0 else ()),
            *([lines.fd] if lines is not None else ()),
            *(lock.fileno() for lock in locks),
            *lines_of_relays,
        )
        super().__init__("runtime.guardian.process", (page.fd, -1 if lines is None else lines.fd, bell), inherited)
        self.granted, self._group = [], None
        self._plan = {}

    def configure(self, plan):
        """Send the plan and wait until every bus is open. Raises GuardianError, with nothing left open."""
        self._plan = plan
        try:
            self._send(json.dumps(plan).encode() + b"\n")
            import_interfaces(plan["buses"])  # in advance, since `take_over` must be fast
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

    def finish(self):
        """End the guardian after the run. Returns its report.

        stop : the safe stop that it performed, or None: `because` is "died", "stalled" or "hung"; `silent`, `took` in
            s; `last_tick`; `block` that hung; `confirmed`, `unconfirmed` are names of devices
        troubles : {bus: reason it failed}
        died : how the process ended, if it ended early
        """
        try:
            self._send(b"release\n")
            answer = self._answer(LEAVE_TIMEOUT)
        except (OSError, TimeoutError):
            answer = None
        how = self.kill(LEAVE_TIMEOUT if answer is not None else 0.0)
        return answer | {"died": None} if answer is not None else {"stop": None, "troubles": {}, "died": how}

    def kill(self, grace=0.0):
        """End the process, by force after `grace` s, and return how it ended."""
        if self._orders.closed:
            return ending(self._child.returncode)
        self._page.let_go()
        try:
            self._orders.close()
        except OSError:
            pass
        try:
            self.wait(grace)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        os.close(self._answers)
        if self._group is not None:
            control_group.remove(self._group)
        return ending(self._child.returncode)

    def take_over(self):
        """Open every bus and stop the actuators, if the guardian does not respond.

        Returns (how the guardian ended, {bus: reason it could not be opened}, report of the stop).
        """
        self._child.kill()  # reaped below, after the actuators are stopped
        deadline = time.monotonic() + GUARDIAN_KILL_LIMIT * 1e-9
        while not self._page.guardian_died and time.monotonic() < deadline:
            time.sleep(0.0002)
        wires, troubles = {}, {}
        devices = [decoded(device) for device in self._plan["devices"]]
        for index, bus in enumerate(self._plan["buses"]):
            try:
                wires[index] = open_wire(bus, again=True)
            except CannotOpen as error:
                troubles[bus["name"]] = str(error)
        now = time.monotonic_ns()
        stop = SafeStop(devices, wires, now, relays=[Relay(relay, now) for relay in self._plan["relays"]])
        for index, wire in wires.items():
            if self._plan["buses"][index]["line"] is None:
                wire.listen(
                    [
                        reply
                        for device in devices
                        if device["bus"] == index
                        for reply in device["replies"] + device["speeds"]
                    ]
                )
        drained = stop.began
        while not stop.over:
            stop.step(time.monotonic_ns())
            time.sleep(0.0005)
            before = time.monotonic_ns()
            for index, wire in wires.items():
                for identifier, data, _ in wire.receive():
                    stop.receive(index, identifier, data, time.monotonic_ns(), drained)
            drained = before
        for wire in wires.values():
            wire.close()
        return self.kill(), troubles, stop.report()


def import_interfaces(buses):
    """Import what `open_wire` needs for the buses of the guardian. The guardian reports a failed import."""
    for bus in buses:
        if bus["line"] is not None:
            with suppress(Exception):
                import can.interfaces

                import_module(can.interfaces.BACKENDS[bus["interface"]][0])


def ending(code):
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def plan(buses, schedule, diagram, priority, relays=()):
    """Return the guardian's plan.

    buses : CAN buses, with the keys above
    priority : of the loop's SCHED_FIFO, or None
    relays : as above
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
                "bus": place[device.bus],
                "zero": plain_frames(device.zero),
                "disable": plain_frames(device.disable),
                "damp": damping(device.damp),
                "unanswered": device.unanswered,
                "replies": [
                    [flagged(wanted, extended), mask | FLAGS, begin if isinstance(begin, str) else begin.hex()]
                    for wanted, mask, extended, begin in diagram[device.name].replies()
                ],
            }
            for device in schedule.devices
            if device.bus in place
        ],
        "relays": list(relays),
        "items": names(schedule),
        "limit": max(LOOP_STALL_PERIODS / schedule.rate, LOOP_STALL_MINIMUM * 1e-9),
        "priority": None if priority is None else priority + 1,
    }


def damping(stop):
    """Convert a graph.DampedStop for the plan."""
    if stop is None:
        return None
    field = stop.velocity
    velocity = (
        None
        if field is None
        else vars(field)
        | {
            "frames": [
                [flagged(wanted, extended), mask | FLAGS, begin.hex()] for wanted, mask, extended, begin in field.frames
            ]
        }
    )
    return {
        "duration": stop.duration,
        "round": stop.round,
        "acceleration": stop.acceleration,
        "velocity": velocity,
        "bands": [[None if speed == math.inf else speed, plain_frames(frames)] for speed, frames in stop.bands],
    }


def plain_frames(frames):
    return [[flagged(identifier, extended), bytes(data).hex()] for identifier, extended, data in frames]


def flagged(identifier, extended):
    return identifier | 0x80000000 * extended

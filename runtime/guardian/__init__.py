"""The guardian as the control process sees it: a process of its own that stops the actuators where this one cannot.

    guardian = GuardianProcess(page, lines, bell, locks)
    guardian.configure(plan)              # its buses are open from here on, and it watches
    ...                                   # the run
    report = guardian.finish()

The plan is a dict that JSON can carry:

    buses       of each: name, interface, channel, bitrate, fd, options (of python-can), virtual, line (its number; None
    where the loop drives
                the bus itself)
    devices     of each: name, bus (index), zero and disable as [id, data], unanswered (how many frames of disable are),
    replies as
                [id, mask, first digits], damp (as below, or None); data in hex digits, ids with the flag bits of struct
                can_frame
    damp        duration and round in s, acceleration in rad/s², bands as [highest speed in rad/s or None, frames as
    above], velocity:
                the fields of graph.ReplyField with frames like replies, or None
    relays      of each charge pump: descriptor of its line, gpio (whether that is a GPIO line), frames (two in hex
    digits, sent in turn), hold in s items       what a tick can hang with, by the numbers that the watchdog of the loop
    puts on the page
    limit       s without a tick after which the loop counts as stalled
    priority    of SCHED_FIFO, or None

The guardian writes on the page when it has looked last, and holds a mutex there: where its look is longer ago than
GUARDIAN_SILENCE, or its thread has died, the loop ends the run. The actuators on buses that the guardian carried are
then stopped from here, by `take_over`.
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
    """There is no guardian, so nothing may be armed. troubles : {bus: why it cannot be opened}"""

    def __init__(self, words, troubles):
        super().__init__(words)
        self.troubles = troubles


class GuardianProcess(ChildProcess):
    """The guardian of one run. Spawned at once.

    page : cext.safety.shared_state.Page
    lines : cext.ring.rings.Lines, or None where the loop drives every bus itself
    bell : file descriptor of the eventfd that the loop rings, or -1
    locks : runtime.guardian.lock.BusLock of every bus, which it holds as long as it lives
    lines_of_relays : file descriptors of the plan's relays

    pid : number of the process
    granted : what the system has granted it, in words
    """

    def __init__(self, page, lines, bell, locks, lines_of_relays=()):
        page.take_hold()  # before anybody waits for it
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
        self._plan = None

    def configure(self, plan):
        """Send the plan and wait until every bus is open. GuardianError; then nothing is left behind."""
        self._plan = plan
        try:
            self._child.stdin.write(json.dumps(plan).encode() + b"\n")
            self._child.stdin.flush()
            import_interfaces(plan["buses"])  # meanwhile: `take_over` has no time for it
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
        """The run is over: let it go. Returns its report.

        stop : what it has done on its own, None if nothing: `because` is "died", "stalled" or "hung"; `silent`, `took`
            in s; `last_tick`; `block`, where one hung; `confirmed`, `unconfirmed` are names of devices
        troubles : {bus: why it failed}
        died : how it ended, where it did not last to the end
        """
        try:
            self._child.stdin.write(b"release\n")
            self._child.stdin.flush()
            answer = self._answer(LEAVE_TIMEOUT)
        except (OSError, TimeoutError):
            answer = None
        how = self.kill(LEAVE_TIMEOUT if answer is not None else 0.0)
        return answer | {"died": None} if answer is not None else {"stop": None, "troubles": {}, "died": how}

    def kill(self, patience=0.0):
        """End it, by force if it takes longer than `patience` s, and say how it ended."""
        if self._child.stdin.closed:
            return ending(self._child.returncode)
        self._page.let_go()
        try:
            self._child.stdin.close()
        except OSError:
            pass
        try:
            self._child.wait(patience)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        os.close(self._answers)
        if self._group is not None:
            control_group.remove(self._group)
        return ending(self._child.returncode)

    def take_over(self):
        """Where the guardian does not answer: open every bus from here, and stop the actuators.

        Returns (how the guardian ended, {bus: why it could not be opened}, the report of the stop).
        """
        self._child.kill()  # it is reaped below, once the actuators are stopped
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
                    stop.hear(index, identifier, data, time.monotonic_ns(), drained)
            drained = before
        for wire in wires.values():
            wire.close()
        return self.kill(), troubles, stop.report()


def import_interfaces(buses):
    """Import what `open_wire` needs for the buses that the guardian carries. An interface that cannot be imported is
    reported by the guardian.
    """
    for bus in buses:
        if bus["line"] is not None:
            with suppress(Exception):
                import can.interfaces

                import_module(can.interfaces.BACKENDS[bus["interface"]][0])


def ending(code):
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def plan(buses, schedule, diagram, priority, relays=()):
    """The guardian's plan. buses : as above, those of CAN alone; priority : of the loop's SCHED_FIFO, or None; relays :
    as above
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
                "zero": told(device.zero),
                "disable": told(device.disable),
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
    """A graph.DampedStop as the plan has it."""
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
        "bands": [[None if speed == math.inf else speed, told(frames)] for speed, frames in stop.bands],
    }


def told(frames):
    return [[flagged(identifier, extended), bytes(data).hex()] for identifier, extended, data in frames]


def flagged(identifier, extended):
    return identifier | 0x80000000 * extended

"""The guardian process: it carries frames, watches the loop, and stops the actuators if the loop cannot.

    watch       the computer, by its clocks, one of which stands still while it is suspended
                the control process, by its mutex in the shared state and by its pidfd (death), and by the pipe for
                orders, which other code of that process may close; the loop, by the time of its newest tick (stall),
                and by the block that hangs or crashes in the shared state
                the torque in the frames of actuators that a subject file caps (runtime.robot.guardian.torque)
    stop        raise the fence; then send zero torque and disable to every actuator until each has confirmed. Those
                that have not after 200 ms are reported, and get the frames at a falling rate; an interface that was
                lost is opened again. The control process orders the same for actuators that its own stop has left
    carry       frames between the rings and its interfaces; behind the fence only those of the safe stop
    hand over   the buses to another run while such a stop continues (runtime.robot.guardian.handover); and, as the
                guardian of that run, send the frames of the safe stop until its loop asks the drives

It ends with the control process, or by its order; after the death of the control process with its stop, or after
STOP_ORPHANED. It ignores signals.
"""

from __future__ import annotations

import gc
import json
import os
import resource
import select
import signal
import sys
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from cext.clock import realtime
from cext.memory.shared_state import RECORD_EVENT, SharedState
from cext.ring.rings import Lines
from cext.safety.owner_death import OwnerDeathWatcher
from cext.safety.suspend import time_suspended, was_paused
from cext.safety.thresholds import (
    GUARDIAN_DEATH,
    GUARDIAN_LOOK_LIMIT,
    GUARDIAN_LOOK_PERIOD,
    HANG_MINIMUM,
    HANG_REPORT_DELAY,
    STOP_ORPHANED,
    STOP_ROUND_MAXIMUM,
)
from runtime.host.console.terminal import StopMessages
from runtime.host.ending import ignore_signals
from runtime.host.run_mark import remove_mark
from runtime.host.system import CAP_IPC_LOCK, capable, maps
from runtime.robot.guardian import MEMORY_LOCKED, REALTIME, control_group
from runtime.robot.guardian.handover import Handover, Successor
from runtime.robot.guardian.interfaces import Interfaces
from runtime.robot.guardian.relay import Relay
from runtime.robot.guardian.stop import SafeStop, decoded, frames_of_stop
from runtime.robot.guardian.torque import TorqueCaps, in_words
from runtime.robot.guardian.wires import SHARED, CannotOpen, load, open_wire

if TYPE_CHECKING:
    from runtime.robot.guardian.plan_types import Plan

ORDERS = 0  # standard input
ACTIVE = ("arming", "ready", "running", "stopping", "waiting")
NAME = "tickwork-guard"


def main(answers: int, control: int, shared: int, lines: int, bell: int) -> None:
    """Run the process.

    The arguments are file descriptors: pipe for answers, pidfd of the control process, shared state, lines or -1, bell
    or -1.
    """
    ignore_signals()
    remove_mark()
    with open("/proc/self/comm", "w") as file:
        file.write(NAME)
    received = receive_plan(control)
    if received is None:
        return
    opened = SharedState(fd=shared), Lines(fd=lines) if lines >= 0 else None
    guardian = Guardian(*opened, bell, answers, control, *received)
    if guardian.prepare():
        guardian.run()


def receive_plan(control: int) -> tuple[Plan, bytes] | None:
    """Wait for the plan. Returns it and what follows it; None if the run has ended.

    control : pidfd of the control process
    """
    poll, received = select.poll(), b""
    for descriptor in (control, ORDERS):
        poll.register(descriptor, select.POLLIN)
    while b"\n" not in received:
        ready = [descriptor for descriptor, _ in poll.poll()]
        data = b"" if control in ready else os.read(ORDERS, 1 << 20)
        if not data:
            return None
        received += data
    line, _, rest = received.partition(b"\n")
    return None if received.endswith(b"release\n") else (json.loads(line), rest)


class Guardian:
    """Guardian of one run, in its process.

    shared, lines : shared state and lines of the run; lines is None if the loop drives every bus itself
    bell : eventfd that the loop signals, or -1
    answers, control : file descriptors of the pipe for answers, and of the control process (pidfd)
    received : orders that have followed the plan
    """

    def __init__(
        self,
        shared: SharedState,
        lines: Lines | None,
        bell: int,
        answers: int,
        control: int,
        plan: Plan,
        received: bytes = b"",
    ) -> None:
        self.shared, self.lines, self.bell, self.answers, self.control = shared, lines, bell, answers, control
        self.received = received
        # dead: its loop; gone: the whole process, which may take 20 ms longer
        # cut off: it no longer has the pipe for orders; ordered: it waits for the end of the stop
        self.released = self.dead = self.gone = self.cut_off = self.reported = self.ordered = False
        self.stop = self.verdict = self.owner_death = self.groups = None
        self.in_send = False  # whether the loop was in a send when the fence was raised, and may still be
        self.messages = StopMessages()
        self.stuck_at = None  # ns at which to check whether the block still hangs
        self.buses, self.items, self.priority = plan["buses"], plan["items"], plan["priority"]
        self.devices = [decoded(device) for device in plan["devices"]]
        self.relays = [*plan["relays"]]
        self.limit = int(plan["limit"] * 1e9)
        self.caps = TorqueCaps(self.devices)
        self.carried = [(index, bus["line"]) for index, bus in enumerate(self.buses) if bus["line"] is not None]
        self.harmless = {(device["bus"], *frame) for device in self.devices for frame in frames_of_stop(device)}
        # of buses that are being taken over: (index, end of the connection)
        self.successors = [
            (lock["bus"], Successor(lock["handover"])) for lock in plan["locks"] if lock["handover"] >= 0
        ]
        self.attend = 0  # ns at which their drives get the next frames
        self.poll = select.poll()
        self.interfaces = Interfaces(self.buses, self.devices, self.poll, lines, self.caps)
        self.wires = self.interfaces.wires
        self.handover = Handover(plan["locks"], self.interfaces)
        for descriptor in (control, ORDERS, *([bell] if bell >= 0 else ())):
            self.poll.register(descriptor, select.POLLIN)

    def prepare(self) -> bool:
        """Open the wires, request privileges. Returns False if the run must not start."""
        problems, known = {}, {*sys.modules}
        for index, bus in enumerate(self.buses):
            try:
                self._open(index, bus)
            except CannotOpen as error:
                problems[bus["name"]] = str(error)
        if problems:
            self._answer({"troubles": problems})
            return False
        for index in {*(index for index, _ in self.carried), *self.caps.buses()}:
            self.interfaces.listen(index)
        self.groups = control_group.enter()
        granted = ["own control group"] * (self.groups is not None) + _obtain_privileges(self.priority)
        self.owner_death = OwnerDeathWatcher(self.shared, self.priority or 0)
        self.poll.register(self.owner_death.fd, select.POLLIN)
        self.shared.take_guard()
        self.shared.look_after(time.monotonic_ns())
        group = None if self.groups is None else str(self.groups[0])
        modules = [name for name in sys.modules if name not in known]
        self._answer({"ready": True, "granted": granted, "group": group, "modules": modules})
        return True

    def _open(self, index, bus):
        """Open the wire of a bus of the plan. Raises CannotOpen."""
        successor = dict(self.successors).get(index)
        if successor is None:
            self.wires[index] = open_wire(bus)
            return
        shared = bus["interface"] in SHARED
        wire = open_wire(bus, again=True) if shared else None
        load(bus["interface"])
        successor.open()
        if wire is None:
            wire = open_wire(bus, again=True)
        while wire.receive():  # frames of the other process, and replies to it
            pass
        self.wires[index] = wire
        self._attend(time.monotonic_ns())

    def _attend(self, now):
        """Send the frames of the safe stop to the drives of buses that are taken over, until the loop asks them."""
        taken = [(bus, successor) for bus, successor in self.successors if bus in self.wires]
        for bus, successor in taken:
            if successor.was_taken():
                self._open_again(bus)
        if self.shared.beat:
            while self.successors:
                self.successors.pop()[1].arming()
        elif now >= self.attend:
            self.attend = now + STOP_ROUND_MAXIMUM
            for bus, successor in taken:
                for device in self.devices:
                    if device["bus"] == bus:
                        for frame in device["zero"] + device["disable"]:
                            self.wires[bus].send(*frame)
                successor.sent()

    def _open_again(self, index):
        """Open the wire of a bus that its earlier process has taken back, as this process was stopped."""
        self.interfaces.close(index)
        try:
            self._open(index, self.buses[index])
        except CannotOpen as error:
            self.wires[index].fail(0, str(error))
            return
        if self.buses[index]["line"] is not None:
            self.interfaces.listen(index)

    def run(self) -> None:
        """Watch the loop and carry frames until the run is over, then report and close the wires."""
        checked = time.monotonic_ns()
        grace = 0
        while not self._is_over():
            self._handle_events(self._poll_timeout(time.monotonic_ns()))
            now = time.monotonic_ns()
            self.shared.look_after(now)
            if now - checked > self.limit // 2:
                grace = now + GUARDIAN_LOOK_PERIOD  # this process was delayed, perhaps with the whole machine
            checked = now
            # reported in the shared state: no grace
            reported = self.shared.hung is not None or time_suspended(self.shared) > 0 or self.caps.excess is not None
            if self.stop is None and (self.dead or now >= grace or reported):
                self.check_loop(now)
            if self.successors:
                self._attend(now)
            self.carry()
            self.messages.flush()
            self.stop_again_if_due(now)
            # one without actuators is over when it begins
            if self.stop is not None and self.verdict is not None and not (self.stop.over and self.reported):
                self.stop.step(now)
                if not self.stop.over and (self.ordered or self.stop.is_due(now)):
                    self._continue(self.stop, now)
                self._report_stop(self.stop, self.verdict, now)
            if self.stuck_at is not None and now >= self.stuck_at:
                self._report_hang()
        self._leave()

    def _is_over(self):
        """Return whether the run, and a safe stop in progress, have ended."""
        if not self._has_ended() or self.in_send:
            return False
        return self.stop is None or self.reported and (self.released or self.stop.over)

    def _has_ended(self):
        """Return whether the run has ended."""
        return self.released or self.gone or (self.cut_off and self.shared.state not in ACTIVE)

    def _poll_timeout(self, now):
        """Return the time-out of the next poll in ms."""
        stop, limit = self.stop, GUARDIAN_LOOK_PERIOD
        if self.in_send:
            return 1
        if stop is None or stop.over:
            return limit // 1_000_000
        if self.reported and (self.ordered or self.gone):  # there is no loop to watch
            limit = GUARDIAN_DEATH // 2 if self.gone else GUARDIAN_LOOK_LIMIT // 2
        return stop.milliseconds(now, limit)

    def _handle_events(self, milliseconds):
        """Wait for an event, and handle it."""
        for descriptor in self.interfaces.wait(milliseconds, self.stop):
            if descriptor == self.bell:
                with suppress(BlockingIOError):
                    os.eventfd_read(self.bell)
            elif descriptor == self.control:
                self.dead = self.gone = True
                self.poll.unregister(self.control)
            elif self.owner_death is not None and descriptor == self.owner_death.fd:
                self.dead = True
                self.poll.unregister(descriptor)
            elif descriptor != ORDERS:
                for line in self.handover.handle(descriptor, self.stop):
                    self.messages.write(f"tickwork guardian: {line}")
            else:
                data = os.read(ORDERS, 1 << 20)
                self.received += data
                self._follow_orders()
                if not data:
                    self.poll.unregister(ORDERS)
                    if maps(self.shared.control, self.shared.fd):
                        self.cut_off = not self.released
                    else:  # it runs another program, under its number
                        self.dead = self.gone = True

    def _follow_orders(self):
        """Carry out the complete lines of orders: a safe stop of the actuators that the loop's own stop has left."""
        *lines, self.received = self.received.split(b"\n")
        for line in lines:
            if line == b"release":
                self.released = True
                continue
            order = json.loads(line)
            now = time.monotonic_ns()
            if self.stop is None or self.stop.over:
                self.begin_stop("unconfirmed", now - self.shared.beat, now, order["devices"], order["lasts"])
            else:
                self.stop.lasts = round(order["lasts"] * 1e9)
            self.ordered = True

    def check_loop(self, now: int) -> None:
        """Check the loop, and begin the safe stop if it has died, hangs, has stalled, is cut off, or was paused.

        now : ns of CLOCK_MONOTONIC
        """
        if self.shared.state not in ACTIVE:
            return
        silent = max(0, now - self.shared.beat)  # a tick may begin while this process waits for a processor
        if self.dead or self.shared.crashed:
            self.begin_stop("died", silent, now)
        elif self.shared.hung is not None:
            self.begin_stop("hung", silent, now)
            self.stuck_at = now + HANG_REPORT_DELAY
        elif suspended := time_suspended(self.shared):
            self.begin_stop("paused" if was_paused(self.shared) else "suspended", suspended, now)
        elif self.cut_off:
            self.begin_stop("cut off", silent, now)
        elif silent > self.limit:
            self.begin_stop("stalled", silent, now)
        elif self.caps.excess is not None:
            self.begin_stop("torque", silent, now)

    def begin_stop(
        self, because: str, silent: int, now: int, only: list[str] | None = None, lasts: float = STOP_ORPHANED
    ) -> None:
        """Raise the fence and begin the safe stop.

        because : "died", "hung", "suspended", "paused", "cut off", "stalled", "torque" above the cap of a subject, or
            "unconfirmed" by the loop's own stop
        silent : ns since the newest tick, or for which the computer was suspended or the loop paused
        now : ns of CLOCK_MONOTONIC
        only : names of the devices to stop; None for all
        lasts : s for which it continues after it was reported
        """
        self.shared.raise_fence()
        self.shared.show_stop(True)
        self.reported = False
        self.verdict = self.verdict or {
            "event": "guardian",
            "because": because,
            "silent": max(silent, HANG_MINIMUM * (because == "hung")) * 1e-9,  # a block may have returned since
            "state": self.shared.state,
            "last_tick": self.shared.statistics()["last_tick"],
        }
        if because == "torque" and self.caps.excess is not None:
            self.verdict.setdefault("excess", in_words(self.caps.excess))
        if self.shared.hung is not None:
            self.verdict["block"] = self._block_name()
        if self.shared.crashed:
            with suppress(ValueError):  # a defective process may have overwritten the number
                self.verdict["signal"] = signal.Signals(self.shared.crashed).name
        for index in self.wires:
            if self.buses[index]["line"] is None:
                self.interfaces.listen(index)
            if self.buses[index]["line"] is not None or index in self.caps.buses():
                self.interfaces.receive(index, None)  # replies to earlier commands confirm nothing
        relays = [Relay(relay, now - silent) for relay in self.relays]
        devices = [device for device in self.devices if only is None or device["name"] in only]
        moving = only is None and self.verdict["last_tick"] >= 0
        self.stop = SafeStop(devices, self.wires, now, moving, relays, self.shared.out, round(lasts * 1e9))
        self.stop.step(now)
        self.in_send = self.shared.sending and not self.dead

    def stop_again_if_due(self, now: int) -> None:
        """Repeat the stop once the loop has left the send that it had begun before the fence: its commands came last.

        now : ns of CLOCK_MONOTONIC
        """
        if self.verdict is None or not self.in_send or (self.shared.sending and not self.dead):
            return
        self.in_send = self.reported = False
        self.shared.show_stop(True)
        self.verdict["again"] = True
        self.stop = SafeStop(self.devices, self.wires, now, moving=False, lasts=round(STOP_ORPHANED * 1e9))
        self.stop.step(now)

    def _continue(self, stop, now):
        """Open lost interfaces again, and offer the buses of a stop that continues after the run to another run."""
        if self.ordered or self._has_ended():
            while self.relays:  # after the damping, the other run may need their lines
                os.close(self.relays.pop()["descriptor"])
            self.handover.attend(now, stop)
        self.interfaces.open_lost(stop, now)

    def _block_name(self):
        """Return the name of the item in which the tick hangs."""
        item = self.shared.hung
        return self.items[item] if item is not None and 0 <= item < len(self.items) else "the tick"

    def carry(self) -> None:
        """Send the frames of the loop; once the fence is raised, only those of the safe stop."""
        lines = self.lines
        if lines is None:
            return
        for index, line in self.carried:
            wire = self.wires[index]
            for identifier, data, _ in lines.take(line):
                if (self.verdict is not None or self.shared.fenced) and (index, identifier, data) not in self.harmless:
                    lines.count_up(line, "withheld")
                elif self.caps.permits(index, identifier, data):
                    wire.send(identifier, data)
                else:
                    lines.count_up(line, "withheld")
                    self.check_loop(time.monotonic_ns())  # before the next frame
            if wire.counts:
                for kind, many in wire.counts.items():
                    lines.count_up(line, kind, many)
                wire.counts.clear()
            if wire.trouble is not None:
                lines.fail(line, wire.trouble[0])

    def _report_stop(self, stop, verdict, now):
        """Report a safe stop on standard error once its time is up, and again when a device has confirmed late."""
        if not stop.is_due(now):
            return
        report = stop.report()
        if self.reported:
            late = [name for name in verdict["unconfirmed"] if name not in report["unconfirmed"]]
            if late:
                seconds = (now - stop.began) * 1e-9
                self.messages.write(
                    f"tickwork guardian: {', '.join(late)} confirmed the stop only after {seconds:.2f} s"
                )
        verdict |= report
        if not self.reported:
            self.reported = True
            self.shared.show_stop(False)
            self.messages.write(_in_words(verdict))
        if stop.over and self.ordered:
            self._answer({"stop": verdict})

    def _report_hang(self):
        """Report a block that the watchdog could not interrupt, so that the operator can end the run."""
        self.stuck_at = None
        if self.shared.state in ("arming", "running") and not self.gone:
            stopped = ", with the motors stopped" * any(map(frames_of_stop, self.devices))
            self.messages.write(f"tickwork guardian: {self._block_name()} still hangs{stopped}; Ctrl-C ends the run")

    def _leave(self):
        if self.verdict is not None and self.gone:
            self.shared.push(RECORD_EVENT, json.dumps(self.verdict).encode())
        self.shared.look_after(0)
        self._answer(
            {
                "stop": self.verdict,
                "troubles": {
                    self.buses[index]["name"]: wire.trouble[1]
                    for index, wire in self.wires.items()
                    if wire.trouble is not None
                },
            }
        )
        self.handover.close()
        self.interfaces.close_all()
        if self.groups is not None:
            control_group.leave(*self.groups)

    def _answer(self, message):
        """Send a line of JSON to the control process, if it still reads."""
        with suppress(BrokenPipeError):
            os.write(self.answers, json.dumps(message).encode() + b"\n")


def _in_words(verdict):
    """Return a verdict as one line of text."""
    tick = f"tick {verdict['last_tick']}" if verdict["last_tick"] >= 0 else "arming"
    why = {
        "died": f"the control process died{_cause(verdict)} after {tick}",
        "hung": f"{verdict.get('block')} hangs: no return {verdict['silent'] * 1e3:.0f} ms after {tick}",
        "suspended": f"the computer was suspended for {verdict['silent']:.1f} s after {tick}",
        "paused": f"every process of the run was paused for {verdict['silent']:.1f} s after {tick}",
        "cut off": f"the control process has closed its connection to the guardian after {tick}",
        "stalled": f"the loop has stalled for {verdict['silent'] * 1e3:.0f} ms after {tick}",
        "torque": f"{verdict.get('excess')}, after {tick}",
        "unconfirmed": f"the stop after {tick} was not confirmed by every actuator",
    }[verdict["because"]]
    done = [f"confirmed by {', '.join(verdict['confirmed'])} after {verdict['took'] * 1e3:.0f} ms"] * bool(
        verdict["confirmed"]
    )
    done += [f"NOT confirmed by {', '.join(verdict['unconfirmed'])}"] * bool(verdict["unconfirmed"])
    can_end = "; Ctrl-C ends them" if verdict["because"] == "unconfirmed" and sys.stderr.isatty() else ""
    done += [f"its frames continue at a falling rate{can_end}"] * bool(verdict["unconfirmed"])
    if verdict.get("again"):
        why += "; a send that had begun before followed, and the stop is repeated"
    return f"tickwork guardian: {why}; zero torque, then disable: {'; '.join(done) or 'no actuator to stop'}"


def _cause(verdict):
    """Return ' of SIGSEGV in left/law', if the process reported its signal, else ''."""
    return f" of {verdict['signal']} in {verdict.get('block', 'the tick')}" if "signal" in verdict else ""


def _obtain_privileges(priority):
    """Request privileges that protect the guardian from other processes. Returns a list of those granted.

    priority : SCHED_FIFO priority, None for an ordinary process
    """
    granted = []
    realtime.set_timer_slack(1)
    gc.collect()
    gc.freeze()
    with suppress(OSError):
        with open("/proc/self/oom_score_adj", "w") as file:
            file.write("-1000")
        granted.append("last to be killed for memory")
    if capable(CAP_IPC_LOCK) or resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY:
        with suppress(OSError):
            realtime.lock_memory()
            granted.append(MEMORY_LOCKED)
    if priority is not None:
        with suppress(OSError):
            for thread in threading.enumerate():  # including those that receive from an interface
                if thread.native_id is not None:
                    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
                    os.sched_setscheduler(thread.native_id, policy, os.sched_param(priority))
            granted.append(f"{REALTIME} {priority}")
    return granted

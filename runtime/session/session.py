"""A run in stages: prepare (runtime.session.prepare), arm, run, finish.

    result = Session(prepare(request)).carry_out()

A Session owns everything that a run takes: the shared state, the guardian of a rig, the recorder process, real-time
priority and the executor. If `arm` fails, it releases everything that it has acquired; `finish` always follows `run`.
"""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from cext.memory.shared_state import RECORD_EVENT, SharedState
from cext.safety.terminal_keys import KeyReader
from cext.safety.thresholds import GUARDIAN_LOOK_LIMIT, STOP_LIMIT, STOP_UNATTENDED
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from runtime.host.ending import ENDING_SIGNALS, raise_if_interrupted
from runtime.host.live.table import describe
from runtime.host.machine.realtime import PRIORITY, Realtime
from runtime.host.machine.sleep import SleepInhibitor
from runtime.host.system import processor_wait
from runtime.record.recorder import RecorderProcess, can_ask
from runtime.record.report.fault import explain
from runtime.record.report.preflight.table import Preflight
from runtime.session.rearming import Rearming
from runtime.session.recording_plan import needs_process, plan, ring_bytes
from runtime.session.result import Result

if TYPE_CHECKING:
    from types import FrameType
    from typing import TypeAlias

    from cext.schedule.outcome import Outcome
    from runtime.record.recorder.local import LocalRecorder
    from runtime.record.recorder.plan_types import Plan
    from runtime.robot.rig.buses import RigBuses
    from runtime.session.prepare import Prepared

    Handler: TypeAlias = Callable[[int, FrameType | None], Any] | int | None  # as returned by signal.getsignal

EVENT_TIMEOUT = 5.0  # s, for the recorder to make room for an event
POLL_PERIOD = 0.001  # s
FOREVER = 1e9  # s


class Session:
    """One run.

    prepared : Prepared
    say : function that shows lines to the operator before the run
    count_from : first tick in which missing replies are counted
    """

    def __init__(
        self, prepared: Prepared, say: Callable[[list[str]], object] = lambda lines: None, count_from: int = 0
    ) -> None:
        self.prepared, self.request, self.rig = prepared, prepared.request, prepared.rig
        self.say, self.count_from = say, count_from

    def carry_out(self) -> Result:
        """Arm, run and finish. Returns a Result; raises as `arm` does."""
        self.arm()
        return self.run()

    def arm(self) -> None:
        """Take everything that the run needs; no frame is sent yet.

        Raises RigError, RecorderError or RealtimeRefused, and then gives everything back.
        """
        request, rig = self.request, self.rig
        with ExitStack() as undo:
            self.shared = SharedState(ring_bytes(self.prepared.schedule), live=describe(self.prepared.schedule))
            if rig is not None:  # the guardian comes first: without it nothing is armed
                undo.callback(rig.close)
                self.inhibitor = SleepInhibitor(f"{self.prepared.diagram.name} drives motors")
                undo.callback(self.inhibitor.release)
                priority = None if request.realtime == "off" else request.priority or PRIORITY
                rig.watch(self.shared, self.prepared.schedule, self.prepared.diagram, priority)
            # before the priority, memory lock and processor of the loop
            self.recorder = self.recorder_of()
            undo.callback(self.recorder.abandon)
            self.realtime = Realtime(request.realtime or "off", request.priority or PRIORITY, request.cpu)
            undo.callback(self.realtime.release)
            self.realtime.obtain()
            aside = self.keep_others_aside()
            self.say(self.remarks())
            recording = self.plan()
            self.recorder.configure(recording)
            self.keys = self.key_reader(aside) if recording["keys"] else None
            if self.keys is not None:
                undo.callback(self.keys.stop)
            self.control = Program(self.prepared.schedule, self.prepared.ends())
            self.control.count_from(self.count_from)
            self.executor = self.loop(aside)
            self.rearming = Rearming(self.prepared, self.shared, self.control, self.executor, can_ask())
            self.realtime.prefault()
            undo.pop_all()

    def recorder_of(self) -> RecorderProcess | LocalRecorder:
        """Return the recorder of the run: a process, or a LocalRecorder where nothing is recorded."""
        if needs_process(self.prepared):
            return RecorderProcess(self.shared)
        from runtime.record.recorder.local import LocalRecorder

        return LocalRecorder(self.shared)

    def key_reader(self, aside: Collection[int]) -> KeyReader | None:
        """Start to read the keys of the terminal. aside : numbers of the processors for other threads"""
        terminal = getattr(self.recorder, "terminal", None)
        return None if terminal is None else KeyReader(self.shared, terminal, aside)

    def plan(self) -> Plan:
        """Return the plan of the recorder."""
        return plan(self.prepared, self.realtime)

    def keep_others_aside(self) -> Collection[int]:
        """Move the other processes of the run off the loop's processor.

        Returns the numbers of the processors left to them.
        """
        aside = self.realtime.others if self.realtime.processor is not None else ()
        if self.realtime.others and not self.request.fast:
            self.recorder.keep_to(self.realtime.others)
        if aside and self.rig is not None and self.rig.guardian is not None:
            self.rig.guardian.bring_to(aside)
        return aside

    def remarks(self) -> list[str]:
        """Return lines for the operator before the run."""
        if self.rig is None:
            return self.realtime.lines()
        return [*self.rig.remarks(), *self.realtime.lines(), *self.realtime.risk(), *self.inhibitor.remarks()]

    def loop(self, aside: Collection[int]) -> Executor:
        """Return the Executor. aside : numbers of the processors for other threads"""
        request, rig = self.request, self.rig
        return Executor(
            self.control,
            self.prepared.schedule.rate,
            plant=self.prepared.plant,
            substeps=self.prepared.substeps,
            shared=self.shared,
            virtual=request.fast,
            reader=self.recorder.lifeline,
            drain=getattr(self.recorder, "drain", None),
            replay=None if self.prepared.feed is None else self.prepared.feed.clock,
            overrun=request.overrun,
            spin=request.spin,
            profile=request.profile,
            guard=rig.guardian_silence if rig is not None else 0.0,
            carried=rig is not None and rig.carries,
            others=aside,
            waits=rig is None and self.prepared.plant is not None,
        )

    def run(self) -> Result:
        """Run until the end, whatever ends it, and finish. Returns a Result."""
        outcome, began = None, time.monotonic()
        self.waited = processor_wait()
        handler = one_interrupt(self.shared)
        try:
            raise_if_interrupted()
            outcome = self.executor.run(self.prepared.ticks, **self.confirmation(), **self.rearming.options())
        finally:
            with undisturbed(handler, lasting=outcome is not None and outcome.signal != 0):
                result = self.finish(outcome, time.monotonic() - began)
        assert result is not None  # without an outcome the executor has raised
        return result

    def confirmation(self) -> dict[str, Any]:
        """Return options of Executor.run: on a rig the operator reads the pre-flight table and confirms it."""
        rig, shared, control = self.rig, self.shared, self.control
        if rig is None or rig.guardian is None:
            return {}
        poses = self.prepared.poses
        interfaces = {name: (bus.interface.bus.interface, bus.interface.bus.channel) for name, bus in rig.buses.items()}
        table = Preflight(
            self.prepared.diagram,
            self.prepared.schedule,
            interfaces,
            self.request.arm_on or not self.request.yes,
            list(rig.guardian.granted),
            poses,
        )

        def show() -> None:
            event = table.event(control.values, control.reports.found_enabled)
            event |= {"question": shared.question} if table.confirm else {}
            shared.push(RECORD_EVENT, json.dumps(event).encode())

        def permitted() -> bool:
            """Return whether the reading of every joint is confirmed.

            If one is not, the table is printed again.
            """
            enabling = control.reports.enabling
            unheard = () if enabling else table.unheard
            if poses is None or not poses.look(control.values, first=shared.state != "waiting", unheard=unheard):
                if shared.state != "waiting" and not enabling:  # the replay enables the drives in the same round
                    shared.push(
                        RECORD_EVENT, json.dumps({"event": "confirmed", "drains": self.executor.arming_rounds}).encode()
                    )
                return True
            if shared.state == "ready":
                show()
            return False

        options = {
            "answered": show,
            "confirm": table.confirm,
            "permitted": permitted,
            "arm_slot": self.prepared.arm_slot,
        }
        return (
            options if poses is None else options | {"may_return": lambda path: poses.may_return(path, control.values)}
        )

    def finish(self, outcome: Outcome | None, seconds: float) -> Result | None:
        """Give everything back and complete the recording.

        outcome : outcome of the executor; None where it raised
        seconds : wall-clock time from arming to the end of the safe stop, s

        Returns a Result, or None without an outcome.
        """
        if self.keys is not None:
            self.keys.stop()
        if self.rig is not None and outcome is not None:
            outcome = stopped_from_here(outcome, self.rig, self.shared, self.request.stop_for)
            outcome = stopped_late(outcome, self.rig, self.shared, self.request.stop_for)
        self.realtime.release()
        if self.realtime.spun:
            self.record({"event": "realtime", "lost": "the priority", "because": self.realtime.summary()})
        statistics = self.shared.statistics()
        if self.rig is not None:
            self.record({"event": "buses", **self.rig.finish()})
            assert self.rig.report is not None
            if self.rig.report["stop"] is not None:
                self.record(self.rig.report["stop"])
            statistics["frames"] = self.rig.correct(statistics["frames"])
            self.inhibitor.release()
        result = None if outcome is None else self.result(outcome, statistics, seconds)
        if result is not None:
            self.record(result.end_event())
        self.shared.close()
        report = self.recorder.finish()
        if result is not None:
            result.recording.update(report)
        return result

    def result(self, outcome: Outcome, statistics: dict[str, Any], seconds: float) -> Result:
        """Return the Result, without the recorder's report. Arguments as for `finish`."""
        result = Result(
            **vars(self.prepared),
            outcome=outcome,
            statistics=statistics,
            recording={},
            seconds=seconds,
            control=self.control,
            realtime=self.realtime,
            overruns=self.executor.overruns,
            stalled=self.executor.stalled,
            profile=self.executor.profile,
            shared=self.shared,
            newest=self.executor.newest,
            waited=processor_wait() - self.waited,
        )
        if outcome.faulted and self.prepared.feed is None:
            result.report += self.rearming.report_of(outcome) or explain(result)
        return result

    def record(self, event: Mapping[str, Any]) -> None:
        """Put an event into the ring, which the recorder may still be emptying. Waits up to EVENT_TIMEOUT for room."""
        payload, deadline = json.dumps(event).encode(), time.monotonic() + EVENT_TIMEOUT
        while not self.shared.push(RECORD_EVENT, payload) and time.monotonic() < deadline:
            if not self.recorder.make_room(POLL_PERIOD):
                break


def stopped_from_here(outcome: Outcome, rig: RigBuses, shared: SharedState, seconds: float | None) -> Outcome:
    """Stop the actuators from this process if the guardian that carries their frames no longer answers.

    seconds : as in `stopped_late`

    Returns the Outcome.
    """
    if outcome.status != "unguarded" and not (outcome.unconfirmed and rig.carries and not guardian_looks(shared)):
        return outcome
    if outcome.status in ("silent", "no answer", "bus error"):  # the drives are silent because the guardian is
        outcome = replace(outcome, status="unguarded", culprit=None)
    return taken_over(outcome, rig, seconds)


def taken_over(outcome: Outcome, rig: RigBuses, seconds: float | None) -> Outcome:
    """Stop the actuators from this process. Returns the Outcome. seconds : as in `stopped_late`"""
    with caught_signals() as caught:
        report = rig.take_over(time_to_stop(seconds), lambda: bool(caught))
    late = [(name, after) for name, after in report["after"].items() if after > report["due"]]
    return replace(outcome, unconfirmed=tuple(report["unconfirmed"]), late=tuple(late))


def time_to_stop(seconds: float | None) -> float:
    """Return the time in s for which a stop continues. seconds : as in `stopped_late`"""
    return seconds or (FOREVER if can_ask() else STOP_UNATTENDED)


def stopped_late(outcome: Outcome, rig: RigBuses, shared: SharedState, seconds: float | None) -> Outcome:
    """Let the guardian continue the stop of actuators that have not confirmed it, or continue it here if that dies.

    seconds : time for which it continues; None for the default: until the operator sends a signal, such as Ctrl-C,
        and for STOP_UNATTENDED without a terminal

    Returns the Outcome.
    """
    if not outcome.unconfirmed or rig.report is not None or rig.guardian is None:
        return outcome
    with caught_signals() as caught:
        rig.leave_sensors()
        report = rig.guardian.go_on(outcome.unconfirmed, time_to_stop(seconds), lambda: bool(caught))
    if report is None and not caught and not guardian_looks(shared):
        return taken_over(outcome, rig, seconds)
    if report is None:
        return outcome
    late = {name: report["after"][name] + STOP_LIMIT * 1e-9 for name in report["confirmed"]}
    return replace(outcome, unconfirmed=tuple(report["unconfirmed"]), late=tuple(late.items()))


@contextmanager
def caught_signals() -> Iterator[list[int]]:
    """Collect the numbers of the ending signals in a list."""
    caught: list[int] = []
    before = {number: signal.signal(number, lambda number, frame: caught.append(number)) for number in ENDING_SIGNALS}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def guardian_looks(shared: SharedState) -> bool:
    """Return whether the guardian reads the shared state within GUARDIAN_LOOK_LIMIT (ns)."""
    if shared.guardian_died:
        return False
    before, deadline = shared.guarded, time.monotonic() + GUARDIAN_LOOK_LIMIT * 1e-9
    while shared.guarded == before and time.monotonic() < deadline:
        time.sleep(POLL_PERIOD)
    return shared.guarded != before


def one_interrupt(shared: SharedState) -> Handler:
    """Ignore Ctrl-C once the motors are being stopped: a second one finds Python's handler.

    Returns the handler before.
    """

    before = signal.getsignal(signal.SIGINT)

    def interrupt(number: int, frame: FrameType | None) -> None:
        if shared.state not in ("stopping", "safe"):
            (before if callable(before) else signal.default_int_handler)(number, frame)

    return signal.signal(signal.SIGINT, interrupt)


@contextmanager
def undisturbed(before: Handler, lasting: bool) -> Iterator[None]:
    """Ignore the ending signals: a second one interrupts neither the stop of the motors nor the end of a recording.

    before : the handler of SIGINT that is restored afterwards
    lasting : whether they stay ignored, because one of them has ended the run: the summary is still to be printed
    """
    handlers = {number: signal.signal(number, signal.SIG_IGN) for number in ENDING_SIGNALS} | {signal.SIGINT: before}
    try:
        yield
    finally:
        for number, handler in () if lasting else handlers.items():
            signal.signal(number, handler)

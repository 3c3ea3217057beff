"""Second stage of a run: armed, it has everything that it takes, and runs until its end."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from cext.memory.shared_state import RECORD_EVENT, SharedState
from cext.safety.thresholds import GUARDIAN_LOOK_LIMIT, PAGE_SILENCE, STOP_LIMIT, STOP_UNATTENDED
from runtime.host.ending import ENDING_SIGNALS, raise_if_interrupted
from runtime.host.system import processor_wait
from runtime.record.recorder import can_ask
from runtime.record.report.fault import explain
from runtime.record.report.preflight.table import Preflight
from runtime.session.rearming import Rearming
from runtime.session.result import Result

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType
    from typing import TypeAlias

    from cext.safety.terminal_keys import KeyReader
    from cext.schedule.executor import Executor
    from cext.schedule.outcome import Outcome
    from cext.schedule.program import Program
    from runtime.host.machine.realtime import Realtime
    from runtime.host.machine.sleep import SleepInhibitor
    from runtime.record.recorder import RecorderProcess
    from runtime.record.recorder.local import LocalRecorder
    from runtime.robot.rig.buses import RigBuses
    from runtime.session.prepare import Prepared

    Handler: TypeAlias = Callable[[int, FrameType | None], Any] | int | None  # as returned by signal.getsignal

EVENT_TIMEOUT = 5.0  # s, for the recorder to make room for an event
POLL_PERIOD = 0.001  # s
FOREVER = 1e9  # s


@dataclass
class Armed:
    """A run that owns everything that it takes. `run` gives all of it back.

    control, executor : program of the robot and its executor
    inhibitor : of a rig, else None
    keys : reader of the keys of the terminal, or None
    """

    prepared: Prepared
    shared: SharedState
    recorder: RecorderProcess | LocalRecorder
    realtime: Realtime
    control: Program
    executor: Executor
    rearming: Rearming
    inhibitor: SleepInhibitor | None
    keys: KeyReader | None

    def run(self) -> Result:
        """Run until the end, whatever ends it, and finish. Returns a Result."""
        outcome, began, waited = None, time.monotonic(), processor_wait()
        handler = one_interrupt(self.shared)
        try:
            raise_if_interrupted()
            outcome = self.executor.run(self.prepared.ticks, **self.confirmation(), **self.rearming.options())
        finally:
            with ignore_ending_signals(handler, lasting=outcome is not None and outcome.signal != 0):
                result = self.finish(outcome, time.monotonic() - began, waited)
        assert result is not None  # without an outcome the executor has raised
        return result

    def confirmation(self) -> dict[str, Any]:
        """Return options of Executor.run: on a rig the operator reads the pre-flight table and confirms it."""
        prepared, shared, control = self.prepared, self.shared, self.control
        rig = prepared.rig
        if rig is None or rig.guardian is None:
            return {}
        poses = prepared.poses
        interfaces = {name: (bus.interface.bus.interface, bus.interface.bus.channel) for name, bus in rig.buses.items()}
        table = Preflight(
            prepared.diagram,
            prepared.schedule,
            interfaces,
            prepared.request.arm_on or not prepared.request.yes,
            list(rig.guardian.granted),
            poses,
            ()
            if prepared.subject is None
            else [*prepared.subject.lines(prepared.diagram), *(prepared.compared.lines if prepared.compared else ())],
        )

        def show() -> None:
            event = table.event(control.values, control.reports.found_enabled, shared.page_linked(PAGE_SILENCE))
            event |= {"question": shared.question} if table.confirm else {}
            shared.push(RECORD_EVENT, json.dumps(event).encode())

        def ask_permission() -> bool:
            """Return whether the reading of every joint is confirmed, and a page that the diagram demands is linked.

            If not, the table is printed again.
            """
            enabling = control.reports.enabling
            unheard = () if enabling else table.unheard
            pageless = table.page and table.confirm and shared.state == "ready" and not shared.page_linked(PAGE_SILENCE)
            if not pageless and (
                poses is None or not poses.look(control.values, first=shared.state != "waiting", unheard=unheard)
            ):
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
            "permitted": ask_permission,
            "arm_slot": prepared.arm_slot,
        }
        return (
            options if poses is None else options | {"may_return": lambda path: poses.may_return(path, control.values)}
        )

    def finish(self, outcome: Outcome | None, seconds: float, waited: float) -> Result | None:
        """Give everything back and complete the recording.

        outcome : outcome of the executor; None where it raised
        seconds : wall-clock time from arming to the end of the safe stop, s
        waited : s for which the thread had waited for a processor before

        Returns a Result, or None without an outcome.
        """
        rig, seconds_to_stop = self.prepared.rig, self.prepared.request.stop_for
        if self.keys is not None:
            self.keys.stop()
        if rig is not None and outcome is not None:
            outcome = stopped_from_here(outcome, rig, self.shared, seconds_to_stop)
            outcome = stopped_late(outcome, rig, self.shared, seconds_to_stop)
        self.realtime.release()
        if self.realtime.spun:
            self.record({"event": "realtime", "lost": "the priority", "because": self.realtime.summary()})
        statistics = self.shared.statistics()
        if rig is not None:
            self.record({"event": "buses", **rig.finish()})
            assert rig.report is not None
            if rig.report["stop"] is not None:
                self.record(rig.report["stop"])
            statistics["frames"] = rig.correct(statistics["frames"])
        if self.inhibitor is not None:
            self.inhibitor.release()
        result = None if outcome is None else self.result(outcome, statistics, seconds, processor_wait() - waited)
        if result is not None:
            self.record(result.end_event())
        self.shared.close()
        report = self.recorder.finish()
        if result is not None:
            result.recording.update(report)
        return result

    def result(self, outcome: Outcome, statistics: dict[str, Any], seconds: float, waited: float) -> Result:
        """Return the Result, without the recorder's report. Arguments as of Result."""
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
            waited=waited,
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
    """Collect the numbers of the ending signals in a list, also of those that this thread inherited blocked."""
    caught: list[int] = []
    before = {number: signal.signal(number, lambda number, frame: caught.append(number)) for number in ENDING_SIGNALS}
    mask = signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING_SIGNALS)
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


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
def ignore_ending_signals(before: Handler, lasting: bool) -> Iterator[None]:
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

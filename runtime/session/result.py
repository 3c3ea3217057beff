"""The end of a run as data."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from cext.memory.shared_state import SharedState
from cext.schedule.outcome import Outcome
from cext.schedule.program import Program
from runtime.host.machine.realtime import Realtime
from runtime.record.report.held_exceptions import held_exceptions
from runtime.session.prepare import Prepared


@dataclass
class Result(Prepared):
    """A run that has ended.

    outcome : cext.schedule.executor.Outcome
    statistics : statistics of the shared state
    recording : the recorder's report
    seconds : wall-clock time from arming to the end of the safe stop, s; None in virtual time
    control : the robot's Program at the end of the run
    realtime : privileges that the system has granted; None in virtual time without processes
    overruns, profile, newest : attributes of cext.schedule.executor.Executor
    shared : the shared state with the final counts
    report : lines on the fault that ended the run
    waited : s for which the loop's thread was ready to run and had no processor
    stalled : number of grid points of real time at which simulated time stood still
    """

    outcome: Outcome
    statistics: dict[str, Any]
    recording: dict[str, Any]
    seconds: float | None
    control: Program
    realtime: Realtime | None
    overruns: list[dict[str, Any]]
    profile: tuple[list[dict[str, Any]], list[dict[str, Any]]]
    shared: SharedState | None
    newest: list[tuple]
    report: list[str] = field(default_factory=list)
    waited: float = 0.0
    stalled: int = 0

    @cached_property
    def held(self) -> list[dict[str, Any]]:
        """The exceptions that blocks have held: runtime.record.report.held_exceptions.held_exceptions."""
        return held_exceptions(self.request.file, self.control, self.plant)

    @property
    def failed_in_plant(self) -> bool:
        """Whether the fault came from a block of the plant."""
        outcome = self.outcome
        simulated = self.simulation is not None and outcome.faulted and outcome.status != "overrun"
        return simulated and self.control.culprit is None and outcome.culprit is not None

    @property
    def session_over(self) -> str | None:
        """What ended a run whose subject file allows no more time, as text; None for another end."""
        outcome, subject = self.outcome, self.subject
        if subject is None or self.ramp.get("ends_at") != self.ticks or outcome.faulted:
            return None
        if outcome.signal or outcome.stopped:
            return None
        return f"the session ended after {self.ticks / self.schedule.rate:g} s: {subject.name} allows no more"

    @property
    def implausible(self) -> str | None:
        """First limit of the simulated wearer that the run exceeded, as text; None without one."""
        return None if self.simulation is None else self.simulation.implausible()

    def end_event(self) -> dict[str, Any]:
        """Return the last event of a recording."""
        outcome = self.outcome
        return {
            "event": "end",
            "status": outcome.status,
            "culprit": outcome.culprit,
            "tick": outcome.tick,
            "signal": outcome.signal,
            "stopped": outcome.stopped,
            "session_over": self.session_over,
            "unconfirmed": list(outcome.unconfirmed),
            "confirmed_late": dict(outcome.late),
            "overruns": self.overruns,
            "late": self.control.late,
            "answers": self.control.reports.latencies,
            "held": self.held,
            "implausible": self.implausible,
            "report": self.report,
            "faults": [[fault.status, fault.culprit, fault.tick] for fault in outcome.faults],
        }

"""Attributes of an ended run that reports read: runtime.session.result.Result, or the state in a fault."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from cext.schedule.outcome import Outcome
    from cext.schedule.program import Program
    from graph import Diagram, Schedule
    from runtime.robot.rig.poses import Poses


class RunResult(Protocol):
    """A run that has ended, with the attributes of runtime.session.result.Result that the reports read."""

    request: Any  # runtime.session.request.Request
    diagram: Diagram
    schedule: Schedule
    simulation: Any  # runtime.robot.loading.simulation.Simulation; None on a rig
    rig: Any  # runtime.robot.rig.RigBuses; None in simulation
    ticks: int
    poses: Poses | None
    outcome: Outcome
    statistics: dict[str, Any]
    recording: dict[str, Any]
    seconds: Any  # s of the wall clock; None in virtual time without processes
    control: Program
    realtime: Any  # runtime.host.machine.realtime.Realtime; None in virtual time without processes
    overruns: list[dict[str, Any]]
    stalled: int
    profile: tuple[list[dict[str, Any]], list[dict[str, Any]]]
    newest: list[tuple]
    waited: float
    shared: Any  # cext.memory.shared_state.SharedState; None in virtual time without processes
    held: Any  # as returned by runtime.record.report.held_exceptions.held_exceptions

    @property
    def implausible(self) -> str | None:
        """First limit of the simulated wearer that the run exceeded, as text; None without one."""
        ...

    @property
    def failed_in_plant(self) -> bool:
        """Whether the fault came from a block of the plant."""
        ...

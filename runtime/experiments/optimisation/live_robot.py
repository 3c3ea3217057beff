"""Live parameters of a run by the names of an optimisation, and the robot of a run in another process."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from cext.schedule.mailbox_writer import CHANGE_LIMIT
from runtime.experiments.optimisation.parameters import Parameter
from runtime.experiments.optimisation.protocol import Refused, Robot
from runtime.host.errors import BadInput
from runtime.host.live import table
from runtime.host.live.requests import changes_of, parameters_of
from runtime.host.live.sending import send

if TYPE_CHECKING:
    from cext.memory.shared_state import SharedState
    from runtime.host.live.table import Parameter as LiveParameter
    from runtime.host.live.table import Table

SHOW_TIMEOUT = 0.5  # s for the shared state to have the values of a change that was applied
POLL_PERIOD = 0.002  # s


class Targets:
    """Live parameters that an optimisation sets.

    live : {name of a parameter of the optimisation: its live parameters}
    parameters : {index of a live parameter: the Parameter that varies it}
    zero : [(live parameter, value)] that switch the assistance off, [] if it cannot be switched off
    """

    def __init__(self, run_table: Table, parameters: Iterable[Parameter], zero: Iterable[tuple[str, str]] = ()) -> None:
        found = [(parameter, matching(run_table, parameter)) for parameter in parameters]
        self.live = {parameter.name: group for parameter, group in found}
        self.parameters = {live.index: parameter for parameter, group in found for live in group}
        self.zero = [change for name, text in zero for change in changes_of(run_table, name, text)]
        varied = [live.path for group in self.live.values() for live in group]
        for path in varied:
            if varied.count(path) > 1:
                raise BadInput(f"--over: two names match {path}: remove one")
        count = len({*varied, *(live.path for live, _ in self.zero)})
        if count > CHANGE_LIMIT:
            raise BadInput(
                f"--over and --zero change {count} live parameters: at most {CHANGE_LIMIT} can change in one tick"
            )
        self._check_rules(run_table)
        self.normal: dict[int, tuple[LiveParameter, float]] = {}  # {index: value before the assistance was off}

    def _check_rules(self, run_table):
        """Raise BadInput if the bounds of the optimisation contain values that break a rule of the run."""
        zero = {live.index: value for live, value in self.zero}
        for entry in run_table.rules:
            small, large = entry.rule.ascending
            slopes = dict.fromkeys(entry.rule.keys, 0.0)
            for sign, side in ((1.0, small), (-1.0, large)):
                for index, factor in side.terms:
                    slopes[index] += sign * factor
            worst = {
                index: bounds.high if slopes[index] > 0.0 else bounds.low
                for index, bounds in self.parameters.items()
                if index in slopes
            }
            off = worst | {index: value for index, value in zero.items() if index in slopes}
            for corner in (worst, off):
                if broken := run_table.broken(None, corner):
                    raise BadInput(
                        f"--over allows values that break a rule: {broken[0]}. Choose bounds within which it holds"
                    )

    def changes(
        self,
        values: Mapping[str, float],
        zero: bool,
        present_of: Callable[[LiveParameter], float],
        target_of: Callable[[LiveParameter], float] | None = None,
    ) -> tuple[list[tuple[LiveParameter, float]], bool]:
        """Return the changes towards values of the optimisation, none larger than the largest step.

        zero : whether the assistance is off
        present_of : function that returns the present value of a live parameter
        target_of : function that returns its target; None without ramps

        Returns [(live parameter, value)], and whether these are all the requested values.
        """
        target_of = target_of or present_of
        varied = {live.index: (live, values[name]) for name, group in self.live.items() for live in group}
        off = {live.index: (live, value) for live, value in self.zero}
        if zero and not self.normal:
            self.normal = {index: (live, target_of(live)) for index, (live, _) in off.items()}
        requested = list(({**varied, **off} if zero else {**self.normal, **varied}).values())
        changes = [(live, self._limit_step(live, value, present_of(live))) for live, value in requested]
        return changes, changes == requested

    def _limit_step(self, live, value, present):
        parameter = self.parameters.get(live.index)
        return value if parameter is None else parameter.towards(present, value)

    def value_text(self, name: str, value: float) -> str:
        """Return a value with four digits and its unit."""
        return self.live[name][0].value_text(float(f"{value:.4g}"))


def matching(run_table: Table, parameter: Parameter) -> list[LiveParameter]:
    """Return the live parameters that a parameter of an optimisation sets.

    `profile.peak` is that parameter, or else `*/profile.peak` of every leg. Raises BadInput if there is none, if they
    are not floats, or if their bounds do not contain those of the optimisation.
    """
    name = parameter.name
    found = parameters_of(run_table, name, f"--over {name}", otherwise=f"*/{name}")
    for live in found:
        if live.dtype != "float":
            raise BadInput(
                f"--over {name}: {live.path} is of type {live.dtype}; only numbers of type float are optimised"
            )
        if not (live.low <= parameter.low and parameter.high <= live.high):
            raise BadInput(
                f"--over {name}={parameter.low:g}:{parameter.high:g}: the live range of {live.path}, for which the "
                f"commands are proved, is {live.bounds}. Choose bounds within it, or change Live(...) in the diagram"
            )
    return found


def with_initial(parameters: Iterable[Parameter], run_table: Table) -> list[Parameter]:
    """Return parameters with initial values: by default that of the diagram, where all legs have one within bounds."""
    result = []
    for parameter in parameters:
        built = {live.built for live in matching(run_table, parameter)}
        if parameter.initial is None and len(built) == 1 and parameter.low <= min(built) <= parameter.high:
            parameter = replace(parameter, initial=min(built))
        result.append(parameter)
    return result


class LiveRobot(Robot):
    """Run of another process.

    shared : its shared state
    targets : Targets
    announce : function that is called before each change
    """

    def __init__(self, shared: SharedState, targets: Targets, announce: Callable[[], None] = lambda: None) -> None:
        self.shared, self.targets = shared, targets
        self.table, self.announce = table.read(shared), announce
        self.applied: dict[int, float] = {}  # {index: value}

    @property
    def running(self) -> bool:
        """Whether the loop runs, armed and without a fault."""
        return self.shared.state == "running" and not self.shared.closed

    @property
    def tick(self) -> int:
        """Newest tick."""
        return self.shared.statistics()["last_tick"]

    def apply(self, values: Mapping[str, float], zero: bool) -> bool:
        self.announce()
        before = self._values()
        changes, complete = self._changes(values, zero, before)
        differing = [(live, value) for live, value in changes if before[live.index][1] != value]
        if differing:
            try:
                send(self.shared, self.table, self.shared.control, differing)
            except BadInput as error:
                raise Refused(str(error)) from None
        self.applied = {live.index: value for live, value in changes}
        until = time.monotonic() + SHOW_TIMEOUT
        while self.interference() and time.monotonic() < until:  # its tick may not have ended
            time.sleep(POLL_PERIOD)
        return complete

    def fallback(self, values: Mapping[str, float]) -> tuple[list[tuple[int, float]], bool]:
        """Return [(index of a live parameter, value)] towards values of the optimisation, and whether it is these."""
        changes, complete = self._changes(values, False, self._values())
        return [(live.index, value) for live, value in changes], complete

    def has_arrived(self) -> bool:
        values = self._values()
        return all(values[index][0] == value for index, value in self.applied.items())

    def interference(self) -> str | None:
        values = self._values()
        changed = (index for index, value in self.applied.items() if values[index][1] != value)
        return next((self.table.parameters[index].path for index in changed), None)

    def value_text(self, name: str, value: float) -> str:
        return self.targets.value_text(name, value)

    def _changes(self, values, zero, before):
        return self.targets.changes(
            values, zero, lambda live: before[live.index][0], lambda live: before[live.index][1]
        )

    def _values(self):
        return table.values(self.shared, self.table.parameters)

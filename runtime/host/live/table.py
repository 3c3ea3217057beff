"""Table of live parameters in a run's shared state, for `set` and for the keys, which have no diagram."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

from msgspec import Struct, to_builtins

from cext.rules import LiveRule, Rule, Side

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from cext.memory.shared_state import SharedState
    from graph.schedule import Schedule

STEPS = 20  # approximate number of key steps from bound to bound
FINE = 10  # fine steps in a step


class Parameter(Struct, frozen=True):
    """Live parameter. dtype is "float", "int" or "bool"; slew in unit per second, math.inf for a step."""

    index: int
    path: str
    dtype: str
    unit: str
    description: str
    built: float
    low: float
    high: float
    slew: float

    def plain(self, value: float) -> float:
        """Return a value in the parameter's type."""
        return {"float": float, "int": int, "bool": bool}[self.dtype](value)

    def setting_text(self, value: float) -> str:
        """Return a value in the syntax of `--set`, exactly: '40.0', '3', 'true'."""
        return repr(self.plain(value)).lower()

    def value_text(self, value: float) -> str:
        """Return a value with its unit for display: '40 N·m/rad'."""
        return f"{self.plain(value)}".lower() if self.dtype == "bool" else f"{value:.6g}" + self.unit_suffix

    @property
    def unit_suffix(self) -> str:
        """Space and unit, "" for a number without a unit."""
        return "" if self.unit in ("1", "any") else f" {self.unit}"

    @property
    def bounds(self) -> str:
        """Range as text: '0 to 150 N·m/rad', or 'false or true'."""
        return "false or true" if self.dtype == "bool" else f"{self.low:g} to {self.high:g}{self.unit_suffix}"

    def next_step(self, value: float, steps: int) -> float:
        """Return the value after a number of fine key steps, on whole steps and within the bounds.

        steps : 1 or -1, or FINE times that for a step of about a twentieth of the range, 1, 2 or 5 times a power of ten
        """
        if self.dtype == "bool":
            return float(steps > 0)
        step = nice((self.high - self.low) / STEPS)
        if abs(steps) < FINE:
            step /= FINE
        if self.dtype == "int":
            step = max(1.0, round(step))
        if not step > 0.0:
            return value
        up = steps > 0
        count = math.floor(value / step + 1e-6) + 1 if up else math.ceil(value / step - 1e-6) - 1
        digits = max(0, 1 - math.floor(math.log10(step)))
        return min(self.high, max(self.low, round(count * step, digits)))


def nice(number: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that does not exceed a number; 0 for 0."""
    if not number > 0.0:
        return 0.0
    power = 10.0 ** math.floor(math.log10(number))
    return power * max(factor for factor in (1, 2, 5) if factor * power <= number * (1 + 1e-9))


def describe(schedule: Schedule) -> tuple[int, bytes]:
    """Return (number of live parameters, their table with the recorded signals as JSON), for SharedState(live=...)."""
    rules = [{"path": entry.path, **to_builtins(entry.rule)} for entry in schedule.live_rules]
    parameters = [
        {
            "path": live.path,
            "dtype": live.dtype,
            "unit": live.unit,
            "description": live.description,
            "built": live.built,
            "low": live.low,
            "high": live.high,
            "slew": live.slew if math.isfinite(live.slew) else None,
        }
        for live in schedule.live
    ]
    signals = [(column.path, column.dtype, column.unit) for column in schedule.recorded]
    return len(parameters), json.dumps(
        {"name": schedule.name, "rate": schedule.rate, "parameters": parameters, "signals": signals, "rules": rules}
    ).encode()


class Table(Struct, frozen=True):
    """Table of live parameters.

    name, rate : name and rate in Hz of the diagram
    parameters : live parameters in the order of the mailbox
    signals : (path, dtype, unit) of each recorded signal, in the order of a row
    rules : rules between the parameters
    """

    name: str
    rate: float
    parameters: tuple[Parameter, ...]
    signals: tuple[tuple[str, str, str], ...] = ()
    rules: tuple[LiveRule, ...] = ()

    def broken(self, shared: SharedState | None, changes: Mapping[int, float]) -> list[str]:
        """Return what each rule reports that changes would break, such as "lower must be at most upper (3), got 5".

        shared : state of the run, with whose other targets they are compared; None for a run with the built values
        changes : {index of a parameter: value}
        """
        targets = [each.built for each in self.parameters]
        if shared is not None:
            targets = [target for _, target in values(shared, self.parameters)]

        def after(index: int) -> float:
            return changes.get(index, targets[index])

        return [
            f"{entry.path}: {entry.rule.sentence(after)}"
            for entry in self.rules
            if not changes.keys().isdisjoint(entry.rule.keys) and not entry.rule.holds(after)
        ]


def values(shared: SharedState, parameters: Sequence[Parameter]) -> list[tuple[float, float]]:
    """Return (value in the newest tick, target) of each live parameter."""
    return (
        [(parameter.built, parameter.built) for parameter in parameters]
        if shared.state == "init"
        else shared.live_values()
    )


def read(shared: SharedState) -> Table:
    """Return the Table in a shared state; an empty one if there is none."""
    return parse(shared.live or b'{"name": "", "rate": 1.0, "parameters": []}')


def title(shared: SharedState) -> str:
    """Return the name of the diagram of a run for a list of runs, whatever its process has written there."""
    try:
        return read(shared).name
    except (ValueError, TypeError, LookupError, AttributeError):
        return "its table of parameters is damaged"


def parse(text: bytes) -> Table:
    """Return the Table that `describe` has written as JSON."""
    table: dict[str, Any] = json.loads(text)
    entries: list[dict[str, Any]] = table["parameters"]
    for entry in entries:
        entry["slew"] = math.inf if entry["slew"] is None else entry["slew"]
    return Table(
        table["name"],
        table["rate"],
        tuple(Parameter(index, **entry) for index, entry in enumerate(entries)),
        tuple(tuple(signal) for signal in table.get("signals", ())),
        tuple(LiveRule(entry["path"], rule_of(entry)) for entry in table.get("rules", ())),
    )


def rule_of(entry: dict[str, Any]) -> Rule:
    """Return the Rule in an entry of the table."""

    def side(given: dict[str, Any]) -> Side:
        return Side(given["text"], tuple((key, factor) for key, factor in given["terms"]), given["constant"])

    return Rule(side(entry["left"]), entry["word"], side(entry["right"]), entry["unit"])

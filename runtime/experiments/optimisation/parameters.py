"""Parameters of an optimisation: their bounds, largest steps and initial values, as the option --over gives them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from runtime.host.errors import BadInput

FORM = "expected NAME=LOW:HIGH or NAME=LOW:HIGH:INITIAL, as in --over 'profile.peak=4:12'"


@dataclass(frozen=True)
class Parameter:
    """Parameter that an optimiser varies.

    name : name of a setting, as in --set: "profile.peak", "*/profile.peak"
    low, high : bounds, in the unit of the setting
    largest_step : largest change from one proposal to the next, in the unit of the setting; None for no limit
    initial : value from which the optimiser starts; None is the middle of the bounds

    Raises BadInput.
    """

    name: str
    low: float
    high: float
    largest_step: float | None = None
    initial: float | None = None

    def __post_init__(self) -> None:
        if not (_is_number(self.low) and _is_number(self.high) and self.low < self.high):
            raise BadInput(
                f"parameter {self.name}: bounds {self.low!r} and {self.high!r}: expected a lower and a higher number"
            )
        if self.initial is not None and not (_is_number(self.initial) and self.low <= self.initial <= self.high):
            raise BadInput(
                f"parameter {self.name}: initial value {self.initial!r} is outside its bounds, "
                f"{self.low:g} to {self.high:g}"
            )
        if self.largest_step is not None and not (_is_number(self.largest_step) and self.largest_step > 0.0):
            raise BadInput(f"parameter {self.name}: largest step {self.largest_step!r}: expected a number above 0")

    @property
    def start(self) -> float:
        """Initial value, by default the middle of the bounds."""
        return 0.5 * (self.low + self.high) if self.initial is None else self.initial

    def scaled(self, value: float) -> float:
        """Return a value as a fraction of the bounds: 0 at `low`, 1 at `high`."""
        return (value - self.low) / (self.high - self.low)

    def value(self, fraction: float) -> float:
        """Return the value at a fraction of the bounds. Outside of 0 to 1 it is the nearer bound."""
        return min(max(self.low + float(fraction) * (self.high - self.low), self.low), self.high)

    def towards(self, present: float, value: float) -> float:
        """Return a value, moved to within the largest step of the present one."""
        step = math.inf if self.largest_step is None else self.largest_step
        return min(max(value, present - step), present + step)


def parse(text: str) -> Parameter:
    """Return the Parameter of "NAME=LOW:HIGH" or "NAME=LOW:HIGH:INITIAL". Raises BadInput."""
    name, equals, rest = text.partition("=")
    try:
        numbers = [float(number) for number in rest.split(":")]
    except ValueError:
        numbers = []
    if not name.strip() or not equals or len(numbers) not in (2, 3):
        raise BadInput(f"--over {text!r}: {FORM}")
    low, high, *initial = numbers
    return Parameter(name.strip(), low, high, initial=initial[0] if initial else None)


def distinct(parameters: Iterable[Parameter]) -> list[Parameter]:
    """Return parameters as a list. Raises BadInput if there are none, or two have one name."""
    listed = list(parameters)
    if not listed:
        raise BadInput("no parameter to optimise: add one, as in --over 'profile.peak=4:12'")
    names = [parameter.name for parameter in listed]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"parameter {name} is given twice: remove one")
    return listed


def within_step(
    parameters: Iterable[Parameter], present: Mapping[str, float], proposed: Mapping[str, float]
) -> dict[str, float]:
    """Return a proposal, each of its values moved to within the largest step of the present value.

    present, proposed : {name: value}
    """
    return {each.name: each.towards(present[each.name], proposed[each.name]) for each in parameters}


def _is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)

"""Bisection for the highest rate that passes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

LOWEST_RATE, HIGHEST_RATE = 50.0, 9000.0  # Hz, of the paper
RESOLUTION = 100.0  # Hz, of the paper


@dataclass(frozen=True)
class Step:
    """One rate that was tried.

    rate : Hz
    commands, missed : number of commands, and of those without a reply
    lost, ticks : grid points that the loop missed, and ticks that it ran
    why : what ended the step early, "" for nothing
    """

    rate: float
    commands: int
    missed: int
    lost: int = 0
    ticks: int = 0
    why: str = ""

    @property
    def passed(self) -> bool:
        """Whether every command was answered, and at most one grid point in a hundred was missed."""
        return (
            not self.why
            and self.missed == 0
            and self.commands > 0
            and self.lost <= 0.01 * max(1, self.ticks + self.lost)
        )


def highest(
    attempt: Callable[[float], Step],
    low: float = LOWEST_RATE,
    high: float = HIGHEST_RATE,
    resolution: float = RESOLUTION,
) -> tuple[float, list[Step]]:
    """Search for the highest rate that passes, by bisection.

    attempt : function of a rate in Hz that returns its Step
    low, high, resolution : Hz

    Returns (highest rate that passed, 0.0 if none did; every Step).
    """
    if not 0.0 < low < high or not resolution > 0.0:
        raise ValueError(
            f"expected 0 < low < high and resolution > 0, got low={low!r}, high={high!r}, resolution={resolution!r} Hz"
        )
    steps = [attempt(low)]
    if not steps[0].passed:
        return 0.0, steps
    while high - low > resolution:
        middle = (low + high) / 2.0
        steps.append(attempt(middle))
        if steps[-1].passed:
            low = middle
        else:
            high = middle
    return low, steps

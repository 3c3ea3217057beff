"""Bisection for the highest rate that passes."""

from __future__ import annotations

from dataclasses import dataclass

LOWEST_RATE, HIGHEST_RATE = 50.0, 9000.0  # Hz, of the paper
RESOLUTION = 100.0  # Hz, of the paper


@dataclass(frozen=True)
class Step:
    """One rate that was tried. missed : commands without an answer; lost : ticks that the loop did not run; why : what
    ended it before
    """

    rate: float
    commands: int
    missed: int
    lost: int = 0
    ticks: int = 0
    why: str = ""

    @property
    def passed(self) -> bool:
        """Every command was answered, and the loop was there for all but one in a hundred."""
        return (
            not self.why
            and self.missed == 0
            and self.commands > 0
            and self.lost <= 0.01 * max(1, self.ticks + self.lost)
        )


def highest(
    attempt, low: float = LOWEST_RATE, high: float = HIGHEST_RATE, resolution: float = RESOLUTION
) -> tuple[float, list[Step]]:
    """(highest rate that passed, 0.0 if none did; every Step). attempt : gives the Step of a rate"""
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

"""Contenders that are timed in turn, round by round."""

from __future__ import annotations

import gc
import statistics
from collections.abc import Sequence
from typing import Protocol

from runtime.host.console.progress import rounds


class Contender(Protocol):
    """Program whose ticks are timed."""

    name: str

    def restart(self) -> None:
        """Return to the state before the first tick."""
        ...

    def advance(self, ticks: int) -> float:
        """Run more ticks; some contenders start at tick 0 in each call. Returns their processor time, in s."""
        ...


class Times:
    """Duration of a tick, in µs, one number per round."""

    def __init__(self, rounds: Sequence[float]) -> None:
        self.rounds = rounds

    @property
    def least(self) -> float:
        """Shortest duration, µs."""
        return min(self.rounds)

    @property
    def median(self) -> float:
        """Median of the rounds, µs."""
        return statistics.median(self.rounds)

    @property
    def most(self) -> float:
        """Longest duration, µs."""
        return max(self.rounds)

    def over(self, other: Times) -> float:
        """Return the ratio to another contender: the median over the rounds, each against its neighbour in time."""
        return statistics.median(mine / theirs for mine, theirs in zip(self.rounds, other.rounds))


def calibrate(contender: Contender, seconds: float) -> int:
    """Return the number of ticks that take about `seconds`."""
    contender.restart()
    ticks = 1
    while (took := contender.advance(ticks)) < 0.2 * seconds:
        ticks *= 4 if took < 0.05 * seconds else 2
    return max(1, round(ticks * seconds / took))


def interleave(contenders: Sequence[Contender], seconds: float, repeats: int) -> dict[str, Times]:
    """Time contenders in turn.

    seconds : approximate duration of a round
    repeats : rounds of each contender

    Returns {name: Times}.
    """
    ticks = {contender: calibrate(contender, seconds) for contender in contenders}
    times = {contender: [] for contender in contenders}
    collecting = gc.isenabled()
    gc.disable()
    try:
        for _ in rounds("measuring", repeats):
            for contender in contenders:
                times[contender].append(contender.advance(ticks[contender]) / ticks[contender] * 1e6)
            gc.collect()
    finally:
        if collecting:
            gc.enable()
    return {contender.name: Times(rounds) for contender, rounds in times.items()}


def table(
    times: dict[str, Times], blocks: dict[str, int], reference: str
) -> tuple[str, list[str], dict[str, dict[str, float]]]:
    """Lay out Times as a table.

    times : {name: Times}; blocks : {name: blocks of its diagram}; reference : the name that the last column divides by

    Returns (heading, lines, {name: row}).
    """
    rows = {
        name: {
            "min": row.least,
            "median": row.median,
            "max": row.most,
            "ns_a_block": row.median * 1e3 / blocks[name],
            "times_native": row.over(times[reference]),
        }
        for name, row in times.items()
    }
    lines = [
        f"  {name:36}{row['min']:16.4g}{row['median']:12.4g}{row['max']:12.4g}{row['ns_a_block']:13.3g}"
        f"{row['times_native']:11.3g}"
        for name, row in rows.items()
    ]
    return f"{'µs per tick: min':>16}{'median':>12}{'max':>12}{'ns per block':>13}{'x native':>11}", lines, rows

"""Contenders in turn: first each must compute what the reference computes, then each is timed, round by round.

A contender is made from a netlist and has

    name
    restart()           back to before the first tick
    advance(ticks)      so many ticks further; returns the processor time they took, in s. Some begin anew whenever they
    advance sinks               what the last tick gave every sink, element by element
"""

import gc
import statistics

from runtime.console.progress import rounds

CHECKED = (1, 2, 3, 257)  # ticks after which the sinks must agree with the reference
TOLERANCE = 1e-9  # of the largest value: other frameworks add up time, and some sums, in another order


class Disagreement(Exception):
    """A contender computes something else than the reference: its time would mean nothing."""


class Times:
    """How long a tick took, in µs, one number a round."""

    def __init__(self, rounds):
        self.rounds = rounds

    @property
    def least(self):
        return min(self.rounds)

    @property
    def median(self):
        return statistics.median(self.rounds)

    @property
    def most(self):
        return max(self.rounds)

    def over(self, other):
        """How many times as long as another contender, by the median of the rounds, each against its own neighbour in
        time.
        """
        return statistics.median(mine / theirs for mine, theirs in zip(self.rounds, other.rounds))


def check(contender, reference):
    """Raises Disagreement."""
    for ticks in CHECKED:
        contender.restart()
        contender.advance(ticks)
        reference.restart()
        reference.advance(ticks)
        got, wanted = list(contender.sinks), list(reference.sinks)
        largest = max(map(abs, wanted))
        off = max((abs(a - b) if a == a else largest for a, b in zip(got, wanted)), default=0.0)
        if len(got) != len(wanted) or off > TOLERANCE * largest:
            raise Disagreement(f"{contender.name} gives {got} after {ticks} ticks, and {reference.name} {wanted}")


def calibrate(contender, seconds):
    """How many ticks take about so long."""
    contender.restart()
    ticks = 1
    while (took := contender.advance(ticks)) < 0.2 * seconds:
        ticks *= 4 if took < 0.05 * seconds else 2
    return max(1, round(ticks * seconds / took))


def interleave(contenders, seconds, repeats):
    """{name: Times} of `repeats` rounds in which each contender runs for about so many seconds."""
    ticks = {contender: calibrate(contender, seconds) for contender in contenders}
    found = {contender: [] for contender in contenders}
    collecting = gc.isenabled()
    gc.disable()
    try:
        for _ in rounds("measuring", repeats):
            for contender in contenders:
                found[contender].append(contender.advance(ticks[contender]) / ticks[contender] * 1e6)
            gc.collect()
    finally:
        if collecting:
            gc.enable()
    return {contender.name: Times(times) for contender, times in found.items()}

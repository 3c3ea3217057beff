"""Check that a contender computes what the reference computes, before it is timed."""

CHECKED_TICKS = (1, 2, 3, 257)  # numbers of ticks after which the sinks are compared
TOLERANCE = 1e-9  # of the largest value: other frameworks add up time, and some sums, in another order


class Disagreement(Exception):
    """A contender whose results differ from the reference's, so that its time cannot be compared."""


def check(contender, reference):
    """Compare the sinks of two contenders. Raises Disagreement.

    Besides what runtime.setup.bench.measure expects, each has `sinks`: the values of the last tick, element by element.
    """
    for ticks in CHECKED_TICKS:
        contender.restart()
        contender.advance(ticks)
        reference.restart()
        reference.advance(ticks)
        values, expected = list(contender.sinks), list(reference.sinks)
        largest = max(map(abs, expected))
        off = max((abs(a - b) if a == a else largest for a, b in zip(values, expected)), default=0.0)
        if len(values) != len(expected) or off > TOLERANCE * largest:
            raise Disagreement(f"{contender.name} computes {values} after {ticks} ticks, {reference.name} {expected}")

"""Contenders are timed in turn."""

import pytest

from runtime.setup.bench.measure import Times, interleave


def test_rounds_are_compared_with_their_neighbours_in_time():
    """A machine that becomes twice as slow halfway leaves the ratio as it is."""
    slow, fast = Times([4.0, 4.0, 8.0]), Times([2.0, 2.0, 4.0])
    assert slow.over(fast) == 2.0 and (slow.least, slow.median, slow.most) == (4.0, 4.0, 8.0)


def test_benchmarks_alternate_for_about_the_requested_time():
    class Clocked:
        """A contender that takes 10 µs a tick and logs its calls."""

        def __init__(self, name, log):
            self.name, self.log = name, log

        def restart(self):
            pass

        def advance(self, ticks):
            self.log.append((self.name, ticks))
            return ticks * 1e-5

    log = []
    times = interleave([Clocked("a", log), Clocked("b", log)], 0.01, 3)
    assert [name for name, _ in log[-6:]] == ["a", "b"] * 3 and {ticks for _, ticks in log[-6:]} == {1000}
    assert times["a"].rounds == pytest.approx([10.0] * 3)

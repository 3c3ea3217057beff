"""The conformance test finds each kind of broken block. (That every block of the library passes it: tests/blocks.)"""

import math

import numpy as np
import pytest

from graph import Block, Input, Interval, Output, Param
from graph.conformance import check_block


class Sound(Block):
    """y = 2 u."""

    gain = Param(2.0, "1", "factor", min=0.0, max=3.0)
    u = Input("1", "in")
    y = Output("1", "out")

    def step(self, u):
        return self.gain * u


def test_a_sound_block_passes():
    assert check_block(Sound) == 7


def test_a_range_that_depends_on_the_width_is_asked_for_the_width_it_is_tried_with():
    class Total(Block):
        """The sum of a vector."""

        u = Input("1", "in", shape=...)
        y = Output("1", "out")

        def output_range(self, u):
            return Interval(2.0 * self.width * u.low, 2.0 * self.width * u.high)

        def step(self, u):
            return float(np.sum(u))

    assert check_block(Total) == 7


class NoUnitSaid(Sound):
    """A port without a description."""

    y = Output("1")


class Shapeless(Sound):
    """Returns two numbers where one is declared."""

    def step(self, u):
        return u, u


class Forgetful(Sound):
    """Keeps its state across a reset."""

    total = 0.0

    def step(self, u):
        self.total += u
        return self.total


class NanHider(Sound):
    """Turns NaN into zero."""

    def step(self, u):
        return 0.0 if math.isnan(u) else u


class NanKeeper(Sound):
    """Keeps a NaN beyond the reset."""

    worst = 0.0

    def step(self, u):
        if u != u:
            self.worst = u
        return u + self.worst


class Liar(Sound):
    """Leaves the range it states."""

    y = Output("1", "out", range=(-1.0, 1.0))


class Unbounded(Sound):
    """Takes any gain."""

    gain = Param(2.0, "1", "factor", min=0.0, max=3.0)

    def __init__(self, gain=2.0, **named):
        super().__init__(gain=min(max(gain, 0.0), 3.0) if gain == gain else 1.0, **named)


@pytest.mark.parametrize("kind, said", [
    (NoUnitSaid, "NoUnitSaid.y has no description"), (Shapeless, "Shapeless.y has shape"), (Forgetful, "not the same after reset"),
    (NanHider, "NanHider hides a NaN"), (NanKeeper, "not the same after reset"), (Liar, "outside its stated range"),
    (Unbounded, "Unbounded takes gain=-1.0"),
])
def test_each_kind_of_broken_block_is_found(kind, said):
    with pytest.raises(AssertionError, match=said):
        check_block(kind)

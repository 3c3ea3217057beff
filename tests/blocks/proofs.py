"""Whether a block keeps the range it states: with inputs from anywhere in their intervals, ends, infinities and huge
numbers too.
"""

import math
import random
import sys

import numpy as np
from hypothesis import strategies as st

from graph import Interval
from graph.arena_layout import size_of
from graph.block import range_of

anything = st.floats(allow_nan=False)  # infinite and huge ones, subnormal ones, both zeros
sensible = st.floats(-10.0, 10.0)
finite = st.floats(allow_nan=False, allow_infinity=False)


@st.composite
def intervals(draw, numbers=anything | sensible):
    a, b = draw(numbers), draw(numbers)
    return Interval(min(a, b), max(a, b))


def inside(interval, dice):
    """A number of an interval: an end, the one next to it, a zero, or one between of any magnitude.

    dice : a random.Random, since an example of Hypothesis costs a hundred times as much
    """
    low, high = max(interval.low, -sys.float_info.max), min(interval.high, sys.float_info.max)
    share = dice.random()
    chosen = dice.choice(
        (
            interval.low,
            interval.high,
            math.nextafter(interval.low, math.inf),
            math.nextafter(interval.high, -math.inf),
            dice.choice((0.0, -0.0)),
            dice.choice((1.0, -1.0)) * 10.0 ** dice.uniform(-323.0, 308.0),
            dice.uniform(-10.0, 10.0),
            low * (1.0 - share) + high * share,
        )
    )
    return chosen if chosen in interval else dice.choice((interval.low, interval.high))


def keeps_its_range(data, block, *, numbers=anything | sensible, nan=False, ticks=1, shapes=((), (3,))):
    """Draw an interval for every input, ask for the range, and step with values from the intervals."""
    shape = data.draw(st.sampled_from(shapes)) if any(port.shape is ... for port in block.inputs.values()) else ()
    block.width = size_of(shape)
    block.dt = block.dt or 1e-3
    block.prepare(block.dt)
    given = {name: draw_interval(data, port, numbers) for name, port in block.inputs.items()}
    found = block.output_range(**given)
    stated = {name: range_of(block, name, found) for name in block.outputs}
    dice = random.Random(data.draw(st.integers(0, 1 << 32), label="seed"))
    for _ in range(ticks):
        values = {
            name: value_of(port, given[name], shape if port.shape is ... else port.shape, nan, dice)
            for name, port in block.inputs.items()
        }
        results = block.step(**values)
        if block.update_kernel is not None:
            block.update(**values)
        for name, result in zip(block.outputs, results if len(block.outputs) > 1 else (results,)):
            for element in np.ravel(np.asarray(result, dtype=float)):
                assert math.isnan(element) or element in stated[name], (
                    f"{name} = {element!r} left {stated[name]!r} at {values}"
                )
    return stated


def draw_interval(data, port, numbers):
    if port.dtype == "bool":
        return data.draw(st.sampled_from([Interval(0.0, 0.0), Interval(1.0, 1.0), Interval(0.0, 1.0)]), label=port.name)
    return data.draw(intervals(st.integers(-3, 10).map(float) if port.dtype == "int" else numbers), label=port.name)


def value_of(port, interval, shape, nan, dice):
    """A value of an input: a float, or an array of a shape. nan : whether NaN is among them"""

    def one():
        if nan and dice.random() < 0.2:
            return math.nan
        if port.dtype in ("bool", "int"):
            return float(dice.randint(int(interval.low), int(interval.high)))
        return inside(interval, dice)

    return np.array([one() for _ in range(size_of(shape))]).reshape(shape) if shape else one()


def ulps(a, b):
    """How many units in the last place two numbers are apart."""
    return 0.0 if a == b else abs(a - b) / math.ulp(max(abs(a), abs(b)))


def at(block, tick):
    """What a block without inputs gives at a tick."""
    block.step()  # the first step makes its arena
    block.scratch.tick = tick
    return block.step()

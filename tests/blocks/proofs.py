"""Whether a block keeps the range it states: with inputs from anywhere in their intervals, ends, infinities and huge
numbers too.
"""

import math

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


def inside(interval):
    """Numbers of an interval, its ends and zeros of both signs among them."""
    some = [interval.low, interval.high] + [zero for zero in (0.0, -0.0) if 0.0 in interval]
    return st.sampled_from(some) | st.floats(interval.low, interval.high, allow_nan=False)


def keeps_its_range(data, block, *, numbers=anything | sensible, nan=False, ticks=1, shapes=((), (3,))):
    """Draw an interval for every input, ask for the range, and step with values from the intervals."""
    shape = data.draw(st.sampled_from(shapes)) if any(port.shape is ... for port in block.inputs.values()) else ()
    block.width = size_of(shape)
    block.dt = block.dt or 1e-3
    block.prepare(block.dt)
    given = {name: draw_interval(data, port, numbers) for name, port in block.inputs.items()}
    found = block.output_range(**given)
    stated = {name: range_of(block, name, found) for name in block.outputs}
    tick = st.fixed_dictionaries(
        {
            name: values_of(port, given[name], shape if port.shape is ... else port.shape, nan)
            for name, port in block.inputs.items()
        }
    )
    for values in data.draw(st.lists(tick, min_size=ticks, max_size=ticks)):
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
    interval = data.draw(intervals(st.integers(-3, 10).map(float) if port.dtype == "int" else numbers), label=port.name)
    return interval


def values_of(port, interval, shape, nan):
    """Strategy of an input's values: floats, or arrays of a shape. nan : whether NaN is among them"""
    whole = port.dtype in ("bool", "int")
    one = st.integers(int(interval.low), int(interval.high)).map(float) if whole else inside(interval)
    if nan:
        one = one | st.just(math.nan)
    if not shape:
        return one
    size = size_of(shape)
    return st.lists(one, min_size=size, max_size=size).map(lambda elements: np.array(elements).reshape(shape))


def ulps(a, b):
    """How many units in the last place two numbers are apart."""
    return 0.0 if a == b else abs(a - b) / math.ulp(max(abs(a), abs(b)))


def at(block, tick):
    """What a block without inputs gives at a tick."""
    block.step()  # the first step makes its arena
    block.scratch.tick = tick
    return block.step()

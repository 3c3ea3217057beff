"""Signals out of nothing but time."""

import math

import numpy as np
import pytest

from blocks.sources import Sine, StepSource
from graph import Diagram, DiagramError
from tests.blocks.running import both_ways


@pytest.mark.parametrize(
    "parameters",
    [
        {},
        {"amplitude": 3.0, "frequency": 0.7},
        {"amplitude": -2.0, "frequency": 25.0, "phase": 1.0, "bias": 0.5},
        {"frequency": 0.0, "phase": 0.5},
    ],
)
def test_a_sine_is_a_sine(parameters):
    """Within 1e-12 of its amplitude, over ten seconds."""
    y = both_ways(lambda: Sine(**parameters), ticks=2000)["y"]
    given = {"amplitude": 1.0, "frequency": 1.0, "phase": 0.0, "bias": 0.0, **parameters}
    t = np.arange(2000) / 200.0
    wanted = given["bias"] + given["amplitude"] * np.sin(2.0 * math.pi * given["frequency"] * t + given["phase"])
    assert np.abs(y - wanted).max() < 1e-12 * 3.0
    assert all(x in Sine(**parameters).output_range() for x in y)


def test_step_occurs_at_its_time():
    y = both_ways(lambda: StepSource(before=-1.0, after=4.0, time=0.025), ticks=10)["y"]
    assert y.tolist() == [-1.0] * 5 + [4.0] * 5, "at 200 Hz tick 5 is at 25 ms"
    assert (StepSource(-1.0, 4.0).output_range().low, StepSource(-1.0, 4.0).output_range().high) == (-1.0, 4.0)


def test_a_step_at_time_zero_was_always_there():
    with Diagram("zero", rate=100):
        assert [StepSource(0.0, 2.0, 0.0).step() for _ in range(2)] == [2.0, 2.0]


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: Sine(frequency=-1.0), "Sine: frequency: must be at least 0.0 Hz, got -1.0"),
        (lambda: Sine(amplitude=math.nan), "Sine: amplitude: NaN"),
        (lambda: StepSource(time=math.nan), "StepSource: time: NaN"),
        (lambda: Sine(1.0, 2.0, 3.0, 4.0, "rad", 6.0), "Sine: takes 5 parameters"),
    ],
)
def test_parameters_out_of_bounds_are_refused(make, said):
    with pytest.raises(DiagramError, match=said):
        make()

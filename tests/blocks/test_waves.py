"""Constant, ramp, chirp and pulse: closed forms, edges at the exact tick, and ranges."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import chirp

from blocks.sources import Chirp, Constant, GaussianNoise, Pulse, Ramp, Sine, StepSource, TimeTable, UniformNoise
from graph import Diagram, DiagramError, Interval, Live, compile
from tests.blocks.proofs import at
from tests.blocks.running import run


def trace(make, ticks, rate=200.0):
    """Every tick of one source, run by the executor."""
    with Diagram("source", rate=rate) as diagram:
        make(name="source")
    return run(diagram, ticks)["source.y"]


def test_a_constant_has_a_value_and_a_unit():
    with Diagram("d", rate=100) as diagram:
        Constant(9.81, unit="m/s^2", name="g")
    schedule = compile(diagram)
    assert schedule.signals["g.y"].unit == "m/s²" and schedule.arena[schedule.parameters["g.value"]] == 9.81
    assert run(diagram, 3)["g.y"].tolist() == [9.81] * 3


SOURCES = [Constant, StepSource, Ramp, Sine, Chirp, Pulse, TimeTable, GaussianNoise, UniformNoise]


@pytest.mark.parametrize("kind", SOURCES, ids=lambda kind: kind.__name__)
def test_every_source_declares_unit_and_refuses_invalid_one(kind):
    with Diagram("d", rate=100) as diagram:
        kind(unit="N*m", name="source")
    assert compile(diagram).signals["source.y"].unit == "N·m"
    with pytest.raises(DiagramError, match="'newton' is not a unit"):
        kind(unit="newton")


def test_a_live_constant_is_proved_over_its_live_range():
    assert Constant(Live(1.0, min=-2.0, max=3.0)).output_range() == Interval(-2.0, 3.0)


def test_a_ramp_is_level_before_and_after():
    t = np.arange(400) / 200.0
    y = trace(lambda name: Ramp(slope=3.0, time=0.5, initial=1.0, duration=1.0, name=name), 400)
    assert np.allclose(y, 1.0 + 3.0 * np.clip(t - 0.5, 0.0, 1.0), rtol=1e-15)
    found = Ramp(3.0, 0.5, 1.0, 1.0).output_range()
    assert found.low == pytest.approx(1.0, rel=1e-15) and found.high == pytest.approx(4.0, rel=1e-15)


@pytest.mark.parametrize("method", ["linear", "logarithmic"])
@pytest.mark.parametrize("start, stop", [(0.5, 20.0), (20.0, 0.5), (3.0, 3.0)])
def test_a_chirp_equals_scipys(method, start, stop):
    """Within 1e-9 of its amplitude over the sweep: SciPy's is a cosine."""
    t = np.arange(1000) / 200.0
    y = trace(lambda name: Chirp(2.0, start, stop, 5.0, method=method, phase=0.25, bias=0.5, name=name), 1000)
    assert y == pytest.approx(0.5 + 2.0 * chirp(t, start, 5.0, stop, method, phi=math.degrees(0.25) - 90.0), abs=2e-9)


@pytest.mark.parametrize("method", ["linear", "logarithmic"])
def test_chirp_continues_at_last_frequency_after_sweep(method):
    """Within 1e-9: the wave from the end of the sweep on is a sine of that frequency and of the phase reached."""
    start, stop, duration = 1.0, 4.0, 2.0
    y = trace(lambda name: Chirp(1.0, start, stop, duration, method=method, name=name), 800)
    turns = (
        0.5 * (start + stop) * duration if method == "linear" else (stop - start) * duration / math.log(stop / start)
    )
    t = np.arange(400, 800) / 200.0
    assert y[400:] == pytest.approx(np.sin(2.0 * math.pi * (turns + stop * (t - duration))), abs=1e-9)


def test_a_logarithmic_chirp_needs_frequencies_above_zero():
    with pytest.raises(DiagramError, match="requires start and stop above 0 Hz"):
        Chirp(start=0.0, method="logarithmic")


@pytest.mark.parametrize("rate", [10.0, 200.0, 300.0, 1000.0])
def test_the_edges_of_pulses_come_at_the_exact_tick(rate):
    """Period 0.3 s, high for a third of it, from 0.1 s on: in whole ticks, by integer arithmetic, over 100 s."""
    ticks, tenth = int(100 * rate), int(rate / 10)
    y = trace(lambda name: Pulse(low=-1.0, high=2.0, period=0.3, duty=1.0 / 3.0, delay=0.1, name=name), ticks, rate)
    k = np.arange(ticks) - tenth
    assert np.array_equal(y, np.where((k >= 0) & (k % (3 * tenth) < tenth), 2.0, -1.0))


@pytest.mark.parametrize("duty, wanted", [(0.0, -1.0), (1.0, 2.0)])
def test_pulses_of_no_length_and_of_full_length(duty, wanted):
    assert set(trace(lambda name: Pulse(-1.0, 2.0, 0.35, duty, name=name), 500)) == {wanted}


SIZES = st.floats(-1e6, 1e6) | st.floats(allow_nan=False, allow_infinity=False)
TIMES = st.floats(-100.0, 100.0)
LENGTHS = st.floats(1e-3, 1e3)
MAKERS = {
    "Constant": st.builds(Constant, SIZES),
    "StepSource": st.builds(StepSource, SIZES, SIZES, TIMES),
    "Ramp": st.builds(Ramp, SIZES, TIMES, SIZES, LENGTHS | st.just(math.inf)),
    "Sine": st.builds(Sine, SIZES, st.floats(0.0, 1e3), TIMES, SIZES),
    "Chirp": st.builds(
        Chirp, SIZES, LENGTHS, LENGTHS, LENGTHS, st.sampled_from(["linear", "logarithmic"]), TIMES, SIZES
    ),
    "Pulse": st.builds(Pulse, SIZES, SIZES, LENGTHS, st.floats(0.0, 1.0), TIMES),
    "GaussianNoise": st.builds(GaussianNoise, SIZES, SIZES.map(abs), st.integers(0, 2**53)),
    "UniformNoise": st.builds(
        lambda a, b, seed: UniformNoise(min(a, b), max(a, b), seed), SIZES, SIZES, st.integers(0, 2**53)
    ),
}


@pytest.mark.parametrize("kind", MAKERS)
@given(data=st.data(), dt=st.floats(1e-4, 1.0), ticks=st.lists(st.integers(0, 2**31), min_size=5, max_size=5))
def test_no_source_leaves_its_range_at_any_time(kind, data, dt, ticks):
    block = data.draw(MAKERS[kind])
    block.dt = dt
    found = block.output_range()
    for tick in ticks:
        y = at(block, tick)
        assert math.isnan(y) or y in found

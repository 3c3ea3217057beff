"""Butterworth against SciPy, sample by sample."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from blocks._plumbing.biquads import butterworth
from blocks.actuators import CubeMars
from blocks.filters import Butterworth
from blocks.sources import Ramp, StepSource
from graph import Diagram, DiagramError, compile
from tests.blocks.running import both_ways, by_hand, player, run
from tests.soaking import soaked

RATE = 200.0


def scipy_filtered(order, cutoff, u, rate=RATE, start=0.0):
    """The same filter of SciPy, in steady state at `start`."""
    sections = signal.butter(order, cutoff, fs=rate, output="sos")
    return signal.sosfilt(sections, u, zi=signal.sosfilt_zi(sections) * start)[0]


def noise(count=400, seed=3):
    u = np.random.default_rng(seed).normal(0.0, 3.0, count)
    u[0] = 0.0
    return u


@pytest.mark.parametrize("order", soaked(range(1, 9), but=[0, 1, 6]))
@pytest.mark.parametrize("cutoff", [0.5, 6.0, 20.0, 49.9, 75.0, 99.0])
def test_every_order_filters_as_scipy_does(order, cutoff):
    """Within 1e-9 of the largest output: the coefficients come from different closed forms, and low cutoffs are
    ill-conditioned.
    """
    u = noise()
    y = both_ways(lambda: Butterworth(order=order, cutoff=cutoff), rate=RATE, u=u)["y"]
    wanted = scipy_filtered(order, cutoff, u)
    assert np.abs(y - wanted).max() < 1e-9 * np.abs(wanted).max()


@given(order=st.integers(1, 8), share=st.floats(0.01, 0.98), rate=st.sampled_from([50.0, 200.0, 333.0, 1000.0]))
def test_any_cutoff_at_any_rate_filters_as_scipy_does(order, share, rate):
    cutoff, u = share * rate / 2.0, noise(200)
    with Diagram("any", rate=rate):
        block = Butterworth(order=order, cutoff=cutoff)
    wanted = scipy_filtered(order, cutoff, u, rate)
    assert np.abs(by_hand(block, len(u), u=u)["y"] - wanted).max() < 1e-8 * max(np.abs(wanted).max(), 1e-6)


@pytest.mark.parametrize("order", range(1, 9))
def test_the_gain_is_one_at_rest_and_one_over_root_two_at_the_cutoff(order):
    """Of the transfer function itself, within 1e-9; and at every frequency that of the formula, f and cutoff
    prewarped.
    """
    sections = butterworth(order, 15.0, "lowpass", 1.0 / RATE)
    assert len(sections) == (order + 1) // 2
    frequencies = np.array([0.0, 1.0, 15.0, 40.0, 90.0])
    _, response = signal.sosfreqz(
        [(b0, b1, b2, 1.0, a1, a2) for b0, b1, b2, a1, a2 in sections], worN=frequencies, fs=RATE
    )
    warped = np.tan(np.pi * frequencies / RATE) / np.tan(np.pi * 15.0 / RATE)
    assert np.abs(np.abs(response) ** 2 - 1.0 / (1.0 + warped ** (2 * order))).max() < 1e-9
    assert abs(abs(response[0]) - 1.0) < 1e-12 and abs(abs(response[2]) - math.sqrt(0.5)) < 1e-9


@pytest.mark.parametrize("order", range(1, 9))
def test_a_robot_that_has_been_armed_starts_its_filters_at_the_present_measurement(order):
    """In steady state at the start: SciPy's sosfilt_zi, within 1e-9. A knee held at 0.8 rad, let go after 50 ms."""
    with Diagram("robot", rate=RATE) as robot:
        knee = CubeMars("AK80-9", name="knee")
        knee(torque_command=0.0)
        Butterworth(order=order, cutoff=20.0, name="filter")(knee.position)
    with Diagram("holder", rate=RATE) as plant:
        knee.emulator()(position=Ramp(slope=0.4, time=0.05, initial=0.8)(), velocity=StepSource(0.0, 0.4, 0.05)())
    recording = run(robot, 60, plant=plant)
    u, y = recording["knee.position"], recording["filter.y"]
    assert abs(u[0] - 0.8) < 25.0 / 65535 and np.ptp(u) > 0.09
    assert np.abs(y - scipy_filtered(order, 20.0, u, start=u[0])).max() < 1e-9 and abs(y[0] - u[0]) < 1e-12


def test_each_element_of_a_vector_is_filtered_separately():
    u = np.random.default_rng(4).normal(size=(100, 3))
    u[0] = 0.0
    y = both_ways(lambda: Butterworth(order=5, cutoff=10.0), u=u)["y"]
    for column in range(3):
        assert np.abs(y[:, column] - scipy_filtered(5, 10.0, u[:, column])).max() < 1e-12 * 10.0


def test_filter_starts_at_zero_outside_a_robot():
    with Diagram("zero", rate=RATE):
        block = Butterworth(order=2, cutoff=20.0)
    assert 0.0 < block.step(1.0) < 0.1


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_nan_persists_only_until_the_reset(bad):
    u = noise(50)
    with Diagram("nan", rate=RATE):
        block = Butterworth(order=3, cutoff=20.0)
    before = by_hand(block, 50, u=u)["y"]
    assert not math.isfinite(block.step(bad))
    assert all(not math.isfinite(block.step(1.0)) for _ in range(100)), "a filter never forgets"
    block.reset()
    assert np.array_equal(by_hand(block, 50, u=u)["y"], before)


def test_nan_in_one_element_does_not_affect_the_others():
    u = np.ones((10, 2))
    u[0], u[3, 0] = 0.0, math.nan
    y = both_ways(lambda: Butterworth(order=2, cutoff=20.0), u=u)["y"]
    assert np.isnan(y[3:, 0]).all() and np.isfinite(y[:, 1]).all()


@pytest.mark.parametrize(
    "parameters, said",
    [
        ({"order": 0}, "order: must be at least 1, got 0"),
        ({"order": 9}, "order: must be at most 8, got 9"),
        ({"order": 2.5}, "order: expected a whole number"),
        ({"order": math.nan}, "order: "),
        ({"order": math.inf}, "order: "),
        ({"cutoff": 0.0}, "cutoff: must be above 0.0 Hz, got 0.0"),
        ({"cutoff": -5.0}, "cutoff: must be above 0.0 Hz, got -5.0"),
        ({"cutoff": math.nan}, "cutoff: NaN is not allowed"),
        ({"cutoff": "20"}, "cutoff: expected a number"),
    ],
)
def test_parameters_out_of_bounds_are_refused(parameters, said):
    with pytest.raises(DiagramError, match=f"Butterworth: {said}"):
        Butterworth(**parameters)


@pytest.mark.parametrize("cutoff", [100.0, 150.0, math.inf])
def test_a_cutoff_above_half_the_rate_is_rejected_with_the_required_rate(cutoff):
    with Diagram("slow", rate=RATE) as diagram:
        block = Butterworth(order=2, cutoff=cutoff)
        said = f"a cutoff of {cutoff:g} Hz requires a rate above {2 * cutoff:g} Hz, got 200 Hz"
        with pytest.raises((DiagramError, ValueError), match=said):
            block.step(1.0)
        block(player([0.0]))
    with pytest.raises(DiagramError, match=f"butterworth: {said}"):
        compile(diagram)


def test_missing_rate_is_reported_with_remedy():
    with pytest.raises(TypeError, match="butterworth needs a sampling period: make it inside `with Diagram"):
        Butterworth().step(1.0)
    block = Butterworth(order=1, cutoff=10.0)
    block.dt = 1.0 / RATE
    assert abs(block.step(1.0) - scipy_filtered(1, 10.0, [1.0])[0]) < 1e-12

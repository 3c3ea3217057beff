"""Assistance torques."""

import math

import numpy as np
import pytest

from blocks.gait import (
    BiologicalTorque,
    DelayedOutputFeedback,
    PeakProfile,
    SplineProfile,
    StanceSwingImpedance,
    TorqueProfile,
)
from graph import Diagram
from tests.blocks.running import both_ways, inside

PHASE = np.arange(400) / 400.0


def test_the_peak_profile_rises_peaks_and_falls_where_it_is_set():
    torque = both_ways(lambda: PeakProfile(peak=12.0, peak_time=0.5, rise=0.2, fall=0.1), phase=PHASE)["torque"]
    at = {phase: torque[round(400 * phase)] for phase in (0.25, 0.3, 0.4, 0.5, 0.55, 0.6, 0.7)}
    assert at == pytest.approx({0.25: 0.0, 0.3: 0.0, 0.4: 6.0, 0.5: 12.0, 0.55: 6.0, 0.6: 0.0, 0.7: 0.0}, abs=1e-9)


@pytest.mark.soak
def test_the_peak_profile_never_exceeds_its_peak_by_a_rounding():
    """An actuator whose limit is the peak would reject the command."""
    random = np.random.default_rng(1)
    for peak in random.uniform(1.0, 40.0, 200):
        profile = PeakProfile(peak=peak, peak_time=0.5, rise=0.3, fall=0.2)
        near = 0.5 + random.uniform(-1e-8, 1e-8, 200)
        assert max(profile.step(phase=phase, enable=True) for phase in near) <= peak


def test_the_peak_profile_assists_both_legs_and_wraps_at_heel_strike():
    both = np.column_stack((PHASE, (PHASE + 0.5) % 1.0))
    enable = np.column_stack((np.ones(400, dtype=bool), PHASE < 0.5))
    profile = lambda: PeakProfile(peak=-5.0, peak_time=0.02, rise=0.1, fall=0.1)  # noqa: E731
    torque = inside(profile, phase=both, enable=enable)["torque"]
    assert torque[0, 0] == pytest.approx(-5.0 * (3 * 0.8**2 - 2 * 0.8**3))
    assert torque[380, 0] < -1.0 and torque[208, 0] == 0.0
    assert torque[207, 1] == 0.0 and torque[197, 1] < -3.0  # disabled from 0.5 on


def test_the_spline_passes_its_points_and_stays_between_them():
    points = (0.0, 3.0, 5.0, 1.0, 0.0, -4.0, -4.0, 2.0)
    torque = inside(lambda: SplineProfile(*points), phase=PHASE)["torque"]
    assert torque[::50] == pytest.approx(points)
    for k in range(8):
        low, high = sorted((points[k], points[(k + 1) % 8]))
        assert torque[50 * k : 50 * k + 50].min() >= low and torque[50 * k : 50 * k + 50].max() <= high
    table = inside(lambda: TorqueProfile(tuple((k / 8, p) for k, p in enumerate(points))), phase=PHASE)["torque"]
    assert np.abs(torque - table).max() < 1e-9


def test_the_biological_torque_is_delayed_scaled_and_smoothed():
    moment = np.where(np.arange(600) < 200, 0.0, 50.0)
    torque = both_ways(lambda: BiologicalTorque(scale=0.2, delay=0.1, cutoff=6.0), moment=moment)["torque"]
    assert not torque[:220].any() and torque[220] > 0.0
    assert (np.diff(torque) >= 0.0).all() and torque[-1] == pytest.approx(10.0)
    time = np.arange(4000) / 1000.0
    sine = inside(lambda: BiologicalTorque(scale=1.0, delay=0.0), rate=1000, moment=np.sin(2.0 * np.pi * 6.0 * time))
    assert np.abs(sine["torque"][2000:]).max() == pytest.approx(math.sqrt(0.5), rel=0.03)


def test_delayed_feedback_assists_both_hips_in_opposite_directions():
    time = np.arange(2000) / 200.0
    left, right = (0.4 * np.sin(2.0 * np.pi * time / 1.1 + start) for start in (0.0, math.pi))
    outputs = both_ways(lambda: DelayedOutputFeedback(gain=10.0), left_angle=left, right_angle=right)
    assert np.array_equal(outputs["left_torque"], -outputs["right_torque"])
    power = outputs["left_torque"] * np.gradient(left, 1.0 / 200.0)
    assert power[400:].mean() > 0.8 * np.abs(power[400:]).mean()


def test_stance_has_a_spring_and_swing_a_damper():
    velocity, position = np.full(400, 2.0), np.full(400, 0.4)
    block = lambda: StanceSwingImpedance(30.0, 0.1, swing_damping=0.5, transition=0.05)  # noqa: E731
    torque = both_ways(block, phase=PHASE, position=position, velocity=velocity)["torque"]
    assert torque[20:240] == pytest.approx(-9.0) and torque[255:] == pytest.approx(-1.0)
    assert np.abs(np.diff(torque)).max() < 1.0


@pytest.mark.parametrize("block", [PeakProfile, SplineProfile])
def test_a_missing_phase_gives_nan(block):
    with Diagram("by hand", rate=200):
        assert math.isnan(block().step(math.nan)) and math.isnan(block().step(math.inf))

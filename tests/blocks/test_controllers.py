"""Impedance and torque profile, against closed forms and SciPy."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from blocks.controllers import Impedance, TorqueProfile
from graph import Diagram, DiagramError, Interval, Live, compile
from tests.blocks.running import both_ways, player

ASSISTANCE = ((0.02, 0.0), (0.14, -9.0), (0.32, 0.0), (0.48, 0.0), (0.60, 7.0), (0.74, 0.0), (0.88, -5.0), (0.97, 0.0))
PHASES = np.linspace(0.0, 1.0, 2001)


def test_an_impedance_is_a_spring_and_a_damper():
    random = np.random.default_rng(9)
    position, velocity, equilibrium = random.normal(size=(3, 100))
    inputs = {"position": position, "velocity": velocity, "equilibrium": equilibrium}
    torque = both_ways(lambda: Impedance(stiffness=40.0, damping=2.5), **inputs)["torque"]
    assert np.array_equal(torque, 40.0 * (equilibrium - position) - 2.5 * velocity)


def test_inputs_add_to_the_stiffness_and_damping_of_an_impedance():
    random = np.random.default_rng(9)
    position, velocity = random.normal(size=(2, 100))
    stiffness, damping = random.uniform(0.0, 50.0, size=(2, 100))
    inputs = {"position": position, "velocity": velocity, "extra_stiffness": stiffness, "extra_damping": damping}
    inputs["equilibrium"] = np.full(100, 0.2)
    torque = both_ways(lambda: Impedance(stiffness=0.0, damping=2.5), **inputs)["torque"]
    assert np.array_equal(torque, stiffness * (0.2 - position) - (2.5 + damping) * velocity)


def test_an_impedance_pulls_toward_its_equilibrium_and_against_motion():
    spring = Impedance(stiffness=30.0, damping=1.0)
    assert (
        spring.step(0.1, 0.0) == -3.0
        and spring.step(-0.1, 0.0) == 3.0
        and spring.step(0.1, 0.0, 0.3) == pytest.approx(6.0)
    )
    assert spring.step(0.0, 2.0) == -2.0 and spring.step(position=0.0, velocity=-2.0) == 2.0


@pytest.mark.parametrize("port", ["position", "velocity", "equilibrium"])
def test_nan_passes_an_impedance(port):
    assert math.isnan(
        Impedance(stiffness=0.0, damping=0.0).step(
            **{"position": 0.0, "velocity": 0.0, "equilibrium": 0.0, port: math.nan}
        )
    )


@pytest.mark.parametrize(
    "parameters, said",
    [
        ({"stiffness": -0.1}, "stiffness: must be at least 0.0 N·m/rad, got -0.1"),
        ({"stiffness": 150.1}, "stiffness: must be at most 150.0 N·m/rad, got 150.1"),
        ({"damping": 10.5}, "damping: must be at most 10.0 N·m·s/rad, got 10.5"),
        ({"damping": math.nan}, "damping: NaN is not allowed"),
        ({"stifness": 30.0}, "has no parameter 'stifness'\n.*did you mean 'stiffness'"),
    ],
)
def test_parameters_of_an_impedance_are_refused(parameters, said):
    with pytest.raises(DiagramError, match=f"Impedance: {said}"):
        Impedance(**parameters)


@given(
    ends=st.lists(st.floats(-10.0, 10.0), min_size=6, max_size=6),
    shares=st.lists(st.floats(0.0, 1.0), min_size=5, max_size=5),
)
def test_an_impedance_stays_in_its_range_for_all_live_gains(ends, shares):
    spring = Impedance()
    spans = {n: Interval(*sorted(ends[i : i + 2])) for n, i in (("position", 0), ("velocity", 2), ("equilibrium", 4))}
    spring.stiffness, spring.damping = 150.0 * shares[3], 10.0 * shares[4]
    now = {
        n: min(span.low + share * (span.high - span.low), span.high) for (n, span), share in zip(spans.items(), shares)
    }
    assert spring.step(**now) in spring.output_range(**spans)


def periodic_pchip(points):
    """SciPy's monotone cubic through five strides of the points, of which the one in the middle knows no ends."""
    phases, torques = np.array(points).T
    strides = np.arange(-2, 3)
    return PchipInterpolator((phases + strides[:, None]).ravel(), np.tile(torques, 5))


def profile(points, phases, **parameters):
    block = TorqueProfile(tuple(points), **parameters)
    return np.array([block.step(phase) for phase in phases])


@st.composite
def curves(draw):
    """Points of a profile: two to eight phases at least 0.01 apart, torques in µN·m up to 50 N·m."""
    places = sorted(draw(st.lists(st.integers(0, 99), min_size=2, max_size=8, unique=True)))
    return tuple((place / 100.0, draw(st.integers(-50_000_000, 50_000_000)) / 1e6) for place in places)


def test_a_profile_is_scipys_monotone_cubic_repeated():
    phases = np.r_[0.0, PHASES]
    torque = both_ways(lambda: TorqueProfile(ASSISTANCE), phase=phases)["torque"]
    assert np.abs(torque - periodic_pchip(ASSISTANCE)(phases % 1.0)).max() < 1e-12 * 9.0


@given(points=curves())
def test_any_profile_is_scipys_monotone_cubic_repeated(points):
    """Within 1e-9 of its largest torque."""
    phases = np.linspace(0.0, 1.0, 101)
    size = max(abs(torque) for _, torque in points)
    assert np.abs(profile(points, phases) - periodic_pchip(points)(phases)).max() <= 1e-9 * size


@given(points=curves())
def test_a_profile_passes_through_its_points_and_never_leaves_their_range(points):
    block = TorqueProfile(points)
    torques = [torque for _, torque in points]
    for phase, torque in points:
        assert block.step(phase) == pytest.approx(torque, rel=1e-12, abs=1e-300)
    found = block.output_range(phase=Interval(0.0, 1.0), enable=Interval(0.0, 1.0))
    for phase in np.linspace(-0.5, 1.5, 301):
        torque = block.step(phase)
        assert min(torques) <= torque <= max(torques) and torque in found


@given(points=curves())
def test_a_profile_is_smooth_everywhere_also_across_the_end_of_the_stride(points):
    """Value and slope from both sides of each knot and of the wrap agree, within what a step of 1e-6 can tell of a
    curve of this size.
    """
    block, h = TorqueProfile(points), 1e-6
    size = max(abs(torque) for _, torque in points) + 1e-9
    steepest = 3.0 * 2.0 * size / 0.01
    for phase in [phase for phase, _ in points] + [0.0, 1.0]:
        left, here, right = (block.step(phase + k * h) for k in (-1, 0, 1))
        assert abs(right - left) <= 2.0 * h * steepest
        assert abs((right - here) - (here - left)) / h < 1e-3 * steepest


def test_a_profile_is_periodic_in_the_phase():
    """Within 1e-9 N·m: a phase of 7.3 is not exactly 0.3 more than 7."""
    inside = profile(ASSISTANCE, PHASES[:-1])
    for stride in (-3, -1, 1, 7):
        assert np.abs(profile(ASSISTANCE, PHASES[:-1] + stride) - inside).max() < 1e-9
    assert profile(ASSISTANCE, [1.0]) == profile(ASSISTANCE, [0.0]) and abs(profile(ASSISTANCE, [-1e-20])[0]) < 0.1


def test_the_scale_is_the_share_of_the_profile_that_is_applied():
    assert np.array_equal(profile(ASSISTANCE, PHASES, scale=0.25), 0.25 * profile(ASSISTANCE, PHASES))
    assert not np.any(profile(ASSISTANCE, PHASES, scale=0.0))
    either_way = TorqueProfile(ASSISTANCE, scale=0.5)
    assert either_way.output_range(phase=Interval(), enable=Interval()) == Interval(-9.0, 7.0), "it may go live up to 1"
    one_way = TorqueProfile(((0.1, 3.0), (0.6, 8.0)), scale=Live(0.5, max=0.75))
    assert one_way.output_range(phase=Interval(), enable=Interval()) == Interval(0.0, 6.0)


def test_torque_is_zero_while_disabled():
    enable = PHASES < 0.5
    torque = both_ways(lambda: TorqueProfile(ASSISTANCE), phase=PHASES, enable=enable)["torque"]
    assert not np.any(torque[~enable]) and np.array_equal(torque[enable], profile(ASSISTANCE, PHASES[enable]))


@pytest.mark.parametrize("enable", [True, False])
def test_nan_passes_a_profile_and_is_not_held(enable):
    block = TorqueProfile(ASSISTANCE)
    assert math.isnan(block.step(math.nan, enable)) and math.isnan(block.step(math.inf, True))
    assert block.step(0.14) == -9.0


@pytest.mark.parametrize(
    "points, said",
    [
        ((), "at least two pairs"),
        (((0.0, 1.0),), "at least two pairs"),
        ((0.0, 1.0), "at least two pairs"),
        (((0.0, 1.0, 2.0), (0.5, 1.0, 2.0)), "at least two pairs"),
        (((0.0, 1.0), (0.5,)), "at least two pairs"),
        (((0.0, "a"), (0.5, 1.0)), "at least two pairs"),
        (((0.0, 1.0), (1.0, 0.0)), "increase strictly within 0 <= phase < 1"),
        (((0.5, 1.0), (0.2, 0.0)), "increase strictly within 0 <= phase < 1"),
        (((0.2, 1.0), (0.2, 0.0)), "increase strictly within 0 <= phase < 1"),
        (((-0.1, 1.0), (0.2, 0.0)), "increase strictly within 0 <= phase < 1"),
        (((0, 0.0), (50, 9.0)), "increase strictly within 0 <= phase < 1"),
        (((0.0, math.nan), (0.5, 1.0)), "must be finite"),
        (((0.0, 1.0), (0.5, math.inf)), "must be finite"),
        (((math.nan, 1.0), (0.5, 0.0)), "must be finite"),
    ],
)
def test_invalid_profile_points_are_rejected(points, said):
    with pytest.raises(DiagramError, match=f"torque_profile: .*{said}"):
        TorqueProfile(points)


@pytest.mark.parametrize("scale", [-0.01, 1.01, math.nan])
def test_scale_outside_zero_to_one_is_refused(scale):
    with pytest.raises(DiagramError, match="TorqueProfile: scale: "):
        TorqueProfile(ASSISTANCE, scale=scale)


def test_a_list_of_points_is_accepted():
    assert TorqueProfile([list(point) for point in ASSISTANCE]).step(0.14) == -9.0


def test_an_angle_is_not_accepted_as_a_phase():
    with Diagram("wrong", rate=100) as diagram:
        TorqueProfile(ASSISTANCE)(player([0.0], "rad"))
    with pytest.raises(DiagramError, match="torque_profile.phase: expected 1, got rad"):
        compile(diagram)

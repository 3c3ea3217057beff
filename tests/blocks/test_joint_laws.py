"""Admittance, feed-forward and gravity compensation: against closed forms and SciPy."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from blocks.controllers import Admittance, FeedForward, GravityCompensation
from graph import Interval
from tests.blocks.playing import made, play

RATE = 200.0
DT = 1.0 / RATE
NOISE = np.random.default_rng(18).normal(0.0, 3.0, 600)
angles = st.floats(-50.0, 50.0)


@pytest.mark.parametrize(
    "M, B, K", [(0.5, 5.0, 30.0), (0.05, 0.2, 100.0), (1.0, 3.0, 0.0), (0.2, 0.0, 50.0), (2.0, 200.0, 1.0)]
)
def test_an_admittance_moves_as_scipys_exact_discretisation_does(M, B, K):
    """Position and velocity within 1e-9 of the largest."""
    found = play(lambda: Admittance(M, B, K), RATE, torque=NOISE, equilibrium=np.full(600, 0.25))
    A, b, *_ = signal.cont2discrete(
        (np.array([[0.0, 1.0], [-K / M, -B / M]]), np.array([[0.0], [1.0 / M]]), np.eye(2), np.zeros((2, 1))), DT, "zoh"
    )
    state, wanted = np.zeros(2), []
    for u in NOISE:
        wanted.append(state)
        state = A @ state + b[:, 0] * u
    wanted = np.array(wanted)
    assert np.abs(found["position"] - 0.25 - wanted[:, 0]).max() < 1e-9 * np.abs(wanted[:, 0]).max()
    assert np.abs(found["velocity"] - wanted[:, 1]).max() < 1e-9 * np.abs(wanted[:, 1]).max()


def test_admittance_step_response_matches_closed_form():
    """Underdamped: e = τ/K (1 - exp(-ζ ω t) (cos ω_d t + ζ ω / ω_d sin ω_d t)), at the ticks exactly: within 1e-12."""
    M, B, K, torque = 0.5, 2.0, 40.0, 3.0
    w, z = math.sqrt(K / M), B / (2.0 * math.sqrt(K * M))
    wd, t = w * math.sqrt(1.0 - z * z), np.arange(1000) * DT
    wanted = torque / K * (1.0 - np.exp(-z * w * t) * (np.cos(wd * t) + z * w / wd * np.sin(wd * t)))
    found = play(lambda: Admittance(M, B, K), RATE, torque=np.full(1000, torque))["position"]
    assert np.abs(found - wanted).max() < 1e-12


def test_the_range_of_an_admittance_is_reached_and_not_left():
    block = made(Admittance, 0.5, 2.0, 40.0)
    found = block.output_range(torque=Interval(-2.0, 3.0), equilibrium=Interval(0.1, 0.1))
    impulse = play(lambda: Admittance(0.5, 2.0, 40.0), RATE, torque=np.r_[1.0, np.zeros(2999)])
    for name, offset in (("position", 0.1), ("velocity", 0.0)):
        worst = np.where(impulse[name][::-1] > 0.0, 3.0, -2.0)
        y = play(lambda: Admittance(0.5, 2.0, 40.0), RATE, torque=worst, equilibrium=np.full(3000, 0.1))[name]
        size = found[name].high - found[name].low
        assert found[name].high - 1e-6 * size < y[-1] and y.max() <= found[name].high and y.min() >= found[name].low
        assert found[name].high > offset


def test_an_admittance_without_a_spring_has_no_range():
    assert (
        made(Admittance, stiffness=0.0).output_range(torque=Interval(-1.0, 1.0), equilibrium=Interval(0.0, 0.0)) == {}
    )


def test_the_torque_has_no_direct_feedthrough_and_nan_persists_until_the_reset():
    block = made(Admittance)
    assert block.step_inputs() == ["equilibrium"]
    block.step(0.0, 0.0), block.update(math.nan, 0.0)
    assert all(map(math.isnan, block.step(0.0, 0.0)))
    block.reset()
    assert block.step(0.0, 0.7) == (0.7, 0.0)


def test_feed_forward_equals_its_formula_bit_for_bit():
    velocity, acceleration = NOISE[:300], NOISE[300:]
    found = play(lambda: FeedForward(0.3, 0.8, 1.5, 0.4), RATE, velocity=velocity, acceleration=acceleration)["torque"]
    assert np.array_equal(found, 0.3 * acceleration + 0.8 * velocity + 1.5 * np.clip(velocity / 0.4, -1.0, 1.0))


@given(
    data=st.data(),
    parameters=st.tuples(st.floats(0.0, 9.0), st.floats(0.0, 9.0), st.floats(0.0, 9.0), st.floats(1e-3, 9.0)),
)
def test_feed_forward_stays_inside_its_range_and_reaches_both_ends(data, parameters):
    spans = [sorted(data.draw(st.tuples(angles, angles))) for _ in range(2)]
    block = made(FeedForward, *parameters)
    found = block.output_range(velocity=Interval(*spans[0]), acceleration=Interval(*spans[1]))
    seen = [block.step(v, a) for v in spans[0] for a in spans[1]]
    assert all(y in found for y in seen)
    if spans[0][0] <= 0.0 <= spans[0][1]:
        assert found.high - max(seen) <= 1e-9 * (1.0 + abs(found.high)) and min(seen) - found.low <= 1e-9 * (
            1.0 + abs(found.low)
        )


def test_gravity_compensation_holds_a_segment():
    """m g l sin θ, within 2 units in the last place of the libm sine and two products."""
    angle = np.linspace(-3.0, 3.0, 200)
    found = play(lambda: GravityCompensation(3.5, 0.25, 0.8), RATE, angle=angle)["torque"]
    wanted = 0.8 * 3.5 * 9.80665 * 0.25 * np.sin(angle)
    assert np.all(np.abs(found - wanted) <= 4.0 * np.spacing(np.abs(wanted)))
    assert found[0] < 0.0 and math.isnan(made(GravityCompensation).step(math.nan))


@given(data=st.data())
def test_gravity_compensation_stays_inside_its_range(data):
    low, high = sorted(data.draw(st.tuples(angles, angles)))
    block = made(GravityCompensation, 3.5, 0.25)
    found = block.output_range(angle=Interval(low, high))
    for share in (0.0, 0.3, 1.0):
        block.share = share
        for angle in (low, high, *data.draw(st.lists(st.floats(low, high), max_size=10))):
            assert block.step(angle) in found


def test_the_range_of_a_compensation_follows_the_angle():
    """The share is live, so that 0 is always in it."""
    weight = 3.5 * 9.80665 * 0.25
    block = made(GravityCompensation, 3.5, 0.25)
    for low, high, wanted in (
        (0.0, 0.5, (0.0, math.sin(0.5))),
        (0.0, 2.0, (0.0, 1.0)),
        (-2.0, 0.2, (-1.0, math.sin(0.2))),
        (-math.inf, 0.0, (-1.0, 1.0)),
        (4.0, 5.0, (-1.0, 0.0)),
        (0.0, 1e7, (-1.0, 1.0)),
    ):
        found = block.output_range(angle=Interval(low, high))
        assert abs(found.low - weight * wanted[0]) < 1e-12 and abs(found.high - weight * wanted[1]) < 1e-12

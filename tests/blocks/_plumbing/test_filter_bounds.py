"""The range of linear systems: worst inputs come as near to it as one likes, and none leaves it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from blocks._plumbing.biquads import butterworth, reach
from blocks._plumbing.filter_bounds import reach_of_cascade, reach_of_state_space
from blocks.actuators import CubeMars
from blocks.filters import Butterworth, Notch
from blocks.limiters import TorqueLimiter
from blocks.linear import BiquadCascade, StateSpace, TransferFunction
from cext.kernels.filter_bounds import impulse_sums
from graph import Diagram, DiagramError, Interval, compile
from tests.blocks.playing import made, play, settle
from tests.soaking import soaked

RATE = 200.0
CASES = {
    "low-pass": lambda: Butterworth(order=4, cutoff=20.0),
    "slow low-pass": lambda: Butterworth(order=2, cutoff=0.5),
    "high-pass": lambda: Butterworth(order=3, cutoff=5.0, btype="highpass"),
    "band-pass": lambda: Butterworth(order=2, cutoff=(4.0, 12.0), btype="bandpass"),
    "band-stop": lambda: Butterworth(order=2, cutoff=(40.0, 60.0), btype="bandstop"),
    "notch": lambda: Notch(frequency=50.0, q=10.0),
    "cascade": lambda: BiquadCascade(signal.cheby1(5, 1.0, 30.0, fs=RATE, output="sos")),
    "lead": lambda: TransferFunction((0.1, 1.0), (0.01, 1.0), domain="s"),
    "lag without feedthrough": lambda: TransferFunction((0.5, -0.2), (1.0, -1.6, 0.68)),
    "finite response": lambda: TransferFunction((0.25, -0.5, 1.0, -0.5), (1.0, 0.0, 0.0, 0.0)),
    "state space": lambda: StateSpace(((0.9, 0.2), (-0.2, 0.85)), ((0.0,), (0.3,)), ((1.0, -2.0),), ((0.5,),)),
}


def response(make, length=6000):
    u = np.zeros(length)
    u[0] = 1.0
    return play(make, RATE, u=u)["y"]


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("low, high", soaked([(-1.0, 1.0), (0.0, 3.0), (-2.0, 0.5), (1.0, 4.0)], but=[0, 2]))
def test_worst_case_input_approaches_both_bounds_without_exceeding_them(name, low, high):
    """The input that has the sign of the impulse response, read backwards. Within 1e-6 of the bound, and inside it to
    the last bit.
    """
    h = response(CASES[name])
    found = made(CASES[name]).output_range(u=Interval(low, high))
    low, high = min(low, 0.0), max(high, 0.0)  # a filter starts at zero
    upward = play(CASES[name], RATE, u=np.where(h[::-1] > 0.0, high, low))["y"]
    downward = play(CASES[name], RATE, u=np.where(h[::-1] > 0.0, low, high))["y"]
    size = found.high - found.low
    assert found.high - 1e-6 * size < upward[-1] and upward.max() <= found.high and upward.min() >= found.low
    assert downward[-1] < found.low + 1e-6 * size and downward.max() <= found.high and downward.min() >= found.low


@pytest.mark.parametrize("name", CASES)
@given(data=st.data())
def test_no_input_leaves_the_range_from_zero_or_from_a_settled_start(name, data):
    low, high = sorted(data.draw(st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))))
    within = st.one_of(st.floats(low, high), st.sampled_from([low, high]))
    block = made(CASES[name])
    found = block.output_range(u=Interval(low, high))
    if data.draw(st.booleans()):
        settle(block, u=data.draw(within))
    for u in data.draw(st.lists(within, max_size=60)):
        y = block.step(u)
        if block.update_kernel is not None:
            block.update(u)
        assert y in found


@pytest.mark.parametrize(
    "order, cutoff, rate", [(2, 0.01, 200.0), (8, 2.0, 1000.0), (4, 0.1, 200.0), (1, 0.001, 100.0)]
)
def test_a_settled_start_at_full_scale_stays_in_range_with_poles_near_one(order, cutoff, rate):
    """Rounding errors persist for many steps here: the bound must allow for them."""
    found = made(Butterworth, order, cutoff, rate=rate).output_range(u=Interval(-1.0, 1.0))
    assert found.high < 1.7
    for level in (1.0, 0.1, 1.0 / 3.0, -0.7):
        block = made(Butterworth, order, cutoff, rate=rate)
        settle(block, u=level)
        y = np.array([block.step(level) for _ in range(2000)])
        assert np.all(np.abs(y - level) < 1e-5) and all(v in found for v in y)


def test_a_low_pass_of_first_order_has_no_overshoot_and_one_of_second_has_four_percent():
    """A Butterworth of second order overshoots a step by exp(-π) = 4.3 % in continuous time; the 1-norm counts both
    swings and the rest.
    """
    first = made(Butterworth, 1, 1.0, rate=1000.0).output_range(u=Interval(-1.0, 1.0))
    second = made(Butterworth, 2, 1.0, rate=1000.0).output_range(u=Interval(0.0, 1.0))
    assert 1.0 <= first.high < 1.0 + 1e-8
    overshoot = math.exp(-math.pi)
    assert (
        abs(second.high - (1.0 + overshoot / (1.0 - overshoot))) < 1e-4
        and abs(second.low + overshoot / (1.0 - overshoot)) < 1e-4
    )


def test_a_filter_behind_a_limiter_is_proved_by_its_overshoot():
    """20 Hz at 200 Hz overshoots to 1.11 times its input at the worst: 16 N·m pass under a rating of 18, and 17 do
    not.
    """

    def diagram(limit):
        with Diagram("filtered", rate=RATE) as found:
            knee = CubeMars("AK10-9-V2.0", name="knee")
            knee(torque_command=Butterworth(2, 20.0)(TorqueLimiter(limit=limit)(knee.torque)))
        return found

    (proof,) = [p for p in compile(diagram(16.0)).proofs if p.port == "torque_command"]
    assert proof.holds and abs(proof.interval.high - 16.0 * 1.10523) < 1e-3
    with pytest.raises(DiagramError) as complaint:
        compile(diagram(17.0))
    assert [d.code for d in complaint.value.diagnostics] == ["TW007"]


def test_each_input_and_output_of_a_state_space_counts():
    A, B = np.diag([0.5, -0.5]), np.array([[1.0, 0.0], [0.0, 2.0]])
    C, D = np.array([[1.0, 1.0]]), np.array([[0.0, -3.0]])
    found = reach_of_state_space(A, B, C, D)
    # h of the first input: 0 1 .5 .25 ... = 2; of the second: -3, then 2 -1 .5 ...: positive 2 / (1 - 1/4), negative 3
    # + 1 / (1 - 1/4).
    assert np.allclose(found.positive, [[2.0, 8.0 / 3.0]], rtol=1e-8) and np.allclose(
        found.negative, [[0.0, 3.0 + 4.0 / 3.0]], atol=1e-8
    )
    interval = found.interval([Interval(0.0, 1.0), Interval(-1.0, 0.0)])
    assert abs(interval.low + 8.0 / 3.0) < 1e-7 and abs(interval.high - (2.0 + 13.0 / 3.0)) < 1e-7


def test_the_start_of_a_state_space_counts():
    found = reach_of_state_space([[-0.5]], [[0.0]], [[1.0]], [[0.0]], start=[4.0]).interval([Interval(-1.0, 1.0)])
    assert abs(found.low + 2.0) < 1e-7 and abs(found.high - 4.0) < 1e-7


@pytest.mark.parametrize("a", [(1.0, -1.0), (1.0, -2.0, 1.0), (1.0, 0.0, 1.0), (1.0, -1.5), (1.0, -(1.0 - 1e-10))])
def test_unstable_or_slow_filter_has_no_range(a):
    assert made(TransferFunction, (1.0,), a).output_range(u=Interval(-1.0, 1.0)) == Interval()


@pytest.mark.soak
def test_a_filter_with_a_too_long_impulse_response_has_no_range():
    A, E, C = np.array([[0.999999]]), np.ones((1, 1)), np.ones((1, 1))
    assert impulse_sums(A, E, C, work=1e6) is None
    positive, negative, highest, lowest, states, steps = impulse_sums(A, E, C)
    assert abs(positive[0, 1] - 1e6) < 1.0 and steps < 3e7 and highest[0, 1] >= 1.0


def test_an_input_without_bound_has_an_output_without_bound():
    block = made(Butterworth, 2, 20.0)
    assert block.output_range(u=Interval()) == block.output_range(u=Interval(0.0)) == Interval()
    assert block.output_range(u=Interval(0.0, 0.0)).high < 1e-280


def test_a_denormal_input_stays_in_range_although_products_with_it_are_rounded_up():
    u = 3.0 * 5e-324
    block = made(lambda: Butterworth(4, 16.0))
    y = play(lambda: Butterworth(4, 16.0), RATE / 2, u=np.full(24, u))["y"]
    block.dt = 2.0 / RATE
    assert 1.5 * u < y.max() <= block.output_range(Interval(0.0, u)).high < 1e-200


def test_slack_grows_with_rounding_memory_and_stays_small():
    slacks = [float(reach(butterworth(2, cutoff, "lowpass", 1e-3)).slack[0, 0]) for cutoff in (100.0, 10.0, 1.0, 0.1)]
    assert slacks == sorted(slacks) and slacks[0] < 1e-12 and slacks[-1] < 1e-6


def test_equal_filters_are_summed_up_once():
    sections = tuple(((b0, b1, b2), (1.0, a1, a2)) for b0, b1, b2, a1, a2 in butterworth(2, 13.7, "lowpass", 1e-3))
    assert reach_of_cascade(sections) is reach_of_cascade(tuple(sections))

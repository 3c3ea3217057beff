"""Transfer functions and state space: against SciPy, sample by sample, and closed in loops."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, signal

from blocks.filters import Butterworth
from blocks.linear import StateSpace, TransferFunction, delays_at_rest, state_at_rest, tustin, zero_order_hold
from blocks.mathematics import Gain, Sum
from blocks.sources import StepSource
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, DiagramError, Interval, compile
from tests.blocks.playing import made, play, settle, taker

RATE = 500.0
NOISE = np.random.default_rng(13).normal(0.0, 2.0, 400)
A, B = ((0.9, 0.1, 0.0), (-0.1, 0.8, 0.2), (0.0, 0.0, -0.5)), ((0.0, 1.0), (0.5, 0.0), (1.0, -1.0))
C, D = ((1.0, 0.0, 2.0), (0.0, -1.0, 0.0)), ((0.0, 0.0), (0.3, 0.0))


@pytest.mark.parametrize(
    "b, a",
    [
        ((3.0,), (1.0,)),
        ((0.2, 0.1), (1.0, -0.7)),
        ((1.0,), (1.0, -0.9)),
        ((0.1, 0.0, -0.3), (2.0, -1.2, 0.5)),
        ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
        ((1.0, -2.0, 1.0, 0.5), (1.0, -0.3, 0.1, -0.05)),
        ((1.0, 0.5), (1.0, -1.5, 0.56, 0.0, 0.0)),
    ],
)
def test_a_transfer_function_in_z_is_scipys_filter(b, a):
    """Coefficients in falling powers of z; within 1e-12 of the largest output."""
    y = play(lambda: TransferFunction(b, a), RATE, u=NOISE)["y"]
    wanted = signal.dlsim((np.trim_zeros(b, "f"), a, 1.0), NOISE)[1][:, 0]
    assert np.abs(y - wanted).max() < 1e-12 * max(1.0, np.abs(wanted).max())


@pytest.mark.parametrize(
    "b, a",
    [
        ((1.0,), (0.05, 1.0)),
        ((0.2, 1.0), (0.01, 1.0)),
        ((40.0,), (1.0, 5.0, 40.0)),
        ((1.0, 0.0), (1.0, 30.0, 900.0)),
        ((1.0, 0.0, 4.0), (1.0, 2.0, 4.0)),
        ((1.875e6,), (1.0, 300.0, 37500.0, 1.875e6)),
        ((2.0,), (1.0, 0.0)),
    ],
)
def test_a_transfer_function_in_s_equals_scipys_tustin_discretisation(b, a):
    for method, scipys in (("tustin", "bilinear"), ("zoh", "zoh")):
        y = play(lambda: TransferFunction(b, a, "s", method), RATE, u=NOISE)["y"]
        numerator, denominator, _ = signal.cont2discrete((b, a), 1.0 / RATE, scipys)
        wanted = signal.lfilter(numerator[0], denominator, NOISE)
        assert np.abs(y - wanted).max() < 1e-9 * np.abs(wanted).max()
    auto = made(TransferFunction, b, a, "s", rate=RATE)
    assert auto.step_inputs() == ([] if len(b) < len(a) else ["u"])
    assert auto.design(1 / RATE) == made(
        TransferFunction, b, a, "s", "zoh" if len(b) < len(a) else "tustin", rate=RATE
    ).design(1 / RATE)


def test_a_continuous_plant_closes_a_loop_and_follows_the_exact_response():
    """PD around a double integrator: the held input makes the zero-order hold exact, here against SciPy's."""
    a, b, c = ((0.0, 1.0), (0.0, -2.0)), ((0.0,), (3.0,)), ((1.0, 0.0),)
    with Diagram("loop", rate=100.0) as diagram:
        plants = [TransferFunction(3.0, (1.0, 2.0, 0.0), "s"), StateSpace(a, b, c, domain="s")]
        seen = []
        for plant in plants:
            error = Sum("+-")
            error(1.0, plant(Gain(4.0)(error.y)))
            seen.append(taker(plant.y, (), 300))
    schedule = compile(diagram)
    assert schedule.warnings == []
    Executor(Program(schedule), 100.0).spin(300)
    A, B, C, D, _ = signal.cont2discrete((*map(np.array, (a, b, c)), np.zeros((1, 1))), 0.01)
    wanted = signal.dlsim((A - 4.0 * B @ C, 4.0 * B, C, D, 0.01), np.ones(300))[1][:, 0]
    for y in seen:
        assert np.abs(y - wanted).max() < 1e-10


@pytest.mark.parametrize(
    "make, said, cure",
    [
        (lambda: TransferFunction(40.0, (1.0, 5.0, 40.0)), "z = -2.5 ± 5.809j is outside", 'pass domain="s"'),
        (lambda: TransferFunction(1.0, (1.0, -2.0), "s"), "s = 2 is in the right half", "close a loop"),
        (lambda: StateSpace(((0.0, 1.0), (9.0, 0.0)), ((0.0,), (1.0,)), ((1.0, 0.0),)), "z = 3", 'domain="s"'),
        (lambda: TransferFunction(1.0, (1.0, -3.0, 3.0, -1.0)), "", ""),
        (lambda: TransferFunction(1.0, (1.0, 0.0, 9.0), "s"), "", ""),
        (lambda: StateSpace(((0.0, 1.0), (0.0, 0.0)), ((0.0,), (1.0,)), ((1.0, 0.0),), domain="s"), "", ""),
    ],
)
def test_an_unstable_pole_is_a_warning_with_the_cure_and_an_integrator_is_not(make, said, cure):
    with Diagram("open", rate=RATE) as diagram:
        taker(make()(1.0), (), 1)
    found = [warning for warning in compile(diagram).warnings if warning.code == "TW037"]
    assert len(found) == bool(said)
    assert all(said in warning.message and cure in warning.hint for warning in found)


@given(st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=5), st.floats(1e-3, 1.0))
@settings(deadline=None)
def test_tustins_transform_preserves_polynomial_values(coefficients, dt):
    """p(s) (z + 1)^n at s = 2/dt (z - 1)/(z + 1), within rounding."""
    z, degree = 0.7, len(coefficients) - 1
    s = 2.0 / dt * (z - 1.0) / (z + 1.0)
    size = np.polyval(np.abs(coefficients), abs(2.0 / dt) * 2.0) * 2.0**degree
    assert abs(
        np.polyval(tustin(coefficients, dt), z) - np.polyval(coefficients, s) * (z + 1.0) ** degree
    ) < 1e-12 * max(size, 1.0)


def test_block_without_feedthrough_closes_loop():
    """An integrator with gain 0.5 around it: the error falls by half each tick, exactly."""
    with Diagram("loop", rate=RATE) as diagram:
        error = Sum("+-")
        plant = TransferFunction((1.0,), (1.0, -1.0))
        error(1.0, plant(Gain(0.5)(error.y)))
        y = taker(plant.y, (), 10)
    Executor(Program(compile(diagram)), RATE).spin(10)
    assert y.tolist() == [1.0 - 0.5**k for k in range(10)]


def test_feedthrough_in_loop_is_reported():
    with Diagram("loop", rate=RATE) as diagram:
        error = Sum("+-")
        error(1.0, TransferFunction((1.0, 0.5), (1.0, -0.5))(error.y))
    with pytest.raises(DiagramError) as complaint:
        compile(diagram)
    assert [d.code for d in complaint.value.diagnostics] == ["TW006"]


@pytest.mark.parametrize("start", [(), (1.0, -2.0, 0.5)])
def test_a_state_space_is_scipys(start):
    u = NOISE.reshape(200, 2)
    for matrix in (D, ()):
        y = play(lambda: StateSpace(A, B, C, matrix, start), RATE, u=u)["y"]
        wanted = signal.dlsim((A, B, C, matrix or np.zeros((2, 2)), 1.0), u, x0=start or None)[1]
        assert np.abs(y - wanted).max() < 1e-12 * np.abs(wanted).max()


def test_a_state_space_of_one_input_and_one_output_has_scalar_ports():
    block = made(StateSpace, ((0.5,),), ((1.0,),), ((2.0,),))
    assert (block.inputs["u"].shape, block.outputs["y"].shape, block.step_inputs()) == ((), (), [])
    assert play(lambda: StateSpace(((0.5,),), ((1.0,),), ((2.0,),)), u=np.ones(4))["y"].tolist() == [0.0, 2.0, 3.0, 3.5]


@pytest.mark.parametrize(
    "make, gain",
    [
        (lambda: TransferFunction((0.3, 0.1), (1.0, -0.8)), 2.0),
        (lambda: TransferFunction((0.2,), (1.0, -0.9)), 2.0),
        (lambda: TransferFunction((3.0,), (1.0, 4.0, 3.0), "s"), 1.0),
        (lambda: StateSpace(((0.0, 1.0), (-3.0, -4.0)), ((0.0,), (3.0,)), ((1.0, 0.0),), domain="s"), 1.0),
        (lambda: TransferFunction((1.0, 0.0), (0.1, 1.0), "s"), 0.0),
        (lambda: StateSpace(((0.9, 0.1), (-0.1, 0.8)), ((0.0,), (0.3,)), ((1.0, 0.0),)), 1.0),
    ],
)
def test_arming_starts_filter_in_steady_state(make, gain):
    block = made(make, rate=RATE)
    settle(block, u=0.6)
    for _ in range(100):
        assert abs(block.step(0.6) - 0.6 * gain) < 1e-10
        block.update(0.6)


@pytest.mark.parametrize("a", [(1.0, -1.0), (1.0, -1.9, 0.9), (1.0, -1.7, 0.7000000000000001)])
def test_an_integrating_transfer_function_starts_at_zero_despite_rounding(a):
    assert delays_at_rest((0.0,) * (len(a) - 1) + (1.0,), a) == [0.0] * (len(a) - 1)
    block = made(StateSpace, ((1.0,),), ((1.0,),), ((1.0,),))
    settle(block, u=9.0)
    assert block.step(9.0) == 0.0


def test_a_given_start_also_applies_when_armed():
    block = made(StateSpace, ((0.5,),), ((1.0,),), ((1.0,),), (), (7.0,))
    settle(block, u=1.0)
    assert block.step(1.0) == 7.0


def test_the_steady_state_is_exact_to_one_rounding():
    for matrix, column in ((((0.999999, 1e-6), (0.0, 0.999999)), ((1.0,), (1.0,))), (A, B)):
        found = state_at_rest(np.array(matrix), np.array(column))
        wanted = np.linalg.solve(np.eye(len(matrix)) - matrix, column)
        assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max()
    assert state_at_rest(np.array([[0.5]]), np.array([[3.0]])).tolist() == [[6.0]]


@pytest.mark.parametrize("dt", [1e-4, 0.005, 0.3])
@pytest.mark.parametrize("K, B_, M", [(30.0, 5.0, 0.5), (0.0, 1.0, 2.0), (1e4, 0.0, 0.01), (1.0, 1e3, 0.1)])
def test_zero_order_hold_is_scipys_matrix_exponential(K, B_, M, dt):
    a, b = np.array([[0.0, 1.0], [-K / M, -B_ / M]]), np.array([[0.0], [1.0 / M]])
    found, wanted = zero_order_hold(a, b, dt), linalg.expm(np.block([[a, b], [np.zeros((1, 3))]]) * dt)
    scale = np.abs(wanted).max()
    assert (
        np.abs(found[0] - wanted[:2, :2]).max() < 1e-10 * scale
        and np.abs(found[1] - wanted[:2, 2:]).max() < 1e-10 * scale
    )


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_non_finite_input_while_arming_is_not_held(bad):
    for make in (
        lambda: TransferFunction((0.5, 0.1), (1.0, -0.5)),
        lambda: StateSpace(((0.5,),), ((1.0,),), ((1.0,),)),
        lambda: Butterworth(2, 20.0),
    ):
        block, fresh = made(make), made(make)
        settle(block, u=bad)
        assert block.step(1.0) == fresh.step(1.0)


def test_nan_persists_until_the_reset():
    for block in (
        made(TransferFunction, (0.5, 0.1), (1.0, -0.5)),
        made(TransferFunction, (0.5,), (1.0, -0.5)),
        made(StateSpace, ((0.5,),), ((1.0,),), ((1.0,),)),
    ):
        seen = []
        for u in (1.0, math.nan, 1.0, 1.0):
            seen.append(block.step(u))
            block.update(u)
        assert math.isnan(seen[-1])
        block.reset()
        assert not math.isnan(block.step(1.0))


def test_the_gain_may_have_a_unit():
    with Diagram("units", rate=RATE) as diagram:
        angle = TransferFunction((40.0,), (1.0, 5.0, 40.0), "s", unit="rad/N/m")(StepSource()())
        torque = StateSpace(((0.5,),), ((1.0,),), ((1.0,),), unit="N*m/rad")(angle)
        Gain(1.0)(torque)
    assert angle.block.unit == "rad/N/m" and torque.block.output_units(u="rad") == {"y": "N·m"}
    compile(diagram)


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: TransferFunction((1.0, 2.0), (1.0,)), "its degree, 1, must not exceed that of the denominator, 0"),
        (lambda: TransferFunction((1.0,), (0.0,)), "denominator: must not be zero"),
        (lambda: TransferFunction((), (1.0,)), "numerator: expected finite numbers"),
        (lambda: TransferFunction((math.inf,), (1.0,)), "numerator: expected finite numbers"),
        (lambda: TransferFunction(("x",), (1.0,)), "numerator: expected numbers in decreasing powers"),
        (lambda: TransferFunction(unit="furlong"), "'furlong' is not a unit"),
        (lambda: StateSpace(((1.0, 2.0),), ((1.0,),), ((1.0,),)), r"A: expected shape \(1, 1\), got \(1, 2\)"),
        (lambda: StateSpace(((0.5,),), ((1.0,),), ((1.0, 2.0),)), r"C: expected shape \(1, 1\), got \(1, 2\)"),
        (
            lambda: StateSpace(((0.5,),), ((1.0,),), ((1.0,),), start=(1.0, 2.0)),
            r"start: expected shape \(1,\), got \(2,\)",
        ),
        (lambda: StateSpace(((0.5,), (1.0, 2.0)), ((1.0,),), ((1.0,),)), "A: expected rows of numbers of equal length"),
        (lambda: StateSpace(((math.nan,),), ((1.0,),), ((1.0,),)), "A: expected rows of finite numbers"),
        (lambda: StateSpace(((0.5,),), ((1.0,),)), "C is missing"),
    ],
)
def test_inconsistent_parameters_are_refused(make, said):
    with pytest.raises(DiagramError, match=said):
        make()


def test_a_pole_that_tustin_cannot_place_is_refused():
    block = made(TransferFunction, (1.0,), (1.0, -2.0 * RATE), "s", "tustin", rate=RATE)
    with pytest.raises((DiagramError, ValueError), match="a pole at 1000 rad/s cannot be discretised at this rate"):
        block.step(0.0)


def test_range_requires_rate_only_if_it_depends_on_it():
    assert TransferFunction((0.5,), (1.0, -0.5)).output_range(u=Interval(0.0, 1.0)).high < 1.0 + 1e-8
    assert TransferFunction((1.0,), (1.0, 1.0), "s").output_range(u=Interval(0.0, 1.0)) == Interval()

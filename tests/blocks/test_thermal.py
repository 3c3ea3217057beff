"""The two-node model of a motor: against the matrix exponential, plain Python and the motor's ratings."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import linalg

from blocks.actuators import CubeMars
from blocks.actuators.cubemars.models import MODELS
from blocks.limiters import TemperatureDerating
from blocks.thermal import COPPER, RISE, ThermalModel, loss_of_rating
from cext.kernels import no_io
from graph import Actuator, Diagram, DiagramError, Input, Interval, Output, Param, compile
from tests.blocks.playing import made, play

RATE = 200.0
DT = 1.0 / RATE


def oracle(torque, ambient, loss, start=None, cw=16.3, rw=1.07, cc=512.0, rc=1.94, dt=DT):
    """Backward Euler by solving the two equations, in plain Python."""
    w = c = ambient[0] if start is None else start
    out = [(w, c)]
    for tau, air in zip(torque[:-1], ambient[:-1]):
        a, b, d = dt / (cw * rw), dt / (cc * rw), dt / (cc * rc)
        heated = w + dt / cw * (loss * (tau * tau) * (1.0 + COPPER * (w - 25.0)))
        cooled = c + d * air
        determinant = 1.0 + b + d + a * (1.0 + d)
        w, c = ((1.0 + b + d) * heated + a * cooled) / determinant, ((1.0 + a) * cooled + b * heated) / determinant
        out.append((w, c))
    return np.array(out)


def test_result_equals_the_oracle_bit_for_bit():
    random = np.random.default_rng(21)
    torque, ambient = random.normal(0.0, 12.0, 2000), 20.0 + random.normal(0.0, 1.0, 2000)
    for start in (None, 55.0):
        found = play(lambda: ThermalModel(loss=0.2, start=start), RATE, torque=torque, ambient=ambient)
        wanted = oracle(torque, ambient, 0.2, start)
        assert np.array_equal(found["winding"], wanted[:, 0]) and np.array_equal(found["case"], wanted[:, 1])


def test_heating_follows_the_exact_solution():
    """Ten minutes at a constant torque, copper included, against the matrix exponential: within 0.02 K of a rise of 34
    K at 200 Hz.
    """
    loss, torque, air = 0.2, 9.0, 22.0
    heat, cw, rw, cc, rc = loss * torque**2, 16.3, 1.07, 512.0, 1.94
    A = np.array(
        [
            [-1.0 / (cw * rw) + heat * COPPER / cw, 1.0 / (cw * rw)],
            [1.0 / (cc * rw), -1.0 / (cc * rw) - 1.0 / (cc * rc)],
        ]
    )
    b = np.array([heat * (1.0 - 25.0 * COPPER) / cw, air / (cc * rc)])
    rest = -np.linalg.solve(A, b)
    ticks = 120_000
    found = play(lambda: ThermalModel(loss=loss), RATE, torque=np.full(ticks, torque), ambient=np.full(ticks, air))
    assert found["winding"][0] == found["case"][0] == air
    for k in (1, 200, 2000, 20_000, ticks - 1):
        exact = rest + linalg.expm(A * k * DT) @ (air - rest)
        assert abs(found["winding"][k] - exact[0]) < 0.02 and abs(found["case"][k] - exact[1]) < 0.02
    assert found["winding"][-1] - air > 30.0 and np.all(np.diff(found["winding"]) > 0.0)


@pytest.mark.parametrize("name", MODELS)
def test_a_motor_held_at_its_rated_torque_ends_75_kelvin_above_ambient(name):
    """At a period of 10 s, which backward Euler takes in its stride."""
    rated = MODELS[name].rated
    found = play(lambda: ThermalModel(name), 0.1, torque=np.full(3000, rated))
    assert abs(found["winding"][-1] - 25.0 - RISE) < 1e-6
    assert abs((found["winding"][-1] - found["case"][-1]) / RISE - 1.07 / (1.07 + 1.94)) < 1e-6
    by_rating = play(lambda: ThermalModel(rated=rated), 0.1, torque=np.full(10, rated))
    assert np.array_equal(by_rating["winding"], found["winding"][:10])


def test_loss_from_rating_is_near_resistance_loss_of_ak80_9():
    """170 mΩ between phases and 0.105 · 9 N·m/A: R / k² = 0.19 W/(N·m)², within a third of the estimate of 0.24."""
    assert abs(loss_of_rating(9.0, 3.01) / (0.17 / (0.105 * 9.0) ** 2) - 1.0) < 1.0 / 3.0


def test_a_peak_torque_heats_the_winding_long_before_the_case():
    found = play(lambda: ThermalModel("AK80-9"), RATE, torque=np.full(2000, 18.0))
    assert found["winding"][-1] > 60.0 and found["case"][-1] < 27.0


@given(
    data=st.data(),
    loss=st.floats(0.0, 1.0),
    start=st.one_of(st.none(), st.floats(-20.0, 120.0)),
    rate=st.sampled_from([0.01, 1.0, 200.0]),
)
def test_a_thermal_model_stays_in_its_range_for_any_torque(data, loss, start, rate):
    torque, ambient = (
        sorted(data.draw(st.tuples(values, values))) for values in (st.floats(-12.0, 12.0), st.floats(-20.0, 45.0))
    )
    block = made(ThermalModel, loss=loss, start=start, rate=rate)
    found = block.output_range(torque=Interval(*torque), ambient=Interval(*ambient))
    for _ in range(30):
        values = data.draw(st.sampled_from(torque)), data.draw(st.sampled_from(ambient))
        assert all(temperature in found for temperature in block.step(*values))
        block.update(*values)


def test_the_range_of_a_thermal_model_is_its_steady_state_at_the_largest_torque():
    found = made(ThermalModel, rated=9.0).output_range(torque=Interval(-9.0, 4.0), ambient=Interval(20.0, 25.0))
    assert abs(found.high - 100.0) < 1e-3 and abs(found.low - 20.0) < 1e-3
    hot = made(ThermalModel, rated=9.0, start=130.0).output_range(
        torque=Interval(0.0, 0.0), ambient=Interval(20.0, 25.0)
    )
    assert abs(hot.high - 130.0) < 1e-3 and abs(hot.low - 20.0) < 1e-3
    runaway = made(ThermalModel, rated=9.0).output_range(torque=Interval(-30.0, 30.0), ambient=Interval(20.0, 25.0))
    assert runaway == Interval()


def test_nan_passes_and_is_not_held():
    """A tick later, since the torque has no direct feedthrough; an infinite torque is taken for one as well."""
    found = play(lambda: ThermalModel(rated=9.0), RATE, torque=[9.0, math.nan, math.inf, 9.0, 9.0])
    assert np.isnan(found["winding"]).tolist() == np.isnan(found["case"]).tolist() == [False, False, True, True, False]


def test_thermal_model_starts_at_initial_or_first_finite_ambient_temperature():
    assert made(ThermalModel, rated=9.0, start=40.0).step(0.0) == (40.0, 40.0)
    block = made(ThermalModel, rated=9.0)
    assert all(map(math.isnan, block.step(0.0, math.nan)))
    block.update(0.0, math.nan)
    assert block.step(0.0, 30.0) == (30.0, 30.0)


def test_missed_ticks_count_in_the_thermal_model():
    block, steady = (made(ThermalModel, rated=9.0) for _ in range(2))
    for each in (block, steady):
        each.step(18.0), each.update(18.0)
    block.scratch.arena[2] = 100.0 * DT
    late = block.step(18.0)
    for _ in range(100):
        last = steady.step(18.0)
        steady.update(18.0)
    assert abs(late[0] - last[0]) < 0.05 and late[0] > 25.5


@pytest.mark.soak
def test_overloaded_motor_with_derating_settles_below_limit():
    model, derating = made(ThermalModel, "AK80-9", rate=1.0), made(TemperatureDerating, 80.0, 100.0)
    torque = 18.0
    for _ in range(20_000):
        winding, _ = model.step(torque)
        torque = derating.step(18.0, winding)
        model.update(torque)
    assert 80.0 < winding < 100.0 and 7.0 < torque < 9.5


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: ThermalModel(), "loss: set `actuator`, `rated` or `loss`"),
        (lambda: ThermalModel("AK99"), "'AK99' is not a CubeMars model"),
        (lambda: ThermalModel(rated=0.0), "rated: must be above 0"),
        (lambda: ThermalModel(loss=0.1, case_capacity=0.0), "case_capacity: must be above 0"),
    ],
)
def test_inconsistent_parameters_are_refused(make, said):
    with pytest.raises(DiagramError, match=said):
        make()


class Winch(Actuator):
    """A motor whose board reports no temperature."""

    bus = Param("legs", "1", "its bus", dtype=str)
    torque_command = Input("N·m", "torque", default=0.0)
    torque = Output("N·m", "of the motor")
    decode, encode = no_io.ignore_all, no_io.send_nothing


def test_actuator_without_temperature_requires_thermal_model():
    with Diagram("bare", rate=200) as bare:
        Winch(name="winch")(torque_command=0.0)
    [warning] = [warning for warning in compile(bare).warnings if warning.code == "TW024"]
    assert warning.path == "winch" and "ThermalModel" in warning.hint
    with Diagram("modelled", rate=200) as modelled:
        winch = Winch(name="winch")
        winch(torque_command=0.0)
        ThermalModel(rated=10.0)(winch.torque)
        CubeMars("AK80-9", bus="others", name="knee")(torque_command=0.0)
    assert "TW024" not in [warning.code for warning in compile(modelled).warnings]

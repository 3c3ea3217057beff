"""Linear blocks, alone and in closed loops, against python-control, sample by sample. Skipped where that is not
installed.
"""

import numpy as np
import pytest

from blocks.controllers import PD, PI, PID
from blocks.discrete import Integrator, UnitDelay
from blocks.filters import Butterworth
from blocks.linear import StateSpace, TransferFunction
from blocks.sources import StepSource
from graph import Diagram
from tests.blocks.running import player, run
from tests.optional import Library

control = Library("control")

RATE, TICKS = 200.0, 400
H = 1.0 / RATE
INPUT = np.random.default_rng(7).normal(size=TICKS).cumsum() * 0.1  # a random walk has low and high frequencies;
INPUT -= INPUT[0]  # from 0, where derivatives start without a kick


def response(system):
    """Of a discrete system of python-control to INPUT, from rest: (outputs, ticks) or (ticks,)."""
    return control.forced_response(system, T=np.arange(TICKS) * H, inputs=INPUT).outputs


def output(make):
    """What `make` wires behind INPUT gives, tick by tick."""
    with Diagram("d", rate=RATE) as diagram:
        signal = make(player(INPUT, "1"))
    return run(diagram, TICKS)[signal.path]


@pytest.mark.parametrize(
    "numerator, denominator",
    [
        ((1.0,), (1.0, -0.9)),
        ((0.2, 0.1), (1.0, -1.5, 0.7)),
        ((1.0, -0.5, 0.3, 0.0), (1.0, -0.2, 0.5, -0.1)),
        ((3.0,), (1.0, 0.0, 0.0, 0.0)),
    ],
)
def test_a_transfer_function_in_z(numerator, denominator):
    assert output(lambda signal: TransferFunction(numerator, denominator)(signal)) == pytest.approx(
        response(control.tf(numerator, denominator, H)), abs=1e-9
    )


@pytest.mark.parametrize(
    "numerator, denominator",
    [((100.0,), (1.0, 12.0, 100.0)), ((1.0, 0.0), (0.01, 1.0)), ((0.1, 1.0), (0.02, 1.0)), ((1.0,), (1.0, 0.0))],
)
def test_a_transfer_function_in_s_by_tustin(numerator, denominator):
    wanted = response(control.sample_system(control.tf(numerator, denominator), H, "tustin"))
    assert output(lambda signal: TransferFunction(numerator, denominator, "s", "tustin")(signal)) == pytest.approx(
        wanted, abs=1e-8
    )


def test_state_space_equals_python_controls():
    A, B, C, D = ((0.9, 0.1), (-0.2, 0.8)), ((0.0,), (0.1,)), ((1.0, 0.5),), ((0.3,),)
    assert output(lambda signal: StateSpace(A, B, C, D)(signal)) == pytest.approx(
        response(control.ss(A, B, C, D, H)), abs=1e-12
    )


def test_a_butterworth_filter_is_the_analog_one_by_tustin_prewarped():
    analog = control.tf(1.0, [1.0 / (2 * np.pi * 20) ** 2, np.sqrt(2) / (2 * np.pi * 20), 1.0])
    wanted = response(control.sample_system(analog, H, "tustin", prewarp_frequency=2 * np.pi * 20))
    assert output(lambda signal: Butterworth(order=2, cutoff=20.0)(signal)) == pytest.approx(wanted, abs=1e-10)


def integral():
    """I[k] = I[k-1] + dt e[k]"""
    return control.tf([H, 0.0], [1.0, -1.0], H)


def slope(filter_time):
    """(u - f) / (filter_time + dt), f following u: the filtered derivative of the controllers."""
    return control.tf([1.0, -1.0], [filter_time + H, -filter_time], H)


@pytest.mark.parametrize(
    "make, law",
    [
        (lambda: PI(2.0, 5.0), lambda: 2.0 + 5.0 * integral()),
        (lambda: PD(2.0, 0.3, 0.02, c=1.0), lambda: 2.0 + 0.3 * slope(0.02)),
        (lambda: PID(2.0, 5.0, 0.3, 0.02, c=1.0), lambda: 2.0 + 5.0 * integral() + 0.3 * slope(0.02)),
    ],
)
def test_controllers_without_limits_are_linear_systems(make, law):
    assert output(lambda signal: make()(signal, 0.0)) == pytest.approx(response(law()), abs=1e-9)


def test_a_closed_loop_of_a_controller_and_a_plant_with_delay():
    """A joint of inertia 0.1 kg·m² and damping 0.5 N·m·s/rad under PI control of its velocity, the measurement one tick
    old.
    """
    plant = control.sample_system(control.tf(1.0, [0.1, 0.5]), H, "zoh")
    law = 1.5 + 8.0 * integral()
    wanted = control.forced_response(
        control.feedback(law * plant, control.tf(1.0, [1.0, 0.0], H)), T=np.arange(TICKS) * H, inputs=np.ones(TICKS)
    ).outputs
    with Diagram("d", rate=RATE) as diagram:
        old = UnitDelay(name="old")
        moved = TransferFunction((1.0,), (0.1, 0.5), domain="s", name="joint")(
            PI(1.5, 8.0)(StepSource(1.0, 1.0, 0.0)(), old.y)
        )
        old(moved)
    assert run(diagram, TICKS)["joint.y"] == pytest.approx(wanted, abs=1e-9)


def test_an_integrator_is_the_sum():
    with Diagram("d", rate=RATE) as diagram:
        signal = Integrator()(player(INPUT, "1"))
    wanted = response(control.tf([H], [1.0, -1.0], H))
    assert run(diagram, TICKS)[signal.path] == pytest.approx(wanted, abs=1e-9)

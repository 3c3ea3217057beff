"""Warnings of periodic values at inputs that must be smooth, and of limits that an integral does not know."""

import pytest

from blocks.actuators import CubeMars
from blocks.controllers import PI, PID
from blocks.discrete import Derivative, UnitDelay, Unwrap
from blocks.filters import Butterworth, Exponential, Median
from blocks.limiters import Saturation, SlewRate, TorqueLimiter
from blocks.linear import TransferFunction
from blocks.quaternions import QuaternionToEuler
from blocks.sources import Constant
from blocks.trigonometry import Atan2, Cos, Sin
from blocks.windows import MovingAverage
from graph import Diagram, compile, stack

SMOOTH = {
    "Butterworth": lambda: Butterworth(cutoff=6.0),
    "Exponential": lambda: Exponential(),
    "MovingAverage": lambda: MovingAverage(window=0.1),
    "Derivative": lambda: Derivative(),
    "SlewRate": lambda: SlewRate(),
    "TransferFunction": lambda: TransferFunction(numerator=(1.0,), denominator=(1.0, 0.1)),
}
WAYS = {
    "at once": lambda yaw: yaw,
    "behind a gain": lambda yaw: 2.0 * yaw,
    "behind a difference": lambda yaw: yaw - 0.5,
    "in degrees": lambda yaw: yaw.to("deg"),
    "one tick late": lambda yaw: UnitDelay()(yaw),
}


def warnings(diagram, code):
    return [warning for warning in compile(diagram).warnings if warning.code == code]


def heading():
    return QuaternionToEuler()(stack(1.0, 0.0, 0.0, Constant(0.0)())).yaw


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("block", SMOOTH)
def test_a_heading_at_a_smooth_input_is_a_warning(block, way):
    with Diagram("d", rate=100) as diagram:
        reader = SMOOTH[block]()
        reader(WAYS[way](heading()))
    [warning] = warnings(diagram, "TW033")
    assert (warning.path, warning.port) == (
        reader.path,
        "u",
    ) and "yaw jumps between -3.142 and 3.142" in warning.message


def test_a_derivative_of_a_controller_counts_and_its_other_parts_do_not():
    for kd, expected in ((0.0, 0), (0.1, 1)):
        with Diagram("d", rate=100) as diagram:
            PID(kp=1.0, kd=kd, lower=-1.0, upper=1.0)(reference=0.0, measurement=heading())
        assert len(warnings(diagram, "TW033")) == expected


def test_signals_that_do_not_jump_give_no_warning():
    with Diagram("d", rate=100) as diagram:
        yaw = heading()
        Median()(yaw)
        smooth = Butterworth(cutoff=6.0)
        x, y = smooth(Cos()(yaw)), Butterworth(cutoff=6.0)(Sin()(yaw))
        Atan2()(y, x)
    assert warnings(diagram, "TW033") == []


def controlled(controller, limiter, law=lambda command: command):
    with Diagram("d", rate=100) as diagram:
        knee = CubeMars("AK80-9", name="knee")
        command = law(controller(reference=0.5, measurement=knee.position))
        knee(torque_command=limiter(command))
    return warnings(diagram, "TW034")


@pytest.mark.parametrize("kind", [PID, PI])
@pytest.mark.parametrize("limiter", [lambda u: TorqueLimiter(limit=9.0)(u), lambda u: Saturation(-9.0, 9.0)(u)])
def test_a_limit_that_an_integral_does_not_know_is_a_warning(kind, limiter):
    def made(**limits):
        return controlled(lambda **inputs: kind(kp=10.0, ki=20.0, unit="N*m", name="pid", **limits)(**inputs), limiter)

    [warning] = made()
    assert warning.path == "pid" and warning.hint == (
        "give the limits to the controller, as in lower=-9, upper=9, or connect the limited command to its input "
        "applied"
    )
    assert len(made(lower=-20.0, upper=20.0)) == 1
    assert made(lower=-9.0, upper=9.0) == [] == made(lower=-5.0, upper=5.0)


def test_the_limits_are_those_in_front_of_a_gain():
    [warning] = controlled(
        lambda **inputs: PID(kp=10.0, ki=20.0, unit="N*m")(**inputs),
        lambda u: TorqueLimiter(limit=9.0)(u),
        lambda u: 0.5 * u,
    )
    assert "lower=-18, upper=18" in warning.hint


def test_a_controller_that_follows_the_limited_command_gives_no_warning():
    with Diagram("d", rate=100) as diagram:
        knee = CubeMars("AK80-9", name="knee")
        limiter = TorqueLimiter(limit=9.0)
        effort = PID(kp=10.0, ki=20.0, unit="N*m")
        knee(torque_command=limiter(effort(reference=0.5, measurement=knee.position, applied=limiter.limited)))
    assert warnings(diagram, "TW034") == []


def test_an_unwrapped_heading_gives_no_warning():
    with Diagram("d", rate=100) as diagram:
        Derivative()(Unwrap()(heading()))
    assert warnings(diagram, "TW033") == []


def test_without_an_integral_a_limit_behind_the_controller_is_no_warning():
    assert controlled(lambda **inputs: PID(kp=10.0, unit="N*m")(**inputs), lambda u: TorqueLimiter(limit=9.0)(u)) == []

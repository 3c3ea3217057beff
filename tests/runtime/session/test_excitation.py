"""Loops through drives, measured in their simulation, against the equations of a linear drive."""

import numpy as np
import pytest

from blocks.actuators import CubeMars
from blocks.continuous import Pendulum
from blocks.controllers import Impedance
from blocks.limiters import TorqueLimiter
from blocks.mathematics import Gain, Sign
from graph import Actuator, Diagram
from runtime.robot.loading.file import load
from runtime.session import excitation
from tests.diagrams.pages import SUITS
from tests.diagrams.robots import ROBOTS, path

control = pytest.importorskip("control")
loop = pytest.importorskip("runtime.session.loop")

RATE, MASS, LENGTH, STIFFNESS, DAMPING, G = 200.0, 2.0, 0.4, 12.0, 1.2, 9.80665


def robot():
    with Diagram("robot", rate=RATE) as diagram:
        knee = CubeMars("AK80-9", bus="leg", can_id=1, name="knee")
        law = Impedance(stiffness=STIFFNESS, damping=DAMPING, name="law")
        command = law(position=knee.position, velocity=knee.velocity, equilibrium=0.0)
        knee(torque_command=TorqueLimiter(limit=9.0)(command))
    return diagram


def plant(diagram):
    with Diagram("plant", rate=5 * diagram.rate) as built:
        drive = diagram["knee"].emulator()
        pendulum = Pendulum(mass=MASS, length=LENGTH, damping=0.3, start=0.05)
        pendulum(torque=drive.torque)
        drive(position=pendulum.position, velocity=pendulum.velocity)
    return built


def test_a_loop_through_a_drive_is_that_of_its_equations_with_a_tick_of_delay():
    """A linear drive of gain 1 whose torque acts from the next tick on, and quanta below the stated error."""
    found = loop.Loop(robot, "knee.torque_command", amplitude=8.0, plant=plant)
    J = MASS * LENGTH**2
    shank = control.ss(
        [[0.0, 1.0], [-MASS * G * LENGTH / J, -0.3 / J]], [[0.0], [1.0 / J]], [[STIFFNESS, DAMPING]], 0.0
    )
    exact = control.sample_system(shank, 1.0 / RATE, "zoh") * control.tf(1.0, [1.0, 0.0], 1.0 / RATE)
    wanted = exact(np.exp(2j * np.pi * found.frequencies / RATE))
    wrong = np.abs((found.response - wanted) / (1.0 + wanted))
    assert wrong.max() < 0.04 and np.median(wrong) < 0.003 and 0.003 < found.error.max() < 0.06
    _, phase, _, crossing = control.margin(exact)
    assert np.degrees(found.margins["phase"]) == pytest.approx(phase, abs=1.0)
    assert found.margins["phase_frequency"] == pytest.approx(crossing / (2.0 * np.pi), rel=0.02)
    assert found.margins["distance"] == pytest.approx(np.abs(1.0 + wanted).min(), rel=0.01)
    again = loop.Loop(robot, "knee.torque_command", amplitude=8.0, plant=plant)
    assert np.array_equal(found.response, again.response)


@pytest.mark.soak
@pytest.mark.parametrize("robot", [robot for robot in ROBOTS if robot not in SUITS])
def test_the_loop_of_a_robot_is_that_of_finite_differences_with_one_sine(robot, monkeypatch):
    """Within its stated error, where L is largest: in walking, other sines at once add to the response to one."""
    _, diagram = load(path(robot))
    drive = next(each.path for each in diagram if isinstance(each, Actuator) and not each.path.startswith("right/"))
    found = loop.Loop(path(robot), f"{drive}.torque_command")
    at = int(np.abs(found.response).argmax())
    for name, value in (("LOWEST", found.frequencies[at]), ("HIGHEST", found.frequencies[at] / found.rate)):
        monkeypatch.setattr(excitation, name, value)
    monkeypatch.setattr(excitation, "TONES", 1)
    monkeypatch.setattr(excitation, "SHARE", 0.1)
    alone = loop.Loop(path(robot), f"{drive}.torque_command")
    assert alone.frequencies.tolist() == [found.frequencies[at]]
    wrong = float(np.abs((alone.response[0] - found.response[at]) / (1.0 + found.response[at])))
    assert wrong < 1.25 * found.error[at]


def switching():
    with Diagram("switching", rate=RATE) as diagram:
        knee = CubeMars("AK80-9", bus="leg", can_id=1, name="knee")
        braking = Gain(3.0)(Sign()(knee.velocity))
        knee(torque_command=TorqueLimiter(limit=9.0)(Gain(-1.0, unit="N·m")(braking)))
    return diagram


@pytest.mark.soak
def test_a_loop_that_does_not_respond_linearly_has_no_margins(tmp_path):
    found = loop.Loop(switching, "knee.torque_command", plant=plant)
    assert not found.linear and "margins: none, because the loop does not respond linearly" in "\n".join(found.lines())
    with open(tmp_path / "loop.svg", "wb") as file:
        found.draw(file, "svg")
    assert "sensitivity" in (tmp_path / "loop.svg").read_text()

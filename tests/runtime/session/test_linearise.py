"""Linearisation of diagrams, and margins of a loop: against python-control and closed forms."""

import math
import re

import numpy as np
import pytest

import runtime
from blocks.actuators import CubeMars
from blocks.continuous import MassSpringDamper, Pendulum
from blocks.controllers import PID
from blocks.discrete import Delay, UnitDelay
from blocks.limiters import Saturation
from blocks.linear import StateSpace, TransferFunction
from blocks.mathematics import Gain
from blocks.sources import Constant
from graph import Block, Diagram, Input, Output
from runtime.host.errors import BadInput
from tests.docs.pages import DOCS

control = pytest.importorskip("control")
loop = pytest.importorskip("runtime.session.loop")

RATE = 200.0
G = 9.80665


def swing(start=0.3, delay=3, settled=True):
    """A pendulum under PID control, the measurement some ticks old."""
    with Diagram("swing", rate=RATE, solver="dopri5") as diagram:
        pendulum = Pendulum(mass=2.0, length=0.4, damping=0.1, start=start, name="pendulum")
        old = Delay(delay, name="bus")(pendulum.position)
        pid = PID(kp=12.0, ki=8.0, kd=1.5, unit="N*m", name="pid")
        pendulum(torque=pid(reference=Constant(start, unit="rad")(), measurement=old))
    return diagram


def test_a_pendulum_is_linearised_at_the_angle_where_it_rests():
    """After 20 s it rests at 0.3 rad: m l² θ'' = τ - d θ' - m g l cos(0.3) θ, held between ticks."""
    system = runtime.linearise(swing(), ["pendulum.torque"], ["pendulum.position", "pendulum.velocity"], at=20.0)
    J, stiffness = 2.0 * 0.4**2, 2.0 * G * 0.4 * math.cos(0.3)
    plant = control.ss([[0.0, 1.0], [-stiffness / J, -0.1 / J]], [[0.0], [1.0 / J]], np.eye(2), np.zeros((2, 1)))
    exact = control.sample_system(plant, 1.0 / RATE, "zoh")
    assert system.dt == 1.0 / RATE and system.nstates == 2
    assert system.input_labels == ["pendulum:torque"] and system.units["pendulum.torque"] == "N·m"
    assert system.output_labels == ["pendulum:position", "pendulum:velocity"]
    z = np.exp(2j * np.pi * np.geomspace(0.01, 90.0, 50) / RATE)
    assert np.abs(system(z) / exact(z) - 1.0).max() < 1e-4


def test_a_pendulum_is_trimmed_at_the_torque_of_its_weight_and_linearised_there():
    """Held at 30° by m g l sin 30°, far from the 0.3 rad of its own loop."""
    weight, angle = 2.0 * G * 0.4, math.radians(30.0)
    torque, position = {"pendulum.torque": None}, {"pendulum.position": angle, "pendulum.velocity": None}
    point = runtime.trim(swing(), torque, position)
    assert point.inputs["pendulum.torque"] == pytest.approx(weight / 2.0, abs=1e-9)
    assert point.units["pendulum.torque"] == "N·m" and point.residual < 1e-8
    assert point.outputs["pendulum.position"] == pytest.approx(angle, abs=1e-9)
    assert point.outputs["pendulum.velocity"] == pytest.approx(0.0, abs=1e-9)
    assert runtime.trim(swing(), {"pendulum.torque": weight / 2.0}, {"pendulum.position": None}).outputs[
        "pendulum.position"
    ] == pytest.approx(angle, abs=1e-9)
    system = runtime.linearise(swing(), ["pendulum.torque"], ["pendulum.position"], at=point)
    J, stiffness = 2.0 * 0.4**2, weight * math.cos(angle)
    plant = control.sample_system(control.tf(1.0, [J, 0.1, stiffness]), 1.0 / RATE, "zoh")
    z = np.exp(2j * np.pi * np.geomspace(0.01, 90.0, 50) / RATE)
    assert np.abs(system(z) / plant(z) - 1.0).max() < 1e-4


def test_a_closed_loop_is_trimmed_through_its_delay_and_integrator():
    """The PID's integral rests at the torque of the weight, from the start of the run, where it is 0."""
    point = runtime.trim(swing(), outputs={"pid.command": None, "pendulum.position": None})
    assert point.outputs["pendulum.position"] == pytest.approx(0.3, abs=1e-8)
    assert point.outputs["pid.command"] == pytest.approx(2.0 * G * 0.4 * math.sin(0.3), abs=1e-7)
    with pytest.raises(
        BadInput, match="the steady state is of other blocks than loop: use the diagram that was trimmed"
    ):
        runtime.linearise(around(UnitDelay), ["mass.force"], ["mass.position"], at=point)


@pytest.mark.parametrize(
    "inputs, outputs, said",
    [
        (
            {"pendulum.torque": 9.0},
            {},
            r"swing has no steady state near 0 s: pendulum\..* changes by .*; free an input",
        ),
        ({"pendulum.torque": 1.0}, {"pendulum.position": 1.0}, "no steady state near 0 s"),
        ({"pendulum.torque": None}, {}, "more inputs to find .1. than values of outputs .0.: give a value"),
        ({}, {"pendulum.position": (1.0, 2.0)}, r"pendulum.position cannot be \(1.0, 2.0\): give 1 finite number"),
        ({"pendulum.torque": math.nan}, {}, "pendulum.torque cannot be nan: give 1 finite number"),
        (
            ["pendulum.torque"],
            {},
            r"inputs are {name: value}, with None for a value to find, got \['pendulum.torque'\]",
        ),
        ({}, {"pendulum.positon": 1.0}, "no signal 'pendulum.positon': did you mean"),
    ],
)
def test_a_diagram_without_that_steady_state_is_an_error(inputs, outputs, said):
    """The weight is at most m g l = 7.8 N·m, so that 9 N·m turn the pendulum for ever."""
    with pytest.raises(BadInput, match=said):
        runtime.trim(swing(), inputs, outputs)


@pytest.mark.parametrize("at", [-1.0, math.nan, math.inf])
def test_a_time_outside_the_run_is_an_error(at):
    with pytest.raises(BadInput, match="the time must be a finite number of seconds from 0, got at="):
        runtime.trim(swing(), {"pendulum.torque": None}, {"pendulum.position": 0.1}, at=at)
    with pytest.raises(BadInput, match="the time must be a finite number of seconds from 0, got at="):
        runtime.linearise(swing(), ["pendulum.torque"], ["pendulum.position"], at=at)


def test_a_saturated_controller_has_no_steady_state_and_the_error_names_what_still_changes():
    diagram = swing()
    diagram["pid"].upper = 1.0  # N·m: below the weight at 0.3 rad, so that it rests elsewhere
    with pytest.raises(BadInput, match="pendulum.position is .* from its value"):
        runtime.trim(diagram, {}, {"pendulum.position": 0.3})


def test_margins_of_a_loop_are_those_of_its_equations_with_the_delay():
    """Linear throughout: a mass, two ticks of a bus, a PD as a transfer function."""
    with Diagram("linear", rate=RATE) as diagram:
        mass = StateSpace(((0.0, 1.0), (-5.0, -2.0)), ((0.0,), (4.0,)), ((1.0, 0.0),), domain="s", name="mass")
        law = TransferFunction((31.0, -30.0), (1.0, -0.2), name="law")(Delay(2)(mass.y))
        mass(Gain(-1.0, name="sign")(law))
    found = loop.Loop(diagram, "mass.u")
    plant = control.sample_system(control.tf(4.0, [1.0, 2.0, 5.0]), 1.0 / RATE, "zoh")
    wanted = plant * control.tf([31.0, -30.0], [1.0, -0.2], 1.0 / RATE) * control.tf(1.0, [1.0, 0.0, 0.0], 1.0 / RATE)
    exact = wanted(np.exp(2j * np.pi * found.frequencies / RATE))
    assert np.abs(found.response / exact - 1.0).max() < 1e-6
    gain, phase, _, crossing = control.margin(control.frd(exact, 2.0 * np.pi * found.frequencies))
    assert found.margins["gain"] == pytest.approx(gain, rel=1e-6)
    assert math.degrees(found.margins["phase"]) == pytest.approx(phase, abs=1e-4)
    assert found.margins["delay"] == pytest.approx(math.radians(phase) / crossing, rel=1e-6)
    poles = control.feedback(wanted, 1).poles()
    assert found.margins["pole"] == pytest.approx(np.abs(poles).max(), abs=1e-6)


@pytest.mark.soak
def test_the_delay_margin_is_the_delay_at_which_the_simulated_loop_becomes_unstable():
    """Another two ticks less than the margin decay, two more than it grow: seen in the simulation itself."""
    found = loop.Loop(swing(delay=1), "pendulum.torque", at=20.0)
    ticks = math.floor(found.margins["delay"] * RATE)
    assert 5 < ticks < 100 and found.margins["pole"] < 1.0

    def grows(extra):
        with Diagram("kicked", rate=RATE, solver="dopri5") as diagram:
            pendulum = Pendulum(mass=2.0, length=0.4, damping=0.1, start=0.301, name="pendulum")
            old = Delay(1 + extra, initial=0.301)(pendulum.position)
            pid = PID(kp=12.0, ki=8.0, kd=1.5, unit="N*m")(reference=0.3, measurement=old)
            pendulum(torque=pid)
        error = np.abs(runtime.run(diagram, 40.0)["pendulum.position"] - 0.3)
        return error[-1000:].max() > error[2000:3000].max()

    assert not grows(ticks - 2) and grows(ticks + 2)


def test_the_command_prints_the_margins_and_draws_them(tmp_path, command_line):
    file = tmp_path / "swing.py"
    file.write_text(
        "from blocks.continuous import MassSpringDamper\nfrom blocks.mathematics import Gain\n"
        "from graph import Diagram\n"
        "with Diagram('swing', rate=200) as diagram:\n    mass = MassSpringDamper(damping=1.0, name='mass')\n"
        "    mass(force=Gain(-9.0, unit='N/m')(mass.position))\n"
    )
    code, out, err = command_line("analyse", str(file), "--loop", "mass.force", "-o", str(tmp_path / "loop.svg"))
    assert (code, err) == (0, "")
    for part in ("loop opened at mass.force, after gain.y", "gain margin", "phase margin", "delay margin", "stable, "):
        assert part in out
    drawn = (tmp_path / "loop.svg").read_text()
    assert all(label in drawn for label in ("|L| [dB]", "Re L", "zeros of L", "closed loop, unit step"))
    assert "no signal is connected to 'mass.forc': choose one of gain.u, mass.force" in command_line.refused(
        "analyse", str(file), "--loop", "mass.forc"
    )


@pytest.mark.soak
def test_a_gain_is_tuned_to_the_distance_and_beyond_reach_it_is_an_error(tmp_path, command_line):
    """A damped mass behind three ticks: the least sensitivity has the highest gain that keeps the distance."""
    file = tmp_path / "swing.py"
    file.write_text(
        "from blocks.continuous import MassSpringDamper\nfrom blocks.discrete import Delay\n"
        "from blocks.mathematics import Gain\nfrom graph import Diagram\n"
        "with Diagram('swing', rate=200) as diagram:\n    mass = MassSpringDamper(damping=1.0, name='mass')\n"
        "    mass(force=Gain(-5.0, unit='N/m', name='gain')(Delay(3)(mass.position)))\n"
    )
    words = ("analyse", str(file), "--loop", "mass.force", "--tune", "gain.gain", "-o", str(tmp_path / "loop.svg"))
    code, out, err = command_line(*words)
    assert (code, err) == (0, "")
    gain = -float(out.split("gain.gain=")[1].split()[0])
    plant = control.sample_system(control.tf(1.0, [1.0, 1.0, 0.0]), 1.0 / RATE, "zoh")
    z = np.exp(2j * np.pi * np.geomspace(0.01, 99.0, 20000) / RATE)
    nearest = np.abs(1.0 + gain * plant(z) * z**-3).min()
    assert gain < 5.0 and nearest == pytest.approx(0.6, abs=0.01)
    for given, said in (("gain.gian", "name a parameter"), ("mass.start", "other than 0")):
        assert said in command_line.refused(*words[:5], given)
    assert "above 0 and below 1" in command_line.refused(*words, "--distance", "1.5")


@pytest.mark.soak
def test_the_tuned_pid_of_the_page_settles_after_a_step(tmp_path):
    """Zeros of the PID beside the poles of the pendulum keep the least |1 + L|, and ring for 25 s."""
    from runtime.session.loop_tuning import tune

    page = (DOCS / "how_to" / "analysis.md").read_text()
    (tmp_path / "swing.py").write_text(re.search("```python\n(.*?)```", page, re.DOTALL)[1])
    found, gains = tune(tmp_path / "swing.py", "shank.torque", ["pid.kp", "pid.ki", "pid.kd"], 0.6, at=5.0)
    assert "tuned: " + " ".join(f"--set {name}={value:g}" for name, value in gains.items()) in page
    poles = np.log(np.array([pole for pole in found.closed.poles() if abs(pole) > 0.5], complex))
    assert (-poles.real / np.abs(poles)).min() >= found.margins["damping"] >= 0.39
    assert found.margins["distance"] >= 0.588
    times, step = found.step_response()
    assert step.max() < 1.285 and np.abs(step[times > 1.0] - 1.0).max() < 0.02


def test_a_state_that_rests_where_its_memory_is_shifted_is_a_state():
    """Mass and damping of 1: a force of d v keeps the velocity."""
    with Diagram("loop", rate=RATE) as diagram:
        mass = MassSpringDamper(damping=1.0, name="mass")
        mass(force=Gain(-9.0, unit="N/m")(mass.position))
    system = runtime.linearise(diagram, ["mass.force"], ["mass.position"])
    assert system.nstates == 2 and sorted(np.abs(system.poles())) == pytest.approx([math.exp(-1.0 / RATE), 1.0])


class Counting(Block):
    """A block with state in Python."""

    u = Input("any", "input")
    y = Output("any", "input plus the number of steps")

    def reset(self):
        self.steps = 0

    def step(self, u):
        self.steps += 1
        return u + self.steps


def robot():
    with Diagram("robot", rate=RATE) as diagram:
        knee = CubeMars("AK80-9", bus="leg", can_id=1, name="knee")
        knee(torque_command=Saturation(lower=-5.0, upper=5.0)(Gain(-2.0, unit="N*m/rad")(knee.position)))
    return diagram


def around(make):
    with Diagram("loop", rate=RATE) as diagram:
        mass = MassSpringDamper(damping=1.0, start=1.0, name="mass")
        mass(force=make()(Gain(-9.0, unit="N/m")(mass.position)))
    return diagram


@pytest.mark.parametrize(
    "diagram, inputs, outputs, said",
    [
        (robot, ["knee.torque_command"], ["knee.position"], "knee is a device"),
        (lambda: around(Counting), ["mass.force"], ["mass.position"], "counting has state in Python"),
        (lambda: around(lambda: UnitDelay(every=2)), ["mass.force"], ["mass.position"], "does not run at every tick"),
        (
            lambda: around(UnitDelay),
            ["mass.forc"],
            ["mass.position"],
            "no input 'mass.forc': did you mean 'mass.force'",
        ),
        (lambda: around(UnitDelay), ["mass.force"], ["mass.positon"], "no signal 'mass.positon': did you mean"),
        (
            lambda: around(lambda: Saturation(lower=-9.0, upper=9.0)),
            ["gain.u"],
            ["saturation.y"],
            "does not respond linearly here",
        ),
    ],
)
def test_a_diagram_without_a_linear_model_is_an_error(diagram, inputs, outputs, said):
    with pytest.raises(BadInput, match=said):
        runtime.linearise(diagram(), inputs, outputs)

"""Continuous states: the solvers against closed forms, over wires, in Python, native and compiled."""

import math

import numpy as np
import pytest
from scipy import signal, special

import runtime
from blocks.actuators import CubeMars
from blocks.continuous import ContinuousIntegrator, DirectCurrentMotor, MassSpringDamper, Pendulum
from blocks.discrete import Integrator, UnitDelay
from blocks.limiters import TorqueLimiter
from blocks.linear import StateSpace
from blocks.mathematics import Gain
from blocks.trigonometry import Sin
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, DiagramError, Input, Output, Param, compile, jit, subsystem
from graph.continuous import Continuous
from graph.solvers import SOLVERS
from graph.store import from_json, to_json
from tests.blocks.playing import taker
from tests.checkout import ROOT

G, LENGTH, START = 9.80665, 0.5, 1.0
ORDERS = [("euler", 1), ("heun", 2), ("rk4", 4), ("dopri5", 5)]


class InPython(Continuous):
    """The undamped pendulum of 0.5 m, in Python."""

    start = Param(START, "rad", "angle at the start", fixed=True)
    length = Param(LENGTH, "m", "length")
    torque = Input("N·m", "torque", default=0.0)
    position = Output("rad", "angle")
    velocity = Output("rad/s", "velocity")

    def initial(self):
        return self.start, 0.0

    def derivative(self, position, velocity, torque):
        weight = 1.0 * self.length
        return velocity, (torque - 0.0 * velocity - weight * 9.80665 * math.sin(position)) / (weight * self.length)


class Compiled(InPython):
    """The same, compiled by Numba."""

    jit = True


def swing(make, rate, duration=10.0, solver="rk4"):
    """(position, velocity) of what `make` makes, arrays over the ticks."""
    ticks = round(duration * rate) + 1
    with Diagram("swing", rate, solver=solver) as diagram:
        position, velocity = make()
        takers = taker(position, (), ticks), taker(velocity, (), ticks)
    Executor(Program(compile(diagram)), rate).spin(ticks)
    return takers


def drawn():
    """The undamped pendulum of integrators: its equation crosses three wires."""
    velocity, position = ContinuousIntegrator(name="velocity"), ContinuousIntegrator(start=START, name="position")
    position(velocity.y)
    velocity(Gain(-G / LENGTH, unit="rad/s^2")(Sin()(position.y)))
    return position.y, velocity.y


def closed_form(t):
    """Angle of the undamped pendulum, from Jacobi's elliptic functions."""
    m = math.sin(START / 2.0) ** 2
    sn, *_ = special.ellipj(special.ellipk(m) - math.sqrt(G / LENGTH) * t, m)
    return 2.0 * np.arcsin(math.sqrt(m) * sn)


def block_of(kind, **parameters):
    def make():
        block = kind(**parameters)
        block()
        return block.position, block.velocity

    return make


NATIVE = block_of(Pendulum, start=START, length=LENGTH)


def test_a_pendulum_keeps_its_energy_and_follows_the_closed_form():
    """At 1 kHz and over 10 s: angle within 1e-9 rad, energy within 1e-9 of that at the start."""
    position, velocity = swing(NATIVE, 1000.0)
    energy = velocity**2 / 2.0 - G / LENGTH * np.cos(position)
    assert np.abs(position - closed_form(np.arange(10001) / 1000.0)).max() < 1e-9
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-9


@pytest.mark.parametrize("solver, order", ORDERS)
def test_the_error_of_a_solver_falls_with_its_order(solver, order):
    errors = []
    for rate in (100.0, 200.0):
        position, _ = swing(NATIVE, rate, 2.0, solver)
        errors.append(np.abs(position - closed_form(np.arange(len(position)) / rate)).max())
    assert 0.8 * 2.0**order < errors[0] / errors[1] < 1.5 * 2.0**order


def discrete():
    """The pendulum of two discrete integrators."""
    velocity, position = Integrator(name="velocity"), Integrator(initial=START, name="position")
    position(velocity.y)
    velocity(Gain(-G / LENGTH, unit="rad/s^2")(Sin()(position.y)))
    return position.y, velocity.y


def table():
    """Rows of the table of errors on the page."""
    rows = [("two `Integrator`", 1, discrete, "rk4")]
    rows += [(f"`{solver}`", order, NATIVE, solver) for solver, order in ORDERS]
    for name, order, make, solver in rows:
        errors = []
        for rate in (100.0, 200.0, 500.0, 1000.0):
            position, _ = swing(make, rate, 10.0, solver)
            errors.append(np.abs(position - closed_form(np.arange(len(position)) / rate)).max())
        yield (
            " | ".join(
                [f"| {name} | {order}", *("below 1e-11" if error < 1e-11 else f"{error:.0e}" for error in errors)]
            )
            + " |"
        )


def test_the_table_of_errors_on_the_page_is_measured():
    page = (ROOT / "docs" / "how_to" / "continuous_plants.md").read_text()
    assert "\n".join(table()) in page


def test_python_native_compiled_and_drawn_pendulums_are_the_same():
    native = swing(NATIVE, 200.0)
    assert [x.tolist() for x in swing(block_of(InPython), 200.0)] == [x.tolist() for x in native]
    if jit.available():
        compiled = swing(block_of(Compiled), 200.0)
        assert np.abs(np.subtract(compiled, native)).max() < 1e-12
    assert np.abs(np.subtract(swing(drawn, 200.0), native)).max() < 1e-12
    assert np.abs(swing(NATIVE, 200.0)[0] - closed_form(np.arange(2001) / 200.0)).max() < 1e-7


def test_signals_of_a_tick_are_those_of_its_states_and_discrete_blocks_are_sampled_once():
    with Diagram("mixed", 100.0, "dopri5") as diagram:
        mass = MassSpringDamper(mass=2.0, damping=0.5, stiffness=30.0, start=0.1)
        old = UnitDelay()
        doubled = Gain(2.0)(mass.position)
        old(doubled)
        mass(force=Gain(-3.0, unit="N/m")(old.y))
        seen = [taker(each, (), 300) for each in (mass.position, doubled, old.y)]
    Executor(Program(compile(diagram)), 100.0).spin(300)
    position, twice, before = seen
    assert np.array_equal(twice, 2.0 * position) and np.array_equal(before[1:], twice[:-1])
    # the exact response to a force that is constant between ticks
    a, b = np.array([[0.0, 1.0], [-15.0, -0.25]]), np.array([[0.0], [0.5]])
    A, B, C, D, _ = signal.cont2discrete((a, b, np.array([[1.0, 0.0]]), np.zeros((1, 1))), 0.01)
    wanted = signal.dlsim((A, B, C, D, 0.01), -3.0 * before, x0=(0.1, 0.0))[1][:, 0]
    assert np.abs(position - wanted).max() < 1e-9


def test_a_stiff_motor_reaches_its_closed_form_speed():
    """Without friction, a linear system with time constants of 0.7 ms and 3.7 ms; exact by StateSpace."""
    J, L, R, k, d = 1e-4, 2e-4, 0.3, 0.09, 1e-4
    with Diagram("motor", 20000.0) as diagram:
        motor = DirectCurrentMotor(friction=0.0)
        motor(voltage=24.0)
        exact = StateSpace(((-d / J, k / J), (-k / L, -R / L)), ((0.0,), (1.0 / L,)), ((1.0, 0.0),), domain="s")
        seen = taker(motor.velocity, (), 4000), taker(exact(24.0), (), 4000)
    Executor(Program(compile(diagram)), 20000.0).spin(4000)
    assert np.abs(seen[0] - seen[1]).max() < 1e-5 and seen[0][-1] == pytest.approx(24.0 * k / (k * k + R * d), rel=1e-9)


def robot():
    with Diagram("robot", rate=200) as diagram:
        knee = CubeMars("AK80-9", bus="leg", can_id=1, name="knee")
        knee(torque_command=TorqueLimiter(limit=5.0)(Gain(-2.0, unit="N*m/rad")(knee.position)))
    return diagram


def plant(diagram):
    with Diagram("plant", rate=5 * diagram.rate) as built:
        emulated = diagram["knee"].emulator()
        pendulum = Pendulum(mass=3.0, length=0.4, damping=0.3, start=0.5)
        pendulum(torque=emulated.torque)
        emulated(position=pendulum.position, velocity=pendulum.velocity)
    return built


def test_a_robot_moves_a_pendulum_and_the_run_is_repeated_bit_for_bit():
    runs = [runtime.run(robot, 2.0, plant=plant, plant_signals="pendulum") for _ in range(2)]
    assert runs[0].fault is None and np.ptp(runs[0]["plant/pendulum.position"]) > 0.5
    for name in ("knee.position", "plant/pendulum.position", "plant/pendulum.velocity"):
        assert np.array_equal(runs[0][name], runs[1][name])


def test_the_solver_is_part_of_the_diagrams_text():
    with Diagram("swing", 100.0, solver="euler") as diagram:
        Pendulum(start=0.1)()
    assert from_json(to_json(diagram)).solver == "euler"


def test_mistakes_are_reported():
    with pytest.raises(DiagramError, match=f"the solver must be one of {', '.join(SOLVERS)}, got 'rk45'"):
        Diagram("d", 100.0, solver="rk45")
    with Diagram("robot", 200.0) as diagram:
        knee = CubeMars("AK80-9", bus="leg", can_id=1, name="knee")
        knee(torque_command=TorqueLimiter(limit=5.0)(Pendulum(start=0.1)().position * 0.0))
    with pytest.raises(DiagramError) as complaint:
        compile(diagram)
    assert "TW038" in [each.code for each in complaint.value.diagnostics]
    with Diagram("slow", 200.0) as diagram:
        with subsystem("part", every=2):
            Pendulum()()
    with pytest.raises(DiagramError, match="must run in every tick"):
        compile(diagram)
    with pytest.raises(TypeError, match=r"define derivative\(self, ...\)"):
        type("Empty", (Continuous,), {"x": Output("m")})
    with pytest.raises(TypeError, match="takes 'y', which is neither a state"):
        type("Wrong", (Continuous,), {"x": Output("m"), "derivative": lambda self, y: y})


def test_a_block_alone_integrates_one_period_per_update():
    with Diagram("alone", 1000.0):
        pendulums = Pendulum(start=START), InPython()
    for pendulum in pendulums:
        for _ in range(1000):
            pendulum.step(0.0)
            pendulum.update(0.0)
        assert abs(pendulum.step(0.0)[0] - closed_form(np.array([1.0]))[0]) < 1e-9

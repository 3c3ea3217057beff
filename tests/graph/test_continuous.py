"""Continuous states: the solvers against closed forms, over wires, in Python, native and compiled."""

import math
from contextlib import nullcontext

import numpy as np
import pytest
from scipy import integrate, signal, special

import runtime
from blocks.actuators import CubeMars
from blocks.continuous import (
    BouncingMass,
    ContinuousIntegrator,
    DirectCurrentMotor,
    MassSpringDamper,
    MuscleTendon,
    Pendulum,
)
from blocks.discrete import Integrator, UnitDelay
from blocks.limiters import TorqueLimiter
from blocks.linear import StateSpace
from blocks.mathematics import Gain
from blocks.sources import Constant
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
    rows += [(f"`{solver}`", order, NATIVE, solver) for solver, order in (*ORDERS, ("rk45", "5, error control"))]
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


def fall(t, restitution, height=1.0):
    """Height of a mass above a floor, from the parabolas between its contacts."""
    contact = math.sqrt(2.0 * height / G)
    x, velocity = height - G * t**2 / 2.0, G * contact
    while velocity > 1e-4:
        velocity *= restitution
        after = t >= contact
        x[after] = (velocity * (t - contact) - G * (t - contact) ** 2 / 2.0)[after]
        contact += 2.0 * velocity / G
    x[t >= contact] = 0.0
    return x


class Ball(Continuous):
    """A mass above a floor in Python, whose jump leaves the height as it is."""

    position = Output("m", "height")
    velocity = Output("m/s", "velocity")

    def initial(self):
        return 1.0, 0.0

    def derivative(self, velocity):
        return velocity, -G

    def crossing(self, position):
        return position

    def jump(self, position, velocity):
        return position, -0.8 * velocity


@pytest.mark.parametrize("solver", ["rk4", "rk45"])
def test_a_mass_bounces_as_in_closed_form_until_it_rests(solver):
    """Contacts within a tick, many in one tick, and rest after 4.1 s."""
    position, velocity = swing(block_of(BouncingMass), 500.0, 6.0, solver)
    assert np.abs(position - fall(np.arange(3001) / 500.0, 0.8)).max() < 1e-12
    assert position[-1] == velocity[-1] == 0.0


class CompiledBall(Ball):
    """The same, compiled by Numba."""

    jit = True


@pytest.mark.parametrize("cls", [Ball, CompiledBall])
def test_a_block_in_python_states_an_event_and_its_jump(cls):
    position, _ = swing(block_of(cls), 100.0, 3.0)
    assert np.abs(position - fall(np.arange(301) / 100.0, 0.8)).max() < 1e-11
    with Diagram("alone", 100.0) as diagram:
        ball = cls()
    for index in range(300):
        assert abs(ball.step()[0] - position[index]) < 1e-12
        ball.update()
    python = [step.name for step in compile(diagram).update if step.function is not None]
    assert (not python) == (cls.jit and jit.available()), python


def test_events_that_accumulate_are_a_fault_with_the_cause():
    with Diagram("falling", 100.0) as diagram:
        Ball()()
    trial = runtime.run(diagram, 10.0)
    assert "20000 steps in one tick" in trial.fault["report"][0] and trial.fault["tick"] == 406


def test_error_control_follows_a_motor_that_is_faster_than_the_tick():
    """Time constant of 0.1 ms at 1 kHz, against SciPy at 1e-12; and it is the default."""
    with Diagram("motor", 1000.0) as diagram:
        motor = DirectCurrentMotor(inductance=3e-5)
        motor(voltage=24.0)
        seen = [taker(each, (), 500) for each in (motor.position, motor.velocity, motor.current)]
    Executor(Program(compile(diagram)), 1000.0).spin(500)

    def rates(_, x):
        friction = 1e-4 * x[1] + 0.01 * math.tanh(x[1] / 0.1)
        return x[1], (0.09 * x[2] - friction) / 1e-4, (24.0 - 0.3 * x[2] - 0.09 * x[1]) / 3e-5

    exact = integrate.solve_ivp(
        rates, (0.0, 0.5), (0.0,) * 3, "DOP853", np.arange(500) / 1000.0, rtol=1e-12, atol=1e-12
    )
    for found, wanted in zip(seen, exact.y):
        assert np.abs(found - wanted).max() < 1e-7 * np.abs(wanted).max()


def test_tolerances_of_the_error_set_it():
    """At 5 Hz the tick is no limit: the error falls with the tolerance, and is repeated bit for bit."""
    errors = []
    for rtol in (1e-5, 1e-8, 1e-11):
        with Diagram("swing", 5.0, rtol=rtol, atol=rtol) as diagram:
            seen = [taker(Pendulum(start=START)().position, (), 51) for _ in range(2)]
        Executor(Program(compile(diagram)), 5.0).spin(51)
        assert np.array_equal(*seen)
        errors.append(np.abs(seen[0] - closed_form(np.arange(51) / 5.0)).max())
    assert errors[0] < 1e-2 and errors[1] < 1e-4 * 2 and errors[2] < 1e-8


@pytest.mark.parametrize("solver, warned", [("rk4", True), ("dopri5", True), ("rk45", False)])
def test_a_fixed_step_that_is_too_long_is_a_warning(solver, warned):
    with Diagram("motor", 1000.0, solver=solver) as diagram:
        DirectCurrentMotor(inductance=3e-5)(voltage=24.0)
    found = [warning for warning in compile(diagram).warnings if warning.code == "TW039"]
    with pytest.warns(UserWarning, match="is 0.1 ms") if warned else nullcontext():
        runtime.run(diagram, 0.01)
    assert bool(found) == warned and ("time constant of the continuous states is 0.1 ms" in str(found)) == warned


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
    with Diagram("swing", 100.0, solver="euler", rtol=1e-3) as diagram:
        Pendulum(start=0.1)()
    read = from_json(to_json(diagram))
    assert (read.solver, read.tolerances) == ("euler", (1e-3, 1e-9))


def test_mistakes_are_reported():
    with pytest.raises(DiagramError, match=f"the solver must be one of {', '.join(SOLVERS)}, got 'ode45'"):
        Diagram("d", 100.0, solver="ode45")
    with pytest.raises(DiagramError, match="rtol must be in"):
        Diagram("d", 100.0, rtol=0.0)
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
    with pytest.raises(TypeError, match="both crossing"):
        type("Half", (Continuous,), {"x": Output("m"), "derivative": lambda self, x: x, "crossing": lambda self, x: x})
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


def test_a_muscle_on_its_tendon_is_that_of_its_equations():
    """A stretch of 10 mm at 2 Hz with a burst of excitation, against SciPy at 1e-12; the isometric force before it."""
    F0, fibre, tendon, pennation = 3000.0, 0.055, 0.25, 0.35

    def rates(excitation, t, x):
        a, F = x
        length, velocity = 0.31 + 0.01 * math.sin(4.0 * math.pi * t), 0.04 * math.pi * math.cos(4.0 * math.pi * t)
        along = length - tendon * (0.995 + math.log((F / F0 + 0.25) / 0.2) / 35.0)
        l, cosine = math.hypot(along, fibre * math.sin(pennation)) / fibre, 0.0  # noqa: E741
        cosine = along / (l * fibre)
        active = 0.815 * math.exp(-0.5 * ((l - 1.055) / (0.162 + 0.063 * l)) ** 2)
        active += 0.433 * math.exp(-0.5 * ((l - 0.717) / (-0.030 + 0.2 * l)) ** 2)
        active += 0.1 * math.exp(-0.5 * ((l - 1.0) / (0.5 * math.sqrt(0.5))) ** 2)
        passive = (math.exp(4.0 * (l - 1.0) / 0.6) - 1.0) / (math.exp(4.0) - 1.0)
        speed = (math.sinh(((F / F0 / cosine - passive) / (a * active) - 0.886) / -0.318) + 0.374) / -8.149
        f = 0.5 * math.tanh(0.1 * (excitation - a))
        change = (0.5 + f) / (0.015 * (0.5 + 1.5 * a)) + (0.5 - f) * (0.5 + 1.5 * a) / 0.06
        stiffness = 35.0 * F0 / tendon * (F / F0 + 0.25)
        return change * (excitation - a), stiffness * (velocity - speed * 10.0 * fibre / cosine)

    class Stretch(Continuous):
        """An oscillation with its velocity, continuous as the muscle."""

        length = Output("m", "length")
        velocity = Output("m/s", "velocity")

        def initial(self):
            return 0.31, 0.04 * math.pi

        def derivative(self, length, velocity):
            return velocity, -((4.0 * math.pi) ** 2) * (length - 0.31)

    ticks = 501
    with Diagram("calf", 1000.0, rtol=1e-9, atol=1e-9) as diagram:
        stretch = Stretch()
        excitation = Constant(0.7)()
        muscle = MuscleTendon(start_length=0.31)
        muscle(excitation=excitation, length=stretch.length, velocity=stretch.velocity)
        seen = taker(muscle.activation, (), ticks), taker(muscle.force, (), ticks)
    Executor(Program(compile(diagram)), 1000.0).spin(ticks)
    start = (seen[0][0], seen[1][0])
    still = rates(0.05, 0.0, start)
    assert still[0] == pytest.approx(0.0, abs=1e-9) and still[1] == pytest.approx(
        35.0 * F0 / tendon * (start[1] / F0 + 0.25) * 0.04 * math.pi, rel=1e-9
    )
    exact = integrate.solve_ivp(
        lambda t, x: rates(0.7, t, x), (0.0, 0.5), start, "Radau", np.arange(ticks) / 1000.0, rtol=1e-12, atol=1e-12
    )
    assert np.ptp(exact.y[1]) > 1000.0
    for found, wanted in zip(seen, exact.y):
        assert np.abs(found - wanted).max() < 1e-7 * np.abs(wanted).max()

"""Simulation of a robot without a rig: the file's plant, or every device emulated on a free inertia."""

import numpy as np
import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, DiagramError, compile, subsystem
from runtime.host.errors import BadInput
from runtime.robot.loading.file import load
from runtime.robot.loading.simulation import Simulation
from tests.runtime.runs import KNEE_EXO

TORQUE = 2.0  # N·m


def robot(rate=200):
    with Diagram("robot", rate=rate) as diagram:
        for side, can_id in (("left", 1), ("right", 2)):
            with subsystem(side):
                CubeMars("AK80-9", bus="legs", can_id=can_id, name="knee")(torque_command=TORQUE)
        CubeMars("AK10-9-V2.0", bus="hips", can_id=1, name="hip")(torque_command=-TORQUE)
        CsvRecorder()
    return diagram


def test_without_a_plant_every_actuator_turns_a_free_inertia():
    """I = 0.1 kg·m² with 0.1 N·m·s/rad of damping: ω goes to τ/d with a time constant of 1 s."""
    diagram = robot()
    schedule = compile(diagram)
    simulation = Simulation(None, diagram, schedule)
    assert not simulation.given and sorted(simulation.buses) == ["hips", "legs"]
    program = Program(schedule, simulation.ends())
    outcome = Executor(program, 200.0, plant=simulation.program, substeps=simulation.substeps, virtual=True).run(
        200, fade=0.0
    )
    assert (outcome.status, outcome.unconfirmed, outcome.unanswered) == ("ok", (), ())
    expected = TORQUE / 0.1 * (1.0 - np.exp(-1.0))
    for path, sign in (("left/knee", 1.0), ("right/knee", 1.0), ("hip", -1.0)):
        velocity = program.values[schedule.signals[f"{path}.velocity"].slot]
        assert velocity == pytest.approx(sign * expected, rel=0.02)  # two ticks of delay, and a code of torque


def test_a_robot_without_devices_has_no_plant():
    with Diagram("wave", rate=100) as diagram:
        Gain(2.0)(Sine()())
        CsvRecorder()
    simulation = Simulation(None, diagram, compile(diagram))
    assert (simulation.program, simulation.plant, simulation.ends(), simulation.substeps) == (None, None, [], 1)


def test_the_plant_of_the_file_receives_the_robot():
    file, diagram = load(KNEE_EXO)
    simulation = Simulation(file, diagram, compile(diagram))
    assert simulation.given and simulation.substeps == 5
    assert simulation.plant.name == "wearer" and simulation.plant.rate == 1000.0
    assert isinstance(simulation.diagram["left/emulated_cube_mars"], EmulatedCubeMars)


@pytest.mark.parametrize("rate, substeps", [(200, 1), (400, 2), (1000, 5), (200.00000001, 1)])
def test_the_plant_runs_at_an_integer_multiple_of_the_robots_rate(plant_of, rate, substeps):
    diagram = robot_of_one()
    assert Simulation(plant_of(rate), diagram, compile(diagram)).substeps == substeps


@pytest.mark.parametrize("rate", [100, 199, 300, 200.01])
def test_any_other_rate_of_the_plant_is_refused(plant_of, rate):
    diagram = robot_of_one()
    with pytest.raises(
        BadInput, match="not a whole multiple of the robot's 200 Hz: set a multiple, such as rate=5 [*] robot.rate"
    ):
        Simulation(plant_of(rate), diagram, compile(diagram))


def test_a_plant_on_a_bus_that_the_robot_has_not_is_refused(plant_of):
    diagram = robot_of_one()
    with pytest.raises(BadInput, match="a device on bus 'arms', but the robot's buses are legs"):
        Simulation(plant_of(1000, bus="arms"), diagram, compile(diagram))


def test_two_emulated_drives_on_one_id_are_refused(plant_of):
    diagram = robot_of_one()
    with pytest.raises(DiagramError) as refused:
        Simulation(plant_of(1000, ids=(1, 1)), diagram, compile(diagram))
    assert [diagnostic.code for diagnostic in refused.value.diagnostics] == ["TW013"]


def robot_of_one():
    with Diagram("robot", rate=200) as diagram:
        CubeMars("AK80-9", bus="legs", can_id=1, name="knee")(torque_command=0.0)
        CsvRecorder()
    return diagram


class PlantFile:
    """What a diagram file with a plant offers to a simulation."""

    path, has_plant, plant_parameters = "robot.py", True, {}

    def __init__(self, rate, bus, ids):
        self.rate, self.bus, self.ids = rate, bus, ids

    def function(self, name):
        return self.plant

    def plant(self, robot):
        with Diagram("plant", rate=self.rate) as plant:
            for can_id in self.ids:
                EmulatedCubeMars("AK80-9", bus=self.bus, can_id=can_id)(position=0.0, velocity=0.0)
        return plant


@pytest.fixture
def plant_of():
    return lambda rate, bus="legs", ids=(1,): PlantFile(rate, bus, ids)

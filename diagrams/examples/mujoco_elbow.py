"""Elbow exoskeleton on an arm of MyoSuite with six muscles. Its drive flexes the elbow as the muscles do.

    pip install --no-deps myo-sim
    python -m runtime diagrams/examples/mujoco_elbow.py --duration 6

The model myoelbow_1dof6muscles is that of myo-sim (Apache 2.0; Caggiano et al. 2022), which MuJoCo reads as it is. Its
biceps and brachialis are excited at 0.25 Hz.
"""

from importlib.util import find_spec
from pathlib import Path

from blocks.actuators import CubeMars
from blocks.limiters import TorqueLimiter
from blocks.mathematics import Gain
from blocks.mujoco import MujocoBody
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from graph import Diagram

MODEL = "models/legacy/elbow/myoelbow_1dof6muscles.xml"


def build(stiffness=1.0):
    """Return the robot: one drive, which bears a share of the weight. stiffness : N·m/rad of elbow flexion"""
    with Diagram("mujoco_elbow", rate=100) as diagram:
        elbow = CubeMars("AK80-9", bus="arm", can_id=1, name="elbow")
        elbow(torque_command=TorqueLimiter(limit=4.0)(Gain(stiffness, unit="N·m/rad")(elbow.position)))
        CsvRecorder()
    return diagram


def plant(robot):
    """Return the arm, at 5 steps per tick."""
    package = find_spec("myo_sim")
    if package is None or package.origin is None:
        raise ImportError("the arm is a model of myo-sim: pip install --no-deps myo-sim")
    with Diagram("arm", rate=5 * robot.rate) as diagram:
        elbow = robot["elbow"].emulator()
        arm = MujocoBody(str(Path(package.origin).parent / MODEL))
        elbow(position=arm.r_elbow_flex_position, velocity=arm.r_elbow_flex_velocity)
        effort = Sine(amplitude=0.05, bias=0.05, frequency=0.25, name="effort")()
        arm(r_elbow_flex_torque=elbow.torque, BIClong=effort, BICshort=effort, BRA=effort)
    return diagram

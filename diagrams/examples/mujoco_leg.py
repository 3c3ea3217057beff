"""Knee exoskeleton on a seated leg, which MuJoCo simulates. A spring of the drive lifts the shank.

    python -m runtime diagrams/examples/mujoco_leg.py --duration 5

Angles are knee extension: 0 rad where the shank hangs. The quadriceps extends the knee at 0.5 Hz.
"""

from blocks.actuators import CubeMars
from blocks.limiters import TorqueLimiter
from blocks.mathematics import Gain
from blocks.mujoco import MujocoBody
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from graph import Diagram


def build():
    """Return the robot: one drive, which adds a share of the weight of shank and foot."""
    with Diagram("mujoco_leg", rate=200) as diagram:
        knee = CubeMars("AK10-9-V2.0", bus="leg", can_id=1, name="knee")
        knee(torque_command=TorqueLimiter(limit=12.0, slew=200.0)(Gain(8.0, unit="N·m/rad")(knee.position)))
        CsvRecorder()
    return diagram


def plant(robot, seed=0):
    """Return the leg, at 5 steps per tick. seed : of the angle at the start"""
    with Diagram("leg", rate=5 * robot.rate) as diagram:
        knee = robot["knee"].emulator()
        leg = MujocoBody("leg.xml", spread=0.05, seed=seed)
        knee(position=leg.knee_position, velocity=leg.knee_velocity)
        leg(knee_torque=knee.torque, quadriceps=Sine(amplitude=4.0, frequency=0.5, name="effort")())
    return diagram

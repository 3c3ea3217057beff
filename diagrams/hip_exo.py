"""Hip exoskeleton: two AK80-9 actuators assist the thighs during walking, with an inertial sensor on each thigh.

    python -m runtime diagrams/hip_exo.py --duration 10
    python -m runtime diagrams/hip_exo.py --duration 10 --set gain=6

Delayed output feedback: τ = gain · (sin θ_left − sin θ_right)(t − delay) assists the right thigh forward and the left
one backward, a quarter of a stride after their largest separation in the opposite direction. It requires neither stride
nor gait phase. (Lim et al. 2019, IEEE Transactions on Robotics 35) Angles are flexion from upright; positive torque
flexes the hip.
"""

from blocks.actuators import CubeMars
from blocks.discrete import Delay
from blocks.filters import Butterworth
from blocks.imus import MicroStrain
from blocks.limiters import TorqueLimiter
from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from blocks.trigonometry import Sin
from blocks.wearer import SegmentIMU, Walker
from graph import Diagram, subsystem

RATE = 200.0  # Hz


def build(gain=4.0, delay=0.25):
    """Return the robot. gain : N·m; delay : s, about a quarter of a stride"""
    with Diagram("hip_exo", rate=RATE) as diagram:
        left, right = (thigh(side, serial) for side, serial in (("left", "133931"), ("right", "133932")))
        difference = Butterworth(order=2, cutoff=6.0)(Sin(name="left_sine")(left) - Sin(name="right_sine")(right))
        assistance = Gain(gain, unit="N·m", name="gain")(Delay(round(delay * RATE))(difference))
        hip("left", 1, Gain(-1.0, name="opposite")(assistance), invert=True)
        hip("right", 2, assistance, invert=False)
        CsvRecorder()
        PlotJuggler()
    return diagram


def thigh(side, serial):
    """Return the flexion of one thigh: the pitch of its sensor, x forward and z down when upright."""
    with subsystem(side):
        return MicroStrain(serial, channels=("accel", "gyro", "euler"), name="thigh_imu").euler[1]


def hip(side, can_id, torque, invert):
    """Command one hip actuator with a limited torque."""
    with subsystem(side):
        hip = CubeMars("AK80-9", bus="hips", can_id=can_id, invert=invert, name="hip")
        hip(torque_command=TorqueLimiter(limit=6.0, slew=100.0)(torque))


def plant(robot, speed=1.2):
    """Return the wearer, an average adult, with the sensors of the thighs. speed : m/s, or as in "0:0 2:1.2" """
    with Diagram("wearer", rate=5 * robot.rate) as wearer:
        adult = Walker(speed)
        drives = {side: robot[f"{side}/hip"].emulator() for side in ("left", "right")}
        motion = adult(left_hip_assistance=drives["left"].torque, right_hip_assistance=drives["right"].torque)
        for side, drive in drives.items():
            drive(position=getattr(motion, f"{side}_thigh_pitch"), velocity=getattr(motion, f"{side}_thigh_motion")[7])
            with subsystem(side):
                sensor = SegmentIMU(along=0.2, forward=0.08)(getattr(motion, f"{side}_thigh_motion"))
                imu = robot[f"{side}/thigh_imu"].emulator()
                imu(quaternion=sensor.quaternion, gyro=sensor.gyro, accel=sensor.accel)
    return wearer

"""Hip exoskeleton: two AK80-9 actuators assist the thighs during walking, with an inertial sensor on each thigh.

    python -m runtime diagrams/hip_exo.py --duration 10
    python -m runtime diagrams/hip_exo.py --duration 10 --set gain=6

Delayed output feedback: τ = gain · (sin θ_left − sin θ_right)(t − delay) assists the right thigh forward and the left
one backward, a quarter of a stride after their largest separation in the opposite direction. It requires neither stride
nor gait phase. (Lim et al. 2019, IEEE Transactions on Robotics 35) Angles are flexion from upright; positive torque
flexes the hip.
"""

from math import pi

from blocks.actuators import CubeMars
from blocks.discrete import Delay
from blocks.filters import Butterworth
from blocks.imus import MicroStrain
from blocks.limiters import TorqueLimiter
from blocks.mathematics import Gain
from blocks.models import Limb
from blocks.quaternions import QuaternionConjugate, QuaternionFromEuler, RotateVector
from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from blocks.sources import Sine
from blocks.trigonometry import Sin
from graph import Diagram, deg, stack, subsystem

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


def plant(robot, stride_time=1.1):
    """Return the wearer: thighs that swing by ±22° about 8° of flexion, half a stride apart, with their sensors."""
    with Diagram("wearer", rate=5 * robot.rate) as wearer:
        for side, start in (("left", 0.0), ("right", pi)):
            with subsystem(side):
                frequency, pace = 1.0 / stride_time, 2.0 * pi / stride_time
                angle = Sine(deg(22), frequency, start, bias=deg(8), unit="rad", name="angle")()
                acceleration = Sine(-deg(22) * pace**2, frequency, start, unit="rad/s²", name="acceleration")()
                rate = Sine(deg(22) * pace, frequency, start + pi / 2.0, unit="rad/s", name="rate")()
                drive = robot[f"{side}/hip"].emulator()
                limb = Limb(inertia=0.8, start=deg(8))
                limb(torque=drive.torque, angle=angle, rate=rate, acceleration=acceleration)
                drive(position=limb.position, velocity=limb.velocity)
                imu = robot[f"{side}/thigh_imu"].emulator()
                turned = QuaternionFromEuler()(0.0, limb.position, 0.0)
                weight = RotateVector()(QuaternionConjugate()(turned), (0.0, 0.0, -9.80665))
                imu(quaternion=turned, gyro=stack(0.0, limb.velocity, 0.0), accel=weight)
    return wearer

"""Hip exoskeleton: two AK80-9 actuators assist the thighs during walking, with an inertial sensor on each thigh.

    python -m runtime diagrams/hip_exo.py --duration 10
    python -m runtime diagrams/hip_exo.py --duration 10 --set gain=6

Delayed output feedback: τ = gain · (sin θ_left − sin θ_right)(t − delay) assists the right thigh forward and the left
one backward, a quarter of a stride after their largest separation in the opposite direction. (Lim et al. 2019, IEEE
Transactions on Robotics 35) The law needs no gait phase; the phases of both legs decide whether the wearer walks, and
the torque fades when that is not certain. Angles are flexion from upright; positive torque flexes the hip.
"""

from math import radians

from blocks.actuators import CubeMars
from blocks.gait import (
    DelayedOutputFeedback,
    GaitState,
    PhaseKalmanFilter,
    SegmentPosture,
    SensorPlacement,
    ThighEvents,
    TorqueGate,
)
from blocks.imus import MicroStrain
from blocks.limiters import TorqueLimiter
from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from blocks.wearer import SegmentIMU, Walker
from graph import Diagram, Live, subsystem


def build(gain=4.0, delay=0.25):
    """Return the robot. gain : N·m, 9 at most; delay : s, about a quarter of a stride"""
    with Diagram("hip_exo", rate=200) as diagram:
        left, right = thigh("left", "133931"), thigh("right", "133932")
        feedback = DelayedOutputFeedback(Live(gain, max=9.0), delay, name="feedback")(
            left_angle=left[0], right_angle=right[0]
        )
        state = GaitState(name="state")(
            **{f"left_{name}": signal for name, signal in left[1].items()},
            **{f"right_{name}": signal for name, signal in right[1].items()},
        )
        drives = (
            hip("left", 1, feedback.left_torque, state.walking, invert=True),
            hip("right", 2, feedback.right_torque, state.walking, invert=False),
        )
        SensorPlacement("thigh IMUs", "hip drives", name="placement")(
            left_reference=drives[0].velocity,
            right_reference=drives[1].velocity,
            left=left[1]["velocity"],
            right=right[1]["velocity"],
        )
        posture = SegmentPosture("thigh IMU", lowest=radians(-15.0), highest=radians(45.0), name="posture")
        posture(left=left[0], right=right[0], enable=state.walking)
        CsvRecorder()
        PlotJuggler()
    return diagram


def thigh(side, serial):
    """Return the flexion of one thigh, and its gait: phase, walking and velocity.

    The sensor is upright with x forward and z down, so its pitch is the flexion.
    """
    with subsystem(side):
        imu = MicroStrain(serial, channels=("accel", "gyro", "euler"), name="thigh_imu")
        angle, velocity = imu.euler[1], imu.gyro[1]
        strike = ThighEvents(name="events")(angle).strike
        gait = PhaseKalmanFilter(name="gait_phase")(angle=angle, velocity=velocity, strike=strike)
    return angle, {"phase": gait.phase, "walking": gait.walking, "velocity": velocity}


def hip(side, can_id, torque, walking, invert):
    """Command one hip actuator with a limited torque, while the wearer walks, and return it."""
    with subsystem(side):
        drive = CubeMars("AK80-9", bus="hips", can_id=can_id, invert=invert, name="hip")
        gated = TorqueGate(name="gate")(u=torque, enable=walking)
        drive(torque_command=TorqueLimiter(limit=6.0, slew=100.0)(gated))
    return drive


def plant(robot, speed="1.2", recording=""):
    """Return the wearer, an average adult, with the sensors of the thighs.

    speed : m/s, or as in "0:0 2:1.2"; recording : path of a recorded motion, as in Walker, instead
    """
    with Diagram("wearer", rate=5 * robot.rate) as wearer:
        adult = Walker(speed, recording=recording)
        drives = {side: robot[f"{side}/hip"].emulator() for side in ("left", "right")}
        motion = adult(left_hip_assistance=drives["left"].torque, right_hip_assistance=drives["right"].torque)
        for side, drive in drives.items():
            drive(position=getattr(motion, f"{side}_thigh_pitch"), velocity=getattr(motion, f"{side}_thigh_motion")[7])
            with subsystem(side):
                sensor = SegmentIMU(along=0.2, forward=0.08)(getattr(motion, f"{side}_thigh_motion"))
                imu = robot[f"{side}/thigh_imu"].emulator(name="thigh_imu")
                imu(quaternion=sensor.quaternion, gyro=sensor.gyro, accel=sensor.accel)
    return wearer

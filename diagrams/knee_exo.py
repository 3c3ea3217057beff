"""Knee exoskeleton: two AK10-9 actuators assist the knees during walking.

    python -m runtime diagrams/knee_exo.py --duration 10
    python -m runtime diagrams/knee_exo.py --duration 10 --set assistance=0.5
    python -m runtime diagrams/knee_exo.py --duration 10 --set gait=walking.csv

Angles are knee flexion: 0 rad with the leg straight, positive as it bends. Positive torque bends the knee.
"""

from blocks.actuators import CubeMars
from blocks.controllers import TorqueProfile
from blocks.filters import Butterworth
from blocks.gait import GaitState, KneeEvents, PhaseKalmanFilter, TorqueGate
from blocks.limiters import TorqueLimiter
from blocks.recorders import CsvRecorder, StrideReport
from blocks.sinks import PlotJuggler
from blocks.wearer import Walker, walking_speed
from graph import Diagram, subsystem

# Torque profile (gait phase, N·m) in the direction of motion: extend the knee in mid-stance, lift it into swing.
PROFILE = ((0.12, 0.0), (0.22, -9.0), (0.34, 0.0), (0.48, 0.0), (0.60, 7.0), (0.72, 0.0))


def build(assistance=1.0):
    """Return the robot. assistance : scale of the torque profile, from 0 to 1"""
    with Diagram("knee_exo", rate=200) as diagram:
        left, right = knee("left", 1, invert=False), knee("right", 2, invert=True)
        state = GaitState(motion="knee", name="state")(
            **{f"left_{name}": signal for name, signal in left[1].items()},
            **{f"right_{name}": signal for name, signal in right[1].items()},
        )
        for side, (drive, gait, uncertainty) in (("left", left), ("right", right)):
            assist(side, drive, gait, state.walking, uncertainty, assistance)
        CsvRecorder()
        PlotJuggler()
    return diagram


def knee(side, can_id, invert):
    """Return the actuator of one knee, its gait (phase, walking and velocity), and the uncertainty of the phase."""
    with subsystem(side):
        drive = CubeMars("AK10-9-V2.0", bus="legs", can_id=can_id, invert=invert, name="knee")
        velocity = Butterworth(order=2, cutoff=20.0)(drive.velocity)
        strike = KneeEvents(name="events")(angle=drive.position, velocity=drive.velocity).strike
        gait = PhaseKalmanFilter(name="gait_phase")(angle=drive.position, velocity=drive.velocity, strike=strike)
    return drive, {"phase": gait.phase, "walking": gait.walking, "velocity": velocity}, gait.uncertainty


def assist(side, knee, gait, walking, uncertainty, assistance):
    """Command one knee: the profile over the gait phase, which fades out when both legs do not walk."""
    with subsystem(side):
        profile = TorqueProfile(PROFILE, scale=assistance, name="profile")(phase=gait["phase"], enable=gait["walking"])
        gated = TorqueGate(name="gate")(u=profile, enable=walking, uncertainty=uncertainty)
        torque = TorqueLimiter(limit=12.0, slew=200.0)(gated)
        knee(torque_command=torque)
        StrideReport(positive="flexion")(angle=knee.position, torque=knee.torque, **gait)


def plant(robot, gait="", stride_time=1.1):
    """Return the wearer, an average adult, at 5 steps per tick. gait : recording of the joints of both legs"""
    with Diagram("wearer", rate=5 * robot.rate) as wearer:
        adult = Walker(walking_speed(stride_time), recording=gait, variability=0.0)
        drives = [drive_of(robot, side) for side in ("left", "right")]
        motion = adult(left_knee_assistance=drives[0].torque, right_knee_assistance=drives[1].torque)
        drives[0](position=motion.left_knee_angle, velocity=motion.left_knee_velocity)
        drives[1](position=motion.right_knee_angle, velocity=motion.right_knee_velocity)
    return wearer


def drive_of(robot, side):
    """Return the emulated drive of one knee, in the subsystem of its leg."""
    with subsystem(side):
        return robot[f"{side}/knee"].emulator()

"""Knee exoskeleton: two AK10-9 actuators assist the knees during walking.

    python -m runtime diagrams/knee_exo.py --duration 10
    python -m runtime diagrams/knee_exo.py --duration 10 --set assistance=0.5
    python -m runtime diagrams/knee_exo.py --duration 10 --set gait=walking.csv

Angles are knee flexion: 0 rad with the leg straight, positive as it bends. Positive torque bends the knee.
"""

from blocks.actuators import CubeMars
from blocks.controllers import GaitPhase, Impedance, TorqueProfile
from blocks.filters import Butterworth
from blocks.limiters import TorqueLimiter
from blocks.mathematics import Sum
from blocks.models import Limb, RecordedKnee, WalkingKnee
from blocks.recorders import CsvRecorder, StrideReport
from blocks.sinks import PlotJuggler
from graph import Diagram, deg, subsystem

# Torque profile (gait phase, N·m): support the knee under load, lift it into swing, brake it before heel strike.
PROFILE = ((0.02, 0.0), (0.14, -9.0), (0.32, 0.0), (0.48, 0.0), (0.60, 7.0), (0.74, 0.0), (0.88, 4.0), (0.97, 0.0))


def build(assistance=1.0):
    """Return the robot. assistance : scale of the torque profile, from 0 to 1"""
    with Diagram("knee_exo", rate=200) as diagram:
        leg("left", 1, assistance, invert=False)
        leg("right", 2, assistance, invert=True)
        CsvRecorder()
        PlotJuggler()
    return diagram


def leg(side, can_id, assistance, invert):
    """Add one leg, in the order of the signal flow: knee motion, gait phase, assistive torque."""
    with subsystem(side):
        knee = CubeMars("AK10-9-V2.0", bus="legs", can_id=can_id, invert=invert, name="knee")
        velocity = Butterworth(order=2, cutoff=20.0)(knee.velocity)

        gait = GaitPhase(threshold=0.7)(angle=knee.position, velocity=velocity)
        profile = TorqueProfile(PROFILE, scale=assistance, name="profile")(phase=gait.phase, enable=gait.walking)
        damper = Impedance(stiffness=0.0, damping=0.3, name="damper")(position=knee.position, velocity=velocity)

        torque = TorqueLimiter(limit=12.0, slew=200.0)(Sum("++")(profile, damper))
        knee(torque_command=torque)

        StrideReport(positive="flexion")(
            phase=gait.phase, walking=gait.walking, angle=knee.position, velocity=velocity, torque=knee.torque
        )


def plant(robot, gait="", stride_time=1.1):
    """Return the wearer, an average adult, at 5 steps per tick. gait : recording of knee flexion in degrees"""
    with Diagram("wearer", rate=5 * robot.rate) as wearer:
        for side, column, start in (("left", "knee_flexion_lt_deg", 0.0), ("right", "knee_flexion_rt_deg", 0.5)):
            with subsystem(side):
                motion = RecordedKnee(gait, column) if gait else WalkingKnee(stride_time, start)
                drive = robot[f"{side}/knee"].emulator()
                limb = Limb(inertia=0.35, lower=deg(-1), start=motion.at_start)
                limb(torque=drive.torque, angle=motion.angle, rate=motion.velocity, acceleration=motion.acceleration)
                drive(position=limb.position, velocity=limb.velocity)
    return wearer

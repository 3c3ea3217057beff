"""A knee exoskeleton: two AK10-9 actuators help the knees of someone who walks.

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

# Torque over the stride, (gait phase, N·m): hold the knee as it loads, lift it into swing, catch it before heel strike.
PROFILE = ((0.02, 0.0), (0.14, -9.0), (0.32, 0.0), (0.48, 0.0), (0.60, 7.0), (0.74, 0.0), (0.88, 4.0), (0.97, 0.0))


def build(assistance=1.0):
    """The robot. `assistance` is the share of the torque profile that is applied, from 0 to 1."""
    with Diagram("knee_exo", rate=200) as diagram:
        leg("left", 1, assistance, invert=False)
        leg("right", 2, assistance, invert=True)
        CsvRecorder()
        PlotJuggler()
    return diagram


def leg(side, can_id, assistance, invert):
    """One leg, read as the signal flows: what the knee does, where in the stride that is, what torque helps."""
    with subsystem(side):
        knee = CubeMars("AK10-9-V2.0", bus="legs", can_id=can_id, invert=invert, name="knee")
        velocity = Butterworth(order=2, cutoff=20.0)(knee.velocity)

        gait = GaitPhase(threshold=0.7)(angle=knee.position, velocity=velocity)
        profile = TorqueProfile(PROFILE, scale=assistance, name="profile")(phase=gait.phase, enable=gait.walking)
        damper = Impedance(stiffness=0.0, damping=0.3, name="damper")(position=knee.position, velocity=velocity)

        torque = TorqueLimiter(limit=12.0, slew=200.0)(Sum("++")(profile, damper))
        knee(torque_command=torque)

        StrideReport()(
            phase=gait.phase, walking=gait.walking, angle=knee.position, velocity=velocity, torque=knee.torque
        )


def plant(robot, gait="", stride_time=1.1):
    """The wearer: an average adult, or with `gait` a recording of knee flexion in degrees, at 5 steps a tick."""
    with Diagram("wearer", rate=5 * robot.rate) as wearer:
        for side, column, start in (("left", "knee_flexion_lt_deg", 0.0), ("right", "knee_flexion_rt_deg", 0.5)):
            with subsystem(side):
                motion = RecordedKnee(gait, column) if gait else WalkingKnee(stride_time, start)
                drive = robot[f"{side}/knee"].emulator()
                limb = Limb(inertia=0.35, lower=deg(-1), start=motion.at_start)
                limb(torque=drive.torque, angle=motion.angle, rate=motion.velocity, acceleration=motion.acceleration)
                drive(position=limb.position, velocity=limb.velocity)
    return wearer

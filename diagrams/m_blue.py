"""M-BLUE, a hip and knee orthosis of both legs: four AK80-9, whose encoders alone determine the gait phase.

    python -m runtime diagrams/m_blue.py --duration 20
    python -m runtime diagrams/m_blue.py --duration 20 --set assistance=0.5
    python -m runtime diagrams/m_blue.py --duration 20 --set speed=0.8 --set mass=110

Torque profiles over the gait phase extend the hip in early stance and flex it into swing, extend the knee in mid-stance
and flex it before swing. Each acts in the direction of motion.
"""

from blocks.controllers import TorqueProfile
from blocks.filters import Butterworth
from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from graph import Diagram, subsystem
from parts import PROFILES, SIDES, Motion, assist, drive, flexion, gait, walk
from wearer import wearer as plant  # noqa: F401


def build(assistance=1.0):
    """Return the robot. assistance : scale of both torque profiles, from 0 to 1"""
    with Diagram("m_blue", rate=200) as diagram:
        legs = {side: leg(side, first) for side, first in zip(SIDES, (1, 3))}
        walking = walk({side: phase for side, (_, phase) in legs.items()})
        for side, (drives, phase) in legs.items():
            with subsystem(side):
                for joint, points in PROFILES.items():
                    profile = TorqueProfile(points, scale=assistance, name=f"{joint}_profile")
                    torque = profile(phase=phase.phase, enable=phase.walking)
                    assist(drives[joint], torque, walking, phase, slew=200.0)
        CsvRecorder()
        PlotJuggler()
    return diagram


def leg(side, first):
    """Return the actuators of one leg by joint, and its Gait. first : CAN id of the hip"""
    with subsystem(side):
        drives = {joint: drive(side, joint, can_id) for can_id, joint in enumerate(PROFILES, first)}
        hip, knee = (motion(drives[joint], joint) for joint in PROFILES)
        return drives, gait(*hip, shank=flexion("shank", hip, knee))


def motion(drive, joint):
    """Return the Motion of a joint from its encoder."""
    return Motion(drive.position, Butterworth(order=2, cutoff=20.0, name=f"{joint}_velocity")(drive.velocity))

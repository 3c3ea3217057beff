"""Knee exoskeleton of Georgia Tech: two AK10-9, six inertial sensors and two insoles.

    python -m runtime diagrams/knee_exo_gatech.py --duration 20
    python -m runtime diagrams/knee_exo_gatech.py --duration 20 --set assistance=0.5
    python -m runtime diagrams/knee_exo_gatech.py --duration 20 --set speed=0.8 --set mass=110

The insole gives the strikes and the thigh the gait phase. A torque profile over the phase extends the knee in
mid-stance and flexes it before swing.
"""

from blocks.controllers import TorqueProfile
from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from graph import Diagram, subsystem
from parts import SEGMENTS, SIDES, assist, drive, flexion, gait, imu, insole, walk
from parts import wearer as plant  # noqa: F401

# Torque profile (gait phase, N·m).
PROFILE = ((0.16, 0.0), (0.24, -12.0), (0.34, 0.0), (0.48, 0.0), (0.60, 9.0), (0.70, 0.0))


def build(assistance=1.0):
    """Return the robot. assistance : scale of the torque profile, from 0 to 1"""
    with Diagram("knee_exo_gatech", rate=200) as diagram:
        legs = {side: leg(side, number) for number, side in enumerate(SIDES, 1)}
        walking = walk({side: gait for side, (_, gait) in legs.items()})
        for side, (knee, gait) in legs.items():
            with subsystem(side):
                torque = TorqueProfile(PROFILE, scale=assistance, name="profile")(phase=gait.phase, enable=gait.walking)
                assist(knee, torque, walking, gait, limit=12.0, slew=300.0)
        CsvRecorder()
        PlotJuggler()
    return diagram


def leg(side, number):
    """Return actuator and Gait of one leg, and measure its joints."""
    with subsystem(side):
        thigh, shank, foot = (imu(segment, f"1339{number}{place}") for place, segment in enumerate(SEGMENTS))
        flexion("knee", thigh, shank)
        flexion("ankle", foot, shank)
        knee = drive(side, "knee", number, "AK10-9-V2.0")
        return knee, gait(*thigh, insole(side).strike)

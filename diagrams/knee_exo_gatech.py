"""Knee exoskeleton of Georgia Tech: two AK10-9, six inertial sensors, two insoles and a neural network.

    python -m runtime diagrams/knee_exo_gatech.py --duration 20
    python -m runtime diagrams/knee_exo_gatech.py --duration 20 --set mass=90 --set share=0.2
    python -m runtime diagrams/knee_exo_gatech.py --duration 20 --set speed=0.8 --set mass=110

The network estimates the biological torque of each knee from the motion of thigh and shank. In mid-stance the actuator
adds a share of its extension torque, and before swing a profile flexes the knee. The insole gives the strikes and the
thigh the gait phase of both.
"""

from blocks.controllers import TorqueProfile
from blocks.gait import BiologicalTorque
from blocks.mathematics import Max, Min
from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from graph import Diagram, Live, subsystem
from parts import SEGMENTS, SIDES, assist, drive, flexion, gait, imu, insole, leg_torque, ordered, placed, rates, walk
from wearer import wearer as plant  # noqa: F401

# Torques over the gait phase, N·m: largest extension, and flexion.
EXTENSION = ((0.12, 0.0), (0.20, -12.0), (0.32, -12.0), (0.40, 0.0))
FLEXION = ((0.48, 0.0), (0.60, 9.0), (0.70, 0.0))


def build(mass=70.0, share=0.3, delay=0.1):
    """Return the robot. mass : mass of the wearer, kg; share, delay : share of the biological torque, its delay in s"""
    with Diagram("knee_exo_gatech", rate=200) as diagram:
        legs = {side: leg(side, number, mass) for number, side in enumerate(SIDES, 1)}
        walking = walk({side: phase for side, (phase, *_) in legs.items()})
        knees = {}
        for number, (side, (phase, torque, _)) in enumerate(legs.items(), 1):
            with subsystem(side):
                biological = BiologicalTorque(Live(share, max=0.5), delay, name="assistance")(torque)
                bound = TorqueProfile(EXTENSION, name="bound")(phase=phase.phase, enable=phase.walking)
                extension = Max(name="extension")(Min()(biological, 0.0), bound)
                flex = TorqueProfile(FLEXION, name="flexion")(phase=phase.phase, enable=phase.walking)
                knees[side] = drive(side, "knee", number, "AK10-9-V2.0")
                options = {"limit": 12.0, "slew": 300.0, "uncertainty": phase.uncertainty}
                assist(knees[side], extension + flex, walking, phase, **options)
        thighs, shanks, feet, loads = ({side: leg[2][place] for side, leg in legs.items()} for place in range(4))
        placed("shank IMUs", rates(shanks), "knee drives", rates(knees), opposite=True, enable=walking)
        placed("foot IMUs", rates(feet), "shank IMUs", rates(shanks), enable=walking)
        placed("insoles", loads, "shank IMUs", rates(shanks), opposite=True, enable=walking)
        placed("thigh IMUs", rates(thighs), "insoles", loads, opposite=True, enable=walking)
        ordered(walking, thigh=thighs, shank=shanks, foot=feet)
        CsvRecorder()
        PlotJuggler()
    return diagram


def leg(side, number, mass):
    """Return the Gait of one leg, the biological torque of its knee, and (Motion of its segments, load on its foot)."""
    with subsystem(side):
        thigh, shank, foot = (imu(segment, f"1339{number}{place}") for place, segment in enumerate(SEGMENTS))
        flexion("ankle", foot, shank)
        knee = flexion("knee", thigh, shank)
        sole = insole(side)
        signals = thigh, shank, foot, sole.load
        return gait(*thigh, sole.strike, shank), leg_torque("knee", knee, thigh, mass), signals

"""Sensor suit: five inertial sensors and two insoles measure joint angles, contact and gait phase of both legs.

    python -m runtime diagrams/sensor_suit_lite.py --duration 20
    python -m runtime diagrams/sensor_suit_lite.py --duration 20 --rerun
    python -m runtime diagrams/sensor_suit_lite.py --duration 20 --set speed=0.8 --set mass=110

The suit has no actuator: it records, and streams to PlotJuggler or Rerun. Its computer is a Raspberry Pi 5.
"""

from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from graph import Diagram, subsystem
from parts import SIDES, flexion, gait, imu, insole, ordered, placed, rates, walk
from wearer import wearer as plant  # noqa: F401


def build():
    """Return the robot."""
    with Diagram("sensor_suit_lite", rate=200) as diagram:
        pelvis = imu("pelvis", "134000")
        legs = {side: leg(side, pelvis, serial) for side, serial in zip(SIDES, (134001, 134003))}
        walking = walk({side: own for side, (own, _) in legs.items()})
        thighs, shanks, loads = ({side: signals[place] for side, (_, signals) in legs.items()} for place in range(3))
        placed("thigh IMUs", rates(thighs), "insoles", loads, opposite=True, enable=walking)
        placed("shank IMUs", rates(shanks), "insoles", loads, opposite=True, enable=walking)
        ordered(walking, thigh=thighs, shank=shanks)
        CsvRecorder()
        PlotJuggler()
    return diagram


def leg(side, pelvis, serial):
    """Return the Gait of one leg and (Motion of its segments, load on its foot). serial : sensor on the thigh"""
    with subsystem(side):
        thigh, shank = imu("thigh", str(serial)), imu("shank", str(serial + 1))
        flexion("hip", thigh, pelvis)
        flexion("knee", thigh, shank)
        sole = insole(side)
        return gait(*thigh, sole.strike), (thigh, shank, sole.load)

"""Sensor suit: six inertial sensors and two insoles measure the knees and ankles, and a network estimates knee torque.

    python -m runtime diagrams/sensor_suit.py --duration 20
    python -m runtime diagrams/sensor_suit.py --duration 20 --rerun
    python -m runtime diagrams/sensor_suit.py --duration 20 --set speed=0.8 --set mass=110

The network estimates the biological torque of each knee from the motion of thigh and shank. The suit has no actuator:
it records, and streams to PlotJuggler or Rerun.
"""

from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from graph import Diagram, subsystem
from parts import SEGMENTS, SIDES, flexion, gait, imu, insole, leg_torque, ordered, placed, rates, walk
from wearer import wearer as plant  # noqa: F401


def build(mass=70.0):
    """Return the robot. mass : mass of the wearer, kg"""
    with Diagram("sensor_suit", rate=200) as diagram:
        legs = {side: leg(side, serial, mass) for side, serial in zip(SIDES, (133951, 133954))}
        walking = walk({side: own for side, (own, _) in legs.items()})
        thighs, shanks, feet, loads = (
            {side: signals[place] for side, (_, signals) in legs.items()} for place in range(4)
        )
        placed("thigh IMUs", rates(thighs), "insoles", loads, opposite=True, enable=walking)
        placed("shank IMUs", rates(shanks), "insoles", loads, opposite=True, enable=walking)
        placed("foot IMUs", rates(feet), "shank IMUs", rates(shanks), enable=walking)
        ordered(walking, thigh=thighs, shank=shanks, foot=feet)
        CsvRecorder()
        PlotJuggler()
    return diagram


def leg(side, serial, mass):
    """Return the Gait of one leg and (Motion of its segments, load on its foot). serial : sensor on the thigh"""
    with subsystem(side):
        thigh, shank, foot = (imu(segment, str(number)) for number, segment in enumerate(SEGMENTS, serial))
        leg_torque("knee", flexion("knee", thigh, shank), thigh, mass)
        flexion("ankle", foot, shank)
        sole = insole(side)
        return gait(*thigh, sole.strike, shank), (thigh, shank, foot, sole.load)

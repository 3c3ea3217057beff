"""Sensor suit: six inertial sensors and two insoles measure the knees and ankles, and a network estimates knee torque.

    python -m runtime diagrams/sensor_suit.py --duration 20
    python -m runtime diagrams/sensor_suit.py --duration 20 --rerun
    python -m runtime diagrams/sensor_suit.py --duration 20 --set speed=0.8 --set mass=110

The suit has no actuator: it records, and streams to PlotJuggler or Rerun.
"""

from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from graph import Diagram, subsystem
from parts import SEGMENTS, SIDES, flexion, gait, imu, insole, walk
from parts import wearer as plant  # noqa: F401


def build():
    """Return the robot."""
    with Diagram("sensor_suit", rate=200) as diagram:
        walk({side: leg(side, serial) for side, serial in zip(SIDES, (133951, 133954))})
        CsvRecorder()
        PlotJuggler()
    return diagram


def leg(side, serial):
    """Return the Gait of one leg, and measure its joints. serial : number of the sensor on the thigh"""
    with subsystem(side):
        thigh, shank, foot = (imu(segment, str(number)) for number, segment in enumerate(SEGMENTS, serial))
        flexion("knee", thigh, shank)
        flexion("ankle", foot, shank)
        return gait(*thigh, insole(side).strike)

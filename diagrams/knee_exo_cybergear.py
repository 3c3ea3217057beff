"""Knee exoskeleton of one leg: a CyberGear, inertial sensors on thigh and shank, and a resistor under the heel.

    python -m runtime diagrams/knee_exo_cybergear.py --duration 20
    python -m runtime diagrams/knee_exo_cybergear.py --duration 20 --set side=right
    python -m runtime diagrams/knee_exo_cybergear.py --duration 20 --set speed=0.8 --set mass=110

The heel gives the strikes and the thigh the gait phase. A torque profile over the phase extends the knee in mid-stance
and flexes it before swing. The computer is a Raspberry Pi 4B, with the converter of the resistor on its I2C bus.
"""

from blocks.actuators import RobStride
from blocks.controllers import TorqueProfile
from blocks.gait import ContactEvents, GaitState, SegmentPosture, SensorPlacement
from blocks.recorders import CsvRecorder
from blocks.sensors import ADS1115, FSR
from blocks.sinks import PlotJuggler
from graph import Diagram, subsystem
from parts import assist, flexion, gait, imu
from wearer import wearer as plant  # noqa: F401

# Torque profile (gait phase, N·m).
PROFILE = ((0.16, 0.0), (0.24, -4.0), (0.34, 0.0), (0.48, 0.0), (0.60, 4.0), (0.70, 0.0))


def build(side="left", assistance=1.0):
    """Return the robot. side : left or right; assistance : scale of the torque profile, from 0 to 1"""
    with Diagram("knee_exo_cybergear", rate=200) as diagram:
        with subsystem(side):
            knee = RobStride("CyberGear", bus="knee", invert=side == "right", name="knee")
            thigh, shank = imu("thigh", "133941"), imu("shank", "133942")
            bend = flexion("knee", thigh, shank)
            placement = SensorPlacement(
                "IMUs of thigh and shank", "knee drive", one_leg=True, least=0.8, name="placement"
            )
            placement(left_reference=knee.velocity, left=bend.velocity)
            posture = SegmentPosture(
                "flexion from the IMUs of thigh and shank", "that of the knee drive", name="posture"
            )
            posture(left=bend.angle, right=knee.position)
            load = FSR(name="heel")(ADS1115(channels=("a0",), timeout=0.1, rate=475, name="converter").a0)
            strike = ContactEvents(smallest=10.0, name="heel_events")(load.force).strike
            leg = gait(*thigh, strike)
            walking = walks(leg, shank.velocity)
            torque = TorqueProfile(PROFILE, scale=assistance, name="profile")(phase=leg.phase, enable=leg.walking)
            assist(knee, torque, walking, leg, limit=4.0, uncertainty=leg.uncertainty)
        CsvRecorder()
        PlotJuggler()
    return diagram


def walks(leg, shank_velocity):
    """Return whether one leg walks. It stands when its thigh and shank are still; no other leg confirms its phase."""
    return GaitState(name="state")(
        left_phase=leg.phase,
        left_walking=leg.walking,
        left_velocity=leg.velocity,
        right_phase=leg.phase + 0.5,
        right_walking=leg.walking,
        right_velocity=shank_velocity,
        left_shank_velocity=shank_velocity,
    ).walking

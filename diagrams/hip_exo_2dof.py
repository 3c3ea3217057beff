"""Hip exoskeleton with two degrees of freedom: four AK80-9, eight inertial sensors, and two resistors under each foot.

    python -m runtime diagrams/hip_exo_2dof.py --duration 20
    python -m runtime diagrams/hip_exo_2dof.py --duration 20 --set assistance=0.5

Flexion is assisted in the direction of motion. In stance the other two actuators support abduction, which keeps the
pelvis level; they do little work. Heel strikes come from the resistors under heel and forefoot.
"""

from blocks.controllers import TorqueProfile
from blocks.gait import ContactEvents
from blocks.recorders import CsvRecorder
from blocks.sensors import ADS1115, FSR
from blocks.sinks import PlotJuggler
from graph import Diagram, subsystem
from parts import SEGMENTS, SIDES, assist, drive, flexion, gait, imu, walk
from parts import wearer as plant  # noqa: F401

# Torque profiles (gait phase, N·m).
PROFILES = {
    "hip": ((0.04, 0.0), (0.20, -6.0), (0.40, 0.0), (0.52, 0.0), (0.66, 8.0), (0.82, 0.0)),
    "abduction": ((0.02, 0.0), (0.15, 5.0), (0.45, 5.0), (0.58, 0.0)),
}


def build(assistance=1.0):
    """Return the robot. assistance : scale of all torque profiles, from 0 to 1"""
    with Diagram("hip_exo_2dof", rate=200) as diagram:
        imu("trunk", "133910")
        pelvis = imu("pelvis", "133911")
        gaits = {side: leg(side, number, pelvis) for number, side in enumerate(SIDES)}
        walking = walk(gaits)
        for number, (side, phase) in enumerate(gaits.items()):
            with subsystem(side):
                for can_id, (joint, points) in enumerate(PROFILES.items(), 1 + 2 * number):
                    profile = TorqueProfile(points, scale=assistance, name=f"{joint}_profile")
                    torque = profile(phase=phase.phase, enable=phase.walking)
                    assist(drive(side, joint, can_id), torque, walking, phase)
        CsvRecorder()
        PlotJuggler()
    return diagram


def leg(side, number, pelvis):
    """Return the Gait of one leg from its sensors. number : 0 or 1; pelvis : inertial sensor"""
    with subsystem(side):
        thigh, _, _ = (imu(segment, f"1339{2 + number}{place}") for place, segment in enumerate(SEGMENTS))
        converter = ADS1115(channels=("a0", "a1"), address=0x48 + number, bus="feet", name="converter")
        load = FSR(name="heel")(converter.a0).force + FSR(name="forefoot")(converter.a1).force
        strike = ContactEvents(smallest=10.0, name="events")(load).strike
        return gait(*flexion("hip", thigh, pelvis), strike)

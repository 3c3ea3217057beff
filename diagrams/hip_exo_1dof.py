"""Hip exoskeleton for flexion and extension: two AK80-9, five inertial sensors, and an insole in each shoe.

    python -m runtime diagrams/hip_exo_1dof.py --duration 20
    python -m runtime diagrams/hip_exo_1dof.py --duration 20 --set assistance=0.5

The phase of each leg follows from its hip angle and the strikes of its insole.
"""

from blocks.controllers import TorqueProfile
from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from graph import Diagram, subsystem
from parts import SIDES, assist, drive, flexion, gait, imu, insole, walk
from parts import wearer as plant  # noqa: F401

# Torque profile (gait phase, N·m): extension in early stance, flexion into swing.
PROFILE = ((0.04, 0.0), (0.20, -6.0), (0.40, 0.0), (0.52, 0.0), (0.66, 8.0), (0.82, 0.0))


def build(assistance=1.0):
    """Return the robot. assistance : scale of the torque profile, from 0 to 1"""
    with Diagram("hip_exo_1dof", rate=200) as diagram:
        pelvis, gaits = imu("pelvis", "133940"), {}
        for number, side in enumerate(SIDES, 1):
            with subsystem(side):
                thigh, _ = imu("thigh", f"13394{number}"), imu("shank", f"13395{number}")
                gaits[side] = gait(*flexion("hip", thigh, pelvis), insole(side).strike)
        walking = walk(gaits)
        for can_id, (side, leg) in enumerate(gaits.items(), 1):
            with subsystem(side):
                torque = TorqueProfile(PROFILE, scale=assistance, name="profile")(phase=leg.phase, enable=leg.walking)
                assist(drive(side, "hip", can_id), torque, walking, leg)
        CsvRecorder()
        PlotJuggler()
    return diagram

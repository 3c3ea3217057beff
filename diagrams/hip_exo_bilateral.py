"""Hip exoskeleton without sensors on the body: two AK80-9, whose encoders alone determine the gait phase.

    python -m runtime diagrams/hip_exo_bilateral.py --duration 20
    python -m runtime diagrams/hip_exo_bilateral.py --duration 20 --set model=AK10-9-V2.0
    python -m runtime diagrams/hip_exo_bilateral.py --duration 20 --set speed=0.8 --set mass=110

A torque profile over the gait phase extends the hip in early stance and flexes it into swing.
"""

from blocks.controllers import TorqueProfile
from blocks.filters import Butterworth
from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from graph import Diagram, subsystem
from parts import SIDES, assist, drive, gait, walk
from wearer import wearer as plant  # noqa: F401

# Torque profile (gait phase, N·m): extension in early stance, flexion into swing.
PROFILE = ((0.04, 0.0), (0.20, -6.0), (0.40, 0.0), (0.52, 0.0), (0.66, 8.0), (0.82, 0.0))


def build(assistance=1.0, model="AK80-9"):
    """Return the robot. assistance : scale of the torque profile, from 0 to 1; model : model of both actuators"""
    with Diagram("hip_exo_bilateral", rate=200) as diagram:
        hips, gaits = {}, {}
        for can_id, side in enumerate(SIDES, 1):
            with subsystem(side):
                hips[side] = drive(side, "hip", can_id, model)
                velocity = Butterworth(order=2, cutoff=20.0)(hips[side].velocity)
                gaits[side] = gait(hips[side].position, velocity)
        walking = walk(gaits)
        for side, leg in gaits.items():
            with subsystem(side):
                torque = TorqueProfile(PROFILE, scale=assistance, name="profile")(phase=leg.phase, enable=leg.walking)
                assist(hips[side], torque, walking, leg, uncertainty=leg.uncertainty)
        CsvRecorder()
        PlotJuggler()
    return diagram

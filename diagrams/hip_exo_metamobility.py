"""Hip exoskeleton with one inertial sensor: two AK80-9, and an ICM-20948 on the pelvis.

    python -m runtime diagrams/hip_exo_metamobility.py --duration 20
    python -m runtime diagrams/hip_exo_metamobility.py --duration 20 --set mass=90 --set scale=0.1

The flexion of a thigh is the angle of its hip, from the encoder, plus the pitch of the pelvis. Two neural networks
receive the motion of both thighs: one estimates the biological torque of each hip, of which the actuators add a share,
the other the gait phase, without which no torque acts.
"""

from blocks.filters import Butterworth
from blocks.gait import SegmentPosture
from blocks.imus import ICM20948
from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from graph import Diagram, subsystem
from parts import SIDES, Motion, assist, drive, hip_assistance, learned_gait, pitch, walk
from wearer import wearer as plant  # noqa: F401

PELVIS = 0.5  # rad, largest mean pitch in walking: that of adults reaches 0.42


def build(mass=70.0, scale=0.15, delay=0.15):
    """Return the robot. mass : mass of the wearer, kg; scale, delay : share of the biological torque, its delay in s"""
    with Diagram("hip_exo_metamobility", rate=200) as diagram:
        pelvis = pitch("pelvis", ICM20948(magnetometer=False, name="pelvis_imu"))
        hips, thighs = {}, {}
        for can_id, side in enumerate(SIDES, 1):
            with subsystem(side):
                hips[side] = drive(side, "hip", can_id)
                velocity = Butterworth(order=2, cutoff=20.0, name="hip_velocity")(hips[side].velocity)
                thighs[side] = Motion(hips[side].position + pelvis.angle, velocity + pelvis.velocity)
        gaits = learned_gait(thighs)
        walking = walk(gaits)
        torques = hip_assistance(thighs, mass, scale, delay)
        for side, leg in gaits.items():
            with subsystem(side):
                assist(hips[side], torques[side], walking, leg)
        posture = SegmentPosture("pelvis IMU", "upright", difference=PELVIS, slip=0.26, name="pelvis_posture")
        posture(left=pelvis.angle, enable=walking)
        CsvRecorder()
        PlotJuggler()
    return diagram

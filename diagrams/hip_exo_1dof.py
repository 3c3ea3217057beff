"""Hip exoskeleton for flexion and extension: two AK80-9, five inertial sensors, and an insole in each shoe.

    python -m runtime diagrams/hip_exo_1dof.py --duration 20
    python -m runtime diagrams/hip_exo_1dof.py --duration 20 --set mass=90 --set scale=0.1

A neural network estimates the biological torque of each hip from the motion of both thighs. The actuators add a share
of it, delayed and smoothed. (Molinaro et al. 2024) Thighs and insoles decide whether the wearer walks.
"""

from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from graph import Diagram, subsystem
from parts import SIDES, assist, drive, gait, hip_assistance, imu, insole, ordered, placed, rates, walk
from wearer import wearer as plant  # noqa: F401


def build(mass=70.0, scale=0.15, delay=0.15):
    """Return the robot. mass : mass of the wearer, kg; scale, delay : share of the biological torque, its delay in s"""
    with Diagram("hip_exo_1dof", rate=200) as diagram:
        imu("pelvis", "133940")
        thighs, shanks, loads, gaits = {}, {}, {}, {}
        for number, side in enumerate(SIDES, 1):
            with subsystem(side):
                thighs[side], shanks[side] = imu("thigh", f"13394{number}"), imu("shank", f"13395{number}")
                sole = insole(side)
                loads[side] = sole.load
                gaits[side] = gait(thighs[side].angle, thighs[side].velocity, sole.strike, shanks[side])
        walking = walk(gaits)
        torques = hip_assistance(thighs, mass, scale, delay)
        hips = {}
        for can_id, (side, leg) in enumerate(gaits.items(), 1):
            with subsystem(side):
                hips[side] = drive(side, "hip", can_id)
                assist(hips[side], torques[side], walking, leg)
        placed("thigh IMUs", rates(thighs), "hip drives", rates(hips))
        placed("insoles", loads, "thigh IMUs", rates(thighs), opposite=True, enable=walking)
        placed("shank IMUs", rates(shanks), "insoles", loads, opposite=True, enable=walking)
        ordered(walking, thigh=thighs, shank=shanks)
        CsvRecorder()
        PlotJuggler()
    return diagram

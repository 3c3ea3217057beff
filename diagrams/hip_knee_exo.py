"""Hip and knee exoskeleton: four AK80-9, five inertial sensors, and an insole in each shoe.

    python -m runtime diagrams/hip_knee_exo.py --duration 20
    python -m runtime diagrams/hip_knee_exo.py --duration 20 --set assistance=0.5

A neural network estimates the gait phase of each leg from the motion of both thighs. Torque profiles over the phase
extend the hip in early stance and flex it into swing, extend the knee in mid-stance and flex it before swing. Torques
fade when the insoles measure no load, as in a jump or a fall.
"""

from blocks.controllers import TorqueProfile
from blocks.logic import And, Or
from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from graph import Diagram, subsystem
from parts import PROFILES, SIDES, assist, drive, imu, insole, learned_gait, ordered, placed, rates, walk
from wearer import wearer as plant  # noqa: F401


def build(assistance=1.0):
    """Return the robot. assistance : scale of all torque profiles, from 0 to 1"""
    with Diagram("hip_knee_exo", rate=200) as diagram:
        imu("pelvis", "133980")
        thighs, shanks, soles = {}, {}, {}
        drives = {joint: {} for joint in PROFILES}
        for number, side in enumerate(SIDES, 1):
            with subsystem(side):
                thighs[side], shanks[side] = imu("thigh", f"13398{number}"), imu("shank", f"13399{number}")
                soles[side] = insole(side)
        gaits = learned_gait(thighs, shanks)
        walking = And()(walk(gaits), Or()(*(sole.contact for sole in soles.values())))
        for number, (side, leg) in enumerate(gaits.items()):
            with subsystem(side):
                for can_id, (joint, points) in enumerate(PROFILES.items(), 1 + 2 * number):
                    profile = TorqueProfile(points, scale=assistance, name=f"{joint}_profile")
                    torque = profile(phase=leg.phase, enable=leg.walking)
                    drives[joint][side] = drive(side, joint, can_id)
                    assist(drives[joint][side], torque, walking, leg, slew=200.0, uncertainty=leg.uncertainty)
        loads = {side: sole.load for side, sole in soles.items()}
        placed("thigh IMUs", rates(thighs), "hip drives", rates(drives["hip"]))
        placed("shank IMUs", rates(shanks), "knee drives", rates(drives["knee"]), opposite=True, enable=walking)
        placed("insoles", loads, "shank IMUs", rates(shanks), opposite=True, enable=walking)
        ordered(walking, thigh=thighs, shank=shanks)
        CsvRecorder()
        PlotJuggler()
    return diagram

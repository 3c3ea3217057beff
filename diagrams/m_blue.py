"""M-BLUE, a hip and knee orthosis of both legs: four AK80-9, and on each leg an inertial sensor and an insole.

    python -m runtime diagrams/m_blue.py --duration 20
    python -m runtime diagrams/m_blue.py --duration 20 --set share=0.1 --set mass=90
    python -m runtime diagrams/m_blue.py --duration 20 --set controller=phase --set assistance=0.5
    python -m runtime diagrams/m_blue.py --duration 20 --set speed=0.8 --set mass=110

Energy shaping, without a gait phase: the torques are a share of the slope of a potential energy over the pitch of thigh
and shank, one that is felt in proportion to the load on the foot and one in proportion to the rest of the weight. They
act in every motion with a foot on the ground, also backward and in squats, once the wearer has walked and the sensors
have been checked. With `controller=phase`, torque profiles over the gait phase from the encoders act in the direction
of motion, and only in walking forward.

As published: orthosis and drives (Nesler et al. 2022), and basis functions of posture and ground force, fitted to the
torques of healthy adults (Lin et al. 2022, Zhang et al. 2023). What differs: the weights, which are fitted to walking
at 0.8 to 1.6 m/s, squatting, sitting and standing, and are those of a potential, without functions of velocity.
"""

from typing import NamedTuple

from blocks.controllers import TorqueProfile
from blocks.filters import Butterworth
from blocks.limiters import Saturation
from blocks.logic import And, Compare, Latch, Or
from blocks.mathematics import Gain, Sum
from blocks.recorders import CsvRecorder
from blocks.sensors import Insole
from blocks.sinks import PlotJuggler
from blocks.trigonometry import Sin
from blocks.vectors import MatrixGain
from graph import Diagram, Live, Signal, stack, subsystem
from parts import PROFILES, SIDES, Gait, Motion, assist, drive, flexion, gait, imu, ordered, placed, rates, walk
from wearer import wearer as plant  # noqa: F401

# Torques of hip and knee in N·m/kg per sin(thigh), sin(shank), sin(knee) and 1, with the whole weight on the foot and
# without load. `python -m tests.diagrams.energy` fits them.
STANCE = ((-2.84, 0.48, 0.0, 0.32), (0.0, -0.48, -1.29, 0.02))
SWING = ((0.31, -0.24, 0.0, -0.21), (0.0, 0.24, 0.0, 0.08))
LARGEST_SHARE = 0.3  # of the torques of an adult
LOADED = 0.05  # load on a foot that stands on the ground
FULL_LOAD = 1.1 * 9.80665  # N/kg, force on a foot at its peak in walking


def build(controller="energy", mass=70.0, share=0.15, assistance=1.0):
    """Return the robot.

    controller : energy or phase
    mass : mass of the wearer, kg
    share : with energy, share of the torques of an adult of that mass, from 0 to 0.3
    assistance : with phase, scale of both torque profiles, from 0 to 1
    """
    if controller not in ("energy", "phase"):
        raise ValueError(f"controller must be 'energy' or 'phase', got {controller!r}")
    if not 0.0 <= share <= LARGEST_SHARE:
        raise ValueError(f"share must be from 0 to {LARGEST_SHARE:g}, got {share:g}")
    with Diagram("m_blue", rate=200) as diagram:
        legs = {side: leg(side, first, mass) for side, first in zip(SIDES, (1, 3))}
        walking = walk({side: own.gait for side, own in legs.items()})
        on_ground = Or(name="on_ground")(*(Compare(">")(own.load, LOADED) for own in legs.values()))
        active = And(name="active")(Latch(name="has_walked")(walking), on_ground)
        for side, own in legs.items():
            with subsystem(side):
                if controller == "energy":
                    torques, enabled = shaped(own, mass, share), active
                else:
                    torques, enabled = profiles(own.gait, assistance), walking
                for joint, torque in torques.items():
                    uncertainty = 0.0 if controller == "energy" else own.gait.uncertainty
                    assist(own.drives[joint], torque, enabled, own.gait, slew=200.0, uncertainty=uncertainty)
        motions = {side: own.thigh for side, own in legs.items()}
        thighs = rates(motions)
        ordered(walking, thigh=motions)
        placed("thigh IMUs", thighs, "hip drives", rates({side: own.drives["hip"] for side, own in legs.items()}))
        loads = {side: own.load for side, own in legs.items()}
        placed("insoles", loads, "thigh IMUs", thighs, opposite=True, enable=walking)
        CsvRecorder()
        PlotJuggler()
    return diagram


class Leg(NamedTuple):
    """Actuators of one leg by joint, its Gait from their encoders, Motion of its thigh, and load from 0 to 1."""

    drives: dict
    gait: Gait
    thigh: Motion
    load: Signal


def leg(side, first, mass):
    """Return a Leg. first : CAN id of the hip; mass : mass of the wearer, kg"""
    with subsystem(side):
        drives = {joint: drive(side, joint, can_id) for can_id, joint in enumerate(PROFILES, first)}
        hip, knee = (motion(drives[joint], joint) for joint in PROFILES)
        thigh = imu("thigh", f"13400{first}")
        force = Insole(side=side, address=f"0.0.0.0:{5005 + SIDES.index(side)}", name="insole").force
        load = Saturation(0.0, 1.0, name="load")(
            Gain(1.0 / (FULL_LOAD * mass), unit="1/N", name="share_of_load")(force)
        )
        return Leg(drives, gait(*hip, shank=flexion("shank", hip, knee)), thigh, load)


def motion(drive, joint):
    """Return the Motion of a joint from its encoder."""
    return Motion(drive.position, Butterworth(order=2, cutoff=20.0, name=f"{joint}_velocity")(drive.velocity))


def shaped(leg, mass, share):
    """Return {joint: torque} of the potential energy of one leg. mass : kg; share : as in `build`"""
    thigh, knee = leg.thigh.angle, leg.drives["knee"].position
    posture = stack(Sin()(thigh), Sin()(Sum("+-", name="shank_pitch")(thigh, knee)), Sin()(knee), 1.0)
    stance, swing = (MatrixGain(weights, unit="N·m/kg")(posture) for weights in (STANCE, SWING))
    normal = swing + leg.load * (stance - swing)
    torques = Gain(Live(share * mass, min=0.0, max=LARGEST_SHARE * mass), unit="kg", name="shaped_torque")(normal)
    return {joint: torques[number] for number, joint in enumerate(PROFILES)}


def profiles(gait, assistance):
    """Return {joint: torque} of the profiles over the gait phase. assistance : as in `build`"""
    return {
        joint: TorqueProfile(points, scale=assistance, name=f"{joint}_profile")(phase=gait.phase, enable=gait.walking)
        for joint, points in PROFILES.items()
    }

"""One body: a torque on one joint against the momentum of all segments, and against the limits of people."""

import re

import numpy as np
import pytest

from blocks.sources import Pulse
from blocks.wearer import Walker
from blocks.wearer.body import (
    ANKLE_HEIGHT,
    FOOT,
    FOOT_LENGTH,
    HEEL,
    SHANK,
    SHANK_LENGTH,
    THIGH,
    THIGH_LENGTH,
    TRUNK_CENTRE,
    TRUNK_GYRATION,
)
from tests.blocks.wearer.test_walker import JOINTS, RATE, walk

TRUNK = 1.0 - 2.0 * (THIGH[0] + SHANK[0] + FOOT[0])


def masses(trace):
    """Yield mass, path forward and up, moment of inertia and pitch rate of each segment. 70 kg, 1.70 m"""
    tilt = trace["pelvis_motion[6]"] - trace["pelvis_motion[6]"][0]
    hips = trace["pelvis_motion[0]"] + 1j * trace["pelvis_motion[1]"]
    inertia = 70.0 * TRUNK * (TRUNK_GYRATION * 1.7) ** 2
    yield 70.0 * TRUNK, hips + 1.7j * TRUNK_CENTRE * np.exp(1j * tilt), inertia, trace["pelvis_motion[7]"]
    for side in ("left", "right"):
        for segment, (share, centre, gyration), length in zip(
            ("thigh", "shank", "foot"), (THIGH, SHANK, FOOT), (THIGH_LENGTH, SHANK_LENGTH, FOOT_LENGTH)
        ):
            x, z, pitch, rate = (trace[f"{side}_{segment}_motion[{k}]"] for k in (0, 1, 6, 7))
            along = centre * length + HEEL - 0.5j * ANKLE_HEIGHT if segment == "foot" else -1j * centre * length
            place = x + 1j * z + 1.7 * along * np.exp(1j * pitch)
            yield 70.0 * share, place, 70.0 * share * (gyration * length * 1.7) ** 2, rate


def momentum_and_ground(trace, dt):
    """Return rate of momentum, rate of angular momentum about the centre of mass, force, and moment of the ground."""
    segments = list(masses(trace))
    centre = sum(mass * place for mass, place, *_ in segments) / 70.0
    speed = np.gradient(centre, dt)
    angular = sum(
        mass * ((place - centre).conj() * (np.gradient(place, dt) - speed)).imag + inertia * rate
        for mass, place, inertia, rate in segments
    )
    force, moment = 0.0, 0.0
    for side in ("left", "right"):
        x, z, pitch = (trace[f"{side}_foot_motion[{k}]"] for k in (0, 1, 6))
        sole = trace[f"{side}_centre_of_pressure"] + 1.7 * (HEEL - 1j * ANKLE_HEIGHT)
        ground = trace[f"{side}_ground_force[0]"] + 1j * trace[f"{side}_ground_force[1]"]
        moment += ((x + 1j * z + sole * np.exp(1j * pitch) - centre).conj() * ground).imag
        force += ground
    return 70.0 * np.gradient(speed, dt), np.gradient(angular, dt), force, moment


@pytest.mark.parametrize("speed", [0.0, 1.2])
def test_ground_gives_the_whole_body_the_momentum_that_a_torque_on_one_hip_causes(speed):
    """Beyond the walk without the torque: force within 6 %, moment about the centre of mass within 30 % (RMS)."""
    half_a_second = {"left_hip_assistance": lambda: Pulse(low=0.0, high=10.0, delay=0.8, unit="N·m")()}
    free, pushed = (
        momentum_and_ground(walk(3.0, 1000, speed=speed, variability=0.0, assistance=each), 1e-3)
        for each in ({}, half_a_second)
    )
    rate, angular, force, moment = ((b - a)[5:-5] for a, b in zip(free, pushed))

    def rms(values):
        return np.sqrt(np.mean(np.abs(values) ** 2))

    assert rms(force) > 2.0 and rms(force - rate) < 0.06 * rms(force)
    assert rms(moment) > 1.0 and rms(moment - angular) < 0.3 * rms(angular)


def test_torque_on_one_hip_moves_the_trunk_and_the_other_leg():
    steady = walk(4.0, speed=1.2, variability=0.0)
    pushed = walk(4.0, speed=1.2, variability=0.0, assistance={"left_hip_assistance": 40.0})
    assert np.abs(pushed["pelvis_motion[6]"] - steady["pelvis_motion[6]"]).max() > np.radians(0.5)
    for joint in JOINTS:
        assert np.abs(pushed[f"right_{joint}_angle"] - steady[f"right_{joint}_angle"]).max() > np.radians(0.5)
    assert pushed["plausible"].all() and not pushed["limit"].any() and pushed["plausible_time"][-1] == 4.0 - 1.0 / RATE


@pytest.mark.parametrize(
    "joint, torque, limits", [("knee", 150.0, "the knee exceeds"), ("hip", 150.0, ""), ("ankle", 100.0, "the ankle")]
)
def test_torque_that_no_wearer_could_bear_is_not_plausible_from_then_on(joint, torque, limits):
    """Square waves of 1 Hz; a tenth of them is plausible."""
    for scale in (1.0, 0.1):
        wave = {f"left_{joint}_assistance": lambda: Pulse(low=scale * torque, high=-scale * torque, unit="N·m")()}
        trace = walk(6.0, speed=1.2, variability=0.0, assistance=wave)
        ends = int(np.argmin(trace["plausible"])) if scale == 1.0 else len(trace["time"])
        assert trace["plausible"][:ends].all() and not trace["plausible"][ends:].any()
        if scale == 1.0:
            assert (
                re.search(limits, Walker.limits[int(trace["limit"][-1])]) and trace["limit"][ends] == trace["limit"][-1]
            )
            assert trace["plausible_time"][-1] == trace["time"][ends - 1]

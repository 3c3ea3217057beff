"""Sensors of the wearer that are exchanged, turned or slip: a fault before torque acts in full."""

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import runtime
from blocks.wearer import SegmentIMU
from graph import Actuator, Device
from runtime.robot.loading.file import build_plant, load
from tests.blocks.running import run
from tests.diagrams.robots import path
from tests.soaking import soaked

SIDES = ("left", "right")
ANKLE = ("left/shank_imu", "left/foot_imu")
THIGHS, SHANKS, FEET = (f"{segment} IMUs" for segment in ("thigh", "shank", "foot"))
# Devices of each leg of a robot, and what the fault calls them.
PLACED = {
    "hip_exo": {"thigh_imu": THIGHS},
    "hip_exo_teensy": {"thigh_imu": THIGHS},
    "hip_exo_1dof": {"thigh_imu": THIGHS, "shank_imu": SHANKS, "insole": "insoles"},
    "hip_exo_2dof": {"thigh_imu": THIGHS, "shank_imu": SHANKS, "foot_imu": FEET, "converter": "resistors"},
    "hip_knee_exo": {"thigh_imu": THIGHS, "shank_imu": SHANKS, "insole": "insoles"},
    "knee_exo_gatech": {"thigh_imu": THIGHS, "shank_imu": SHANKS, "foot_imu": FEET, "insole": "insoles"},
    "m_blue": {"thigh_imu": THIGHS, "insole": "insoles"},
    "ankle_exo": {"thigh_imu": THIGHS, "shank_imu": SHANKS, "insole": "insoles"},
    "sensor_suit": {"thigh_imu": THIGHS, "shank_imu": SHANKS, "foot_imu": FEET, "insole": "insoles"},
    "sensor_suit_lite": {"thigh_imu": THIGHS, "shank_imu": SHANKS, "insole": "insoles"},
}
# Each kind of sensor, and each kind of reference; the rest is soak.
QUICK = {
    ("hip_exo", "thigh_imu"),
    ("hip_knee_exo", "shank_imu"),
    ("hip_exo_2dof", "converter"),
    ("ankle_exo", "insole"),
    ("m_blue", "insole"),
}
PAIRS = [
    pytest.param(robot, device, name, marks=() if (robot, device) in QUICK else pytest.mark.soak)
    for robot, devices in PLACED.items()
    for device, name in devices.items()
]


@pytest.mark.hazard("H12f")
@pytest.mark.parametrize("robot, device, name", PAIRS)
def test_exchanged_sensors_end_the_run_before_the_torque_is_full(robot, device, name):
    file, diagram = load(path(robot))
    plant = build_plant(file, diagram)
    left, right = (plant[f"{side}/{device}"] for side in SIDES)
    other = {left: right, right: left}
    plant.wires[:] = [replace(wire, block=other.get(wire.block, wire.block)) for wire in plant.wires]
    trial = run(diagram, round(8.0 * diagram.rate), plant=plant, substeps=5)
    assert trial.outcome.status == "kernel status 64", trial.outcome
    text = diagram[trial.outcome.culprit].fault_text(64)
    assert f"the {name} of left and right are exchanged" in text or f"or the {name}:" in text
    walking = trial.time[trial["state.walking"] > 0.0]
    assert not len(walking) or trial.time[-1] - walking[0] < 0.3  # s, of the 0.5 s in which torque fades in


SEGMENTS = ("thigh_imu", "shank_imu", "foot_imu")
# Every pair of inertial sensors that is not the same segment of both legs; one is quick.
ACROSS = [
    pytest.param(robot, *pair, marks=() if (robot, *pair) == ("hip_exo_2dof", *ANKLE) else pytest.mark.soak)
    for robot, devices in PLACED.items()
    for pair in combinations([f"{side}/{name}" for side in SIDES for name in SEGMENTS if name in devices], 2)
    if pair[0].partition("/")[2] != pair[1].partition("/")[2]
]


RANGES = {"hip": (-0.45, 1.6), "knee": (-0.1, 1.9), "abduction": (-0.5, 0.5)}  # rad, as a rig has them
HIPS = ["hip_exo", "hip_exo_teensy", "hip_exo_1dof", "hip_exo_2dof", "hip_knee_exo", "m_blue"]


@pytest.mark.hazard("H12f")
@pytest.mark.parametrize("robot", soaked(HIPS, but=[0]))
@pytest.mark.parametrize("alike", [False, True], ids=["mirrored", "alike"])
def test_drives_with_exchanged_ids_end_the_run_before_any_torque(robot, alike):
    """Mirrored drives leave the range of their joint; drives that are mounted alike disagree with the thighs."""
    drives, trial = exchanged_ids(robot, ("can_id", "invert", "offset")[: 3 if alike else 1], RANGES)
    assert trial.outcome.status == ("kernel status 64" if alike else "over-travel"), trial.outcome
    assert max(np.abs(trial[f"{name}.torque_sent"]).max() for name in drives) < 0.01  # N·m


@pytest.mark.hazard("H12f")
@pytest.mark.parametrize("robot, joint", [("ankle_exo", "ankle"), ("hip_exo_2dof", "abduction")])
@pytest.mark.parametrize("alike", [False, True], ids=["mirrored", "alike"])
def test_drives_that_no_segment_shows_with_exchanged_ids_end_the_run_while_torque_fades_in(robot, joint, alike):
    """Also without a range: the sum of both angles moves against the knees, or each against the load on its foot."""
    drives, trial = exchanged_ids(robot, ("can_id", "invert", "offset")[: 3 if alike else 1], joint=joint)
    assert trial.outcome.status == "kernel status 64", trial.outcome
    assert trial.outcome.culprit == f"{joint}_drives_{'placement' if alike else 'direction'}"
    assert trial.time[-1] - trial.time[trial["state.walking"] > 0.0][0] < 0.3  # s, of 0.5 s
    assert max(np.abs(trial[f"{name}.torque_sent"]).max() for name in drives) < 4.0  # N·m, of 38 and 5


@pytest.mark.parametrize("robot", ["knee_exo", "hip_exo_bilateral", "hip_exo_metamobility"])
def test_robots_whose_exchanged_drives_are_not_found_have_no_sensor_on_the_legs(robot):
    _, diagram = load(path(robot))
    worn = [block for block in diagram if isinstance(block, Device) and block.path.startswith(SIDES)]
    assert len(worn) == 2 and all(isinstance(block, Actuator) for block in worn)


def exchanged_ids(robot, properties, ranges=None, joint=""):
    """Return {name: drive} and the trial of a robot whose drives of left and right have exchanged properties.

    ranges : {joint: range}; joint : the only one whose drives are exchanged
    """
    file, diagram = load(path(robot))
    plant = build_plant(file, diagram)  # has the ids and the mounting of the table
    drives: dict[str, Any] = {block.path: block for block in diagram if isinstance(block, Actuator)}
    for name, left in drives.items():
        if ranges:
            left.range = ranges[name.rpartition("/")[2]]
        if name.startswith("left") and name.endswith(joint):
            right = drives[name.replace("left", "right")]
            for own in properties:
                here, there = getattr(left, own), getattr(right, own)
                setattr(left, own, there)
                setattr(right, own, here)
    for block in drives.values():
        block.reconfigure()
    return drives, run(diagram, round(8.0 * diagram.rate), plant=plant, substeps=5)


@pytest.mark.hazard("H12f")
@pytest.mark.parametrize("robot, one, two", ACROSS)
def test_exchanged_sensors_of_two_segments_end_the_run_or_no_torque_acts(robot, one, two):
    file, diagram = load(path(robot))
    plant = build_plant(file, diagram)
    other = {plant[one]: plant[two], plant[two]: plant[one]}
    plant.wires[:] = [replace(wire, block=other.get(wire.block, wire.block)) for wire in plant.wires]
    trial = run(diagram, round(8.0 * diagram.rate), plant=plant, substeps=5)
    torques = [values for name, values in trial.signals.items() if name.endswith(".torque_sent")]
    acts = np.any(np.abs(torques) > 0.25, axis=0).sum() / diagram.rate if torques else 0.0  # s
    if trial.outcome.status == "ok":  # the network of ankle_exo does not find a gait
        assert robot == "ankle_exo" and acts == 0.0
    else:
        assert trial.outcome.status.startswith("kernel status") and acts < 0.75


@pytest.mark.hazard("H12f")
def test_exchanged_sensors_of_thigh_and_shank_of_one_leg_end_the_run_before_any_torque():
    file, diagram = load(path("knee_exo_cybergear"))
    plant = build_plant(file, diagram)
    thigh, shank = plant["left/thigh_imu"], plant["left/shank_imu"]
    other = {thigh: shank, shank: thigh}
    plant.wires[:] = [replace(wire, block=other.get(wire.block, wire.block)) for wire in plant.wires]
    trial = run(diagram, round(8.0 * diagram.rate), plant=plant, substeps=5)
    assert trial.outcome.status == "kernel status 64", trial.outcome
    assert "the IMUs of thigh and shank do not move as the knee drive" in diagram[trial.outcome.culprit].fault_text(64)
    assert abs(trial["left/knee.torque_sent"]).max() < 0.001  # N·m, half a step of the command


# Each inertial sensor on which a robot relies, on one leg; the rest is soak.
WORN = [
    (robot, f"{side}/{name}")
    for robot, devices in PLACED.items()
    for side, name in zip(("left", "right", "left"), SEGMENTS)
    if name in devices
] + [("knee_exo_cybergear", "left/thigh_imu"), ("knee_exo_cybergear", "left/shank_imu")]
FAST = {("hip_exo", "left/thigh_imu"), ("hip_exo_2dof", "left/foot_imu"), ("knee_exo_cybergear", "left/shank_imu")}
FLEXION = [(0.0, angle, 0.0) for angle in (-60.0, -20.0, 20.0, 60.0)]
ABOUT = [(180.0, 0.0, 0.0), (90.0, 0.0, 0.0), (-90.0, 0.0, 0.0), (0.0, 0.0, 180.0), (0.0, 0.0, 90.0), (0.0, 180.0, 0.0)]


def turned(robot, device, degrees):
    """Return the diagram and its run with a sensor turned by roll, pitch and yaw, and s with torque."""
    file, diagram = load(path(robot))
    plant = build_plant(file, diagram)
    [sensor] = {wire.source.block for wire in plant.wires if wire.block is plant[device]} & {
        block for block in plant if isinstance(block, SegmentIMU)
    }
    sensor.mounting = tuple(np.radians(degrees))
    sensor.configure()
    trial = run(diagram, round(8.0 * diagram.rate), plant=plant, substeps=5)
    torques = [values for name, values in trial.signals.items() if name.endswith(".torque_sent")]
    acts = np.any(np.abs(torques) > 0.25, axis=0).sum() / diagram.rate if torques else 0.0
    return diagram, trial.outcome, acts


@pytest.mark.hazard("H12f")
@pytest.mark.parametrize(
    "robot, device", [pytest.param(*worn, marks=() if worn in FAST else pytest.mark.soak) for worn in WORN]
)
def test_a_sensor_turned_about_the_axis_of_flexion_ends_the_run_while_torque_fades_in(robot, device):
    side, name = device.removesuffix("_imu").split("/")
    for degrees in FLEXION:
        diagram, outcome, acts = turned(robot, device, degrees)
        text = diagram[str(outcome.culprit)].fault_text(int(outcome.status.split()[-1]))
        assert ("thigh and shank" if robot == "knee_exo_cybergear" else f"{name} IMU of the {side} leg") in text
        assert "turned about the axis of flexion" in text and acts < 0.5, (degrees, acts)


@pytest.mark.hazard("H12f")
@pytest.mark.parametrize(
    "robot, device",
    [
        pytest.param(*worn, marks=() if worn in FAST and worn[0] != "hip_exo_2dof" else pytest.mark.soak)
        for worn in WORN
    ],
)
def test_a_sensor_turned_about_other_axes_ends_the_run_or_no_torque_acts(robot, device):
    for degrees in ABOUT:
        _, outcome, acts = turned(robot, device, degrees)
        assert acts < (0.5 if outcome.status.startswith("kernel status") else 0.05), (degrees, acts)


@pytest.mark.parametrize("robot", soaked(["hip_exo_teensy", "hip_exo_2dof", "ankle_exo", "knee_exo_gatech"], but=[0]))
def test_a_wearer_who_stops_and_walks_on_is_no_fault(robot):
    """The first step after a stand turns one leg alone."""
    for person, (speed, rise) in enumerate(((0.5, 1.5), (0.8, 1.0), (1.2, 0.5), (1.6, 0.52), (0.5, 0.5), (0.8, 1.5))):
        schedule = f"0:0 0.5:0 {0.5 + rise}:{speed} 9:{speed} 10:0 12:0 {12 + rise}:{speed}"
        settings = {"speed": schedule, "person": person, "mass": 50 + 5 * person, "seed": person}
        trial = runtime.run(path(robot), 18.0, settings=settings)
        assert trial.fault is None, (person, trial.fault)


@pytest.mark.parametrize("person, speed, walk, stand", [(0, 0.5, 1.0, 2.0), (5, 0.8, 0.5, 1.5), (1, 1.2, 1.0, 2.0)])
def test_an_abrupt_start_after_two_steps_and_a_stand_is_no_fault(person, speed, walk, stand):
    stop = 1.4 + walk
    rise, again = max(0.3, speed / 3.0), stop + stand  # s
    schedule = f"0:0 0.5:0 {0.5 + rise}:{speed} {stop - 0.4}:{speed} {stop}:0 {again}:0 {again + rise}:{speed}"
    settings = {"speed": schedule, "person": person, "mass": 50 + 4 * person, "seed": person}
    trial = runtime.run(path("hip_exo_2dof"), stop + stand + 4.0, settings=settings)
    assert trial.fault is None, trial.fault

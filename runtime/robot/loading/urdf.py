"""URDF of a robot: its actuators as joints, and its inertial sensors, on the segments of an adult.

x is forward, y left, z up. An actuator or a sensor belongs to a limb by its name, such as left/knee, left_knee or
left/thigh_imu. Names of joints and of the sensors' links are those of blocks.sinks.Ros2.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any
from xml.etree import ElementTree

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
from graph import Actuator, Block, Diagram
from graph.device import actuators_of
from runtime.host.errors import BadInput
from runtime.host.ros2_node import named

MASS, HEIGHT = 75.0, 1.75  # kg, m, of the wearer
HIP_WIDTH = 0.18  # m, between the hips
RADII = {"thigh": 0.07, "shank": 0.05, "foot": 0.035}  # m, of the drawn segments
COLOUR = "0.56 0.64 0.72 1"  # red, green, blue and opacity of segments
HOUSING = 0.1, 1e-4  # kg, kg·m², of what moves between two joints in one place
JOINTS = {"abduction": "pelvis", "hip": "thigh", "knee": "shank", "ankle": "foot"}  # joint: the segment that it moves
AXES = {"hip": (0, -1, 0), "knee": (0, 1, 0), "ankle": (0, -1, 0)}  # of flexion
LENGTHS = {"thigh": THIGH_LENGTH * HEIGHT, "shank": SHANK_LENGTH * HEIGHT, "foot": FOOT_LENGTH * HEIGHT}
SHARES = {"thigh": THIGH, "shank": SHANK, "foot": FOOT}


def urdf(diagram: Diagram) -> str:
    """Return a diagram's robot as URDF.

    Raises BadInput if no actuator or sensor has the name of a joint or segment, or two actuators that of one joint.
    """
    joints: dict[tuple[str, str], Block] = {}
    for place, actuator in members(actuators_of(diagram), JOINTS):
        if (other := joints.setdefault(place, actuator)) is not actuator:
            raise BadInput(f"{other.path} and {actuator.path} are one joint in a URDF: give them different names")
    sensors = list(members(filter(is_inertial, diagram), ("pelvis", "trunk", *LENGTHS)))
    places = [*joints, *(place for place, _ in sensors)]
    limbs = dict.fromkeys(side for side, part in places if part not in ("pelvis", "trunk"))
    if not limbs:
        raise BadInput(
            f"{diagram.name} has no actuator with a name such as left/knee, and no inertial sensor such as "
            f"left/thigh_imu: a URDF needs one of {', '.join((*JOINTS, *LENGTHS))}"
        )
    robot = ElementTree.Element("robot", name=named(diagram.name))
    pelvis = ElementTree.SubElement(robot, "link", name="pelvis")
    mass = MASS * (1.0 - 2.0 * sum(share for share, _, _ in SHARES.values()))  # with the trunk
    inertia = (mass * (TRUNK_GYRATION * HEIGHT) ** 2,) * 3
    box = ("box", {"size": numbers((0.12, HIP_WIDTH, 0.1))})
    body(pelvis, (0.0, 0.0, TRUNK_CENTRE * HEIGHT), mass, inertia, box, (0.0, 0.0, 0.05))
    for side in limbs:
        add_limb(robot, side, {joint: joints.get((side, joint)) for joint in JOINTS})
    for (side, segment), sensor in sensors:
        link = segment_name(side, segment) if segment in LENGTHS else "pelvis"
        name = named(sensor.path)
        ElementTree.SubElement(robot, "link", name=name)
        half = 0.0 if link == "pelvis" else -0.5 * LENGTHS[segment]
        place = (0.5 * LENGTHS["foot"], 0.0, 0.0) if segment == "foot" else (0.0, 0.0, half)
        connect(robot, "fixed", f"{name}_mount", link, name, place, turn=(math.pi, 0.0, 0.0))  # z is down
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def segment_name(side: str, segment: str) -> str:
    """Return the name of the link of a segment, such as left_thigh."""
    return named(f"{side}_{segment}" if side else segment)


def members(blocks: Iterable[Block], parts: Iterable[str]) -> Iterable[tuple[tuple[str, str], Block]]:
    """Yield ((side, part), block) of the blocks whose name has one of these parts."""
    for block in blocks:
        match = re.fullmatch(rf"(.*?)[/_]?({'|'.join(parts)})(?:_\w+)?", block.path)
        if match:
            yield (match[1].strip("/_"), match[2]), block


def is_inertial(block: Block) -> bool:
    """Return whether a block is an inertial sensor."""
    return all(name in block.outputs and block.outputs[name].shape == (3,) for name in ("accel", "gyro"))


def add_limb(robot: ElementTree.Element, side: str, joints: dict[str, Any]) -> None:
    """Add the segments of a limb to the pelvis, each moved by its joint or fixed. joints : {name: actuator or None}"""
    lateral = 0.5 * HIP_WIDTH * (("left" in side) - ("right" in side))
    above, place = "pelvis", (0.0, lateral, 0.0)
    for joint, segment in JOINTS.items():
        actuator = joints[joint]
        if joint == "abduction" and actuator is None:
            continue
        name = segment_name(side, "abductor" if joint == "abduction" else segment)
        link = ElementTree.SubElement(robot, "link", name=name)
        if joint == "abduction":
            inertial(link, (0.0, 0.0, 0.0), HOUSING[0], (HOUSING[1],) * 3)
            axis, next_place = (-1 if "right" in side else 1, 0, 0), (0.0, 0.0, 0.0)
        else:
            add_segment(link, segment)
            axis, next_place = AXES[joint], (0.0, 0.0, -LENGTHS[segment])
        if actuator is None:
            connect(robot, "fixed", f"{name}_fixed", above, name, place)
        else:
            bounds = {key: f"{value:.6g}" for key, value in limits(actuator).items()}
            kind = "revolute" if "upper" in bounds else "continuous"
            added = connect(robot, kind, named(actuator.path), above, name, place)
            ElementTree.SubElement(added, "axis", xyz=numbers(axis))
            ElementTree.SubElement(added, "limit", bounds)
        above, place = name, next_place


def limits(actuator: Actuator) -> dict[str, float]:
    """Return torque in N·m and velocity in rad/s of an actuator, and its range in rad where it is known."""
    commands = actuator.command_limits()
    ends = {name: commands[f"{name}_command"].high for name in ("torque", "velocity") if f"{name}_command" in commands}
    torque = ends.get("torque") or getattr(actuator, "torque_limit", 0.0)
    velocity = getattr(actuator, "max_velocity", 0.0) or ends.get("velocity", 0.0)
    span = dict(zip(("lower", "upper"), getattr(actuator, "range", ())))
    return {"effort": torque, "velocity": velocity, **span}


def add_segment(link: ElementTree.Element, segment: str) -> None:
    """Add mass and shape of a segment, whose proximal joint is the origin of the link."""
    share, centre, gyration = SHARES[segment]
    length, radius = LENGTHS[segment], RADII[segment]
    mass, transverse = share * MASS, share * MASS * (gyration * length) ** 2
    along = 0.5 * mass * radius**2
    if segment == "foot":
        place = (HEEL * HEIGHT + 0.5 * length, 0.0, radius - ANKLE_HEIGHT * HEIGHT)
        at = (HEEL * HEIGHT + centre * length, 0.0, place[2])
        shape = ("box", {"size": numbers((length, 2.4 * radius, 2.0 * radius))})
        body(link, at, mass, (along, transverse, transverse), shape, place)
    else:
        shape = ("cylinder", {"radius": f"{radius:g}", "length": f"{length:g}"})
        at, place = (0.0, 0.0, -centre * length), (0.0, 0.0, -0.5 * length)
        body(link, at, mass, (transverse, transverse, along), shape, place)


def body(
    link: ElementTree.Element,
    centre: tuple[float, ...],
    mass: float,
    inertia: tuple[float, ...],
    shape: tuple[str, dict[str, str]],
    place: tuple[float, ...] | None = None,
) -> None:
    """Add mass and shape to a link. place : centre of the shape, by default that of the mass"""
    inertial(link, centre, mass, inertia)
    visual = ElementTree.SubElement(link, "visual")
    ElementTree.SubElement(visual, "origin", xyz=numbers(centre if place is None else place))
    ElementTree.SubElement(ElementTree.SubElement(visual, "geometry"), shape[0], shape[1])
    material = ElementTree.SubElement(visual, "material", name="segment")
    ElementTree.SubElement(material, "color", rgba=COLOUR)


def inertial(link: ElementTree.Element, centre: tuple[float, ...], mass: float, inertia: tuple[float, ...]) -> None:
    """Add a mass to a link. inertia : kg·m² about x, y and z"""
    added = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(added, "origin", xyz=numbers(centre))
    ElementTree.SubElement(added, "mass", value=f"{mass:g}")
    products = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    moments = {key: f"{value:g}" for key, value in zip(("ixx", "iyy", "izz"), inertia)}
    ElementTree.SubElement(added, "inertia", moments | products)


def connect(
    robot: ElementTree.Element,
    kind: str,
    name: str,
    above: str,
    below: str,
    place: tuple[float, ...],
    turn: tuple[float, ...] = (0.0, 0.0, 0.0),
) -> ElementTree.Element:
    """Add a joint between two links, and return it. place, turn : of the lower link in the upper one, in m and rad"""
    joint = ElementTree.SubElement(robot, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "origin", xyz=numbers(place), rpy=numbers(turn))
    ElementTree.SubElement(joint, "parent", link=above)
    ElementTree.SubElement(joint, "child", link=below)
    return joint


def numbers(values: Iterable[float]) -> str:
    """Return numbers as URDF writes them."""
    return " ".join(f"{value:.6g}" for value in values)

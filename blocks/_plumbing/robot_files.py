"""Rigid bodies of a robot and the joints between them, from URDF and MJCF."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from blocks._plumbing.mjcf_size import check_size
from blocks.mujoco import library

KINDS = {"revolute": False, "continuous": False, "prismatic": True}  # of joints in URDF that move: whether they slide


@dataclass
class Joint:
    """Joint between a body and its parent.

    slides : whether it is prismatic; else it is revolute
    axis, place : in the body
    reference : position, in rad or m, in which the body has the pose of the file
    armature : kg·m² or kg
    follows : name of the joint that moves this one, or ""
    """

    name: str
    slides: bool
    axis: np.ndarray
    place: np.ndarray = field(default_factory=lambda: np.zeros(3))
    reference: float = 0.0
    armature: float = 0.0
    follows: str = ""


@dataclass
class Body:
    """Rigid body.

    parent : index of the body that carries it, -1 for the world
    rotation, place : of this body in its parent
    mass : kg
    centre : centre of mass, in the body
    inertia : kg·m², (3, 3), about the centre of mass, in the axes of the body
    """

    parent: int
    rotation: np.ndarray
    place: np.ndarray
    joints: list[Joint]
    mass: float = 0.0
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))


def bodies_of(path: Path) -> list[Body]:
    """Return the bodies of a URDF or MJCF file, parents first. Raises ValueError."""
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise ValueError(f"not XML: {error}") from None
    if root.tag == "mujoco":
        return bodies_of_mjcf(path)
    if root.tag == "robot":
        return bodies_of_urdf(root)
    raise ValueError(f"its root element is <{root.tag}>: use a URDF file, with <robot>, or an MJCF file, with <mujoco>")


def bodies_of_mjcf(path: Path) -> list[Body]:
    """Return the bodies of an MJCF file in its reference pose, as MuJoCo compiles it. Raises ValueError."""
    mujoco = library()
    check_size(path)
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise ValueError(str(error).removeprefix("Error: ")) from None
    bodies: list[Body] = []
    for index in range(1, model.nbody):
        first, count = model.body_jntadr[index], model.body_jntnum[index]
        axes = matrix(mujoco, model.body_iquat[index])
        bodies.append(
            Body(
                int(model.body_parentid[index]) - 1,
                matrix(mujoco, model.body_quat[index]),
                model.body_pos[index].copy(),
                [joint_of_mjcf(mujoco, model, k) for k in range(first, first + count) if model.jnt_type[k] >= 2],
                float(model.body_mass[index]),
                model.body_ipos[index].copy(),
                axes @ np.diag(model.body_inertia[index]) @ axes.T,
            )
        )
    return bodies


def joint_of_mjcf(mujoco: Any, model: Any, index: int) -> Joint:
    """Return a hinge or slide of a model of MuJoCo."""
    return Joint(
        model.joint(index).name,
        model.jnt_type[index] == mujoco.mjtJoint.mjJNT_SLIDE.value,
        model.jnt_axis[index].copy(),
        model.jnt_pos[index].copy(),
        float(model.qpos0[model.jnt_qposadr[index]]),
        float(model.dof_armature[model.jnt_dofadr[index]]),
    )


def matrix(mujoco: Any, quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a quaternion, w first."""
    found = np.zeros(9)
    mujoco.mju_quat2Mat(found, quaternion)
    return found.reshape(3, 3)


def bodies_of_urdf(root: ElementTree.Element) -> list[Body]:
    """Return the links of a URDF file as bodies. Raises ValueError."""
    links = named(root, "link")
    joints: dict[str, list[tuple[ElementTree.Element, str]]] = {}  # by the parent link, each with its child
    above: dict[str, str] = {}
    for name, joint in named(root, "joint").items():
        parent, child = (required(joint, end, f"joint {name!r}").get("link", "") for end in ("parent", "child"))
        for link in (parent, child):
            if link not in links:
                raise ValueError(f"joint {name!r} refers to the link {link!r}, which does not exist")
        if child in above:
            raise ValueError(f"joints {above[child]!r} and {name!r} both carry the link {child!r}: a robot is a tree")
        above[child] = name
        joints.setdefault(parent, []).append((joint, child))
    roots = [name for name in links if name not in above]
    if len(roots) != 1:
        raise ValueError(f"it must have one link without a parent, and has {len(roots)}: {', '.join(roots) or 'none'}")
    bodies = [body_of_urdf(links[roots[0]], roots[0], -1, None)]
    todo = [(0, *item) for item in joints.get(roots[0], ())]
    for parent, joint, child in todo:
        bodies.append(body_of_urdf(links[child], child, parent, joint))
        todo += [(len(bodies) - 1, *item) for item in joints.get(child, ())]
    if len(bodies) < len(links):
        raise ValueError("its joints form a loop: a robot is a tree")
    return bodies


def body_of_urdf(link: ElementTree.Element, name: str, parent: int, joint: ElementTree.Element | None) -> Body:
    """Return a link and the joint that carries it. joint : None for the root"""
    where = f"link {name!r}"
    moving, (rotation, place) = [], (np.eye(3), np.zeros(3))
    if joint is not None:
        label, kind, mimic = f"joint {joint.get('name')!r}", joint.get("type", ""), joint.find("mimic")
        rotation, place = pose(joint, label)
        if kind in KINDS:
            axis = numbers(joint.find("axis"), "xyz", label, (1.0, 0.0, 0.0))
            if not (length := float(np.linalg.norm(axis))):
                raise ValueError(f"{label}: the axis must not be 0 0 0")
            follows = mimic.get("joint", "") if mimic is not None else ""
            moving = [Joint(joint.get("name", ""), KINDS[kind], axis / length, follows=follows)]
    body = Body(parent, rotation, place, moving)
    inertial = link.find("inertial")
    if inertial is not None:
        (body.mass,) = numbers(required(inertial, "mass", where), "value", where)
        element = required(inertial, "inertia", where)
        xx, xy, xz, yy, yz, zz = (
            float(numbers(element, key, where)[0]) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
        axes, body.centre = pose(inertial, where)
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if body.mass < 0.0 or np.linalg.eigvalsh(inertia)[0] < -1e-9 * np.abs(inertia).max():
            raise ValueError(f"{where}: mass and principal moments of inertia must not be negative")
        body.inertia = axes @ inertia @ axes.T
    return body


def named(root: ElementTree.Element, tag: str) -> dict[str, ElementTree.Element]:
    """Return the elements of a tag by name. Raises ValueError if one has no name, or that of another."""
    found: dict[str, ElementTree.Element] = {}
    for element in root.findall(tag):
        name = element.get("name", "")
        if not name or name in found:
            raise ValueError(f"each <{tag}> must have a name of its own, and one has {name!r}")
        found[name] = element
    return found


def required(element: ElementTree.Element, tag: str, where: str) -> ElementTree.Element:
    """Return the child with a tag. Raises ValueError."""
    found = element.find(tag)
    if found is None:
        raise ValueError(f"{where} has no <{tag}>")
    return found


def pose(element: ElementTree.Element, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation matrix and place of the <origin> of an element. Raises ValueError."""
    origin = element.find("origin")
    roll, pitch, yaw = numbers(origin, "rpy", where, (0.0, 0.0, 0.0))
    (r, s), (p, q), (y, z) = ((math.cos(angle), math.sin(angle)) for angle in (roll, pitch, yaw))
    rotation = np.array([[y, -z, 0.0], [z, y, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
        [[p, q * s, q * r], [0.0, r, -s], [-q, p * s, p * r]]
    )
    return rotation, numbers(origin, "xyz", where, (0.0, 0.0, 0.0))


def numbers(
    element: ElementTree.Element | None, key: str, where: str, default: Iterable[float] | None = None
) -> np.ndarray:
    """Return the finite numbers of an attribute: as many as those of the default, or one. Raises ValueError."""
    text = element.get(key) if element is not None else None
    if text is None and default is not None:
        return np.array(default)
    count = 1 if default is None else 3
    try:
        found = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        found = np.zeros(0)
    if len(found) != count or not np.isfinite(found).all():
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        tag = element.tag if element is not None else ""
        raise ValueError(f"{where}: {key} of <{tag}> must be {wanted}, got {text or ''!r}")
    return found

"""Inverse dynamics of a leg, an arm or another tree of rigid bodies, from its URDF or MJCF file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from blocks._plumbing.paths import file_param
from blocks._plumbing.ports import check_port_names, port_name
from blocks._plumbing.robot_files import Body, Joint, bodies_of
from blocks.mujoco import files_of, listed
from cext.kernels import inverse_dynamics as kernels
from graph import Block, Input, Interval, Memory, Output, Param
from graph.interval import EVERYTHING

STATE = 27  # numbers of the kernel's struct State
ROUNDING = Interval.point(1.0 + 1e-9)  # far above the relative error of the kernel
TURNING = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s²", "torque": "N·m"}
SLIDING = {"position": "m", "velocity": "m/s", "acceleration": "m/s²", "force": "N"}


class InverseDynamics(Block):
    """Inverse dynamics of a robot from its URDF or MJCF file: τ = M(q) a + c(q, v) + g(q).   (Luh et al. 1980)

        leg = InverseDynamics("leg.urdf", joints=("hip", "knee"))
        torques = leg(hip_position=hip.position, knee_position=knee.position)

    A revolute joint `knee` has the inputs `knee_position`, `knee_velocity` and `knee_acceleration` and the output
    `knee_torque` (prismatic: `knee_force`). Velocities and accelerations that are not connected are 0: positions alone
    give the gravity compensation. Names become those of ports as in `MujocoBody`.

    Positions are those of the file. Joints that are not listed are held: in URDF at 0, in MJCF in the reference pose.
    The base does not accelerate or rotate; `orientation` may come from an IMU on it. Masses, inertias and the armature
    of joints count, and no friction, damping, spring, tendon or contact. The range of each torque follows from the
    masses, the lengths, and the ranges of velocities and accelerations, in any pose.

    Direct feedthrough; NaN passes. MJCF requires MuJoCo: `pip install 'tickwork[mujoco]'`.
    """

    file = file_param("URDF or MJCF file")
    joints = Param((), "1", "names of the joints that move; by default all revolute and prismatic joints of the file")
    gravity = Param(9.80665, "m/s²", "gravitational acceleration, along -z of the world", min=0.0)

    orientation = Input(
        "1",
        "rotation from the frame of the base to the world, whose z is up: quaternion (w, x, y, z) of any length",
        shape=(4,),
        default=(1.0, 0.0, 0.0, 0.0),
    )
    links = Memory(0.0, "moving links, parents first")
    states = Memory(0.0, "motion of the base and of each link, and the forces on it")

    kernel = kernels.inverse_dynamics

    def configure(self) -> None:
        try:
            self.tree = links_of(bodies_of(Path(self.file)), self.joints)
        except ValueError as error:
            raise ValueError(f"{self.file}: {error}") from None
        self.links = np.concatenate([link.numbers() for link in self.tree])
        self.states = np.zeros(STATE * (len(self.tree) + 1))
        ordered = sorted(self.tree, key=lambda link: link.port)
        self.stems = [port_name(link.joint.name, (), "") for link in ordered]
        units = [SLIDING if link.joint.slides else TURNING for link in ordered]
        self.inputs = {
            f"{stem}_{word}": Input(unit[word], f"{word} of the joint", default=default).named(f"{stem}_{word}")
            for word, default in (("position", None), ("velocity", 0.0), ("acceleration", 0.0))
            for stem, unit in zip(self.stems, units)
        } | type(self).inputs
        self.outputs = {}
        for stem, unit in zip(self.stems, units):
            word = list(unit)[-1]
            self.outputs[f"{stem}_{word}"] = Output(unit[word], f"{word} of the joint").named(f"{stem}_{word}")
        check_port_names([f"{stem}_position" for stem in self.stems], _RESERVED_NAMES)

    def output_range(self, orientation: Interval, **inputs: Interval) -> dict[str, Interval]:
        """Return bounds by the norms of all vectors, which no rotation changes."""
        base = Bounds(Interval.point(0.0), Interval.point(0.0), around(self.span("gravity")))
        bounds: list[Bounds] = []
        for link in self.tree:
            parent = bounds[link.parent] if link.parent >= 0 else base
            stem = self.stems[link.port]
            motion = (inputs[f"{stem}_{word}"] for word in ("position", "velocity", "acceleration"))
            bounds.append(link.bounds(parent, *motion))
        found: dict[str, Interval] = {}
        for link, bound in reversed(list(zip(self.tree, bounds))):
            if link.parent >= 0:
                parent = bounds[link.parent]
                parent.force += bound.force
                parent.torque += bound.torque + bound.lever * bound.force
            reach = (bound.force if link.joint.slides else bound.torque) + bound.rotor
            name = list(self.outputs)[link.port]
            found[name] = reach * ROUNDING if reach.high < 1e307 else EVERYTHING
        return found

    def files_of(self, name: str) -> list[Path]:
        """Return the file, and those that an MJCF file includes or refers to."""
        path = Path(self.file)
        return sorted(files_of(path), key=lambda found: (found != path, found))


@dataclass
class Bounds:
    """Symmetric intervals that contain every element of the vectors of a link.

    rate, turning : angular velocity and acceleration; acceleration : of the origin of its frame, less gravity
    lever : distance of this origin from that of the parent; rotor : torque on the armature
    """

    rate: Interval
    turning: Interval
    acceleration: Interval
    lever: Interval = Interval.point(0.0)
    force: Interval = Interval.point(0.0)
    torque: Interval = Interval.point(0.0)
    rotor: Interval = Interval.point(0.0)


@dataclass
class Link:
    """Rigid part of the robot that a joint moves, in the frame of the joint: z is its axis.

    parent : index of the link that carries the joint, -1 for the base
    port : index of the joint among the ports
    rotation, place : of the frame in that of the parent, at the reference of the joint
    mass : kg
    moment : kg·m, mass times centre of mass
    inertia : kg·m², (3, 3), about the origin
    """

    parent: int
    port: int
    joint: Joint
    rotation: np.ndarray
    place: np.ndarray
    mass: float = 0.0
    moment: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))

    def add(self, body: Body, rotation: np.ndarray, place: np.ndarray) -> None:
        """Add the mass of a body. rotation, place : of the body in the frame of the link"""
        centre = place + rotation @ body.centre
        self.mass += body.mass
        self.moment += body.mass * centre
        self.inertia += rotation @ body.inertia @ rotation.T
        self.inertia += body.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))

    def numbers(self) -> np.ndarray:
        """Return the numbers of the kernel's struct Link."""
        joint, inertia = self.joint, self.inertia
        head = self.parent, self.port, float(joint.slides), joint.reference, joint.armature, self.mass
        products = inertia[0, 1], inertia[0, 2], inertia[1, 2]
        return np.concatenate((head, self.rotation.ravel(), self.place, self.moment, np.diag(inertia), products))

    def bounds(self, parent: Bounds, position: Interval, velocity: Interval, acceleration: Interval) -> Bounds:
        """Return the bounds of the link alone, without what it carries."""
        zero, slides = Interval.point(0.0), self.joint.slides
        spin, pull = (zero, zero) if slides else (around(velocity), around(acceleration))
        rate = parent.rate + spin
        turning = parent.turning + pull + parent.rate * spin
        lever = reach_of(self.place)
        moved = parent.acceleration
        if slides:
            lever += around(position - Interval.point(self.joint.reference))
            moved += around(acceleration) + Interval(-2.0, 2.0) * rate * velocity
        moved += (parent.turning + parent.rate * parent.rate) * lever
        moment = reach_of(self.moment)
        least, _, most = np.linalg.eigvalsh(self.inertia).tolist()
        skew = 0.5 * (most - least) + 1e-9 * most  # |ω × I ω| is at most (most - least) ω² / 2, and rounding
        return Bounds(
            rate,
            turning,
            moved,
            lever,
            force=Interval.point(self.mass) * moved + moment * (turning + rate * rate),
            torque=Interval.point(most) * turning + Interval.point(skew) * rate * rate + moment * moved,
            rotor=Interval.point(self.joint.armature) * around(acceleration),
        )


def links_of(bodies: list[Body], names: Sequence[str]) -> list[Link]:
    """Return the links that the named joints move, or all joints, parents first. Raises ValueError."""
    joints = {joint.name: joint for body in bodies for joint in body.joints}
    names = tuple(names) or tuple(joints)
    if not names or not all(names):
        raise ValueError("it has no revolute or prismatic joint, or one without a name: name each joint")
    for name in names:
        if name not in joints or names.count(name) > 1:
            what = "occurs twice" if name in joints else "is not a revolute or prismatic joint of the file"
            raise ValueError(f"joints: {name!r} {what}, which has {listed(joints)}")
    for name, joint in joints.items():
        if joint.follows in names and name not in names:
            raise ValueError(f"joints: {name!r} follows {joint.follows!r} (<mimic>): list it too")
    links: list[Link] = []
    poses: list[tuple[int, np.ndarray, np.ndarray]] = []  # of each body: its link, and its pose in this link
    for body in bodies:
        index, rotation, place = poses[body.parent] if body.parent >= 0 else (-1, np.eye(3), np.zeros(3))
        place, rotation = place + rotation @ body.place, rotation @ body.rotation
        for joint in body.joints:
            if joint.name in names:
                frame = frame_along(joint.axis)
                at = place + rotation @ joint.place
                links.append(Link(index, names.index(joint.name), joint, rotation @ frame, at))
                index, rotation, place = len(links) - 1, frame.T, -frame.T @ joint.place
        poses.append((index, rotation, place))
        if index >= 0:
            links[index].add(body, rotation, place)
    heavy: set[int] = set()
    for index in reversed(range(len(links))):
        if not links[index].mass and index not in heavy:
            raise ValueError(f"joint {links[index].joint.name!r} moves no mass: add masses and inertias to its links")
        heavy.add(links[index].parent)
    return links


def frame_along(axis: np.ndarray) -> np.ndarray:
    """Return a rotation matrix whose third column is a unit vector."""
    x = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross(axis, x), axis))


def around(u: Interval) -> Interval:
    """Return the smallest symmetric interval that contains another."""
    return Interval(-abs(u).high, abs(u).high)


def reach_of(vector: np.ndarray) -> Interval:
    """Return the symmetric interval up to the length of a vector."""
    length = math.nextafter(float(np.linalg.norm(vector)), math.inf)
    return Interval(-length, length)


_RESERVED_NAMES = {name for name in dir(InverseDynamics) if not name.startswith("_")} | set(InverseDynamics.parameters)

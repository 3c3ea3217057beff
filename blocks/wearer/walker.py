"""Walking adult that a robot assists."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from blocks.wearer.body import plan
from blocks.wearer.norms import MOTIONS
from blocks.wearer.recording import samples
from blocks.wearer.tables import over_speed, schedule
from cext.kernels.wearer import walker as kernels
from graph import Block, Input, Memory, Output, Param
from graph.files import path_beside

SIDES = ("left", "right")
JOINTS = {"hip": "hip flexion", "knee": "knee flexion", "ankle": "ankle dorsiflexion"}
SEGMENTS = {"thigh": "hip", "shank": "knee", "foot": "ankle"}
MOTION = "x, z of {} [m], their velocities and accelerations, pitch [rad], its velocity and acceleration"

# Muscles of hip, knee, ankle: stiffness in N·m/rad, more of it per N·m of moment, damping in N·m·s/rad, more of it per
# stiffness in s, stiffness and damping of the delayed part, range of the joint in rad. Of 70 kg and 1.70 m.
MUSCLES = (
    (45.0, 2.0, 3.0, 0.01, 30.0, 2.0, -0.7, 2.2),
    (25.0, 3.0, 2.0, 0.01, 30.0, 1.5, -0.15, 2.5),
    (15.0, 4.0, 0.5, 0.01, 10.0, 0.5, -1.0, 0.8),
)
# Standard deviations from stride to stride of one adult at 1.2 m/s.
GAIN_DEVIATIONS = (0.027, 0.014, 0.05)
OFFSET_DEVIATIONS = (0.0122, 0.0094, 0.0120)  # rad
STRIDE_TIME_DEVIATION = 0.012


def ports_of_legs() -> Iterator[tuple[str, Input | Output]]:
    """Yield the name and the declaration of each port of a leg, inputs first."""
    for side in SIDES:
        for joint, name in JOINTS.items():
            yield f"{side}_{joint}_assistance", Input("N·m", f"torque of the robot, positive in {name}", default=0.0)
    for side in SIDES:
        for joint, name in JOINTS.items():
            yield f"{side}_{joint}_angle", Output("rad", f"{side} {name}")
            yield f"{side}_{joint}_velocity", Output("rad/s", f"velocity of {side} {name}")
            yield f"{side}_{joint}_acceleration", Output("rad/s²", f"acceleration of {side} {name}")
            yield f"{side}_{joint}_torque", Output("N·m", f"torque of the muscles in {side} {name}")
            yield f"{side}_{joint}_power", Output("W", f"power of the muscles in {side} {name}")
        for segment in SEGMENTS:
            yield f"{side}_{segment}_pitch", Output("rad", f"pitch of the {side} {segment}, 0 in a straight stand")
        for segment, joint in SEGMENTS.items():
            yield f"{side}_{segment}_motion", Output("any", MOTION.format(f"the {side} {joint}"), shape=(9,))
        yield f"{side}_ground_force", Output("N", f"ground force on the {side} foot, forward and up", shape=(2,))
        yield f"{side}_centre_of_pressure", Output("m", f"centre of pressure from the heel of the {side} foot")
        yield f"{side}_contact", Output("1", f"true if the {side} foot bears 3 % of the weight or more", dtype=bool)
        yield f"{side}_phase", Output("1", f"gait phase of the {side} leg, 0 at heel strike", circle=(0, 1))


class Walker(Block):
    """Walking adult in the sagittal plane: pelvis, hips, knees, ankles, feet on level ground.

    The reference motion is the mean of 20 adults, a series of 12 harmonics over the stride, interpolated between
    walking speeds and joined smoothly to standing. (Bovi et al. 2011) Torques of a robot make the body deviate from it:

        M(q) δ'' + B δ' + K δ + c(q, q') + reflex(δ(t - delay)) = (1 - adaptation) assistance + Jᵀ ground

    δ are the six joints and place and pitch of the pelvis with the trunk; M and c are those of the seven segments (de
    Leva 1996, Winter 2009). A loaded foot sticks to the ground up to its friction. K grows with the moment of the
    joint, at the ankle by 4 N·m/rad per N·m: its stiffness in stance is up to 5.4 N·m/rad per kg
    (Ficanha et al. 2018). In swing the hip has 34 to 66 N·m/rad and the knee few (van der Kooij et al. 2022). Trained
    wearers yield 80 % of an assistance at the ankle (Nuckols and Sawicki 2020), in phase and as far as they have a
    torque of their own in that direction; at hip and knee similar shares are assumed. Against an opposing torque they
    add 48 % of it within 50 ms, an assumption.

    The metabolic power is 1.4 W/kg at rest, 1.42 times the positive power of the muscles, a part of their squared
    torques, and one of the squared torque that the calf leaves to a robot. It is within 10 % of that of adults (Ralston
    1958).

    `person` selects an adult who differs from the average as the measured adults do; it is the same adult at every
    speed. An adult drawn at random whose knee would overextend is moved toward the average.

    Angles are positive in flexion (dorsiflexion at the ankle), pitches with the front up; x is forward and z up.
    `*_torque` is the net torque of the muscles in the direction of flexion: the nominal moment, less the adapted share
    of the assistance, plus what K, B and the reflex add; `*_power` is that torque times the velocity. The phase is 0 at
    heel strike; the right leg is half a stride ahead. `*_motion` of a segment has its proximal joint in world
    coordinates and its pitch: a point r of the segment has the acceleration a + α × r + ω × (ω × r).

    A recording has the columns time, hip_flexion_lt_deg, knee_flexion_lt_deg, ankle_dorsiflexion_lt_deg and those of
    the right leg (`rt`), or OpenSim's hip_flexion_l, knee_angle_l and ankle_angle_l in degrees. It repeats. Contacts,
    ground forces, torques and the pitch of the pelvis are played where it has them (docs/explanation/wearer.md names
    the columns); else they follow from the angles and from the average adult at the same phase.

    The legs that bear the body hold the balance: they transmit a force and a moment of the ground that return pelvis
    and trunk. `plausible` is false from the moment at which the motion exceeds one of `limits`.

    Limits: cadence and the plan of the next step do not adapt to the robot. Both legs have the same mean motion.
    Turning and slopes are not modelled.
    """

    speed = Param(1.2, "1", 'walking speed in m/s, or times and speeds as in "0:0 2:1.2 20:1.2 25:0"', dtype=object)
    motion = Param("walk", "1", "reference motion", choices=tuple(MOTIONS))
    mass = Param(70.0, "kg", "mass of the body", above=0.0, max=300.0, fixed=True, kernel=False)
    height = Param(1.70, "m", "height of the body", above=0.5, max=2.5, fixed=True, kernel=False)
    person = Param(
        0,
        "1",
        "adult: 0 for the average, a seed for one drawn at random, scores of components in standard deviations, or the "
        "path of one that blocks.wearer.fit made of a recording",
        dtype=object,
    )
    start = Param(0.0, "1", "phase of the left leg at t = 0", min=0.0, max=1.0, fixed=True, kernel=False)
    variability = Param(
        1.0, "1", "scale of the variation from stride to stride, 0 for none", min=0.0, max=5.0, fixed=True, kernel=False
    )
    seed = Param(0, "1", "seed of the variation from stride to stride", min=0, max=2**53, fixed=True, kernel=False)
    strength = Param(
        1.0,
        "1",
        "scale of the muscles' stiffness and damping against deviations; above 1, only of those without delay",
        above=0.0,
        max=10.0,
        fixed=True,
        kernel=False,
    )
    adaptation = Param(
        0.8,
        "1",
        "share of a helpful torque by which a trained wearer reduces the torque of the muscles",
        min=0.0,
        max=1.0,
    )
    reflex_delay = Param(0.05, "s", "delay of the reflexes", min=0.0, max=0.3, fixed=True, kernel=False)

    recording = Param(
        "",
        "1",
        "path of a recorded motion, a CSV file or OpenSim's .mot; it replaces the choice of motion, speed and person",
        file=True,
    )

    locals().update(ports_of_legs())
    pelvis_motion = Output("any", MOTION.format("the hips"), shape=(9,))
    walking_speed = Output("m/s", "walking speed of the schedule")
    plausible = Output("1", "false once the adult has exceeded a limit of people", dtype=bool)
    limit = Output("1", "limit that was exceeded first, an index of `limits`", dtype=int)
    plausible_time = Output("s", "time for which the motion was plausible")
    metabolic_power = Output("W", "estimated metabolic power")
    metabolic_change = Output("W", "part of the metabolic power that the torques of the robot cause")
    limits = (
        "none",
        *(f"the {joint} exceeds its stop by more than 5°" for joint in JOINTS),
        "the trunk tilts by more than 30°",
        "the hips fall by more than 15 cm",
        "a loaded foot slips by more than 10 cm",
        "a swinging foot meets the ground",
        "the centre of pressure leaves a foot by more than 10 cm",
    )

    body = Memory(0.0, "lengths, inertias and masses")
    muscles = Memory(0.0, "stiffness, damping and range of each joint")
    variation = Memory(0.0, "seed and standard deviations of gain, offset and stride time")
    pieces = Memory(0.0, "pieces of the speed over time")
    knots = Memory(0.0, "speeds of the table")
    table = Memory(0.0, "height of the body, slope of the way, then the cubics over the speed")
    samples = Memory(0.0, "rate and samples of the recording")
    history = Memory(0.0, "deviations of the last moments")
    state = Memory(0.0, "phase, draws of the stride, deviations, present row of the table")

    kernel = kernels.walker
    update_kernel = kernels.walker_next
    feedthrough = ()

    def configure(self) -> None:
        person: Any = self.person
        if isinstance(person, str) and person.endswith(".json"):
            person = str(path_beside(self.location, person))
        speeds, cubics = over_speed(self.motion, self.height, person)
        if self.recording:
            self.samples = samples(self.recording, self.mass, self.height)
        self.pieces = schedule(self.speed, speeds[-1]).ravel()
        self.knots = speeds
        self.table = np.concatenate([[self.height, MOTIONS[self.motion][0]["slope"]], cubics.ravel()])
        self.body = plan(self.mass, self.height)
        # As the inertia of the leg, so that all bodies are damped alike; a stronger delayed part would be unstable.
        size = self.mass / 70.0 * (self.height / 1.70) ** 2
        scale = np.array([size * self.strength, self.strength, size * math.sqrt(self.strength), 1.0])
        scale = np.concatenate([scale, [size * min(1.0, self.strength)] * 2, [1.0, 1.0]])
        self.muscles = (np.array(MUSCLES) * scale).ravel()
        deviations = (*GAIN_DEVIATIONS, *OFFSET_DEVIATIONS, STRIDE_TIME_DEVIATION)
        self.variation = (float(self.seed), *(self.variability * value for value in deviations))

    def prepare(self, dt: float) -> None:
        self.history = np.zeros(12 * max(1, math.ceil(self.reflex_delay / dt - 1e-9)))
        size, unset = kernels.layout()
        state = np.zeros(size)
        state[0] = self.start
        state[unset] = -1.0
        self.state = state

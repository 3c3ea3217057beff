"""A joint that an emulated drive moves in virtual time, for the steps of `commission` under torque."""

import math

from blocks import actuators
from graph import Block, Diagram, Input, Output, Param
from runtime.setup.commissioning.guided import driven
from tests.cext.imposed import Given
from tests.cext.rigs import Rig

STOP = 2000.0, 5.0  # N·m/rad and N·m·s/rad of a mechanical stop


class Moved(Block):
    """Joint with inertia, friction and stops. `most`: the largest torque of the drive so far, N·m.

    Its friction is Coulomb friction, of which a share more holds it at rest, and viscous friction.
    """

    inertia = Param(0.02, "kg·m²")
    friction = Param(0.1, "N·m")
    sticking = Param(0.0, "1", "share by which friction at rest is larger")
    viscous = Param(0.0, "N·m·s/rad")
    cogging = Param(0.0, "N·m", "amplitude of a torque that depends on the angle, 36 times a turn")
    weight = Param(0.0, "N·m", "torque of a horizontal link")
    lower = Param(-math.inf, "rad", "lower stop")
    yields = Param(0.0, "rad", "motion of the stops after the first contact")
    start = Param(0.0, "rad")

    torque = Input("N·m")
    position = Output("rad")
    velocity = Output("rad/s")

    def reset(self):
        self.at, self.speed, self.most, self.end, self.pressed = self.start, 0.0, 0.0, self.lower, False

    def step(self):
        return self.at, self.speed

    def update(self, torque):
        self.most = max(self.most, abs(torque))
        net = torque - self.viscous * self.speed - self.weight * math.sin(self.at)
        net -= self.cogging * math.sin(36.0 * self.at)
        if self.at < self.end:
            net += max(0.0, STOP[0] * (self.end - self.at) - STOP[1] * self.speed)
            self.pressed = True
        elif self.pressed and self.at > self.end + 0.06:
            self.pressed, self.end = False, self.end - self.yields
        resisted = self.friction * (1.0 + self.sticking * math.exp(-((self.speed / 0.05) ** 2)))
        free = self.speed + net * self.dt / self.inertia
        self.speed = math.copysign(max(0.0, abs(free) - resisted * self.dt / self.inertia), free)
        self.at += self.speed * self.dt


def block_of(kind, model, **parameters):
    """A drive of a robot."""
    with Diagram("bench", rate=200):
        return getattr(actuators, kind)(
            model, can_id=1, name="knee", **{"range": (-1.5, 0.5), "offset": 0.0} | parameters
        )


def moved(robot, joint, duration, inputs=None, **faults):
    """Run the Diagram of a step. Returns (Outcome, joint). joint : parameters of Moved; inputs : of the emulator"""
    with Diagram("plant", rate=2000) as plant:
        arm = Moved(**joint)
        drive = robot["joint"].emulator(name="drive", **faults)
        arm(drive.torque)
        given = {name: Given(value, unit="1", dtype=bool)() for name, value in (inputs or {}).items()}
        drive(position=arm.position, velocity=arm.velocity, **given)
    return Rig(robot, plant).run(math.ceil(duration * driven.RATE)), arm

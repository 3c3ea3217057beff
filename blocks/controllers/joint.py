"""Joint control laws: impedance, admittance, feed-forward, gravity compensation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from blocks._plumbing.filter_bounds import design_at, reach_of_state_space
from blocks._plumbing.ranges import wave
from blocks.linear import zero_order_hold
from cext.kernels import controllers as kernels
from graph import Block, Input, Interval, Memory, Output, Param

GRAVITY = 9.80665  # m/s², standard
ZERO = Interval.point(0.0)


class Impedance(Block):
    """Virtual spring and damper about an equilibrium: τ = K (θ₀ − θ) − B ω.   (Hogan 1985)

    An input adds to each parameter: for a stiffness that depends on the gait, connect `extra_stiffness` and set
    `stiffness` to 0. Direct feedthrough; NaN passes.
    """

    stiffness = Param(30.0, "N·m/rad", "stiffness K", min=0.0, max=150.0, live=True)
    damping = Param(1.0, "N·m·s/rad", "damping B", min=0.0, max=10.0, live=True)

    position = Input("rad", "joint angle θ")
    velocity = Input("rad/s", "joint velocity ω")
    equilibrium = Input("rad", "equilibrium angle θ₀", default=0.0)
    extra_stiffness = Input("N·m/rad", "stiffness that adds to K", default=0.0)
    extra_damping = Input("N·m·s/rad", "damping that adds to B", default=0.0)
    torque = Output("N·m", "torque τ")

    kernel = kernels.impedance

    def output_range(
        self,
        position: Interval,
        velocity: Interval,
        equilibrium: Interval,
        extra_stiffness: Interval = ZERO,
        extra_damping: Interval = ZERO,
    ) -> Interval:
        stiffness, damping = self.span("stiffness") + extra_stiffness, self.span("damping") + extra_damping
        return stiffness * (equilibrium - position) - damping * velocity


class Admittance(Block):
    """Virtual mass, spring and damper driven by a torque: M ë + B ė + K e = τ, θ = θ₀ + e.   (Hogan 1985)

    For position-controlled drives with a sensor of the interaction torque. Exact for a torque that is constant between
    ticks. No direct feedthrough of the torque. Starts at rest at the equilibrium. NaN persists until the next reset.
    """

    inertia = Param(0.5, "kg·m²", "virtual inertia M", above=0.0, fixed=True)
    damping = Param(5.0, "N·m·s/rad", "virtual damping B", min=0.0, fixed=True)
    stiffness = Param(30.0, "N·m/rad", "virtual stiffness K", min=0.0, fixed=True)

    torque = Input("N·m", "interaction torque τ; positive increases the angle")
    equilibrium = Input("rad", "equilibrium angle θ₀", default=0.0)
    position = Output("rad", "position command θ for the drive")
    velocity = Output("rad/s", "velocity ė of the virtual mass")
    transition = Memory(0.0, "state matrix, row by row, followed by the input column")
    state = Memory((0.0, 0.0), "displacement e and velocity ė")

    kernel = kernels.admittance
    update_kernel = kernels.admittance_next
    feedthrough = ("equilibrium",)

    def design(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Return (A, B) over one period. dt : s"""
        A = np.array([[0.0, 1.0], [-self.stiffness / self.inertia, -self.damping / self.inertia]])
        return zero_order_hold(A, np.array([[0.0], [1.0 / self.inertia]]), dt)

    def prepare(self, dt: float) -> None:
        A, B = self.design(dt)
        self.transition = np.append(A.ravel(), B.ravel())

    def output_range(self, torque: Any, equilibrium: Any) -> Any:
        system = design_at(self)
        if system is None:
            return {}
        A, B = system
        angle, rate = (reach_of_state_space(A, B, [row], [[0.0]]) for row in ((1.0, 0.0), (0.0, 1.0)))
        if angle is None or rate is None:
            return {}
        return {"position": angle.interval([torque]) + equilibrium, "velocity": rate.interval([torque])}


class FeedForward(Block):
    """Feed-forward torque of a planned motion: τ = M α + B ω + τ_c · clip(ω / ω_c, -1, 1).

    Direct feedthrough; NaN passes.
    """

    inertia = Param(0.0, "kg·m²", "inertia M of the joint and its load", min=0.0)
    damping = Param(0.0, "N·m·s/rad", "viscous friction B", min=0.0)
    friction = Param(0.0, "N·m", "Coulomb friction τ_c", min=0.0)
    slip = Param(0.1, "rad/s", "velocity ω_c above which the full Coulomb friction applies", above=0.0)

    velocity = Input("rad/s", "planned velocity ω")
    acceleration = Input("rad/s²", "planned acceleration α", default=0.0)
    torque = Output("N·m", "torque τ")

    kernel = kernels.feed_forward

    def output_range(self, velocity: Interval, acceleration: Interval) -> Interval:
        slip = self.span("slip").low
        sign = Interval(
            min(max(velocity.low / slip, -1.0), 1.0), min(max(velocity.high / slip, -1.0), 1.0)
        ) | Interval.point(0.0)
        return self.span("inertia") * acceleration + self.span("damping") * velocity + self.span("friction") * sign


class GravityCompensation(Block):
    """Gravity compensation of a limb segment: τ = share · m g l sin θ, with θ = 0 hanging straight down.

    Direct feedthrough; NaN passes. g = 9.80665 m/s². For masses and centres of mass of segments see Winter,
    Biomechanics and Motor Control of Human Movement, table 4.1.
    """

    mass = Param(3.0, "kg", "mass m of the segment and its load", min=0.0)
    length = Param(0.2, "m", "distance l from the joint to the centre of mass", min=0.0)
    share = Param(1.0, "1", "share of the weight that is compensated", min=0.0, max=1.0, live=True)

    angle = Input("rad", "segment angle θ; 0 hanging straight down")
    torque = Output("N·m", "torque τ")

    kernel = kernels.gravity

    def output_range(self, angle: Interval) -> Interval:
        sine = wave(math.sin, angle, 0.5 * math.pi)
        return self.span("share") * self.span("mass") * Interval.point(GRAVITY) * self.span("length") * sine


class DisturbanceObserver(Block):
    """Torque that acts on a joint besides the commanded one: d̂ = g / (s + g) · (J dω/dt + B ω − τ).   (Ohnishi 1987)

    Friction that the damping B leaves out, gravity, a wearer, an error of the inertia J. No derivative is taken: the
    observer filters momentum and torque. d̂ starts at 0, and follows a step of the disturbance with the time constant
    1/g. Its error is 0 for a constant disturbance, torque and inertia. Direct feedthrough of the velocity only, so
    the command that is its torque may subtract d̂. NaN persists until the next reset.
    """

    inertia = Param(0.1, "kg·m²", "inertia J of the joint and its load", above=0.0, fixed=True)
    damping = Param(0.0, "N·m·s/rad", "viscous friction B, which is not part of d̂", min=0.0, fixed=True)
    bandwidth = Param(20.0, "rad/s", "bandwidth g; at most the rate of the block", above=0.0, fixed=True)
    limit = Param(5.0, "N·m", "largest d̂", above=0.0, fixed=True)

    torque = Input("N·m", "torque τ of the drive")
    velocity = Input("rad/s", "joint velocity ω")
    disturbance = Output("N·m", "estimate d̂ of the torque that acts besides τ; positive increases the velocity")
    filtered = Memory(0.0, "filtered sum of g J ω, τ and -B ω")
    started = Memory(0.0, "1 after the first tick")

    kernel = kernels.observer
    update_kernel = kernels.observer_next
    feedthrough = ("velocity",)

    def prepare(self, dt: float) -> None:
        """Raise ValueError for a bandwidth above the rate of the block."""
        if self.bandwidth * dt > 1.0:
            raise ValueError(
                f"bandwidth must be at most the rate of the block, {1 / dt:g} rad/s, got {self.bandwidth:g}"
            )

    def output_range(self, torque: Interval, velocity: Interval) -> Interval:
        return Interval(-self.limit, self.limit)

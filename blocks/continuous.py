"""Plants with continuous states, which the solver of the diagram integrates between its ticks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from cext.kernels import continuous as kernels
from graph import Input, Output, Param
from graph.continuous import Continuous
from graph.units import multiply

# of the force over the length of a fibre: height, middle, width, and growth of the width
BELLS = ((0.815, 1.055, 0.162, 0.063), (0.433, 0.717, -0.030, 0.200), (0.1, 1.0, math.sqrt(0.125), 0.0))
RESTING = 0.318 * math.asinh(0.374) + 0.886  # factor of the force of a fibre at rest


class ContinuousIntegrator(Continuous):
    """Integral over time: y' = u, y(0) = start, by the solver of the diagram.

    Between continuous blocks, u is the signal at each stage of the solver and not only at the ticks: two of these in a
    loop are an oscillator without growth. NaN persists until the next reset.
    """

    start = Param(0.0, "any", "value at the start", fixed=True)

    u = Input("any", "integrand", shape=...)
    y = Output("any", "integral of u", shape=...)

    derivative_kernel = kernels.integral

    def initial(self) -> Sequence[Any]:
        return ([self.start] * self.width,)

    def output_units(self, u: str) -> dict[str, str]:
        return {"y": multiply(u, "s")}


class Pendulum(Continuous):
    """Point mass on a massless rod: m l² θ'' = τ - d θ' - m g l sin θ.

    θ = 0 hangs down. NaN persists until the next reset.
    """

    mass = Param(1.0, "kg", "mass m", above=0.0)
    length = Param(0.5, "m", "length l of the rod", above=0.0)
    damping = Param(0.0, "N·m·s/rad", "damping d of the bearing", min=0.0)
    gravity = Param(9.80665, "m/s²", "acceleration g of gravity")
    start = Param(0.0, "rad", "angle at the start, at rest", fixed=True)

    torque = Input("N·m", "torque τ at the bearing", default=0.0)
    position = Output("rad", "angle θ")
    velocity = Output("rad/s", "angular velocity θ'")

    derivative_kernel = kernels.pendulum

    def initial(self) -> Sequence[Any]:
        return self.start, 0.0


class MassSpringDamper(Continuous):
    """Mass on a spring and a damper: m x'' = F - d x' - k x.

    NaN persists until the next reset.
    """

    mass = Param(1.0, "kg", "mass m", above=0.0)
    damping = Param(0.0, "N·s/m", "damping d", min=0.0)
    stiffness = Param(0.0, "N/m", "stiffness k of the spring", min=0.0)
    start = Param(0.0, "m", "position at the start, at rest", fixed=True)

    force = Input("N", "force F", default=0.0)
    position = Output("m", "position x")
    velocity = Output("m/s", "velocity x'")

    derivative_kernel = kernels.mass

    def initial(self) -> Sequence[Any]:
        return self.start, 0.0


class BouncingMass(Continuous):
    """Mass that falls on a floor at x = 0: m x'' = F - m g above it, v → -e v at the contact.

    Below `rest` after a contact it stays on the floor until F > m g. NaN persists until the next reset.
    """

    mass = Param(1.0, "kg", "mass m", above=0.0)
    restitution = Param(0.8, "1", "share e of the velocity after a contact", min=0.0, max=1.0)
    gravity = Param(9.80665, "m/s²", "acceleration g of gravity", min=0.0)
    rest = Param(1e-4, "m/s", "velocity after a contact below which it stays on the floor", above=0.0)
    start = Param(1.0, "m", "height at the start, at rest", min=0.0, fixed=True)

    force = Input("N", "force F upwards", default=0.0)
    position = Output("m", "height x")
    velocity = Output("m/s", "velocity v")

    derivative_kernel = kernels.bouncer
    crossing_kernel = kernels.bouncer_contact
    jump_kernel = kernels.bouncer_rebound

    def initial(self) -> Sequence[Any]:
        return self.start, 0.0


class DirectCurrentMotor(Continuous):
    """Motor with its winding and friction: J ω' = k i - τ - d ω - τ_c tanh(ω / ω_s), L i' = U - R i - k ω.

    The fastest time constants are about L / R and J ω_s / τ_c. NaN persists until the next reset.
    """

    resistance = Param(0.3, "Ω", "resistance R of the winding", above=0.0)
    inductance = Param(2e-4, "V·s/A", "inductance L of the winding", above=0.0)
    torque_constant = Param(0.09, "N·m/A", "torque constant k, also in V·s/rad", above=0.0)
    inertia = Param(1e-4, "kg·m²", "moment of inertia J of the rotor", above=0.0)
    damping = Param(1e-4, "N·m·s/rad", "damping d of the bearing", min=0.0)
    friction = Param(0.01, "N·m", "Coulomb friction τ_c", min=0.0)
    slip = Param(0.1, "rad/s", "velocity ω_s up to which the friction is proportional to the velocity", above=0.0)

    voltage = Input("V", "voltage U", default=0.0)
    load = Input("N·m", "torque τ of the load", default=0.0)
    position = Output("rad", "angle")
    velocity = Output("rad/s", "angular velocity ω")
    current = Output("A", "current i")

    derivative_kernel = kernels.motor


class MuscleTendon(Continuous):
    """Muscle of the Hill type on an elastic tendon: F' = k_T (F + 0.25 F_0) (v - v_fibre / cos α) / l_T.

    The curves of force over length and velocity, the tendon (k_T = 35) and the dynamics of the activation are those of
    De Groote, Kinney, Rao and Fregly (2016), with the force of the tendon as a state: Ann. Biomed. Eng. 44, 2922-2936,
    doi:10.1007/s10439-016-1591-9. The fibre has a constant height, and an excitation outside 0.01 to 1 counts as the
    nearer of the two. At the start the fibre rests. NaN persists until the next reset.
    """

    max_force = Param(3000.0, "N", "isometric force F_0 of the muscle", above=0.0)
    fibre = Param(0.055, "m", "optimal length of the fibre", above=0.0)
    tendon = Param(0.25, "m", "slack length l_T of the tendon", above=0.0)
    pennation = Param(0.35, "rad", "angle α of the fibre at its optimal length", min=0.0, max=1.4)
    max_velocity = Param(10.0, "1/s", "largest velocity of the fibre, in optimal lengths per second", above=0.0)
    activation_time = Param(0.015, "s", "time constant of the activation", above=0.0)
    deactivation_time = Param(0.06, "s", "time constant of the deactivation", above=0.0)
    start_activation = Param(0.05, "1", "activation at the start", min=0.01, max=1.0, fixed=True)
    start_length = Param(0.305, "m", "length of muscle and tendon at the start", above=0.0, fixed=True)

    excitation = Input("1", "neural excitation, 0.01 to 1")
    length = Input("m", "length of muscle and tendon")
    velocity = Input("m/s", "rate of change of the length", default=0.0)
    activation = Output("1", "activation")
    force = Output("N", "force of the tendon F")

    derivative_kernel = kernels.muscle

    def initial(self) -> Sequence[Any]:
        return self.start_activation, self.force_at(self.start_activation, self.start_length)

    def force_at(self, activation: float, length: float) -> float:
        """Return the force in N of the resting muscle. length : of muscle and tendon, m"""
        optimal, height = self.fibre, self.fibre * math.sin(self.pennation)
        low, high = 1e-6 * optimal, max(length - 0.9 * self.tendon, 2e-6 * optimal)  # along the tendon
        for _ in range(60):
            along = 0.5 * (low + high)
            cosine = along / math.hypot(along, height)
            l = math.hypot(along, height) / optimal  # noqa: E741
            active = sum(
                top * math.exp(-0.5 * ((l - middle) / (width + growth * l)) ** 2)
                for top, middle, width, growth in BELLS
            )
            passive = math.expm1(4.0 * (l - 1.0) / 0.6) / math.expm1(4.0)
            pull = (activation * active * RESTING + passive) * cosine
            tension = 0.2 * math.exp(35.0 * ((length - along) / self.tendon - 0.995)) - 0.25
            low, high = (along, high) if tension > pull else (low, along)
        return self.max_force * (0.2 * math.exp(35.0 * ((length - low) / self.tendon - 0.995)) - 0.25)

"""Plant models: a joint that a wearer and a drive move."""

from __future__ import annotations

import math

from cext.kernels import models as kernels
from graph import Block, Input, Memory, Output, Param


class Limb(Block):
    """Joint moved by its wearer and a drive: I (α − α₀) = τ + K (θ₀ − θ) + B (ω₀ − ω) − d (ω − ω₀).

    The wearer follows the intended motion θ₀, ω₀, α₀ with a spring and a damper; τ is the torque of the drive. Without
    a wearer (stiffness and reflex 0) the joint is a free inertia. Below `lower`, ligaments of stiffness `ligament`
    limit the motion, as in a straight knee. Semi-implicit Euler; no direct feedthrough.
    """

    inertia = Param(0.35, "kg·m²", "moment of inertia I; the default is shank and foot about the knee", above=0.0)
    damping = Param(1.0, "N·m·s/rad", "damping d of the tissue", min=0.0)
    stiffness = Param(120.0, "N·m/rad", "stiffness K of the wearer", min=0.0)
    reflex = Param(8.0, "N·m·s/rad", "damping B of the wearer's reflexes", min=0.0)
    start = Param(0.0, "rad", "initial angle", fixed=True)
    lower = Param(-math.inf, "rad", "angle below which the ligaments pull")
    ligament = Param(500.0, "N·m/rad", "stiffness of the ligaments", min=0.0)

    torque = Input("N·m", "torque of the drive", default=0.0)
    angle = Input("rad", "intended angle θ₀ of the wearer", default=0.0)
    rate = Input("rad/s", "intended velocity ω₀ of the wearer", default=0.0)
    acceleration = Input("rad/s²", "intended acceleration α₀ of the wearer", default=0.0)
    position = Output("rad", "joint angle θ")
    velocity = Output("rad/s", "joint velocity ω")
    state = Memory((0.0, 0.0), "angle θ and velocity ω")

    kernel = kernels.limb
    update_kernel = kernels.limb_next
    feedthrough = ()

    def configure(self) -> None:
        self.state = (self.start, 0.0)

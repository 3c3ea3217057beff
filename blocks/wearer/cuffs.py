"""Cuff between a drive and a limb of the wearer."""

from __future__ import annotations

from cext.kernels.wearer import cuffs as kernels
from graph import Block, Input, Memory, Output, Param


class Cuff(Block):
    """Cuff of a robot on a limb, with a load cell: F = τ / r, and the soft tissue yields by x, k x + c dx/dt = F.

    The drive is ahead of the joint by x / r. All torque of the drive reaches the joint, without inertia or slip of the
    cuff; part of its work deforms the tissue, which returns most of it. (Yandell et al. 2017, J NeuroEng Rehabil 14:40)
    The default stiffness is that of a cuff perpendicular to the arm, the median of 21 adults. (Schiebl et al. 2025,
    Sensors 25:4605) If both segments have such a cuff, use half. The relaxation time c / k is an assumption.

    No direct feedthrough of the torque: `force` is that of the previous step of the plant. Example:

        cuff = Cuff(lever=0.3)
        contact = cuff(angle=motion.left_ankle_angle, velocity=motion.left_ankle_velocity)
        drive(position=contact.position, velocity=contact.speed)
        cuff(torque=drive.torque)
        adult(left_ankle_assistance=drive.torque)
    """

    lever = Param(0.3, "m", "distance of the cuff from the joint", above=0.0)
    stiffness = Param(4500.0, "N/m", "stiffness of soft tissue and strap", above=0.0)
    relaxation = Param(0.02, "s", "relaxation time, damping divided by stiffness", above=0.0)
    gain = Param(1.0, "1", "measured over true force", min=0.0)
    zero = Param(0.0, "N", "force that is measured without a torque")
    zero_drift = Param(0.0, "N/s", "drift of the zero", fixed=True)
    noise = Param(0.0, "N", "standard deviation of a sample of the measured force", min=0.0)
    seed = Param(0, "1", "seed of the noise", min=0, max=2**53, fixed=True)

    torque = Input("N·m", "torque of the drive at the joint")
    angle = Input("rad", "angle of the joint")
    velocity = Input("rad/s", "velocity of the joint")
    position = Output("rad", "angle of the drive")
    speed = Output("rad/s", "velocity of the drive")
    force = Output("N", "force on the limb in the direction of the torque")
    measured = Output("N", "force that the load cell measures")
    state = Memory((0.0,) * 4, "deflection and its rate, force, drift")

    kernel = kernels.cuff
    update_kernel = kernels.cuff_next
    feedthrough = ("angle", "velocity")

"""What the watch over an actuator's motion and torque has found, in words: the value, what it must be inside of, and
what to do.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cext.schedule.program import Program


def text(status: str, block, program: Program) -> str | None:
    """The fault of an actuator, or None where `status` is none of these."""
    words = WORDS.get(status)
    row = next((row for row in program.watched if block is not None and row["device"] == block.path), None)
    return None if words is None or row is None else words(block, row["about"], row["value"], row["bound"])


def acceleration(block, about: str, value: float, bound: float) -> str:
    return (
        f"the joint goes on accelerating by more than its max_acceleration of {bound:g} rad/s² (up to {value:.0f} "
        "rad/s²): with stiffness or "
        "damping its limit rests on that. Find what hits or shakes it; raise max_acceleration where such motion is "
        "meant"
    )


def excess_torque(block, about: str, value: float, bound: float) -> str:
    accuracy = block.watched().motion.accuracy
    return (
        f"the drive measures {value:.3g} N·m; its limit is {bound:.3g} N·m, and its measurement is trusted to "
        f"{accuracy:.2g} N·m. Compare "
        f"wire_stiffness, wire_damping and wire_torque with the drive's firmware"
    )


def over_travel(block, about: str, value: float, bound: float) -> str:
    low, high = block.range
    return (
        f"position {value:.3f} rad is outside the joint's range of {low:g} to {high:g} rad. Find out why before "
        "it is armed again"
    )


def overspeed(block, about: str, value: float, bound: float) -> str:
    return (
        f"velocity {value:.3g} rad/s is beyond {bound:.3g} "
        f"rad/s{'' if block.max_velocity else ', which max_velocity is by default'}"
    )


def not_following(block, about: str, value: float, bound: float) -> str:
    return (
        f"the drive gives {value:.2g} N·m where {bound:.2g} N·m are commanded: it is disabled, as after a loss of "
        "its power, or at a limit "
        f"of its own. Check its supply, and arm it again"
    )


def scale_mismatch(block, about: str, value: float, bound: float) -> str:
    if about == "velocity":
        if value < 0.0:
            return (
                "the reported velocity has the other sign than the position's rate: the drive's firmware is not "
                "the one of its model's table"
            )
        if not 0.01 < value < 100.0:
            still, moves = ("position", "velocity") if value > 1.0 else ("velocity", "position")
            return (
                f"the reported {still} is constant while the reported {moves} shows motion: an "
                "encoder, or the drive's firmware"
            )
        cure = wire_cure(block, value)
        return f"the reported velocity is {value:.3g} of the rate of the reported position: {cure}"
    constant = " or the torque constant" if "current" in block.outputs else ""
    return (
        f"the measured torque is {value:.3g} of what was sent: wire_torque, wire_stiffness, wire_damping{constant} "
        f"of {block.spec.name} "
        f"are not those of the drive's firmware. Compare them with its manual"
    )


def wire_cure(block, value: float) -> str:
    """What to set where a velocity is `value` times the position's rate."""
    if "wire_velocity" not in block.parameters or "current" in block.outputs:
        return f"the pole pairs or the gear of {block.spec.name} are not the drive's. Check the model's name"
    ratio = block.gear_ratio
    return (
        f"set wire_velocity={block.wire[1] * ratio / value:.4g}, or "
        f"wire_position={block.wire[0] * ratio * value:.4g}, whichever is the "
        f"range of the drive's firmware"
    )


def implausible(block, about: str, value: float, bound: float) -> str:
    if about == "temperature":
        return (
            f"implausible temperature {value:g} °C: the drive's sensor is broken, or it is not the model "
            f"{block.spec.name}"
        )
    return f"it reports a {about} of {value if math.isfinite(value) else str(float(value))}, which is no measurement"


WORDS = {
    "acceleration": acceleration,
    "excess torque": excess_torque,
    "over-travel": over_travel,
    "overspeed": overspeed,
    "not following": not_following,
    "scale mismatch": scale_mismatch,
    "implausible": implausible,
}

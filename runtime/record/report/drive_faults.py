"""Texts of the faults that the monitor of actuators detects: the value, its bound, and what to do."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cext.schedule.program import Program


def text(status: str, block: Any, program: Program) -> str | None:
    """Return the text of an actuator's fault; None where `status` is another fault.

    status : status of the Outcome
    block : the actuator, or None
    program : program of the diagram with the actuator; its `watched` has the value and the bound
    """
    words = WORDS.get(status)
    row = next((row for row in program.reports.watched if block is not None and row["device"] == block.path), None)
    if words is None or row is None:
        return None
    facts = {"block": block, "about": row["about"], "value": row["value"], "bound": row["bound"]}
    return words.format(**facts) if isinstance(words, str) else words(**facts)


def _excess_torque(block: Any, about: str, value: float, bound: float) -> str:
    accuracy = block.watched().motion.accuracy
    return (
        f"the drive measures {value:.3g} N·m, above its limit of {bound:.3g} N·m by more than the assumed accuracy of "
        f"{accuracy:.2g} N·m. Compare wire_stiffness, wire_damping and wire_torque with the drive's firmware"
    )


def _overspeed(block: Any, about: str, value: float, bound: float) -> str:
    return (
        f"velocity {value:.3g} rad/s exceeds max_velocity, {bound:.3g} rad/s"
        f"{'' if block.max_velocity else ' by default'}"
    )


def _scale_mismatch(block: Any, about: str, value: float, bound: float) -> str:
    if about == "velocity":
        if value < 0.0:
            return (
                "the reported velocity and the rate of the reported position have opposite signs: the drive's "
                "firmware does not match the table of its model"
            )
        if not 0.01 < value < 100.0:
            still, moves = ("position", "velocity") if value > 1.0 else ("velocity", "position")
            return (
                f"the reported {still} is constant while the reported {moves} changes. Check the encoder and the "
                "drive's firmware"
            )
        cure = wire_cure(block, value)
        return f"the reported velocity is {value:.3g} times the rate of the reported position: {cure}"
    constant = " or the torque constant" if "current" in block.outputs else ""
    return (
        f"the measured torque is {value:.3g} times the commanded law: wire_torque, wire_stiffness, "
        f"wire_damping{constant} of {block.spec.name} do not match the drive's firmware. Compare them with its manual"
    )


def wire_cure(block: Any, value: float) -> str:
    """Return the setting that corrects a velocity of `value` times the rate of the position, as text."""
    if "wire_velocity" not in block.parameters or "current" in block.outputs:
        pairs = f", or set pole_pairs={round(block.spec.pole_pairs * value)}" * ("pole_pairs" in block.parameters)
        return f"the drive does not have the pole pairs or the gear of {block.spec.name}. Check the model's name{pairs}"
    ratio = block.gear_ratio
    return (
        f"set wire_velocity={block.wire[1] * ratio / value:.4g}, or "
        f"wire_position={block.wire[0] * ratio * value:.4g}, whichever is the range of the drive's firmware"
    )


def _position_jump(block: Any, about: str, value: float, bound: float) -> str:
    turn = getattr(block, "shift", 0.0)
    turns = round(value / turn) if turn else 0
    turned = f", {abs(turns)} motor turn{'s' * (abs(turns) > 1)}" if turns and abs(value - turns * turn) < 0.03 else ""
    return (
        f"the reported angle changed by {value:.3f} rad{turned} between two replies, and motion explains at most "
        f"{bound:.2g} rad: the drive has restarted or lost count of its turns, its encoder is defective, or another "
        f"drive has the same id {block.can_id}. Compare the angle with the joint before you arm it again"
    )


def _implausible(block: Any, about: str, value: float, bound: float) -> str:
    if about == "temperature":
        return (
            f"implausible temperature {value:g} °C: the drive's sensor is defective, or the drive is not of the "
            f"model {block.spec.name}"
        )
    return f"the drive reports an impossible {about}, {value if math.isfinite(value) else str(float(value))}"


WORDS: dict[str, str | Callable[..., str]] = {  # format string, or function, of block, about, value and bound
    "acceleration": "the joint accelerates by up to {value:.0f} rad/s², more than its max_acceleration of {bound:g} "
    "rad/s², on which its torque limit with stiffness or damping rests. Find the cause of the impact or vibration. If "
    "such motion is intended, raise max_acceleration",
    "excess torque": _excess_torque,
    "over-travel": "position {value:.3f} rad is outside the joint's range of {block.range[0]:g} to {block.range[1]:g} "
    "rad. Find the cause before you arm it again",
    "overspeed": _overspeed,
    "not following": "the drive outputs {value:.2g} N·m, but {bound:.2g} N·m are commanded: it was disabled, for "
    "instance by a loss of power, or it has reached an internal limit. Check its supply, and arm it again",
    "uncommanded torque": "the drive measures {value:.3g} N·m, but no torque is commanded. Cut its power. Then find "
    "out which program commands the drive, or in which mode it starts",
    "scale mismatch": _scale_mismatch,
    "implausible": _implausible,
    "position jump": _position_jump,
}

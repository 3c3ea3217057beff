"""Check of joint positions before arming, which may be off by motor turns after a power cycle.

A joint is armed if its reading lies in its range and no reading one motor turn away does, or if other evidence decides:
a known pose of its rig, a pose that the operator states, a reference that measures the same angle.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from cext.safety.thresholds import TRAVEL_MARGIN
from graph import Device
from graph.device import actuators_of
from graph.signal import Signal
from runtime.host.errors import BadInput
from runtime.host.suggestions import suggestion

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy as np

    from graph import Diagram
    from graph.schedule import Schedule


RANGE_MARGIN, RANGE_MARGIN_MINIMUM = 0.01, 0.02  # permitted excess over a range: fraction of the range, rad
# rad, of a stated pose without a wake shift; else a quarter of that shift
STATED_TOLERANCE = 0.2
OTHER_READINGS_LIMIT = 4  # in a message


class Poses:
    """Positions of the joints of a robot.

    diagram, schedule : diagram and schedule of the robot on its rig
    stated : {path: rad} that the operator states
    refusals : {path: reason not to arm} of the newest `look`

    Raises BadInput for an unknown path, an invalid reference, or a known pose outside the range of its joint.
    """

    def __init__(self, diagram: Diagram, schedule: Schedule, stated: Mapping[str, float] | None = None) -> None:
        self.schedule, self.stated, self.refusals = schedule, dict(stated or {}), {}
        self.joints = [
            block for block in actuators_of(diagram) if getattr(block, "range", ()) and "position" in block.outputs
        ]
        for block in self.joints:
            self._check_known_pose(block)
        paths = [block.path for block in self.joints]
        for path in self.stated:
            if path not in paths:
                hint = suggestion(path, paths) or f"its joints are {', '.join(paths) or 'none'}"
                raise BadInput(f"--pose {path}: {diagram.name} has no such joint with a range; {hint}")
        self.references = {
            block: self._reference_slot(diagram, block) for block in self.joints if getattr(block, "reference", "")
        }

    def _check_known_pose(self, block):
        """Raise BadInput for a known pose at which the range of the joint prevents arming."""
        angle, tolerance = getattr(block, "known_pose", ()) or (0.0, math.inf)
        low, high = _bounds(block)
        if not low - tolerance <= angle <= high + tolerance:
            raise BadInput(
                f"{block.path}: its known_pose, {angle:g} ± {tolerance:g} rad, is outside its range "
                f"{block.range[0]:g} to {block.range[1]:g} rad, so it could not be armed: correct one of them"
            )

    def _reference_slot(self, diagram, block):
        """Return the slot of a joint's reference. Raises BadInput."""
        match = re.fullmatch(r"(.+)\.(\w+?)(?:\[(\d+)\])?", block.reference)
        path, port, index = match.groups() if match else (block.reference, "", None)
        other = diagram.blocks.get(path)
        if (
            not isinstance(other, Device)
            or other is block
            or port not in other.outputs
            or other.outputs[port].unit != "rad"
        ):
            raise BadInput(
                f"{block.path}: reference {block.reference!r} is not an output in rad of another device, as "
                "in 'left/encoder.angle'"
            )
        place = self.schedule.signals[Signal(other, port).path]
        if int(index or 0) >= place.size or (index is None and place.size != 1):
            raise BadInput(
                f"{block.path}: reference {block.reference!r} has {place.size} elements: name one, as in "
                f"'{path}.{port}[0]'"
            )
        return place.slot + int(index or 0)

    def look(
        self, values: Sequence[float] | np.ndarray, *, first: bool = True, unheard: Sequence[str] = ()
    ) -> dict[str, str]:
        """Return {path: reason not to arm}; without the joints whose drives are taken out.

        values : the arena
        first : whether the robot is armed for the first time in this run, in which no power cycle can have shifted the
            reading of a drive whose zero arming has set
        unheard : paths of joints whose drives have not replied yet, which are left out
        """
        reasons = {
            block.path: self._reason(block, values, first)
            for block in self.joints
            if block.path not in unheard and ("active" not in block.outputs or self._value(block, "active", values))
        }
        self.refusals = {path: why for path, why in reasons.items() if why}
        return self.refusals

    def may_return(self, path: str, values: Sequence[float] | np.ndarray) -> bool:
        """Return whether a drive that was taken out may be armed again at its reading. values : the arena"""
        return not any(self._reason(block, values, False) for block in self.joints if block.path == path)

    def _value(self, block, name, values):
        """Return the value of a scalar output."""
        return float(values[self.schedule.signals[Signal(block, name).path].slot])

    def _reason(self, block, values, first):
        """Return why a joint is not armed, "" if it is. Arguments as in `look`."""
        shift = 0.0 if first and getattr(block, "zero_at_arming", False) else getattr(block, "shift", 0.0)
        return _refusal(block, self._value(block, "position", values), self._evidence(block, values), shift)

    def _evidence(self, block, values):
        """Yield (text, rad, tolerance in rad) of all evidence for the position of a joint."""
        shift = getattr(block, "shift", 0.0)
        fine = shift / 4.0 if shift else STATED_TOLERANCE
        if getattr(block, "known_pose", ()):
            yield ("its known pose", *block.known_pose)
        if block.path in self.stated:
            yield "the stated pose", self.stated[block.path], fine
        if block in self.references:
            yield f"its reference {block.reference}", float(values[self.references[block]]), fine


def _bounds(block):
    """Return the lowest and the highest reading in rad at which the range of a joint permits arming."""
    low, high = block.range
    margin = min(max(RANGE_MARGIN * (high - low), RANGE_MARGIN_MINIMUM), 1e-3 * TRAVEL_MARGIN)
    return low - margin, high + margin


def _refusal(block, position, evidence, shift):
    """Return why a joint is not armed at a reading, "" if it is.

    position : rad; shift : rad, by a multiple of which a power cycle may have shifted it
    """
    path, (low, high) = block.path, block.range
    if not math.isfinite(position):
        return f"{path} has no position reading"
    reads, decided = f"{path} reads {position:.3f} rad", False
    for source, angle, tolerance in evidence:
        decided = True
        if not abs(position - angle) <= tolerance:  # also NaN of a reference
            turns = _turns_text(block, position, angle, tolerance)
            return f"{reads}, but {source} is {angle:.3f} ± {tolerance:.3g} rad{turns}"
    lowest, highest = _bounds(block)
    others = readings(position, shift, lowest, highest)
    bounds = f"{low:g} to {high:g} rad"
    if not lowest <= position <= highest:
        off = (
            f"; if the joint is inside, its reading is wrong, and it may be at {_angles_text(others)}" if others else ""
        )
        return (
            f"{reads}, outside its range {bounds}: move it inside by hand, or correct `offset` and `range` in the "
            f"rig{off}"
        )
    if others and not decided:
        lie = "lies" if len(others) == 1 else "lie"
        return (
            f"{reads}; a power cycle can shift it by {shift:.3f} rad ({math.degrees(shift):.3g}°), and "
            f"{_angles_text(others)} also {lie} in its range {bounds}: "
            "hold it at a known pose (known_pose = [ANGLE, TOLERANCE] in the rig), give it a `reference`, or state "
            f"its position: --pose {path}=ANGLE"
        )
    return ""


def _turns_text(block, position, angle, tolerance):
    """Return a clause that explains a difference between reading and evidence."""
    shift = getattr(block, "shift", 0.0)
    turns = round((angle - position) / shift) if shift and math.isfinite(angle) else 0
    if not turns or abs(position + turns * shift - angle) > tolerance:
        return ": move it there, or correct the pose"
    count = f"{abs(turns)} motor turn{'s' * (abs(turns) > 1)}"
    return (
        f": the reading is off by {count} of {shift:.3f} rad; offset = {block.offset - turns * shift:.4f} in the "
        "rig corrects this until the next "
        "power cycle"
    )


def readings(position: float, shift: float, low: float, high: float) -> list[float]:
    """Return the other possible angles of a joint with this reading, in ascending order."""
    if not shift > 0.0:
        return []
    first, last = math.ceil((low - position) / shift), math.floor((high - position) / shift)
    return [position + turns * shift for turns in range(first, last + 1) if turns]


def _angles_text(angles):
    """Return the angles nearest to 0 as text, at most OTHER_READINGS_LIMIT."""
    shown = sorted(angles, key=abs)[:OTHER_READINGS_LIMIT]
    texts = [f"{angle:.3f}" for angle in sorted(shown)]
    more = f" and {len(angles) - OTHER_READINGS_LIMIT} more" if len(angles) > OTHER_READINGS_LIMIT else ""
    last = texts.pop()
    joint = "" if not texts else ", " if more else " and "
    return f"{', '.join(texts)}{joint}{last}{more} rad"

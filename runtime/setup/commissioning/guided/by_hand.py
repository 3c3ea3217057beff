"""Steps in which the operator moves a joint whose motor is off: zero, direction, encoded ranges, wraps and range."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from runtime.setup.commissioning.guided.bench import Bench, Given, Lost, Result, Sample

if TYPE_CHECKING:
    from collections.abc import Sequence

ANGLE_TOLERANCE = 0.05  # of the marked angle, turned by hand
VELOCITY_TOLERANCE = 0.05  # of the change of position
PARAMETER_TOLERANCE = 0.02  # of a parameter of the drive
ZERO_TOLERANCE = 0.05  # rad
TURNS = 3  # of the motor, by which the reading of a joint may be shifted
LITTLE = 0.3  # of the marked angle, below which a joint has not moved
STUCK = 0.03  # of the marked angle, below which a position or a velocity does not follow a joint that has moved
JUMP = 0.06  # rad between two replies, in addition to the motion at their velocity
SHORTEST, FASTEST = 0.005, 5.0  # s between two replies, and rad/s, from which the pace of a hand is derived
SPIKE_TIME = 0.15  # s within which a reading that has jumped is back
LOST_SHARE, FEWEST_LOST = 0.05, 10  # of the queries during a motion, above which a plug or a cable has lost contact
RANGE_MARGIN = 0.05  # rad


def sign_of(block: Any) -> float:
    """Return the direction of the motor at the joint."""
    return -1.0 if block.invert else 1.0


def pose(bench: Bench, block: Any, given: Given) -> Result:
    """Compare the joint in a known pose with the diagram: at its zero, or at another angle."""
    where = f"at {math.degrees(given.pose):g}°" if given.pose else "at its zero"
    bench.until_entered(f"Hold the joint {where}, as the diagram defines it")
    joint = sign_of(block) * mean_position(bench, block) - block.offset
    result = Result([f"the joint reads {joint:.3f} rad {where}"], {"zero": joint - given.pose})
    if given.pose:
        result.measured["pose"] = given.pose
    compare_zero(result, block, joint - given.pose, f"{joint:.3f} rad {where}")
    return result


def mean_position(bench: Bench, block: Any) -> float:
    """Return the position of a drive at rest in rad, before sign and offset."""
    samples = bench.at_rest(block)
    return sum(sample.position for sample in samples) / len(samples)


def compare_zero(result: Result, block: Any, error: float, reading: str) -> None:
    """Name an error of the joint's zero in rad. reading : as text"""
    turn = block.shift
    if (
        turn > ZERO_TOLERANCE
        and 0 < round(abs(error) / turn) <= TURNS
        and abs(math.remainder(error, turn)) < 0.1 * turn
    ):
        result.find(
            "motor turn",
            f"the joint reads {reading}, {round(error / turn)} turns of the motor off: the drive was "
            "switched on elsewhere and does not count turns without power. Switch it on at its zero, or set reference "
            "or known_pose",
        )
    elif not block.zero_at_arming and abs(error) > ZERO_TOLERANCE:
        result.find("zero", f"the joint reads {reading}", offset=round(block.offset + error, 4))


def turn(bench: Bench, block: Any, given: Given) -> Result:
    """Compare direction, position and velocity with a turn by the marked angle in the positive direction."""
    angle = given.angle
    bench.until_entered("Hold the joint still at the first mark")
    seen = bench.until_entered(
        f"Turn the joint in the positive direction of the diagram to the second mark, {math.degrees(angle):g}° on, "
        "without going back, and hold it"
    )
    queries = bench.queried[block.path]
    bench.at_rest(block)
    rest = given.steps.get("state")
    bias = rest.measured.get("velocity", 0.0) if rest is not None else 0.0
    turned = {path: Turn(samples, bias * (path == block.path)) for path, samples in seen.items() if len(samples) > 10}
    result = Result()
    if block.path not in turned:
        raise Lost(f"the drive sent {len(seen[block.path])} replies during the turn")
    own = turned[block.path]
    result.measured = {"angle": angle, "turned": own.moved, "velocity_integral": own.integral}
    result.says.append(f"turned by {own.moved:.3f} rad of {angle:.3f} rad, by its velocity {own.integral:.3f} rad")
    others = [path for path, each in turned.items() if path != block.path and abs(each.moved) > LITTLE * angle]
    if abs(own.moved) < LITTLE * angle and not own.jumps and abs(own.integral) < LITTLE * angle:
        if others:
            result.find(
                "exchanged", f"the reading of {' and '.join(others)} moved instead: exchange can_id or bus of the two"
            )
        else:
            result.find("encoder", f"the reading moved by {own.moved:.3f} rad: the encoder is stuck, or another joint")
        return result
    if abs(own.moved) < STUCK * angle and not own.jumps:
        result.find(
            "encoder",
            f"the reading moved by {own.moved:.3f} rad, and the integral of its velocity by {own.integral:.3f} rad: "
            "the position is stuck",
        )
        return result
    if found_wraps(result, block, own):
        return result
    direction = sign_of(block)
    if own.moved * direction < 0.0:
        result.find("direction", "the joint moved in the opposite direction", invert=not block.invert)
    compare_ranges(result, block, abs(own.moved) / angle, own.integral / own.moved)
    compare_parameters(result, bench, block)
    compare_contact(result, block, queries, len(seen[block.path]))
    if "invert" in result.cures and "pose" in given.steps:
        scale = abs(own.moved) / angle if "wire_position" in result.cures else 1.0
        result.cures |= offset_inverted(block, given, scale)
    return result


def offset_inverted(block: Any, given: Given, scale: float) -> dict[str, float]:
    """Return {"offset": rad} with which a joint reads its pose once `invert` is the other one.

    scale : of the position, which another cure corrects. Returns {} if the offset stays, or is set at arming
    """
    pose = given.steps["pose"].measured
    if "zero" not in pose or "encoder" in pose or block.zero_at_arming:
        return {}
    angle = pose.get("pose", 0.0)
    offset = round(-(pose["zero"] + angle + block.offset) / scale - angle, 4)
    return {"offset": offset} if abs(offset - block.offset) > ZERO_TOLERANCE else {}


def compare_contact(result: Result, block: Any, queries: int, replies: int) -> None:
    """Name replies that are missing while the joint and its cable were moved."""
    lost = queries - replies
    if not getattr(block, "report_rate", 0.0) and lost > max(FEWEST_LOST, LOST_SHARE * queries):
        result.find(
            "lost replies",
            f"{lost} of {queries} queries had no reply while the joint was moved: check the plugs and the cable along "
            "the joint",
        )


class Turn:
    """A motion by hand that starts and ends at rest.

    moved : rad, without jumps; integral : rad, of the velocity without its mean at rest
    jumps : rad; spikes : whether the reading was back soon after each of them
    """

    def __init__(self, samples: Sequence[Sample], bias: float = 0.0) -> None:
        """bias : rad/s, velocity at rest that another step has found"""
        first = samples[: max(3, len(samples) // 20)]
        least = min((sample.velocity for sample in first), key=abs)
        if abs(least - bias) <= 0.1 * max(abs(sample.velocity - bias) for sample in samples):
            bias = least  # otherwise the motion began before the first samples
        noise = max(sample.position for sample in first) - min(sample.position for sample in first)
        self.jumps: list[float] = []
        times: list[float] = []
        self.integral, pace = 0.0, 0.0
        for before, after in zip(samples, samples[1:]):
            dt = after.time - before.time
            self.integral += (0.5 * (before.velocity + after.velocity) - bias) * dt
            fastest = max(abs(before.velocity), abs(after.velocity), pace)
            step = after.position - before.position
            if abs(step) > max(JUMP, 3.0 * noise) + 3.0 * fastest * dt + 0.2 * min(dt, 1.0):
                self.jumps.append(step - 0.5 * (before.velocity + after.velocity) * dt)
                times.append(after.time)
            elif dt > SHORTEST:
                pace = min(FASTEST, abs(step) / dt)  # of a drive whose velocity is wrong
        self.moved = samples[-1].position - samples[0].position - sum(self.jumps)
        pairs = list(zip(self.jumps[::2], self.jumps[1::2], times[::2], times[1::2]))
        self.spikes = len(self.jumps) % 2 == 0 and all(
            abs(up + down) < 0.3 * abs(up) and back - at < SPIKE_TIME for up, down, at, back in pairs
        )


def found_wraps(result: Result, block: Any, motion: Turn) -> bool:
    """Name the largest jump of the reading in a motion. Returns whether there was one."""
    if motion.jumps:
        size = max(map(abs, motion.jumps))
        result.measured["jump"] = size
        words = wrap_in_words(block, size)
        if motion.spikes and not words:
            result.find(
                "noisy position",
                f"the reading jumped by {size:.3f} rad and back, {len(motion.jumps) // 2} times: check the ground, the "
                "shield and the magnet of the encoder",
            )
        else:
            result.find("wraps", f"the reading jumped by {size:.3f} rad{words}")
    return bool(motion.jumps)


def wrap_in_words(block: Any, size: float) -> str:
    """Return what a jump of the reading by `size` rad at the joint suggests."""
    known = {
        "it wraps at one turn of the output": 2.0 * math.pi / block.gear_ratio,
        "it wraps at one turn of the motor": block.shift,
        "it wraps at the end of its encoded range": 2.0 * block.wire[0],
    }
    near = [text for text, value in known.items() if value and abs(size / value - 1.0) < 0.1]
    return f": {near[0]}" if near else ""


def compare_ranges(result: Result, block: Any, ratio: float, rate: float) -> None:
    """Compare the encoded ranges with a turn.

    ratio : position over true angle; rate : integral of the velocity over position
    """
    if abs(rate) < STUCK:
        result.find("no velocity", "the velocity of the drive stays at zero while the joint turns: its firmware")
        return
    sets = getattr(block.spec, "range_sets", ())
    position, velocity = block.wire[0] * block.gear_ratio, block.wire[1] * block.gear_ratio
    if sets:

        def error(each: Any) -> float:
            expected = position / each.values[0], (velocity / each.values[1]) / (position / each.values[0])
            return math.hypot((ratio / expected[0] - 1.0), 2.0 * (rate / expected[1] - 1.0))

        best = min(sets, key=error)
        present = block.ranges or sets[0].name
        own = next(each for each in sets if each.name == present)
        if best is not own and error(best) < 0.5 * error(own) and error(own) > 0.015 and error(best) < 0.1:
            result.find(
                "encoded ranges",
                f"position {ratio:.3f} and velocity {rate:.3f} of the expected: the ranges {best.name!r} of "
                f"{block.spec.name}, not {own.name!r}",
                ranges=best.name,
            )
            return
    scaled = hasattr(block, "wire_position")
    if abs(ratio - 1.0) > ANGLE_TOLERANCE:
        cure = {"wire_position": round(position / ratio, 4)} if scaled else {}
        result.find(
            "position range",
            f"the reading moved by {ratio:.3f} of the marked angle: another range, or another gear, than the table's",
            **cure,
        )
    if rate < 0.0:
        result.find("sign of velocity", "the velocity has the opposite sign of the change of position")
    elif abs(rate - 1.0) > VELOCITY_TOLERANCE and abs(rate * ratio - 1.0) > VELOCITY_TOLERANCE:
        if scaled:
            cure = {"wire_velocity": round(velocity / (rate * ratio), 4)}
        else:
            cure = {"pole_pairs": round(block.spec.pole_pairs * rate)} if hasattr(block, "pole_pairs") else {}
        result.find("velocity range", f"the integral of the velocity is {rate * ratio:.3f} of the marked angle", **cure)


def compare_parameters(result: Result, bench: Bench, block: Any) -> None:
    """Compare the position in the replies with the parameter of the drive, where it has one."""
    if not hasattr(block, "read_parameter"):
        return
    before = bench.at_rest(block)[-1]
    value = bench.buses[block.bus].converse(block.read_parameter("mechPos"))
    after = bench.at_rest(block)[0]
    if value is None:
        result.says.append("the drive does not return its parameter mechPos")
        return
    reply = before.answer.position
    moved = abs(after.answer.position - before.answer.position)
    result.measured["mechPos"] = value
    if abs(value) > 0.3 and moved < 0.01 and abs(reply / value - 1.0) > PARAMETER_TOLERANCE:
        own = block.wire[0] * block.gear_ratio * value / reply
        result.find(
            "position range",
            f"replies have {reply:.3f} rad, the parameter mechPos {value:.3f} rad: half the encoded range is "
            f"{own:.4g} rad",
            wire_position=round(own, 4),
        )


def motion(bench: Bench, block: Any, given: Given) -> Result:
    """Measure the range of the joint."""
    seen = bench.until_entered("Move the joint through its full motion, to both ends")[block.path]
    queries = bench.queried[block.path]
    bench.at_rest(block)
    angles = [sign_of(block) * sample.position - block.offset for sample in seen]
    low, high = min(angles), max(angles)
    result = Result([f"moves from {low:.3f} to {high:.3f} rad"], {"low": low, "high": high})
    compare_contact(result, block, queries, len(seen))
    if found_wraps(result, block, Turn(seen)):
        return result
    if not block.range:
        result.cures["range"] = [round(low, 3), round(high, 3)]
    elif low < block.range[0] - RANGE_MARGIN or high > block.range[1] + RANGE_MARGIN:
        ends = f"[{block.range[0]:g}, {block.range[1]:g}]"
        result.find("range", f"the joint moves from {low:.3f} to {high:.3f} rad, and its range is {ends} rad")
    return result

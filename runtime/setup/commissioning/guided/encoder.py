"""Zero of a joint against its absolute encoder, on request of the operator instead of a known pose.

The joint is read with its motor off: where it is, turned by hand, and back. A magnet or a coupling that slips shows in
the last place, an encoder of another joint or with another centre in the second one.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING, Any

from blocks.sensors.magnetic_encoder import MagneticEncoder
from graph import Block, Diagram, Input
from runtime.setup.commissioning.guided import by_hand
from runtime.setup.commissioning.guided.bench import Bench, Given, Result, confirmed
from runtime.setup.commissioning.guided.driven import raise_if_of_computer, run_on_rig
from runtime.setup.commissioning.guided.sensors import SENSOR_TIMEOUT, copied

if TYPE_CHECKING:
    from collections.abc import Sequence

TURN, STILL = math.pi / 6.0, 0.02  # rad, by which the joint is turned; motion while it is read
SLIP, OFF_CENTRE = 0.03, 0.06  # rad, differences that remain, and of a magnet beside the axis
READ_TIME, RATE = 0.5, 200.0  # s and Hz
MAGNETS = {1: "weak", 2: "strong"}  # of the output `magnet`


def pose(bench: Bench, block: Any, given: Given) -> Result:
    """Compare the zero of a joint with its encoder if it has one and the operator agrees, otherwise with a pose."""
    encoder = encoder_of(bench, block)
    if encoder is not None and confirmed(f"Compare with the encoder {encoder.path} instead of a known pose"):
        return against_encoder(bench, block, encoder)
    return by_hand.pose(bench, block, given)


def encoder_of(bench: Bench, block: Any) -> Any:
    """Return the MagneticEncoder of a joint: its `reference`, or the only one in its subsystem; None without one."""
    encoders = [each for each in bench.diagram if isinstance(each, MagneticEncoder)]
    if reference := getattr(block, "reference", ""):
        return next((each for each in encoders if reference == f"{each.path}.position"), None)
    folder = block.path.rpartition("/")[0]
    near = [each for each in encoders if each.path.rpartition("/")[0] == folder]
    return near[0] if len(near) == 1 and len(bench.drives) == 1 or folder and len(near) == 1 else None


def against_encoder(bench: Bench, block: Any, encoder: Any) -> Result:
    """Compare a joint with its absolute encoder in a pose, turned by hand, and back in the first pose."""
    places, magnets, result = [], set(), Result()
    for instruction in (
        "Hold the joint still anywhere",
        f"Turn the joint by {math.degrees(TURN):.0f}° or more, and hold it",
        "Turn the joint back to where it was, and hold it",
    ):
        bench.until_entered(instruction)
        before = by_hand.mean_position(bench, block)
        angle, magnet = encoder_angle(bench, encoder)
        magnets.add(magnet)
        joint = by_hand.sign_of(block) * by_hand.mean_position(bench, block) - block.offset
        if angle is None:
            result.find("silent", f"the encoder {encoder.path} does not respond, or has no magnet")
            return result
        if abs(joint + block.offset - by_hand.sign_of(block) * before) > STILL:
            return Result(["the joint moved while it was read: repeat with --again pose"], done=False)
        places.append((joint, angle))
    result = encoder_result(block, encoder.path, places)
    compare_magnet(result, encoder.path, magnets)
    return result


def compare_magnet(result: Result, path: str, magnets: set[int]) -> None:
    """Name a field that the encoder reports as too weak or too strong. magnets : in the places, as its output"""
    if fields := [MAGNETS[magnet] for magnet in sorted(magnets) if magnet in MAGNETS]:
        result.find(
            "magnet",
            f"{path} reports a field that is too {' and too '.join(fields)}: mount the magnet "
            f"{' or '.join('nearer' if field == 'weak' else 'farther away' for field in fields)}, on the axis",
        )


def encoder_result(block: Any, path: str, places: Sequence[tuple[float, float]]) -> Result:
    """Compare a joint with its encoder. places : (joint, encoder) in rad: at first, turned, back"""
    errors = [math.remainder(joint - angle, math.tau) for joint, angle in places]
    turned = places[1][0] - places[0][0]
    shown = math.remainder(places[1][1] - places[0][1], math.tau)
    result = Result(measured={"zero": errors[0], "turned": turned, "encoder": shown, "slip": errors[2] - errors[0]})
    result.says.append(
        f"the joint reads {places[0][0]:.3f} rad and {path} {places[0][1]:.3f} rad; it turned by {turned:.3f} rad, and "
        f"by {shown:.3f} rad at the encoder; back again, they differ by {1e3 * (errors[2] - errors[0]):.0f} mrad more"
    )
    if abs(turned) < by_hand.LITTLE * TURN:
        if abs(shown) < by_hand.LITTLE * TURN:
            return Result(
                [*result.says, "the joint was not turned: repeat with --again pose"], result.measured, done=False
            )
        result.find("encoder", "the encoder of the joint turned, and the reading of the drive did not")
    elif abs(shown + turned) < SLIP * max(1.0, abs(turned)):
        result.find("direction of the encoder", f"{path} turns against the joint: set its invert")
    elif abs(math.remainder(errors[2] - errors[0], math.tau)) > SLIP:
        result.find(
            "slip",
            f"turned and back again, the joint and {path} differ by {errors[2] - errors[0]:.3f} rad more than before: "
            "the magnet, its arm or the coupling of the drive slips",
        )
    elif abs(math.remainder(errors[1] - errors[0], math.tau)) > OFF_CENTRE:
        result.find(
            "encoder",
            f"the joint turned by {turned:.3f} rad, and {path} by {shown:.3f} rad: its magnet is not centred, or it is "
            "not on this joint",
        )
    else:
        by_hand.compare_zero(
            result, block, errors[0], f"{places[0][0]:.3f} rad where {path} reads {places[0][1]:.3f} rad"
        )
        if not block.reference:
            result.cures["reference"] = f"{path}.position"
    return result


def encoder_angle(bench: Bench, encoder: Any) -> tuple[float | None, int]:
    """Return (mean angle of an encoder in rad, None if it does not respond, its output `magnet` as most often)."""
    with Diagram("encoder", rate=RATE) as diagram:
        kept = Angles()
        copy = copied(encoder, timeout=SENSOR_TIMEOUT)
        kept(copy.position, copy.magnet)
    run = run_on_rig(bench, diagram, round(READ_TIME * RATE))
    raise_if_of_computer(run)
    if run.outcome.faulted or not kept.rows:
        return None, 0
    first = kept.rows[0]
    angle = first + sum(math.remainder(angle - first, math.tau) for angle in kept.rows) / len(kept.rows)
    return angle, kept.magnets.most_common(1)[0][0]


class Angles(Block):
    """Keeps the angles of an encoder, and how often it reported which field of its magnet."""

    angle = Input("rad")
    magnet = Input("1", dtype=int)

    def reset(self):
        self.rows, self.magnets = [], Counter()

    def step(self, angle, magnet):
        self.rows.append(angle)
        self.magnets[int(magnet)] += 1

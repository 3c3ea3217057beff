"""Homing of a joint against its mechanical stop, at a bounded torque, speed and travel.

The drive is commanded with torque alone, which it bounds whatever its encoded gains are. The torque grows while the
joint is slower than wanted, and is reduced while it is faster:

    away from the stop, a little      shows that the joint moves, and in the direction of the torque
    to the stop                       until the speed collapses although the torque is at its limit. A stop holds the
                                      joint at half of it too, and less torque moved the joint there; otherwise its
                                      weight or friction may hold it
    away from it, and to it again     the stop is at the same place, unless a coupling slips
    away from it
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from graph import Param
from runtime.host.console.terminal import print_lines
from runtime.host.errors import BadInput
from runtime.robot.rig.records import AGREES
from runtime.setup.commissioning.guided.bench import Bench, Given, Result, confirmed
from runtime.setup.commissioning.guided.by_hand import RANGE_MARGIN, compare_zero
from runtime.setup.commissioning.guided.driven import (
    LIMIT_SHARE,
    RATE,
    diagram_of,
    failed,
    limit_of,
    rated_of,
    run_on_rig,
)
from runtime.setup.commissioning.guided.scripted import REST_TIME, Found, Open, ScriptedProbe

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

AWAY = 0.12  # rad, motion away from the stop
RISE_TIME = 1.0  # s in which the torque of a joint that stands grows to its limit
CUT = 0.9  # of the torque that remains from tick to tick while the joint is too fast
BRAKE = 0.5  # of the largest torque, against a joint that is twice as fast as wanted, or as fast backwards
SLOW, AT_LIMIT, HELD_TIME = 0.15, 0.98, 0.3  # of the speed, of the torque, and s: the joint stands against a stop
MOVED, AGAINST = 0.02, 0.02  # rad in the direction of the torque, and against it
SPEED_SHARE = 0.35  # of the speed limit, at which the joint is moved
REPEATED = 0.03  # rad between two contacts with a stop
ENDS = ("lower", "upper")  # of the range, in the record
BY_HAND = 0.08  # rad between a stop and the end of the motion by hand
NEAR, HEAVY = 0.06, 0.9  # rad before a contact, and share of the torque that moves a joint there: no stop is needed
LESS, LESS_TIME, SPRINGS_BACK = 0.5, 0.5, 0.006  # of the torque, s, and rad of a joint that its weight turns back


@dataclass(frozen=True)
class Home:
    """What the operator allows, and where the stop is.

    direction : -1.0 for the lower end, 1.0 for the upper one
    torque, speed, travel : limits in N·m, rad/s and rad
    angle : rad of the joint at its stop in the convention of the diagram; None if unknown
    """

    direction: float
    torque: float
    speed: float
    travel: float
    angle: float | None = None

    @property
    def duration(self) -> float:
        """Longest duration in s: travel and way back at a third of the speed, and five times the growth of torque."""
        return REST_TIME + 3.0 * (self.travel + 4.0 * AWAY) / (SPEED_SHARE * self.speed) + 10.0 * (RISE_TIME + 0.5)


class HomingProbe(ScriptedProbe):
    """Sequence of motions against a stop. `stops` : joint angles in rad of the contacts

    `running` : N·m, largest torque while the joint moved; `needed` : N·m, mean torque that moved it to the last contact
    """

    direction = Param(1.0, "1", "direction of the stop")
    travel = Param(1.0, "rad", "largest motion from the beginning", above=0.0)

    def reset(self):
        super().reset()
        self.stops, self.running, self.moved, self.needed = [], 0.0, False, 0.0

    def sequence(self) -> Iterator[float]:
        """Yield the torque of each tick."""
        yield from self.rest()
        begin, away, reach = self.at, -self.direction, self.travel
        yield from self.move(away, AWAY)
        for _ in range(2):
            left = reach - self.direction * (self.at - begin)
            if not (yield from self.move(self.direction, left)):
                raise Found(
                    "no stop", f"no stop within {reach:.2f} rad: the joint turned from {begin:.3f} to {self.at:.3f} rad"
                )
            if not self.moved:
                raise Found(
                    "stuck",
                    f"the reading stays at {self.at:.3f} rad with {self.largest:.3g} N·m in both "
                    "directions: the encoder or the joint is stuck, or its friction or weight is larger",
                )
            reached = self.at
            for tick in range(round(LESS_TIME / self.dt)):
                yield self.direction * self.largest * max(LESS, 1.0 - 2.0 * tick * self.dt / LESS_TIME)
            back = self.direction * (reached - self.at)
            if back > SPRINGS_BACK or self.needed > HEAVY * self.largest:
                raise Open(
                    f"the joint stands at {reached:.3f} rad with {self.largest:.3g} N·m and turns back by "
                    f"{back * 1e3:.0f} mrad with half of it; {self.needed:.3g} N·m moved it there. The weight of "
                    "its link or its friction may hold it, not a stop: remove or balance the link, or use the step pose"
                )
            self.stops.append(reached)
            if (yield from self.move(away, AWAY)):
                raise Found(
                    "stuck",
                    f"the reading stays at {self.at:.3f} rad with {self.largest:.3g} N·m away from "
                    "the stop: the encoder or the joint is stuck",
                )

    def move(self, sign: float, distance: float) -> Generator[float, None, bool]:
        """Yield the torque of a motion. Returns whether the speed collapsed before the distance in rad was covered."""
        begin, command, held, moving = self.at, 0.0, 0, []
        growth = self.largest * self.dt / RISE_TIME
        while (way := sign * (self.at - begin)) < distance:
            share = sign * self.rate / (SPEED_SHARE * self.speed)
            if share < 1.0:
                command = min(self.largest, command + growth * min(1.0 - share, 1.5))
            else:
                command = max(-self.largest, min(command, CUT * command) - growth * (share - 1.0))
            if way > MOVED:
                self.moved, self.running = True, max(self.running, command * (share > 0.5))
            elif not self.moved and (way < -AGAINST or share < -1.0):
                raise Found(
                    "sign of torque",
                    f"a torque of {sign * command:.3g} N·m turned the joint by {self.at - begin:.3f} rad",
                )
            moving += [(way, command)] * (share > SLOW)
            held = held + 1 if share < SLOW and command >= AT_LIMIT * self.largest else 0
            if held * self.dt >= HELD_TIME:
                near = [torque for at, torque in moving if at > moving[-1][0] - NEAR]
                self.needed = sum(near) / len(near) if near else 0.0
                return True
            brake = BRAKE * self.largest * (max(0.0, share - 1.0) + min(0.0, share))
            yield sign * max(-self.largest, min(self.largest, command - brake))
        return False


def home(bench: Bench, block: Any, given: Given) -> Result:
    """Drive a joint against its stop, and compare the place of the stop with the diagram."""
    wanted: Home = given.home
    print_lines([f"  {line}" for line in announced(block, wanted)])
    if not confirmed("Is the robot off the person, the lever removed and the way free"):
        return Result(["the joint was not moved"], done=False)
    diagram, probe = homing_diagram(block, wanted)
    run = run_on_rig(bench, diagram, math.ceil(wanted.duration * RATE))
    steps = given.steps | ({} if given.before is None else {"home": given.before})
    return home_of(block, wanted, probe, steps) if probe.ended else failed(Result(), block, run)


def announced(block: Any, wanted: Home) -> list[str]:
    """Return what will move, as lines."""
    end, speed = "upper" if wanted.direction > 0.0 else "lower", math.degrees(wanted.speed)
    own = block.own_timeout
    return [
        f"{block.path} turns {math.degrees(AWAY):.0f}° away from its {end} end, then twice to its stop and back, at "
        f"most {math.degrees(wanted.travel):.0f}°",
        f"at about {SPEED_SHARE * speed:.0f}°/s and at most {wanted.torque:.3g} N·m "
        f"({wanted.torque / rated_of(block):.1%} of rated); beyond {speed:.0f}°/s the run ends",
        "it has no time-out that is known: if computer and cable fail, it keeps this torque until you switch it off"
        if own is None
        else f"without frames it stops by itself after {own:g} s",
    ]


def check_limits(block: Any, wanted: Home) -> None:
    """Raise BadInput if the torque is above the limit of the bench."""
    limit = limit_of(block)
    if wanted.torque > limit:
        raise BadInput(
            f"--torque {wanted.torque:g}: at most {limit:.3g} N·m for {block.path}, {LIMIT_SHARE:.0%} of its rated "
            "torque or the limit of the diagram"
        )


def homing_diagram(block: Any, wanted: Home) -> tuple[Any, HomingProbe]:
    """Return (Diagram, its HomingProbe) of one drive. The range of the joint does not end the run: it is measured."""
    probe_of = partial(HomingProbe, direction=wanted.direction, speed=wanted.speed, travel=wanted.travel)
    return diagram_of(block, probe_of, wanted.torque, range=())


def home_of(block: Any, wanted: Home, probe: HomingProbe, steps: dict[str, Any]) -> Result:
    """Compare what a HomingProbe has found with the diagram, and with the ends of the motion by hand.

    steps : {name: StepRecord} of the steps before, among them the homing before, perhaps against the other end
    """
    if (ended := probe.without_measurement()) is not None:
        return ended
    result = Result()
    first, again = probe.stops
    stop, spread = 0.5 * (first + again), abs(first - again)
    end = ENDS[wanted.direction > 0.0]
    result.measured = {"stop": stop, end: stop, "spread": spread, "torque": wanted.torque, "running": probe.running}
    result.says.append(
        f"the stop is at {stop:.3f} rad, again within {spread * 1e3:.1f} mrad, at {wanted.torque:.3g} N·m; up to "
        f"{probe.running:.3g} N·m moved the joint"
    )
    if spread > REPEATED:
        result.find(
            "stop not repeated",
            f"the joint stopped at {first:.3f} and {again:.3f} rad: a coupling or strap slips, or the stop yields",
        )
        return result
    motion = steps.get("motion")
    if motion is not None and motion.measured:
        end = motion.measured["high" if wanted.direction > 0.0 else "low"]
        if wanted.direction * (end - stop) > BY_HAND:
            result.find(
                "stop before the end",
                f"the joint stopped at {stop:.3f} rad, and by hand it moved to {end:.3f} rad: it binds, or the torque "
                "is too low",
            )
            return result
    if "home" in steps and steps["home"].verdict == AGREES and not block.zero_at_arming:
        result.measured = steps["home"].measured | result.measured
    if set(ENDS) <= set(result.measured) and differs_between_stops(result, block):
        return result
    angle = wanted.angle
    if angle is None and block.range:
        angle = block.range[1 if wanted.direction > 0.0 else 0]
    if angle is None:
        result.says.append("to compare it with the diagram, declare range in the rig, or pass --at")
    elif block.zero_at_arming:
        result.says.append("its zero is set at arming, so the stop is not compared with the diagram")
    else:
        compare_zero(result, block, stop - angle, f"{stop:.3f} rad at its stop, which is at {angle:.3f} rad")
    return result


def differs_between_stops(result: Result, block: Any) -> bool:
    """Compare the range between both stops with that of the diagram. Returns whether the stops are nearer."""
    low, high = (result.measured[end] for end in ENDS)
    result.says.append(f"both stops: from {low:.3f} to {high:.3f} rad, {high - low:.3f} rad apart")
    if not block.range or high - low > block.range[1] - block.range[0] - 2.0 * RANGE_MARGIN:
        return False
    result.find(
        "range",
        f"both stops are {high - low:.3f} rad apart, and the range of the joint has "
        f"{block.range[1] - block.range[0]:.3f} rad: one is not a stop, the joint binds, or its range is wrong",
    )
    return True

"""The step for the encoded ranges of stiffness and damping, which no drive reports: a lever shows what they do.

Setpoints ahead of the joint give the torque of a spring, then of a damper: K (θ₀ − θ) and B (ω₀ − ω). The torque grows
until the lever shows it, as in the step `torque`, so that gains of a multiple of what was commanded are found at a part
of it. Both gains are whole codes: rounding changes nothing.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

from blocks.limiters import Saturation
from graph import Diagram, Input, Output, Param
from runtime.host.console.terminal import print_lines
from runtime.setup.commissioning.guided.bench import Bench, Given, Result
from runtime.setup.commissioning.guided.driven import (
    LIMIT_SHARE,
    NO_LEVER,
    RATE,
    STEEPEST,
    diagram_of,
    failed,
    friction_before,
    lever_of,
    limit_of,
    run_on_rig,
)
from runtime.setup.commissioning.guided.probes import Friction, Lever, LeverProbe, friction_of

AHEAD, FASTER, SPEED_SHARE = 0.5, 6.0, 0.4  # rad; rad/s, and share of the encoded range: farthest setpoints
AIMED_SHARE = 0.025  # of the rated torque: leaves room for gains of a multiple while the lever accelerates
ACCELERATION = 60.0  # rad/s² of the lever: a larger bound would replace the gains by a torque
FACTOR = 1.5  # between commanded and shown torque, beyond which the encoded range is another; friction stays below it
LIMITED_SHARE = 0.05  # of the ticks that count, in which a torque may replace the gains: replies were late
CODES = 4095  # of stiffness and damping in 12 bits; codes of 16 bits are finer
GAINS = ("stiffness", "damping")


class LawProbe(LeverProbe):
    """LeverProbe whose torque is that of a spring in the positive direction, and of a damper in the negative one."""

    stiffness = Param(1.0, "N·m/rad", "of the spring", above=0.0)
    damping = Param(1.0, "N·m·s/rad", "of the damper", above=0.0)

    limited = Input("1", "ticks in which the block sent a torque instead of its gains", dtype=int)
    position_command = Output("rad", "setpoint of the spring")
    velocity_command = Output("rad/s", "setpoint of the damper")
    stiffness_command = Output("N·m/rad")
    damping_command = Output("N·m·s/rad")

    def reset(self):
        super().reset()
        self.limited_ticks, self.limited_before = 0, 0

    def step(self, position, velocity, reported, limited, t):
        used = len(self.rows)
        torque, _, over = super().step(position, velocity, reported, t)
        self.limited_ticks += limited > self.limited_before and len(self.rows) > used
        self.limited_before = limited
        if t - self.waited < self.side_time:
            return 0.0, 0.0, over, position + torque / self.stiffness, velocity, self.stiffness, 0.0
        return 0.0, 0.0, over, position, velocity + torque / self.damping, 0.0, self.damping


def law(bench: Bench, block: Any, given: Given) -> Result:
    """Compare the torque of a stiffness and of a damping with what a lever shows."""
    if "stiffness_command" not in block.inputs:
        return Result(["it is not commanded with stiffness or damping"], done=False)
    lever = lever_of(block, given)
    if lever is None:
        return Result([NO_LEVER], done=False)
    result, limited = law_once(bench, block, given, lever)
    if limited:
        print_lines([f"  {result.says[-1]}", "  the step is repeated"])
        result, limited = law_once(bench, block, given, lever)
    return result


def law_once(bench: Bench, block: Any, given: Given, lever: Lever) -> tuple[Result, bool]:
    """Compare both gains in one run. Returns (Result, whether late replies have kept it from a measurement)."""
    diagram, probe = law_diagram(block, lever)
    run = run_on_rig(bench, diagram, math.ceil(probe.duration * RATE))
    if not all(probe.sides().values()):
        return failed(Result(), block, run), False
    torque = given.steps.get("torque")
    scale = torque.measured.get("ratio", 1.0) if torque else 1.0
    return law_of(block, lever, probe, scale, friction_before(given)), is_limited(probe)


def is_limited(probe: LawProbe) -> bool:
    """Return whether late replies have replaced the gains by a torque for too long to measure them."""
    return probe.limited_ticks > LIMITED_SHARE * len(probe.rows)


def law_of(block: Any, lever: Lever, probe: LawProbe, scale: float = 1.0, before: Friction | None = None) -> Result:
    """Compare both gains with what a lever has shown in a run.

    scale : true over commanded torque; before : Friction of the step `torque`, None if it is not known
    """
    before = before or Friction(0.0, held=True)
    result = Result()
    if is_limited(probe):
        result.done = False
        result.says.append(
            f"in {probe.limited_ticks} of {len(probe.rows)} ticks a torque was sent instead of both, as after late "
            "replies: not measured"
        )
        return result
    for (side, rows), name, range_now in zip(probe.sides().items(), GAINS, block.wire[2:4]):
        angle, command = (sum(row[i] for row in rows) / len(rows) for i in (1, 2))
        ratio = lever.torque * math.sin(angle) / command / scale
        result.measured[name] = ratio
        result.says.append(f"{name}: the lever shows {ratio:.2f} times the commanded torque")
        friction = friction_of(lever, probe.falls[side])
        most = math.inf if friction.held and before.held else max(friction.torque, before.torque)
        hidden = 2.0 * most / abs(command) / scale  # the lever may be beside its balance at rest and under torque
        if 1.0 / FACTOR < ratio < FACTOR:
            continue
        if ratio - hidden < FACTOR and ratio + hidden > 1.0 / FACTOR:
            result.done = False
            result.says.append(f"friction hides the {name}: not measured")
        else:
            true = ratio * range_now / block.gear_ratio**2
            result.find(
                f"{name} range",
                f"the {name} of the drive is {ratio:.2g} times the commanded one: its encoded range is about "
                f"{true:.2g}, and not {range_now / block.gear_ratio**2:g}. Compare both with its manual, and set "
                f"wire_{name}",
            )
    return result


def law_diagram(block: Any, lever: Lever) -> tuple[Diagram, LawProbe]:
    """Return (Diagram, its LawProbe) of one drive."""
    limit = limit_of(block)
    wanted = min(AIMED_SHARE / LIMIT_SHARE * limit, STEEPEST * lever.torque)
    speed = min(FASTER, SPEED_SHARE * block.wire[1])
    stiffness, damping = (
        math.ceil(wanted / setpoint / (most / CODES)) * most / CODES
        for setpoint, most in zip((AHEAD, speed), block.wire[2:4])
    )
    probe_of = partial(LawProbe, wanted=wanted, lever=lever.torque, stiffness=stiffness, damping=damping)
    diagram, probe = diagram_of(block, probe_of, limit, max_acceleration=ACCELERATION)
    joint = diagram["joint"]
    ends = joint.command_limits()
    with diagram:
        probe(limited=joint.limited)
        for name, low, high in (
            ("position_command", -ends["position_command"].high, ends["position_command"].high),
            ("velocity_command", -ends["velocity_command"].high, ends["velocity_command"].high),
            ("stiffness_command", 0.0, stiffness),
            ("damping_command", 0.0, damping),
        ):
            joint(**{name: Saturation(lower=low, upper=high)(getattr(probe, name))})
    return diagram, probe

"""Inertia, friction and ripple of a free joint, and how it feels by hand.

chirp        a torque whose frequency falls; its amplitude is reduced while the joint is fast, or far from the middle
legs         constant speeds in both directions, by a controller of the inertia that the chirp has shown
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from graph import Param
from runtime.host.console.terminal import print_lines
from runtime.setup.commissioning.guided.bench import Bench, Given, Result, confirmed
from runtime.setup.commissioning.guided.driven import RATE, diagram_of, failed, limit_of, rated_of, run_on_rig
from runtime.setup.commissioning.guided.identification import Dynamics, Estimate, Point, friction_at, identified, ripple
from runtime.setup.commissioning.guided.scripted import REST_TIME, Found, Open, ScriptedProbe

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

CHIRP_TIME, FASTEST, SLOWEST = 16.0, 8.0, 0.4  # s, Hz
GROWTH_TIME = 2.0  # s, of the amplitude
CALM, FAR = 2.0, 0.6  # rad/s, and share of half the travel, beyond which the amplitude is reduced
LESS, MORE = 0.97, 1.004  # of the amplitude, from tick to tick
CENTRING = 0.3  # of the largest torque, at the end of the travel
SPEED_LIMIT = 6.0  # rad/s
SPEEDS = (0.1, 0.2, 0.4, 0.8, 1.6)  # rad/s
LEG_TIME, SETTLE_TIME = 3.0, 0.35  # s
FEWEST_SAMPLES = 30  # of a leg
RESPONSE, INTEGRAL = 0.05, 0.2  # s, of the speed controller
EXPLAINED = 0.85  # share of the variance, below which inertia and friction do not describe the joint
SATURATED = 0.95  # of the largest torque
HAND = 0.3  # m, from the axis to the hand that turns the joint
FEEL = ((0.5, "hardly felt"), (3.0, "light"), (10.0, "clearly felt"), (math.inf, "stiff"))  # N at the hand


class DynamicsProbe(ScriptedProbe):
    """Chirp and motions at constant speeds. `begin` : first tick of the chirp; `legs` : (speed, rows) of each motion"""

    travel = Param(math.pi / 2.0, "rad", "motion, half of it to each side", above=0.0)
    lower = Param(-math.inf, "rad", "lower end of the range of the joint")
    upper = Param(math.inf, "rad", "upper end of the range of the joint")

    def reset(self):
        super().reset()
        self.legs = []

    def sequence(self) -> Iterator[float]:
        """Yield the torque of each tick."""
        yield from self.rest()
        self.middle, self.begin = self.at, len(self.rows)
        half = 0.5 * self.travel
        if not self.lower < self.at - half < self.at + half < self.upper:
            raise Open(
                f"the joint is at {self.at:.3f} rad, and {half:.3f} rad to a side are not within its range "
                f"[{self.lower:g}, {self.upper:g}] rad: turn it, or reduce --travel"
            )
        yield from self.swing()
        chirp = np.array(self.rows[self.begin :])
        self.centre = float(chirp[:, 0].mean())
        joint = identified(chirp, self.dt, quick=True)
        if joint is None:
            raise Open(f"the joint hardly moved with {self.largest:.3g} N·m: it is held, or its friction is larger")
        if joint.explained < EXPLAINED or joint.inertia.value < 0.0:
            raise Open(
                f"inertia and friction explain {max(0.0, joint.explained):.0%} of the motion: the joint is not "
                "free, or it has play"
            )
        for speed in SPEEDS:
            for sign in (1.0, -1.0):
                yield from self.leg(joint, sign * speed)

    def swing(self) -> Iterator[float]:
        """Yield the torque of the chirp."""
        half, amplitude, phase = 0.5 * self.travel, 0.0, 0.0
        for tick in range(round(CHIRP_TIME / self.dt)):
            time = tick * self.dt
            away = self.at - self.middle
            if abs(away) > half and against(np.array(self.rows[self.begin :])):
                raise Found("sign of torque", f"the joint accelerates against the torque, {away:.2f} rad away")
            if abs(away) > half:
                raise Open(f"the joint left the middle by {away:.2f} rad: balance it, or allow more --travel")
            if abs(self.rate) > CALM or abs(away) > FAR * half:
                amplitude *= LESS
            else:
                most = self.largest * min(1.0, time / GROWTH_TIME)
                amplitude = min(most, amplitude * MORE + 0.002 * most)
            phase += 2.0 * math.pi * FASTEST * (SLOWEST / FASTEST) ** (time / CHIRP_TIME) * self.dt
            if abs(away) > FAR * half and away * self.rate > 0.0:
                yield math.copysign(self.largest, -away)
            else:
                yield amplitude * math.sin(phase) - CENTRING * self.largest * away / half

    def leg(self, joint: Dynamics, speed: float) -> Iterator[float]:
        """Yield the torque of a motion at a constant speed in rad/s, to the end of the travel or for LEG_TIME."""
        sign, begin = math.copysign(1.0, speed), len(self.rows)
        gain, integral = joint.inertia.value / RESPONSE, 0.0
        base = joint.coulomb.value * sign + joint.viscous.value * speed + joint.constant.value
        for _ in range(round(LEG_TIME / self.dt)):
            if sign * (self.at - self.middle) > 0.5 * self.travel:
                break
            error = speed - self.rate
            weight = joint.stiffness.value * (self.at - self.centre)
            command = base + weight + gain * (error + integral / INTEGRAL)
            if abs(command) < self.largest:
                integral += error * self.dt
            yield command
        self.legs.append((speed, np.array(self.rows[begin + round(SETTLE_TIME / self.dt) :])))

    @property
    def duration(self) -> float:
        """Longest duration in s."""
        return REST_TIME + CHIRP_TIME + 2.0 * len(SPEEDS) * LEG_TIME + 1.0


def against(rows: np.ndarray) -> bool:
    """Return whether a joint accelerates against its torque. rows : as for `identification.windows`"""
    return float(np.diff(rows[:, 1])[1:] @ rows[1:-1, 2]) < 0.0


@dataclass(frozen=True)
class Identified:
    """What a DynamicsProbe has shown. points : of increasing speed; ripple : (times a turn, N·m), or None"""

    joint: Dynamics
    points: list[Point]
    ripple: tuple[int, float] | None


def dynamics(bench: Bench, block: Any, given: Given) -> Result:
    """Measure inertia, friction and ripple of a free joint."""
    travel = given.travel
    print_lines(
        [
            f"  {block.path} swings for {CHIRP_TIME:.0f} s and then turns back and forth, within "
            f"{math.degrees(0.5 * travel):.0f}° to both sides of where it is",
            f"  with at most {limit_of(block):.3g} N·m; beyond {SPEED_LIMIT:g} rad/s the run ends",
        ]
    )
    if not confirmed("Is the robot off the person, the lever removed, and the joint free in both directions"):
        return Result(["the joint was not moved"], done=False)
    diagram, probe = dynamics_diagram(block, travel)
    run = run_on_rig(bench, diagram, math.ceil(probe.duration * RATE))
    if not probe.ended:
        return failed(Result(), block, run)
    return dynamics_of(block, probe, given)


def dynamics_diagram(block: Any, travel: float) -> tuple[Any, DynamicsProbe]:
    """Return (Diagram, its DynamicsProbe) of one drive."""
    ends = dict(zip(("lower", "upper"), block.range))
    probe_of = partial(DynamicsProbe, travel=travel, speed=SPEED_LIMIT, **ends)
    return diagram_of(block, probe_of, limit_of(block))


def identified_by(probe: DynamicsProbe, scale: float = 1.0) -> Identified:
    """Return what a DynamicsProbe has shown. scale : torque at the joint over the torque commanded"""
    motion = scaled(np.array(probe.rows[probe.begin :]), scale)
    joint, centre = identified(motion, probe.dt), float(motion[:, 0].mean())
    assert joint is not None  # nor was it of the chirp alone
    legs = [(speed, scaled(rows, scale)) for speed, rows in probe.legs if usable(rows, speed, probe.largest)]
    points = [friction_at(rows, probe.dt, speed, joint, centre) for speed, rows in legs]
    return Identified(joint, sorted(points, key=lambda point: point.speed), ripple(motion, probe.dt, joint))


def scaled(rows: np.ndarray, scale: float) -> np.ndarray:
    """Return rows with their torque multiplied."""
    return rows * np.array([1.0, 1.0, scale])


def usable(rows: np.ndarray, speed: float, largest: float) -> bool:
    """Return whether a motion had its speed, with a torque below the largest."""
    return (
        len(rows) >= FEWEST_SAMPLES
        and abs(rows[:, 1].mean() / speed - 1.0) < 0.15
        and float(np.abs(rows[:, 2]).mean()) < SATURATED * largest
    )


def dynamics_of(block: Any, probe: DynamicsProbe, given: Given) -> Result:
    """Return the Result of a DynamicsProbe, and write its picture."""
    if (ended := probe.without_measurement()) is not None:
        return ended
    result = Result()
    lever = given.steps.get("torque")
    scale = lever.measured.get("ratio", 1.0) if lever is not None else 1.0
    found = identified_by(probe, scale)
    joint = found.joint
    for name in ("inertia", "viscous", "coulomb"):
        estimate: Estimate = getattr(joint, name)
        result.measured |= {name: estimate.value, f"{name}_error": estimate.error}
    for point in found.points:
        at = f"{'forward' if point.speed > 0.0 else 'backward'}_at_{round(1e3 * abs(point.speed))}"  # mrad/s
        result.measured |= {f"torque_{at}": point.torque.value, f"torque_{at}_error": point.torque.error}
    source = "of the lever" if scale != 1.0 else "as commanded, not compared with a lever"
    result.says += [
        f"inertia {joint.inertia} kg·m², Coulomb friction {joint.coulomb} N·m, viscous friction {joint.viscous} "
        f"N·m·s/rad (95 %, torque {source})",
        *(f"at {point.speed:+.1f} rad/s: {point.torque} N·m" for point in found.points),
        "no ripple stands out"
        if found.ripple is None
        else f"a ripple of {found.ripple[1]:.3g} N·m, about {found.ripple[0]} times a turn",
        *in_words(block, joint),
    ]
    if found.ripple is not None:
        result.measured |= {"ripple": found.ripple[1], "ripple_order": found.ripple[0]}
    if given.picture is not None:
        result.says.append(f"picture: {given.picture.parent.name}/{given.picture.name}")
        draw(block.path, found, given.picture)
    return result


def in_words(block: Any, joint: Dynamics) -> list[str]:
    """Return how the joint feels by hand, as lines."""
    friction = max(0.0, joint.coulomb.value)
    force = friction / HAND
    word = next(word for limit, word in FEEL if force < limit)
    return [
        f"by hand, {HAND:g} m from the axis: {word}; {force:.2g} N turns it slowly, {friction / rated_of(block):.1%} "
        f"of the rated torque; 1 rad/s adds {joint.viscous.value / HAND:.2g} N, 10 rad/s² adds "
        f"{10.0 * joint.inertia.value / HAND:.2g} N"
    ]


def draw(name: str, found: Identified, path: Path) -> None:
    """Draw torque over speed, and the identified parameters with their confidence, as a PNG. name : of the joint"""
    from runtime.host.replaced_file import replacement
    from runtime.record.analysis import picture

    figure = picture.figure(8.0, 4.2)
    curve, numbers = figure.subplots(1, 2, width_ratios=(2.2, 1.0))
    joint = found.joint
    speeds = np.array([point.speed for point in found.points])
    curve.errorbar(
        speeds,
        [point.torque.value for point in found.points],
        [point.torque.error for point in found.points],
        fmt="o",
        color=picture.BLUE,
        capsize=3,
        label="at constant speed, 95 %",
    )
    line = np.linspace(-1.0, 1.0, 201) * (max(map(abs, speeds)) if len(speeds) else 1.0)
    curve.plot(
        line,
        joint.coulomb.value * np.sign(line) + joint.viscous.value * line,
        color=picture.ORANGE,
        linewidth=1.2,
        label="Coulomb and viscous friction",
    )
    curve.set_xlabel("speed [rad/s]")
    curve.set_ylabel("torque [N·m]")
    curve.legend(frameon=False, fontsize=8)
    picture.frame(curve)
    numbers.axis("off")
    rows = [("inertia", joint.inertia, "kg·m²"), ("Coulomb friction", joint.coulomb, "N·m")]
    rows += [("viscous friction", joint.viscous, "N·m·s/rad")]
    text = [f"{label}\n{estimate} {unit}" for label, estimate, unit in rows]
    if found.ripple is not None:
        text.append(f"ripple\n{found.ripple[1]:.3g} N·m, {found.ripple[0]} times a turn")
    numbers.text(0.0, 0.95, "\n\n".join(text), va="top", fontsize=9, color=picture.INK)
    figure.suptitle(f"{name}: friction and inertia", fontsize=11, color=picture.INK)
    path.parent.mkdir(exist_ok=True)
    with replacement(path) as file:
        picture.save(figure, file)

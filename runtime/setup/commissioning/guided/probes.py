"""Probes of the steps under torque: what they command in a run, and what a lever that hangs from the joint shows.

Friction holds a lever within a band about its balance, so that it shows more or less than the torque of the drive.
After each direction the torque falls slowly to zero. A lever without friction follows it; one with friction stays where
it is at first, and ends beside its rest: torque of the lever = torque of the drive + friction, while it falls.
"""

from __future__ import annotations

import math
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from graph import Block, Input, Output, Param

GRAVITY = 9.81  # m/s²
START_SHARE, GROWTH_TIME = 0.02, 2.5  # of the torque; s to its full value, exponentially
REST_TIME, HOLD_TIME = 0.8, 1.2  # s
FALL_TIME = 2.0  # s, in which the torque falls to zero
BACK, FEWEST = 0.85, 30  # of the torque of the lever, below which it falls; samples of a fall
SWING, SWING_LIMIT = 0.15, 6.0  # rad within REST_TIME, in which a lever still swings; s for which it may
SWUNG, TOO_FAST = 1.3, 12.0  # rad, rad/s: the run ends
AFTER_TICKS = 6  # after the silence, in which a lever that has fallen is not yet back


@dataclass(frozen=True)
class Lever:
    """Weight on a lever at the output. mass in kg, length in m from the axis to its centre"""

    mass: float
    length: float

    @property
    def torque(self) -> float:
        """Torque of the horizontal lever in N·m."""
        return self.mass * GRAVITY * self.length


class Probe(Block):
    """Torque of a step, and the end of its run."""

    largest = Param(0.1, "N·m", "largest command", above=0.0)
    constant = Param(1.0, "N·m/A", "torque constant at the joint, of a drive that is commanded with a current")

    position = Input("rad", "joint angle")
    velocity = Input("rad/s", "joint velocity")
    reported = Input("N·m", "torque that the drive reports")
    torque = Output("N·m", "torque command")
    current = Output("A", "current of this torque")
    over = Output("1", "whether the run ends", dtype=bool)


class LeverProbe(Probe):
    """Torque that grows exponentially, in each direction, until the deflection of a lever shows the wanted one.

    `rows` has (phase, position, command, reported torque, velocity) of each tick, `falls` (deflection, command) of the
    ticks in which the torque falls, in its direction.
    """

    wanted = Param(0.1, "N·m", "torque that the lever is to show", above=0.0)
    lever = Param(1.0, "N·m", "torque of the horizontal lever", above=0.0)
    silence = Param(0.0, "s", "duration without frames after the first direction; 0: none", min=0.0)

    def configure(self) -> None:
        self.allowance = self.silence + 0.1 if self.silence else 0.0
        self.ends = [REST_TIME, REST_TIME + GROWTH_TIME, REST_TIME + GROWTH_TIME + HOLD_TIME]
        self.fall_time = 0.0 if self.silence else FALL_TIME
        self.side_time = self.ends[2] + self.fall_time + self.silence + REST_TIME  # s, of one direction
        self.count = 1 if self.silence else 2  # directions

    @property
    def duration(self) -> float:
        """Longest duration in s."""
        return self.count * (self.side_time + SWING_LIMIT)

    def sides(self) -> dict[str, list[tuple[Any, ...]]]:
        """Return the rows of each direction, {"+" or "-": rows}."""
        return {name: [row for row in self.rows if row[0] == name] for name in "+-"}

    def reset(self):
        self.rows, self.rest, self.command, self.hushed, self.grown = [], None, 0.0, False, False
        self.begun = self.held = 0.0
        self.falls: dict[str, list[tuple[float, float]]] = {"+": [], "-": []}
        self.recent, self.waited, self.ended = deque(maxlen=round(REST_TIME / self.dt)), 0.0, False

    def step(self, position, velocity, reported, t):
        phase, local = divmod(t - self.waited, self.side_time)
        self.recent.append(position)
        self.ended = phase >= self.count
        sign, deflection = 1.0 if phase == 0.0 else -1.0, 0.0 if self.rest is None else position - self.rest
        row = deflection, self.command, reported, velocity
        if local < self.ends[0]:
            self.hang(phase, local, deflection)
        elif local < self.ends[1]:
            self.grow(sign, local, deflection)
        elif local < self.ends[2]:
            if local > self.ends[1] + 0.3 * HOLD_TIME:
                self.rows.append(("+" if sign > 0 else "-", *row))
        elif local < self.ends[2] + self.fall_time:
            self.fall(sign, local, deflection)
        else:
            self.let_go(row)
        lost = abs(deflection) > SWUNG or abs(velocity) > TOO_FAST
        return self.command, self.command / self.constant, lost or self.ended

    def hang(self, phase: float, local: float, deflection: float) -> None:
        """Command zero, longer while the lever swings from the direction or the step before. Its rest is the first."""
        self.command, self.grown, self.begun = 0.0, False, deflection
        if phase == 0.0:
            self.rest = sum(self.recent) / len(self.recent)
        if local > self.ends[0] - 1.5 * self.dt and self.waited < (phase + 1.0) * SWING_LIMIT:
            self.waited += self.dt * (max(self.recent) - min(self.recent) > SWING)

    def grow(self, sign: float, local: float, deflection: float) -> None:
        """Increase the torque until the lever shows the wanted one, in whichever direction."""
        shown, before = (sign * self.lever * math.sin(max(-1.5, min(1.5, at))) for at in (deflection, self.begun))
        against = before - shown  # where friction held the lever before, it has not moved
        self.grown = self.grown or max(shown, against) >= self.wanted
        if not self.grown:
            share = START_SHARE ** (1.0 - (local - self.ends[0]) / GROWTH_TIME)
            self.command = sign * min(self.wanted * 1.3 * share, self.largest)

    def fall(self, sign: float, local: float, deflection: float) -> None:
        """Decrease the torque to zero, and note what the lever shows."""
        fall = self.falls["+" if sign > 0 else "-"]
        fall.append((sign * deflection, sign * self.command))
        self.held = self.command if len(fall) == 1 else self.held
        self.command = self.held * (1.0 - (local - self.ends[2]) / self.fall_time)

    def let_go(self, row: tuple[float, ...]) -> None:
        """Command zero. With a silence, send nothing before that, and note where the lever is before and after."""
        if self.silence and not self.hushed:
            self.hushed = True
            self.rows.append(("held", *row))
            time.sleep(self.silence)
            return
        if self.hushed and sum(name == "after" for name, *_ in self.rows) < AFTER_TICKS:
            self.rows.append(("after", *row))
        self.command = 0.0


@dataclass(frozen=True)
class Friction:
    """Friction that a lever has shown while its torque fell to zero.

    torque : N·m; at least that much if the lever was held
    scale : change of the torque of the lever over that of the command, NaN of a lever that was held
    held : whether the lever stayed where it was, without torque
    """

    torque: float
    scale: float = math.nan
    held: bool = False


def friction_of(lever: Lever, fall: list[tuple[float, float]]) -> Friction:
    """Return the Friction of one direction. fall : one of `LeverProbe.falls`"""
    rows = np.array(fall).reshape(-1, 2)
    shown, command = lever.torque * np.sin(rows[:, 0]), rows[:, 1]
    falling = np.flatnonzero(shown < BACK * shown[0]) if len(rows) else []
    if len(falling) == 0 or len(rows) - falling[0] < FEWEST or not np.ptp(command):
        return Friction(abs(float(shown[-1])) if len(rows) else 0.0, held=True)
    scale, friction = np.polyfit(command[falling[0] :], shown[falling[0] :], 1)
    return Friction(max(0.0, float(friction)), float(scale))

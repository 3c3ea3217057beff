"""Where in the stride a leg is, and what torque helps there."""

import math
from typing import Any

import numpy as np

from cext.kernels import gait as kernels
from graph import Block, Input, Interval, Memory, Output, Param


class TorqueProfile(Block):
    """A torque over the gait phase: τ = scale · p(phase), p a periodic curve through given points that never leaves
    their range.

    The curve is a monotone piecewise cubic (Fritsch and Carlson 1980), smooth across the end of the stride. No torque
    where `enable` is false. Direct feedthrough; NaN passes, infinity becomes NaN. Such profiles are what
    human-in-the-loop optimisation tunes (Zhang et al. 2017).
    """

    points = Param(
        ((0.0, 0.0), (0.5, 0.0)), "1", "pairs (phase from 0 to 1, torque in N·m), at least two, in order", dtype=tuple
    )
    scale = Param(1.0, "1", "share of the profile that is applied", min=0.0, max=1.0, live=True)

    phase = Input("1", "gait phase, 0 at heel strike, 1 at the next")
    enable = Input("1", "whether the wearer walks", dtype=bool, default=True)
    torque = Output("N·m", "τ")
    knots = Memory(0.0, "phase of each point, the first again at the end")
    cubics = Memory(0.0, "four coefficients for each piece")
    bounds = Memory(0.0, "smallest and largest torque")

    kernel = kernels.torque_profile

    def configure(self):
        try:
            points: Any = np.asarray(self.points, dtype=float)
        except (TypeError, ValueError):
            points = np.empty(0)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
            raise ValueError(f"points are at least two pairs (phase, torque), not {self.points!r}")
        phases, torques = points.T
        if not np.all(np.isfinite(points)):
            raise ValueError(f"points must be finite, not {self.points!r}")
        if phases[0] < 0.0 or phases[-1] >= 1.0 or np.any(np.diff(phases) <= 0.0):
            raise ValueError(f"the phases must rise from 0 to below 1, and they are {phases.tolist()}")
        knots = np.append(phases, phases[0] + 1.0)
        values = np.append(torques, torques[0])
        self.knots, self.cubics = knots, monotone_cubics(knots, values).ravel()
        self.bounds = torques.min(), torques.max()

    def output_range(self, phase, enable):
        most = self.span("scale").high
        return Interval(min(most * float(self.bounds[0]), 0.0), max(most * float(self.bounds[1]), 0.0))


def monotone_cubics(knots, values):
    """Coefficients (n, 4), constant first, of a periodic monotone cubic through n + 1 knots, values[0] ==
    values[-1].
    """
    width = np.diff(knots)
    slope = np.diff(values) / width
    before, before_width = np.roll(slope, 1), np.roll(width, 1)
    # The weighted harmonic mean of the slopes on both sides; flat at a peak.
    w1, w2 = 2.0 * width + before_width, width + 2.0 * before_width
    rising = np.sign(slope) * np.sign(before) > 0.0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        tangent = np.where(rising, (w1 + w2) / (w1 / before + w2 / slope), 0.0)
    after = np.roll(tangent, -1)
    return np.column_stack(
        (
            values[:-1],
            tangent,
            (3.0 * slope - 2.0 * tangent - after) / width,
            (tangent + after - 2.0 * slope) / width**2,
        )
    )


class GaitPhase(Block):
    """Gait phase from the knee alone: time since the swing knee last passed a flexion threshold, over the mean stride
    time.

    Principle: 1. an event is the angle rising through `threshold` (near toe-off) after having been below half of it; 2.
    the time between two events, if between `shortest` and `longest`, is a stride and enters a running mean, else all
    starts over; 3. phase = event_phase + elapsed / mean, modulo 1; 4. `walking` from the third event on, until none
    comes for one and a half strides. Direct feedthrough. NaN or infinity in the angle or its velocity gives NaN in the
    phase, and is forgotten with it.
    """

    threshold = Param(0.7, "rad", "knee flexion at the event", above=0.0)
    event_phase = Param(0.62, "1", "gait phase at the event, shortly after toe-off", min=0.0, max=1.0)
    shortest = Param(0.6, "s", "shortest stride believed", above=0.0)
    longest = Param(2.5, "s", "longest stride believed", above=0.0)

    angle = Input("rad", "knee flexion")
    velocity = Input("rad/s", "knee flexion velocity")
    phase = Output("1", "0 at heel strike, 1 at the next", range=(0.0, 1.0), circle=(0.0, 1.0))
    walking = Output("1", "whether the phase is known", dtype=bool, range=(0.0, 1.0))
    stride_time = Output("s", "mean stride time, 0 while unknown")
    strides = Output("1", "events since the start, one a stride", dtype=int)
    elapsed = Memory(math.inf, "s since the last event")
    armed = Memory(0.0, "whether the knee was extended since")
    mean = Memory(0.0, "mean stride time")
    valid = Memory(0.0, "strides in a row that were believed")
    events = Memory(0.0, "since the start")

    kernel = kernels.gait_phase

    def configure(self):
        if self.shortest >= self.longest:
            raise ValueError(f"shortest, {self.shortest:g} s, is not below longest, {self.longest:g} s")

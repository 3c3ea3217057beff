"""Gait phase, and torque profiles over the gait phase."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cext.kernels import gait as kernels
from graph import Block, Input, Interval, Memory, Output, Param


class TorqueProfile(Block):
    """Torque profile over the gait phase: τ = scale · p(phase), p a periodic curve through given points.

    The curve is a monotone piecewise cubic (Fritsch and Carlson 1980), smooth across the end of the stride, and never
    leaves the range of the points. The torque is 0 while `enable` is false. Direct feedthrough; NaN passes, infinity
    becomes NaN. Human-in-the-loop optimisation tunes such profiles (Zhang et al. 2017).
    """

    points = Param(
        ((0.0, 0.0), (0.5, 0.0)),
        "1",
        "at least two pairs (phase from 0 to 1, torque in N·m), with increasing phases",
        dtype=tuple,
    )
    scale = Param(1.0, "1", "scale factor of the profile", min=0.0, max=1.0, live=True)

    phase = Input("1", "gait phase, 0 at heel strike, 1 at the next")
    enable = Input("1", "true while the wearer is walking; false sets the torque to 0", dtype=bool, default=True)
    torque = Output("N·m", "torque τ")
    knots = Memory(0.0, "phase of each point, with the first repeated at the end")
    cubics = Memory(0.0, "four coefficients per segment")
    bounds = Memory(0.0, "smallest and largest torque")

    kernel = kernels.torque_profile

    def configure(self) -> None:
        try:
            points: Any = np.asarray(self.points, dtype=float)
        except (TypeError, ValueError, OverflowError):
            points = np.empty(0)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
            raise ValueError(f"points must be at least two pairs (phase, torque), got {self.points!r}")
        phases, torques = points.T
        if not np.all(np.isfinite(points)):
            raise ValueError(f"points must be finite, got {self.points!r}")
        if phases[0] < 0.0 or phases[-1] >= 1.0 or np.any(np.diff(phases) <= 0.0):
            raise ValueError(f"the phases must increase strictly within 0 <= phase < 1, got {phases.tolist()}")
        knots = np.append(phases, phases[0] + 1.0)
        values = np.append(torques, torques[0])
        self.knots, self.cubics = knots, monotone_cubics(knots, values).ravel()
        self.bounds = torques.min(), torques.max()

    def output_range(self, phase: Interval, enable: Interval) -> Interval:
        scale = self.span("scale").high
        return Interval(min(scale * float(self.bounds[0]), 0.0), max(scale * float(self.bounds[1]), 0.0))


def monotone_cubics(knots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return coefficients (n, 4), constant first, of a periodic monotone cubic through n + 1 knots.

    knots, values : (n + 1,), with values[0] == values[-1]
    """
    width = np.diff(knots)
    slope = np.diff(values) / width
    before, before_width = np.roll(slope, 1), np.roll(width, 1)
    # Tangent: weighted harmonic mean of the slopes on both sides, zero at a peak.
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
    """Gait phase from the knee angle: phase = event_phase + elapsed / mean stride time, modulo 1.

    Principle: 1. an event is the angle rising through `threshold` (near toe-off) after it was below half of it; 2. the
    time between two events is a stride if it is between `shortest` and `longest`, and enters a running mean; 3.
    `elapsed` is the time since the last event; 4. `walking` is true from the third event until one and a half strides
    pass without an event; 5. after a stop the mean stride time is kept: `walking` is true again when the knee has
    extended after a swing that lasted as usual within 40 %, or after one stride that differs from the mean by less than
    a quarter; 6. `uncertainty` is the RMS difference of the last strides from the mean, each with a weight of 20 %, at
    least 5 % after a stop; it rises while an event is overdue. Direct feedthrough. NaN or infinity in the angle or its
    velocity gives a NaN phase and is not stored.
    """

    rules = ("shortest < longest",)

    threshold = Param(0.7, "rad", "knee flexion at the event", above=0.0)
    event_phase = Param(0.62, "1", "gait phase at the event, shortly after toe-off", min=0.0, max=1.0)
    shortest = Param(0.6, "s", "shortest accepted stride", above=0.0)
    longest = Param(2.5, "s", "longest accepted stride", above=0.0)

    angle = Input("rad", "knee flexion")
    velocity = Input("rad/s", "knee flexion velocity")
    phase = Output("1", "gait phase: 0 at heel strike, 1 at the next", range=(0.0, 1.0), circle=(0.0, 1.0))
    walking = Output("1", "true while the phase is known", dtype=bool, range=(0.0, 1.0))
    stride_time = Output("s", "mean stride time, 0 while unknown")
    strides = Output("1", "number of events since the start, one per stride", dtype=int)
    uncertainty = Output("1", "standard deviation of the phase, as a fraction of a stride", range=(0.0, 0.3))
    elapsed = Memory(math.inf, "time in s since the last event")
    armed = Memory(0.0, "1 if the knee has been extended since")
    mean = Memory(0.0, "mean stride time, also of the last walk")
    valid = Memory(0.0, "number of consecutive accepted strides, up to 2")
    swing = Memory(0.0, "usual time from an event to the extended knee, 0 while unknown")
    events = Memory(0.0, "number of events since the start")
    spread = Memory(0.0025, "mean square difference of the last strides from the mean")

    kernel = kernels.gait_phase

"""Inertia and friction of a joint from a run: least squares of its change of velocity, with intervals of confidence.

    ω(t₂) - ω(t₁) = (1/J) ( ∫ τ dt - b (θ(t₂) - θ(t₁)) - τ_c ∫ sign ω dt - τ_0 (t₂ - t₁) - k ∫ θ dt )

J inertia, b viscous and τ_c Coulomb friction, τ_0 a constant torque and k a stiffness, such as that of a weight. A
window in which the joint stands or turns round does not count. The interval of 95 % comes from the jackknife over
GROUPS groups of segments, whose errors are independent of each other, unlike those of neighbouring samples, and from
the time of an effect, which is known within an eighth of a tick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

WINDOWS = (4, 8, 16)  # ticks; a heavy joint, whose velocity changes slowly, needs long ones
SEGMENT = 0.5  # s
GROUPS = 10
STUDENT = 2.26  # of 9 degrees of freedom, 95 %
SMALLEST_SPEED = 0.08  # rad/s, below which the direction of the friction is uncertain
SHIFTS, PARTS = range(-1, 6), (-0.75, -0.5, -0.25, 0.25, 0.5, 0.75)  # ticks from a torque to its effect, less one
FEWEST = 60  # windows
CHUNKS = 6  # of a motion at a constant speed
STUDENT_CHUNKS = 2.57  # of 5 degrees of freedom, 95 %
RIPPLE_ORDERS = range(12, 201)  # times a turn, so that a motion has several of them
RIPPLE_SEEN, RIPPLE_SHARE = 5.0, 0.1  # of the median amplitude over all orders, and of the Coulomb friction


@dataclass(frozen=True)
class Estimate:
    """A number and half its interval of 95 % confidence."""

    value: float
    error: float

    def __str__(self) -> str:
        digits = max(0, 1 - math.floor(math.log10(self.error))) if 0.0 < self.error < math.inf else 4
        return f"{self.value:.{digits}f} ± {self.error:.{digits}f}"


@dataclass(frozen=True)
class Dynamics:
    """Identified parameters of a joint.

    inertia : kg·m²; viscous : N·m·s/rad; coulomb, constant : N·m; stiffness : N·m/rad, as Estimates
    explained : share of the variance of the changes of velocity
    shift : ticks from a torque to its effect, less one; window : ticks
    """

    inertia: Estimate
    viscous: Estimate
    coulomb: Estimate
    constant: Estimate
    stiffness: Estimate
    explained: float
    shift: float
    window: int


@dataclass(frozen=True)
class Point:
    """Torque at a constant speed. speed : rad/s, with its sign; torque : Estimate, N·m, without weight and inertia"""

    speed: float
    torque: Estimate


def windows(rows: np.ndarray, period: float, shift: float, window: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (start in ticks, change of velocity, factors of it (n, 5)) of the windows that count.

    rows : (n, 3) position, velocity and torque sent before; period : s; shift, window : ticks
    """
    whole, part, time = math.floor(shift), shift - math.floor(shift), window * period
    begins = np.arange(window, len(rows) - window - max(0, whole) - 1, window)
    inside = begins[:, None] + np.arange(window + 1)
    position, velocity = rows[inside + whole, 0], rows[inside + whole, 1]
    signs = np.sign(velocity)
    turning = (np.abs(velocity).min(axis=1) > SMALLEST_SPEED) & (np.abs(signs.sum(axis=1)) == window + 1)
    torque = rows[inside[:, :-1], 2].mean(axis=1)
    torque += part * (rows[begins - 1, 2] - rows[begins + window - 1, 2]) / window
    factors = np.column_stack(
        [
            torque * time,
            position[:, 0] - position[:, -1],
            -signs[:, 0] * time,
            np.full(len(begins), -time),
            -(position.mean(axis=1) - rows[:, 0].mean()) * time,
        ]
    )
    return begins[turning], (velocity[:, -1] - velocity[:, 0])[turning], factors[turning]


def solved(change: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Return (J, b, τ_c, τ_0, k) of windows, (5,)."""
    return physical(np.linalg.lstsq(factors, change, rcond=None)[0])


def physical(solution: np.ndarray) -> np.ndarray:
    """Return (J, b, τ_c, τ_0, k) of a least-squares solution, (5,)."""
    return np.array([1.0, *solution[1:]]) / solution[0]


@dataclass(frozen=True)
class Fit:
    """Least squares with a shift and a window in ticks. explained : share of the variance; solution : (5,)"""

    explained: float
    shift: float
    window: int
    solution: np.ndarray


def fit(rows: np.ndarray, period: float, shift: float, window: int) -> Fit | None:
    """Return the Fit, None if the joint has hardly moved. Arguments as for `windows`."""
    _, change, factors = windows(rows, period, shift, window)
    if len(change) < FEWEST:
        return None
    solution = np.linalg.lstsq(factors, change, rcond=None)[0]
    explained = 1.0 - float(np.var(change - factors @ solution) / max(float(np.var(change)), 1e-12))
    return Fit(explained, shift, window, solution)


def explained_by(each: Fit) -> float:
    """Return the share of the variance that a Fit explains."""
    return each.explained


def identified(rows: np.ndarray, period: float, quick: bool = False) -> Dynamics | None:
    """Return the Dynamics of a motion, None if the joint has hardly moved.

    rows, period : as for `windows`; quick : without intervals, in about one tick
    """
    shifts, lengths = (SHIFTS[:3], WINDOWS[1:]) if quick else (SHIFTS, WINDOWS)
    coarse = [fit(rows, period, shift, window) for window in lengths for shift in shifts]
    best = max(filter(None, coarse), key=explained_by, default=None)
    if best is None:
        return None
    errors = np.full(5, math.inf)
    if not quick:
        fine = [fit(rows, period, best.shift + part, best.window) for part in PARTS]
        best = max(best, *filter(None, fine), key=explained_by)
        begins, change, factors = windows(rows, period, best.shift, best.window)
        group = (begins * period / SEGMENT).astype(int) % GROUPS
        without = np.array([solved(change[group != each], factors[group != each]) for each in range(GROUPS)])
        spread = np.sqrt((GROUPS - 1) / GROUPS * np.sum((without - without.mean(axis=0)) ** 2, axis=0))
        timing = [solved(*windows(rows, period, best.shift + part, best.window)[1:]) for part in (-0.125, 0.125)]
        errors = np.hypot(STUDENT * spread, np.abs(np.array(timing) - physical(best.solution)).max(axis=0))
    values = [Estimate(float(value), float(error)) for value, error in zip(physical(best.solution), errors)]
    return Dynamics(*values, explained=best.explained, shift=best.shift, window=best.window)


def friction_at(rows: np.ndarray, period: float, speed: float, joint: Dynamics, centre: float) -> Point:
    """Return the Point of a motion at a constant speed.

    rows : as for `windows`; speed : rad/s, with its sign; centre : rad, mean position of the run that gave `joint`
    """
    chunks, away = np.array_split(rows, CHUNKS), float(rows[:, 0].mean()) - centre
    torques = [
        chunk[:, 2].mean()
        - joint.constant.value
        - joint.stiffness.value * (chunk[:, 0].mean() - centre)
        - joint.inertia.value * (chunk[-1, 1] - chunk[0, 1]) / max(period * (len(chunk) - 1), period)
        for chunk in chunks
    ]
    error = STUDENT_CHUNKS * float(np.std(torques, ddof=1)) / math.sqrt(CHUNKS)
    error = math.hypot(error, joint.constant.error, joint.stiffness.error * away)
    return Point(speed, Estimate(float(np.mean(torques)), error))


def ripple(rows: np.ndarray, period: float, joint: Dynamics) -> tuple[int, float] | None:
    """Return (times a turn, amplitude in N·m) of a torque that depends on the angle; None if none stands out."""
    window = WINDOWS[0]
    begins, change, factors = windows(rows, period, joint.shift, window)
    if len(change) < FEWEST:
        return None
    constants = [1.0, *(getattr(joint, name).value for name in ("viscous", "coulomb", "constant", "stiffness"))]
    left = (factors @ np.array(constants) - joint.inertia.value * change) / (window * period)  # N·m, not explained
    middle = rows[begins + window // 2 + math.floor(joint.shift), 0]
    amplitudes = []
    for order in RIPPLE_ORDERS:
        waves = np.column_stack([np.cos(order * middle), np.sin(order * middle), np.ones(len(middle))])
        amplitudes.append(float(np.hypot(*np.linalg.lstsq(waves, left, rcond=None)[0][:2])))
    best = int(np.argmax(amplitudes))
    if amplitudes[best] < max(RIPPLE_SEEN * float(np.median(amplitudes)), RIPPLE_SHARE * joint.coulomb.value):
        return None
    return RIPPLE_ORDERS[best], amplitudes[best]

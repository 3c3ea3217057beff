"""Average stride of one leg in constant memory, for the summary, the plot of a run and `plot --strides`.

A stride lasts from one wrap of the phase to the next, with the leg walking throughout. Work is the integral of torque
× velocity over its samples by the trapezoidal rule, separately for positive and negative power; curves are resampled
over the phase and added to running sums. A stride with missing ticks, a non-finite value or an implausible duration is
excluded and counted.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence


POINTS = 101  # 0, 1, ... 100 % of the stride
GRID = np.linspace(0.0, 1.0, POINTS)
WRAP = 0.5  # decrease of the phase at the end of a stride
STRIDE_MINIMUM, STRIDE_LIMIT = 0.4, 4.0  # s: running, and walking with great difficulty
CURVES = ("angle", "torque", "power")
PHASE, WALKING, ANGLE, VELOCITY, TORQUE, CONTACT = range(6)  # ground contact where it is measured


class Stride(NamedTuple):
    """One complete stride.

    begin, end : its first tick, and that of the next stride
    time : duration in s
    positive_work, negative_work : J
    curves : array (CURVES, POINTS) in rad, N·m and W, at 0, 1, ... 100 % of the stride
    toe_off : phase at which ground contact ends; NaN where it is not measured
    """

    begin: int
    end: int
    time: float
    positive_work: float
    negative_work: float
    curves: Any
    toe_off: float = math.nan


class AverageStride:
    """Average stride. rate : Hz, of the rows"""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self.length_limit = int(STRIDE_LIMIT * rate + 1)  # samples
        # blocks of samples since the last wrap; None while there was none
        self.stride: Any = None
        self.before: Any = None  # the sample before the stride
        self.last_tick: Any = None
        self.last: Any = None  # the newest sample
        self.strides = 0
        self.left_out: dict[str, int] = {}  # {reason: strides}
        # ticks: all, without walking, of strides that ended or were excluded
        self.rows = self.standing = self.in_strides = 0
        self.time = self.positive_work = self.negative_work = self.peak = 0.0
        self.sums = Sums()
        self.toe_offs: list[float] = []

    def add(self, ticks: np.ndarray, samples: np.ndarray) -> None:
        """Add rows, in the order of ticks.

        ticks : array (rows,)
        samples : array (rows, 5) of stride_signals.INPUTS in s, rad, rad/s and N·m; walking is 1.0 where the phase is
            valid. A sixth column is 1.0 while the foot is on the ground
        """
        if not len(ticks):
            return
        walking = samples[:, WALKING] == 1.0
        self.rows += len(ticks)
        self.standing += int(np.count_nonzero(~walking))
        torque = np.abs(samples[:, TORQUE])
        self.peak = max(self.peak, float(torque[np.isfinite(torque)].max(initial=0.0)))
        phase = samples[:, PHASE]
        first = self.last is None
        unbroken = np.diff(ticks, prepend=ticks[0] if first else self.last_tick) == 1
        with np.errstate(invalid="ignore"):
            wrapped = unbroken & walking & (-np.diff(phase, prepend=phase[0] if first else self.last[PHASE]) > WRAP)
        ended = ~unbroken | ~walking
        ended[1:] &= ~ended[:-1]  # further ticks without walking end nothing
        start = 0
        for place in np.flatnonzero(ended | wrapped):
            self.extend(samples[start:place])
            start = place
            if wrapped[place]:
                if self.stride is not None:
                    self.complete(samples[place], int(ticks[place]))
                self.before, self.stride = (samples[place - 1].copy() if place else self.last), []
            elif not unbroken[place]:
                self.leave_out("with missed ticks")
            else:
                self.leave_out("in which walking ended")
        self.extend(samples[start:])
        self.last_tick, self.last = ticks[-1], samples[-1].copy()

    @property
    def samples(self) -> int:
        """Number of samples of the present stride."""
        return sum(map(len, self.stride))

    def extend(self, samples: np.ndarray) -> None:
        """Extend the present stride, if there is one."""
        if self.stride is None or not len(samples):
            return
        self.stride.append(samples.copy())
        if self.samples > self.length_limit:
            self.stride = [np.concatenate(self.stride)[: self.length_limit + 1]]
            self.leave_out(f"longer than {STRIDE_LIMIT:g} s")

    def leave_out(self, reason: str) -> None:
        """Exclude the present stride, if there is one."""
        if self.stride is not None:
            self.left_out[reason] = self.left_out.get(reason, 0) + 1
            self.in_strides += self.samples
        self.stride = None

    def complete(self, after: np.ndarray, end: int) -> None:
        """Average a complete stride unless it is excluded. after, end : first sample of the next one, and its tick"""
        count = self.samples
        duration = count / self.rate
        rows = np.concatenate([[self.before], *self.stride, [after]])
        reason = (
            f"shorter than {STRIDE_MINIMUM:g} s"
            if duration < STRIDE_MINIMUM
            else f"longer than {STRIDE_LIMIT:g} s"
            if duration > STRIDE_LIMIT
            else ""
            if np.isfinite(rows).all()
            else "with a value that is not finite"
        )
        if reason:
            self.leave_out(reason)
            return
        power = rows[:, VELOCITY] * rows[:, TORQUE]
        phases = rows[:, PHASE].copy()
        phases[0] -= 1.0
        phases[-1] += 1.0
        self.in_strides += count
        lifts = np.flatnonzero(np.diff(rows[:, CONTACT]) < 0) + 1 if rows.shape[1] > CONTACT else []
        self.keep(
            Stride(
                end - count,
                end,
                duration,
                trapezoid(np.maximum(power[1:], 0.0), 1.0 / self.rate),
                trapezoid(np.minimum(power[1:], 0.0), 1.0 / self.rate),
                resample(phases, rows[:, ANGLE], rows[:, TORQUE], power),
                float(phases[lifts[-1]]) if len(lifts) else math.nan,
            )
        )

    def keep(self, stride: Stride) -> None:
        """Add a complete stride to the average."""
        self.strides += 1
        self.time += stride.time
        self.positive_work += stride.positive_work
        self.negative_work += stride.negative_work
        self.sums.add(stride.curves)
        self.toe_offs += [stride.toe_off] * (stride.toe_off == stride.toe_off)

    def result(self) -> dict[str, Any]:
        """Return a dict in s, N·m, J, rad and W: means over the strides, and the rows outside strides.

        It has no curves without a stride.
        """
        count = self.strides
        result = {
            "strides": count,
            "left_out": sum(self.left_out.values()),
            "left_out_because": dict(self.left_out),
            "peak_torque": self.peak,
            "unused": {
                "standing": self.standing / self.rate,
                "unfinished": max(0, self.rows - self.standing - self.in_strides) / self.rate,
            },
        }
        if count:
            result |= {
                "stride_time": self.time / count,
                "positive_work": self.positive_work / count,
                "negative_work": self.negative_work / count,
                "toe_off": sum(self.toe_offs) / len(self.toe_offs) if self.toe_offs else None,
                "curves": {
                    name: {"mean": mean, "sd": sd}
                    for name, mean, sd in zip(CURVES, self.sums.mean.tolist(), self.sums.sd().tolist())
                },
            }
        return result


def left_out_text(result: dict[str, Any]) -> str:
    """Return why strides were excluded, such as '1 with missed ticks, 2 longer than 4 s'. result : AverageStride"""
    return ", ".join(f"{count} {reason}" for reason, count in result["left_out_because"].items())


def signals_texts(result: dict[str, Any]) -> tuple[str, str]:
    """Return the signals of the figures, without the folder of the leg, as two texts.

    result : as `legs.average_strides` returns it
    """
    signals = {name: path.removeprefix(f"{result['title']}/") for name, path in result["signals"].items()}
    return f"work of {signals['torque']} and {signals['velocity']}", (
        f"angle {signals['angle']}, phase {signals['phase']}"
    )


class Sums:
    """Running mean and standard deviation of the CURVES. (Welford 1962)"""

    def __init__(self) -> None:
        self.count = 0
        self.mean, self.squares = np.zeros((len(CURVES), POINTS)), np.zeros((len(CURVES), POINTS))

    def add(self, curves: np.ndarray) -> None:
        """Add the curves of a stride, an array (CURVES, POINTS)."""
        self.count += 1
        difference = curves - self.mean
        self.mean += difference / self.count
        self.squares += difference * (curves - self.mean)

    def sd(self) -> np.ndarray:
        """Return the sample standard deviation; zero for a single stride."""
        return np.sqrt(self.squares / max(1, self.count - 1))


def resample(phases: np.ndarray | Sequence[float], *curves: np.ndarray | Sequence[float]) -> np.ndarray:
    """Resample curves to 0, 1, ... 100 % of the stride, linearly. Samples that do not advance the phase are skipped.

    phases : array (samples,); the first is 0 or less, the last 1 or more
    curves : arrays (samples,)

    Returns an array (curves, POINTS).
    """
    phases = np.asarray(phases)
    advances = np.append(True, phases[1:] > np.maximum.accumulate(phases)[:-1])
    return np.array([np.interp(GRID, phases[advances], np.asarray(values)[advances]) for values in curves])


def trapezoid(values: np.ndarray, dt: float) -> float:
    """Return the integral of samples over time by the trapezoidal rule. dt : s"""
    return float(dt * (values.sum() - 0.5 * (values[0] + values[-1])))

"""Average stride of one leg in constant memory, for the summary, the plot of a run and `plot --strides`.

A stride lasts from one wrap of the phase to the next, with the leg walking throughout. Work is the integral of torque
× velocity over its samples by the trapezoidal rule, separately for positive and negative power; curves are resampled
over the phase and added to running sums. A stride with missing ticks, a non-finite value or an implausible duration is
excluded and counted.
"""

from math import isfinite, sqrt
from typing import Any

POINTS = 101  # 0, 1, ... 100 % of the stride
WRAP = 0.5  # decrease of the phase at the end of a stride
STRIDE_MINIMUM, STRIDE_LIMIT = 0.4, 4.0  # s: running, and walking with great difficulty
CURVES = ("angle", "torque", "power")
INPUTS = ("phase", "walking", "angle", "velocity", "torque")


class AverageStride:
    """Average stride. rate : Hz, of the rows"""

    def __init__(self, rate):
        self.rate = rate
        self.stride: Any = (
            None  # samples (phase, angle, velocity, torque) since the last wrap, None while there was none
        )
        self.longest = STRIDE_LIMIT * rate + 1
        self.before: Any = None
        self.previous: Any = None  # the sample before the stride, one stride back in phase; and the newest
        self.last_tick = self.last_phase = None
        self.strides = 0
        self.left_out = {}  # {reason: strides}
        # ticks: all, without walking, of strides that ended or were excluded
        self.rows = self.standing = self.in_strides = 0
        self.time = self.positive_work = self.negative_work = self.peak = 0.0
        self.sums = {name: Sums() for name in CURVES}

    def add(self, tick, phase, walking, angle, velocity, torque):
        """Add a row, in the order of ticks. walking : 1.0 if the phase is valid"""
        self.rows += 1
        self.standing += walking != 1.0
        if abs(torque) > self.peak and isfinite(torque):
            self.peak = abs(torque)
        unbroken = self.last_tick is not None and tick == self.last_tick + 1
        wrapped = unbroken and walking == 1.0 and self.last_phase - phase > WRAP
        sample = (phase, angle, velocity, torque)
        if not unbroken:
            self.leave_out("with missed ticks")
        elif walking != 1.0:
            self.leave_out("in which walking ended")
        elif wrapped:
            if self.stride is not None:
                self.complete(sample)
            self.before, self.stride = self.previous, [sample]
        elif self.stride is not None:
            self.stride.append(sample)
            if len(self.stride) > self.longest:
                self.leave_out(f"longer than {STRIDE_LIMIT:g} s")
        self.last_tick, self.last_phase, self.previous = tick, phase, sample

    def leave_out(self, reason):
        """Exclude the present stride, if there is one."""
        if self.stride is not None:
            self.left_out[reason] = self.left_out.get(reason, 0) + 1
            self.in_strides += len(self.stride)
        self.stride = None

    def complete(self, after):
        """Average a complete stride unless it is excluded. after : first sample of the next one"""
        samples = [*self.stride, after]
        duration = len(self.stride) / self.rate
        reason = (
            f"shorter than {STRIDE_MINIMUM:g} s"
            if duration < STRIDE_MINIMUM
            else f"longer than {STRIDE_LIMIT:g} s"
            if duration > STRIDE_LIMIT
            else ""
            if all(isfinite(v) for sample in [self.before, *samples] for v in sample)
            else "with a value that is not finite"
        )
        if reason:
            self.leave_out(reason)
            return
        powers = [velocity * torque for _, _, velocity, torque in samples]
        self.positive_work += trapezoid([max(p, 0.0) for p in powers], 1.0 / self.rate)
        self.negative_work += trapezoid([min(p, 0.0) for p in powers], 1.0 / self.rate)
        self.strides += 1
        self.in_strides += len(self.stride)
        self.time += duration
        rows = [self.before, *samples]
        phases = [self.before[0] - 1.0, *(phase for phase, _, _, _ in self.stride), after[0] + 1.0]
        for name, values in (
            ("angle", [angle for _, angle, _, _ in rows]),
            ("torque", [torque for _, _, _, torque in rows]),
            ("power", [velocity * torque for _, _, velocity, torque in rows]),
        ):
            self.sums[name].add(resample(phases, values))

    def result(self):
        """Return a dict in s, N·m, J, rad and W: means over the strides, and the rows outside strides.

        It has no curves without a stride.
        """
        count = self.strides
        found = {
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
            found |= {
                "stride_time": self.time / count,
                "positive_work": self.positive_work / count,
                "negative_work": self.negative_work / count,
                "curves": {name: {"mean": sums.mean, "sd": sums.sd()} for name, sums in self.sums.items()},
            }
        return found


def left_out_text(result):
    """Return why strides were excluded, such as '1 with missed ticks, 2 longer than 4 s'."""
    return ", ".join(f"{count} {reason}" for reason, count in result["left_out_because"].items())


def signals_texts(result):
    """Return the signals of the figures, without the folder of the leg, as two texts."""
    signals = {name: path.removeprefix(f"{result['title']}/") for name, path in result["signals"].items()}
    return f"work of {signals['torque']} and {signals['velocity']}", (
        f"angle {signals['angle']}, phase {signals['phase']}"
    )


class Sums:
    """Running mean and standard deviation of curves. (Welford 1962)"""

    def __init__(self):
        self.count = 0
        self.mean, self.squares = [0.0] * POINTS, [0.0] * POINTS

    def add(self, curve):
        self.count += 1
        for index, value in enumerate(curve):
            difference = value - self.mean[index]
            self.mean[index] += difference / self.count
            self.squares[index] += difference * (value - self.mean[index])

    def sd(self):
        """Return the sample standard deviation; zero for a single curve."""
        return [sqrt(square / (self.count - 1)) if self.count > 1 else 0.0 for square in self.squares]


def resample(phases, values):
    """Resample values to 0, 1, ... 100 % of the stride, linearly. Samples that do not advance the phase are skipped."""
    xs, ys = [phases[0]], [values[0]]
    for phase, value in zip(phases, values):
        if phase > xs[-1]:
            xs.append(phase)
            ys.append(value)
    curve, right = [], 1
    for point in range(POINTS):
        at = point / (POINTS - 1)
        while right < len(xs) - 1 and xs[right] < at:
            right += 1
        share = (at - xs[right - 1]) / (xs[right] - xs[right - 1])
        curve.append(ys[right - 1] + min(1.0, max(0.0, share)) * (ys[right] - ys[right - 1]))
    return curve


def trapezoid(values, dt):
    return dt * (sum(values) - 0.5 * (values[0] + values[-1]))

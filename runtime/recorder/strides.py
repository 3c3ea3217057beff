"""The average stride of each leg, in constant memory: every stride is resampled over the gait phase and added to running sums.

A stride goes from one wrap of the phase to the next, with the leg walking all the while. One with missing ticks, with a value
that is not finite, or of an implausible duration is left out and counted. Each part of a
recording has its own average; `plot --strides` reads them all.
"""

import os
from math import isfinite, sqrt

from runtime.recorder.files import create
from runtime.recorder.service import Service

POINTS = 101                    # 0, 1, ... 100 % of the stride
WRAP = 0.5                      # the phase falls by more than this where a stride ends
SHORTEST, LONGEST = 0.4, 4.0    # s, of a stride: running, and walking with great difficulty
CURVES = ("angle", "torque", "power")


class StrideAverage(Service):
    """Serves blocks.recorders.StrideReport: columns phase, walking, angle, velocity, torque, in this order."""

    def open(self):
        if len(self.sink["columns"]) != 5:
            raise ValueError("wire all five inputs: phase, walking, angle, velocity, torque")
        path = self.sink["path"]
        self.title = self.sink["parameters"].get("title") or path.rpartition("/")[0] or path
        self.stride = None              # samples (phase, angle, velocity, torque) since the last wrap, None while there was none
        self.longest = LONGEST * self.plan["rate"] + 1
        self.before = self.previous = None      # the sample before the stride, one stride back in phase; and the newest
        self.last_tick = self.last_phase = None
        self.strides = self.left_out = 0
        self.time = self.positive_work = self.negative_work = self.peak = 0.0
        self.sums = {name: Sums() for name in CURVES}

    def row(self, tick, time, values):
        phase, walking, angle, velocity, torque = values
        if abs(torque) > self.peak and isfinite(torque):
            self.peak = abs(torque)
        unbroken = self.last_tick is not None and tick == self.last_tick + 1
        wrapped = unbroken and walking == 1.0 and self.last_phase - phase > WRAP
        sample = (phase, angle, velocity, torque)
        if not unbroken or walking != 1.0:
            self.drop(count=self.stride is not None and walking == 1.0)
        elif wrapped:
            if self.stride is not None:
                self.complete(sample)
            self.before, self.stride = self.previous, [sample]
        elif self.stride is not None:
            self.stride.append(sample)
            if len(self.stride) > self.longest:
                self.drop(count=True)
        self.last_tick, self.last_phase, self.previous = tick, phase, sample

    def drop(self, count):
        self.left_out += count
        self.stride = None

    def complete(self, after):
        """A whole stride: average it if it is fit for that. after : the first sample of the next one"""
        samples = [*self.stride, after]
        duration = len(self.stride) / self.plan["rate"]
        if not SHORTEST <= duration <= LONGEST or not all(isfinite(v) for sample in [self.before, *samples] for v in sample):
            self.left_out += 1
            return
        powers = [velocity * torque for _, _, velocity, torque in samples]
        self.positive_work += trapezoid([max(p, 0.0) for p in powers], 1.0 / self.plan["rate"])
        self.negative_work += trapezoid([min(p, 0.0) for p in powers], 1.0 / self.plan["rate"])
        self.strides += 1
        self.time += duration
        rows = [self.before, *samples]
        phases = [self.before[0] - 1.0, *(phase for phase, _, _, _ in self.stride), after[0] + 1.0]
        for name, values in (
            ("angle", [angle for _, angle, _, _ in rows]),
            ("torque", [torque for _, _, _, torque in rows]),
            ("power", [velocity * torque for _, _, velocity, torque in rows]),
        ):
            self.sums[name].add(resample(phases, values))

    def close(self):
        count = self.strides
        result = {
            "title": self.title, "path": self.sink["path"], "strides": count, "left_out": self.left_out, "peak_torque": self.peak,
        }
        if count:
            result |= {
                "stride_time": self.time / count, "positive_work": self.positive_work / count, "negative_work": self.negative_work / count,
                "curves": {name: {"mean": sums.mean, "sd": sums.sd()} for name, sums in self.sums.items()},
            }
        self.result = result
        told, part = {"strides": count, "left_out": self.left_out}, self.plan.get("part", 1)
        return told | ({"problem": f"{self.title}: strides before part {part} are not in the average"} if part > 1 else {})

    @classmethod
    def conclude(cls, plan, services):
        """All legs in one picture. Report: `strides`, of each leg a dict in s, N·m, J, rad and W."""
        results = [service.result for service in services]
        walked = [result for result in results if result["strides"]]
        if not walked or plan["folder"] is None:
            return {"strides": results}
        from runtime.recorder.picture import draw

        path, descriptor = create(os.path.join(plan["folder"], plan["stem"]), ".png")
        try:
            with open(descriptor, "wb") as file:
                draw(plan["name"], walked, file)
        except BaseException:
            os.unlink(path)
            raise
        return {"strides": results, "files": {path: "the average stride of " + " and ".join(r["title"] for r in walked)}}


class Sums:
    """Mean and standard deviation of curves, without keeping them. (Welford 1962)"""

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
        """Of the sample; zero for a single curve."""
        return [sqrt(square / (self.count - 1)) if self.count > 1 else 0.0 for square in self.squares]


def resample(phases, values):
    """Values at 0, 1, ... 100 % of the stride, on straight lines between samples; one that does not advance the phase is passed over."""
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

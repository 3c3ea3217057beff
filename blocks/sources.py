"""Signal sources. Each is a function of the tick: late ticks and disabled subsystems do not shift it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from blocks._plumbing.csv_columns import read_columns
from blocks._plumbing.paths import file_param
from blocks._plumbing.ports import UnitOfOutput, finite_numbers
from cext.kernels import sources as kernels
from graph import Block, Interval, Memory, Output, Param, units


class Constant(UnitOfOutput, Block):
    """Constant: y = value.

    A number connected to an input is also a constant. This block has a name and a unit, so it can be recorded.
    """

    value = Param(0.0, "any", "value of the output")
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "constant")

    kernel = kernels.constant

    def output_range(self) -> Interval:
        return self.span("value")


class StepSource(UnitOfOutput, Block):
    """Step: y = before for t < time, y = after for t >= time."""

    before = Param(0.0, "any", "value before the step")
    after = Param(1.0, "any", "value after the step")
    time = Param(1.0, "s", "time of the step")
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "step")

    kernel = kernels.step

    def output_range(self) -> Interval:
        return self.span("before") | self.span("after")


class Ramp(UnitOfOutput, Block):
    """Ramp: y = initial + slope · (t − time) from `time` on, for `duration`; constant before and after."""

    slope = Param(1.0, "any", "change per second")
    time = Param(0.0, "s", "start of the ramp")
    initial = Param(0.0, "any", "value before the ramp")
    duration = Param(math.inf, "s", "duration of the ramp", min=0.0)
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "ramp")

    kernel = kernels.ramp

    def output_range(self) -> Interval:
        return self.span("initial") + self.span("slope") * Interval(0.0, self.span("duration").high)


class Sine(UnitOfOutput, Block):
    """Sine wave: y = bias + amplitude · sin(2π f t + phase).

    A change of a live frequency also shifts the phase: while f changes by s Hz per second, the wave has f + s t Hz.
    """

    amplitude = Param(1.0, "any", "amplitude, half of peak to peak")
    frequency = Param(1.0, "Hz", "frequency f", min=0.0)
    phase = Param(0.0, "rad", "phase at t = 0")
    bias = Param(0.0, "any", "mean value")
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "wave")

    kernel = kernels.sine

    def output_range(self) -> Interval:
        return self.span("bias") + self.span("amplitude") * Interval(-1.0, 1.0)


class Chirp(UnitOfOutput, Block):
    """Sine wave with a frequency sweep: y = bias + amplitude · sin(2π ∫ f dt + phase).

    With `method="linear"`, f = start + (stop − start) t / duration. With `method="logarithmic"`,
    f = start · (stop / start) ^ (t / duration). The frequency remains at `stop` after `duration`. With phase = π/2 the
    wave equals scipy.signal.chirp, a cosine.
    """

    amplitude = Param(1.0, "any", "amplitude, half of peak to peak")
    start = Param(0.1, "Hz", "frequency at t = 0", min=0.0)
    stop = Param(10.0, "Hz", "frequency at the end of the sweep", min=0.0)
    duration = Param(10.0, "s", "duration of the sweep", above=0.0)
    method = Param("linear", "1", "course of the frequency", choices=("linear", "logarithmic"))
    phase = Param(0.0, "rad", "phase at t = 0")
    bias = Param(0.0, "any", "mean value")
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "wave")

    kernel = kernels.chirps["linear"]

    def configure(self) -> None:
        super().configure()
        if self.method == "logarithmic" and min(self.span("start").low, self.span("stop").low) <= 0.0:
            raise ValueError("a logarithmic sweep requires start and stop above 0 Hz")
        self.kernel = kernels.chirps[self.method]

    def output_range(self) -> Interval:
        return self.span("bias") + self.span("amplitude") * Interval(-1.0, 1.0)


class Pulse(UnitOfOutput, Block):
    """Rectangular pulse train: y = high if (t − delay) mod period < duty · period, else low.

    Before `delay`, y = low.
    """

    low = Param(0.0, "any", "value between pulses")
    high = Param(1.0, "any", "value during pulses")
    period = Param(1.0, "s", "period of the pulses", above=0.0)
    duty = Param(0.5, "1", "duty cycle: high share of the period", min=0.0, max=1.0)
    delay = Param(0.0, "s", "start of the first pulse")
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "pulse train")

    kernel = kernels.pulse

    def output_range(self) -> Interval:
        return self.span("low") | self.span("high")


class _OverTime(UnitOfOutput):
    """Base of tables over time and played files: their kernel and output range."""

    kernel = kernels.tables["linear"]
    interpolation: Any

    def take(self, times: np.ndarray, samples: np.ndarray) -> None:
        """Check and store the table. times : s, strictly increasing; samples : one value per time"""
        if len(times) < 2 or len(times) != len(samples):
            raise ValueError(
                f"expected at least two times and as many values, got {len(times)} times and {len(samples)} values"
            )
        if (
            not np.all(np.isfinite(times))
            or not np.all(times[:-1] < times[1:])
            or not math.isfinite(float(times[-1]) - float(times[0]))
        ):
            raise ValueError("the times must be finite and strictly increasing")
        self.instants, self.samples = times, samples
        self.kernel = kernels.tables[self.interpolation]

    def output_range(self) -> Interval:
        return Interval(float(np.nanmin(self.samples)), float(np.nanmax(self.samples)))


class TimeTable(_OverTime, Block):
    """Table over time: y interpolates (times, values), constant before the first and after the last time.

    With `repeat` the table repeats: the first value follows the last one, so a closed curve needs equal first and last
    values.
    """

    times = Param((0.0, 1.0), "s", "times of the values: at least two, strictly increasing")
    values = Param((0.0, 1.0), "any", "values, one per time")
    interpolation = Param(
        "linear", "1", "interpolation between two times: linear, or the previous value", choices=("linear", "previous")
    )
    repeat = Param(False, "1", "true repeats from the start after the end")
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "present value")
    instants = Memory(0.0, "times")
    samples = Memory(0.0, "values")

    def configure(self) -> None:
        super().configure()
        self.take(np.array(finite_numbers("times", self.times)), np.array(finite_numbers("values", self.values)))


class Playback(_OverTime, Block):
    """Playback of one column of a CSV file, timed by a column of times in s.

    The first row is t = 0. Columns are selected by name; the unit follows the name in the header, as in
    `knee.position [rad]`. A NaN in the file gives NaN, even while interpolating to and from it.
    """

    file = file_param("CSV file with commas, semicolons or tabs")
    column = Param("", "1", "name of the column", required=True, dtype=str)
    time = Param("time", "1", "name of the column of times, in s")
    interpolation = Param(
        "linear", "1", "interpolation between two rows: linear, or the previous row", choices=("linear", "previous")
    )
    repeat = Param(False, "1", "true repeats from the start after the end")
    unit = Param("", "1", "unit of the column, if the header contains none")

    y = Output("any", "present value of the column")
    instants = Memory(0.0, "times")
    samples = Memory(0.0, "values of the column")

    def configure(self) -> None:
        times, samples, written = read_columns(self.file, self.time, self.column)
        if self.unit and written and units.canonical(self.unit) != written:
            raise ValueError(
                f"{self.file}: {self.column} is in {written}, not in {self.unit}. Convert it with a UnitConversion"
            )
        self.of_column = units.canonical(self.unit or written or units.ANY)
        try:
            self.take(times - times[0], samples)
        except ValueError as error:
            raise ValueError(f"{self.file}, column {self.time!r}: {error}") from None

    def output_units(self, **inputs: str) -> dict[str, str]:
        return {"y": self.of_column}


class GaussianNoise(UnitOfOutput, Block):
    """White noise with a normal distribution, a reproducible function of seed and tick.

    Philox 4x64-10 (Salmon et al. 2011) and the Box-Muller transform, whose values are within 8.572 deviations of the
    mean. Give each noise block of a diagram a different seed: blocks with equal seeds have equal values.
    """

    mean = Param(0.0, "any", "mean of the distribution")
    deviation = Param(1.0, "any", "standard deviation", min=0.0)
    seed = Param(0, "1", "seed of the generator", min=0, max=2**53)
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "noise")

    kernel = kernels.gaussian

    def output_range(self) -> Interval:
        return self.span("mean") + self.span("deviation") * Interval(-8.572, 8.572)


class UniformNoise(UnitOfOutput, Block):
    """White noise with a uniform distribution from `lower` to `upper`, a reproducible function of seed and tick.

    Philox 4x64-10 (Salmon et al. 2011). Give each noise block of a diagram a different seed: blocks with equal seeds
    have equal values.
    """

    rules = ("lower <= upper",)

    lower = Param(0.0, "any", "smallest value")
    upper = Param(1.0, "any", "largest value")
    seed = Param(0, "1", "seed of the generator", min=0, max=2**53)
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "noise")

    kernel = kernels.uniform

    def configure(self) -> None:
        super().configure()
        if not (self.span("lower") | self.span("upper")).bounded:
            raise ValueError(f"lower and upper must be finite, got {self.lower:g} and {self.upper:g}")

    def output_range(self) -> Interval:
        return self.span("lower") | self.span("upper")

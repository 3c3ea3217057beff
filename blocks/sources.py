"""Signals out of nothing but time. Each is a function of the tick: late ticks and held subsystems do not shift it."""

import math
from typing import Any

import numpy as np

from blocks._plumbing.csv_columns import read_columns
from blocks._plumbing.ports import UnitOfOutput, finite_numbers
from cext.kernels import sources as kernels
from graph import Block, Interval, Memory, Output, Param, units


class Constant(UnitOfOutput, Block):
    """A constant: y = value. A number wired to an input is one already; this one has a name and a unit, and may be
    recorded, or live.
    """

    value = Param(0.0, "any", "what it is")
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "the value")

    kernel = kernels.constant

    def output_range(self):
        return self.span("value")


class StepSource(UnitOfOutput, Block):
    """A step: y = before for t < time, after from then on."""

    before = Param(0.0, "any", "value up to the step")
    after = Param(1.0, "any", "value from the step on")
    time = Param(1.0, "s", "when it steps")
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "the step")

    kernel = kernels.step

    def output_range(self):
        return self.span("before") | self.span("after")


class Ramp(UnitOfOutput, Block):
    """A ramp: y = initial + slope · (t − time) from `time` on, for `duration`, and level before and after."""

    slope = Param(1.0, "any", "change a second")
    time = Param(0.0, "s", "when it begins")
    initial = Param(0.0, "any", "value up to then")
    duration = Param(math.inf, "s", "how long it lasts", min=0.0)
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "the ramp")

    kernel = kernels.ramp

    def output_range(self):
        return self.span("initial") + self.span("slope") * Interval(0.0, self.span("duration").high)


class Sine(UnitOfOutput, Block):
    """Sine wave: y = bias + amplitude · sin(2π f t + phase)."""

    amplitude = Param(1.0, "any", "half of peak to peak")
    frequency = Param(1.0, "Hz", "f", min=0.0)
    phase = Param(0.0, "rad", "at t = 0")
    bias = Param(0.0, "any", "mean value")
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "the wave")

    kernel = kernels.sine

    def output_range(self):
        return self.span("bias") + self.span("amplitude") * Interval(-1.0, 1.0)


class Chirp(UnitOfOutput, Block):
    """A sine wave whose frequency sweeps: y = bias + amplitude · sin(2π ∫ f dt + phase), and stays at `stop` after
    `duration`.

    linear: f = start + (stop − start) t / duration. logarithmic: f = start · (stop / start) ^ (t / duration). It begins
    as Sine does; scipy.signal.chirp, a cosine, is this with phase = π/2.
    """

    amplitude = Param(1.0, "any", "half of peak to peak")
    start = Param(0.1, "Hz", "frequency at t = 0", min=0.0)
    stop = Param(10.0, "Hz", "frequency at the end of the sweep", min=0.0)
    duration = Param(10.0, "s", "of the sweep", above=0.0)
    method = Param("linear", "1", "how the frequency grows", choices=("linear", "logarithmic"))
    phase = Param(0.0, "rad", "at t = 0")
    bias = Param(0.0, "any", "mean value")
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "the wave")

    kernel = kernels.chirps["linear"]

    def configure(self):
        super().configure()
        if self.method == "logarithmic" and min(self.span("start").low, self.span("stop").low) <= 0.0:
            raise ValueError("a logarithmic sweep needs start and stop above 0 Hz")
        self.kernel = kernels.chirps[self.method]

    def output_range(self):
        return self.span("bias") + self.span("amplitude") * Interval(-1.0, 1.0)


class Pulse(UnitOfOutput, Block):
    """A train of rectangular pulses: y = high for the first `duty` of every period from `delay` on, low otherwise."""

    low = Param(0.0, "any", "value between pulses")
    high = Param(1.0, "any", "value in a pulse")
    period = Param(1.0, "s", "from the start of one pulse to the next", above=0.0)
    duty = Param(0.5, "1", "share of the period that is high", min=0.0, max=1.0)
    delay = Param(0.0, "s", "when the first pulse starts")
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "the pulses")

    kernel = kernels.pulse

    def output_range(self):
        return self.span("low") | self.span("high")


class _OverTime(UnitOfOutput):
    """What a table over time and a played file share: the kernel, and that neither leaves its values."""

    kernel = kernels.tables["linear"]
    interpolation: Any

    def take(self, times, samples):
        if len(times) < 2 or len(times) != len(samples):
            raise ValueError(
                f"at least two times are needed, and as many values: there are {len(times)} and {len(samples)}"
            )
        if (
            not np.all(np.isfinite(times))
            or not np.all(times[:-1] < times[1:])
            or not math.isfinite(float(times[-1]) - float(times[0]))
        ):
            raise ValueError("the times must be finite, and rise from each to the next")
        self.instants, self.samples = times, samples
        self.kernel = kernels.tables[self.interpolation]

    def output_range(self):
        return Interval(float(np.nanmin(self.samples)), float(np.nanmax(self.samples)))


class TimeTable(_OverTime, Block):
    """A table over time: y runs through (times, values), level before the first and after the last, or over and over
    with `repeat`.

    A table that repeats goes from its last value on with its first, so a closed curve has the first value at its end
    once more.
    """

    times = Param((0.0, 1.0), "s", "at least two, rising")
    values = Param((0.0, 1.0), "any", "one for each time")
    interpolation = Param(
        "linear",
        "1",
        "between two times: on a line, or at the value of the time before",
        choices=("linear", "previous"),
    )
    repeat = Param(False, "1", "whether it starts again at the end")
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "the value now")
    instants = Memory(0.0, "the times")
    samples = Memory(0.0, "the values")

    def configure(self):
        super().configure()
        self.take(np.array(finite_numbers("times", self.times)), np.array(finite_numbers("values", self.values)))


class Playback(_OverTime, Block):
    """Plays a column of a CSV file by its column of times in s.

    The first row of the file is t = 0. Columns are found by name; the unit is what the header says behind it, as in
    `knee.position [rad]`. A NaN in the file is played as NaN, and shows on the way to it and from it.
    """

    file = Param("", "1", "path of the CSV file; commas, semicolons or tabs", required=True, dtype=str, file=True)
    column = Param("", "1", "name of the column", required=True, dtype=str)
    time = Param("time", "1", "name of the column of times, in s")
    interpolation = Param(
        "linear", "1", "between two rows: on a line, or at the value of the row before", choices=("linear", "previous")
    )
    repeat = Param(False, "1", "whether it starts again at the end")
    unit = Param("", "1", "unit of the column, where the header does not say it")

    y = Output("any", "the column now")
    instants = Memory(0.0, "the times")
    samples = Memory(0.0, "the column")

    def configure(self):
        times, samples, written = read_columns(self.file, self.time, self.column)
        if self.unit and written and units.canonical(self.unit) != written:
            raise ValueError(
                f"{self.file}: {self.column} is in {written}, not in {self.unit}: convert it with a UnitConversion"
            )
        self.of_column = units.canonical(self.unit or written or units.ANY)
        self.take(times - times[0], samples)

    def output_units(self):
        return {"y": self.of_column}


class GaussianNoise(UnitOfOutput, Block):
    """White noise with a normal distribution: each tick's value depends on the seed and the tick alone, so a run can be
    repeated.

    Philox 4x64-10 (Salmon et al. 2011) and Box and Muller's transform, which never leaves the mean by more than 8.572
    deviations. Give each noise of a diagram a seed of its own: two with the same are the same.
    """

    mean = Param(0.0, "any", "of the distribution")
    deviation = Param(1.0, "any", "standard deviation", min=0.0)
    seed = Param(0, "1", "which noise", min=0, max=2**53)
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "the noise")

    kernel = kernels.gaussian

    def output_range(self):
        return self.span("mean") + self.span("deviation") * Interval(-8.572, 8.572)


class UniformNoise(UnitOfOutput, Block):
    """White noise, anywhere from lower to upper with equal chance: each tick's value depends on the seed and the tick
    alone.

    Philox 4x64-10 (Salmon et al. 2011). Give each noise of a diagram a seed of its own: two with the same are the same.
    """

    lower = Param(0.0, "any", "smallest value")
    upper = Param(1.0, "any", "largest value")
    seed = Param(0, "1", "which noise", min=0, max=2**53)
    unit = Param(units.ANY, "1", "unit of the output")

    y = Output("any", "the noise")

    kernel = kernels.uniform

    def configure(self):
        super().configure()
        if self.span("lower").high > self.span("upper").low or not (self.span("lower") | self.span("upper")).bounded:
            raise ValueError(f"lower and upper must be finite and in order, got {self.lower:g} and {self.upper:g}")

    def output_range(self):
        return self.span("lower") | self.span("upper")

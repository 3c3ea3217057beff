"""Signals out of nothing but time."""

from cext.kernels import mathematics as kernels
from graph import Block, Interval, Output, Param


class Sine(Block):
    """Sine wave: y = bias + amplitude · sin(2π f t + phase)."""

    amplitude = Param(1.0, "any", "half of peak to peak")
    frequency = Param(1.0, "Hz", "f", min=0.0)
    phase = Param(0.0, "rad", "at t = 0")
    bias = Param(0.0, "any", "mean value")

    y = Output("any", "the wave")

    kernel = kernels.sine

    def output_range(self):
        return self.span("bias") + self.span("amplitude") * Interval(-1.0, 1.0)


class StepSource(Block):
    """A step: y = before for t < time, after from then on."""

    before = Param(0.0, "any", "value up to the step")
    after = Param(1.0, "any", "value from the step on")
    time = Param(1.0, "s", "when it steps")

    y = Output("any", "the step")

    kernel = kernels.step

    def output_range(self):
        return self.span("before") | self.span("after")


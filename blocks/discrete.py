"""Blocks that remember."""

from cext.kernels import discrete as kernels
from graph import Block, Input, Memory, Output, Param


class UnitDelay(Block):
    """The input of the tick before: y[k] = u[k-1], and y[0] = initial. No direct feedthrough, so it may close a loop."""

    initial = Param(0.0, "any", "output at the first tick")

    u = Input("any", "input", shape=...)
    y = Output("any", "input of the tick before", shape=...)
    held = Memory(0.0, "the input of the tick before")

    kernel = kernels.unit_delay
    update_kernel = kernels.unit_delay_next
    feedthrough = ()

    def prepare(self, dt):
        self.held = [self.initial] * self.width

    def output_range(self, u):
        return u | self.span("initial")

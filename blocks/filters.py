"""Filters, as cascades of biquads from closed forms."""

import math

from cext.kernels import discrete as kernels
from graph import Block, Input, Memory, Output, Param


class Butterworth(Block):
    """Low-pass with a maximally flat pass band: |H(f)|² = 1 / (1 + (f / cutoff)^(2 order)), by the bilinear transform with prewarping.

    (Oppenheim and Schafer, Discrete-Time Signal Processing, 7.1.) Direct feedthrough. The filter starts at zero; when a robot has been
    armed it starts at its present input, so that the first tick does not kick. NaN passes and stays until the next reset.
    """

    order = Param(2, "1", "number of poles", min=1, max=8)
    cutoff = Param(10.0, "Hz", "frequency where the gain is 1/√2", above=0.0)

    u = Input("any", "raw", shape=...)
    y = Output("any", "filtered", shape=...)
    sections = Memory(0.0, "b0 b1 b2 a1 a2 of each biquad")
    delays = Memory(0.0, "two for each biquad and element")

    kernel = kernels.biquads
    settle_kernel = kernels.biquads_at_rest

    def prepare(self, dt):
        if self.cutoff * dt >= 0.5:
            raise ValueError(f"a cutoff of {self.cutoff:g} Hz needs a rate above {2 * self.cutoff:g} Hz, and this is {1 / dt:g} Hz")
        sections = butterworth_lowpass(self.order, self.cutoff, dt)
        self.sections = [coefficient for section in sections for coefficient in section]
        self.delays = [0.0] * (2 * len(sections) * self.width)


def butterworth_lowpass(order, cutoff, dt):
    """Biquads (b0, b1, b2, a1, a2) of a digital Butterworth low-pass, a0 = 1. cutoff in Hz, dt in s."""
    k = math.tan(math.pi * cutoff * dt)
    sections = []
    for pair in range(order // 2):
        damping = 2.0 * math.sin(math.pi * (2 * pair + 1) / (2 * order))       # 1 / Q of this pair of poles
        norm = 1.0 / (1.0 + damping * k + k * k)
        sections.append((k * k * norm, 2.0 * k * k * norm, k * k * norm, 2.0 * (k * k - 1.0) * norm, (1.0 - damping * k + k * k) * norm))
    if order % 2:
        sections.append((k / (1.0 + k), k / (1.0 + k), 0.0, (k - 1.0) / (1.0 + k), 0.0))
    return sections

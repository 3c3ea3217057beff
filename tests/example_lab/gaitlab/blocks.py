"""Blocks of the gait laboratory: one in Python, one native."""

import math

from gaitlab import kernels

from graph import Block, Input, Memory, Output, Param


class CadenceMeter(Block):
    """Steps a minute from heel strikes: 60 over the time between the last two. Zero until there are two; NaN and
    infinity pass.
    """

    strike = Input("1", "above 0.5 while the heel is on the ground")
    cadence = Output("1", "steps a minute")

    def reset(self):
        self.elapsed, self.down, self.rate = None, False, 0.0

    def step(self, strike, dt):
        if not math.isfinite(strike):
            return strike
        if self.elapsed is not None:
            self.elapsed += dt
        if strike > 0.5 and not self.down:
            if self.elapsed:
                self.rate = 60.0 / self.elapsed
            self.elapsed = 0.0
        self.down = strike > 0.5
        return self.rate


class LeakyAccumulator(Block):
    """A sum that forgets: y[k] = u[k] + (1 - leak) y[k-1]. NaN passes and is not held."""

    leak = Param(0.1, "1", "share forgotten each tick", min=0.0, max=1.0)

    u = Input("any", "input")
    y = Output("any", "the sum")
    held = Memory(0.0, "y of the tick before")

    kernel = kernels.leaky

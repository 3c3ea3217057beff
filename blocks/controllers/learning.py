"""Iterative learning: a feed-forward command that improves from stride to stride."""

from __future__ import annotations

import math

from cext.kernels import learning as kernels
from graph import Block, Input, Interval, Memory, Output, Param
from graph.units import ANY, canonical


class IterativeLearning(Block):
    """Feed-forward command over a phase, learned stride by stride: u ← Q [(1 − f) u + L e(t + lead)].

    For errors that repeat in every stride, such as those of friction and of the delay of a drive. e is the reference
    less the measurement. Q is the projection on the mean and the first `harmonics` of the phase, without a phase shift.
    With a linear plant G and f = 0, the error at each of them changes by the factor 1 − L G e^(iω lead) per stride, and
    decreases where its magnitude is below 1. A harmonic of two ticks or fewer learns nothing, and the part of u beyond
    `limit` is removed in the next stride that teaches. (Arimoto et al. 1984; Bristow, Tharayil and Alleyne 2006; for
    the torque of exoskeletons Zhang, Cheah and Collins 2017)

    A stride teaches if `learning` and `enable` were true throughout it, its duration differs from the usual one, or
    that of the stride before, by at most `tolerance`, and the phase neither jumped nor moved back by more than 0.1. A
    stop, a stumble, a backward step and an invalid phase teach nothing. The command changes at phase 0, where a stride
    ends, and is 0 while `enable` is false. Direct feedthrough. NaN passes, even while `enable` is false, and infinity
    becomes NaN; the stride then teaches nothing.
    """

    rules = ("shortest < longest",)

    gain = Param(0.3, "any", "learning gain L, at most about 1/|G|", min=0.0, max=10.0, live=True)
    lead = Param(
        0.0, "s", "advance of the error: the delay from the command to the measurement", min=0.0, max=0.5, live=True
    )
    forgetting = Param(0.0, "1", "share f of the command that is forgotten per stride", min=0.0, max=1.0, live=True)
    harmonics = Param(8, "1", "number of harmonics of the command besides its mean", min=0, max=64, fixed=True)
    limit = Param(5.0, "any", "largest magnitude of the command", above=0.0, fixed=True)
    tolerance = Param(0.15, "1", "largest deviation from the usual duration, as a share of it", above=0.0, max=1.0)
    shortest = Param(0.4, "s", "shortest stride that teaches", above=0.0)
    longest = Param(4.0, "s", "longest stride that teaches", above=0.0)
    unit = Param("any", "1", "unit of the command; the unit of the reference by default")

    phase = Input("1", "phase of the stride: 0 at its start, 1 at the next")
    reference = Input("any", "reference r")
    measurement = Input("any", "measurement y")
    enable = Input("1", "false sets the command to 0", dtype=bool, default=True)
    learning = Input("1", "false keeps the command as it is", dtype=bool, default=True)
    command = Output("any", "feed-forward command u")
    strides = Output("1", "number of strides that have taught", dtype=int)
    rms_error = Output("any", "root mean square of r − y over the last stride of usual duration; 0 before one")
    curve = Memory(0.0, "mean, then cosine and sine of each harmonic of the command")
    sums = Memory(0.0, "the same of the error of the present stride")
    excess = Memory(0.0, "the same of the curve beyond `limit`")
    state = Memory((math.nan, *[0.0] * 9), "phase, the present stride, durations, count of strides and RMS error")

    kernel = kernels.learning

    def configure(self) -> None:
        self.unit = canonical(self.unit)
        if self.unit != ANY:
            self.outputs = self.outputs | {"command": self.outputs["command"].with_unit(self.unit)}
        self.curve = self.sums = self.excess = [0.0] * (1 + 2 * self.harmonics)

    def output_range(self, **inputs: Interval) -> Interval | dict[str, Interval]:
        return {"command": Interval(-self.limit, self.limit)}

"""The clock of the run, as signals."""

from cext.kernels import sources as kernels
from graph import Block, Output


class Clock(Block):
    """When the tick should run, and when it did: wake = time + lateness. In virtual time nothing is late."""

    time = Output("s", "nominal: tick / rate, from the first tick on")
    wake = Output("s", "when the tick really began, on the same scale")
    lateness = Output("s", "wake-up behind the nominal time: less than a period, but for ticks that catch up")
    elapsed = Output("s", "since the tick before: more than a period where grid points were missed")

    kernel = kernels.clock

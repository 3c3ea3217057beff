"""Clock of the run, as signals."""

from cext.kernels import sources as kernels
from graph import Block, Output


class Clock(Block):
    """Nominal and actual time of the tick: wake = time + lateness. In virtual time the lateness is 0."""

    time = Output("s", "nominal time since the first tick: tick / rate")
    wake = Output("s", "actual start of the tick, on the same time scale")
    lateness = Output(
        "s", "delay of the wake-up after the nominal time: less than one period, except in ticks that catch up"
    )
    elapsed = Output("s", "time since the previous tick: more than one period after missed ticks")

    kernel = kernels.clock

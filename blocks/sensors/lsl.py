"""Inlet of the Lab Streaming Layer: numbers of another device, such as EMG or motion capture, with their age."""

from __future__ import annotations

from typing import Any

from blocks.sensors.received import ReceivedStream
from graph import Interval, Param, units


class LslInlet(ReceivedStream):
    """Channels of a stream of the Lab Streaming Layer, each in an output of its declared unit.

    A channel without a label has its name as label; a stream without labels gives its channels in order. A unit that
    the stream names is converted. A process receives the samples and passes each to the loop, which uses
    the newest. `stamp` is the sample's time stamp on the LSL clock of this computer (CLOCK_MONOTONIC), to which
    `offset` of the sender's clock, as liblsl measures it, has been added. A sample that arrives more than `max_delay`
    after its time stamp is dropped and counted in `lost`.

    Without samples for `timeout` the run ends in the safe stop. With `timeout=0` the outputs keep their last values,
    and `age` increases.

    Requires liblsl: `pip install 'tickwork[lsl]'`.
    """

    stream = Param("", "1", "name of the stream; set in the diagram or in the rig file", dtype=str)
    source = Param("", "1", "source_id of the stream, where several have its name", dtype=str)
    rectify = Param(
        0.0,
        "Hz",
        "for EMG: cut-off frequency of a high-pass filter of first order, after which the values that arrive together "
        "are rectified and averaged; 0 passes the newest values on",
        min=0.0,
        fixed=True,
        kernel=False,
    )
    clocks = (("stamp", "float64", "s"), ("offset", "float64", "s"))
    line = "lsl"
    hardware = ("stream", "source")
    examples = ({"channels": (("biceps", "mV"), ("triceps", "mV", "EMG 2")), "stream": "EMG"},)

    def opening(self) -> dict[str, Any]:
        wanted = [(label[0] if label else name, units.canonical(unit)) for name, unit, *label in self.channels]
        return {
            "stream": self.stream,
            "source": self.source,
            "channels": wanted,
            "rectify": self.rectify,
            "max_delay": self.max_delay,
        }

    def output_range(self) -> dict[str, Interval]:
        positive = [name for name, *_ in self.channels] if self.rectify else []
        return super().output_range() | {name: Interval(0.0) for name in positive}

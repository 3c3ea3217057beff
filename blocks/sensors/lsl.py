"""Inlet of the Lab Streaming Layer: numbers of another device, such as EMG or motion capture, with their age."""

from __future__ import annotations

from typing import Any

from blocks.sensors import fields
from blocks.sensors.microcontroller import EmulatedMicrocontroller, Microcontroller
from cext.kernels.devices import microcontroller as kernels
from graph import Interval, Param, StreamDevice, units
from graph.narrowing import is_row

CHANNELS_LIMIT = 48  # per stream
CLOCKS = (("stamp", "float64", "s"), ("offset", "float64", "s"))


class LslInlet(StreamDevice):
    """Channels of a stream of the Lab Streaming Layer, each in an output of its declared unit.

    A unit that the stream names is converted. A process receives the samples and passes each to the loop, which uses
    the newest. `stamp` is the sample's time stamp on the LSL clock of this computer (CLOCK_MONOTONIC), to which
    `offset` of the sender's clock, as liblsl measures it, has been added. A sample that arrives more than `max_delay`
    after its time stamp is dropped and counted in `lost`.

    Without samples for `timeout` the run ends in the safe stop. With `timeout=0` the outputs keep their last values,
    and `age` increases.

    Requires liblsl: `pip install 'tickwork[lsl]'`.
    """

    channels = Param(
        (),
        "1",
        'channels, such as ("biceps", "mV"), or ("biceps", "mV", "EMG 1") with the label in the stream, which is '
        "otherwise the name; a stream without labels gives its channels in order",
        required=True,
    )
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
    max_delay = Param(
        0.5, "s", "age of a sample on arrival above which it is dropped", above=0.0, fixed=True, kernel=False
    )
    timeout = Microcontroller.parameters["timeout"]

    age, received, lost = (Microcontroller.outputs[name] for name in ("age", "received", "lost"))
    late, corrupt = Microcontroller.outputs["late"], Microcontroller.outputs["corrupt"]
    sample_time, clock_drift = Microcontroller.outputs["sample_time"], Microcontroller.outputs["clock_drift"]
    plan, parsed = Microcontroller.memory["plan"], Microcontroller.memory["parsed"]
    sequence, buffer = Microcontroller.memory["sequence"], Microcontroller.memory["buffer"]
    clock_plan, mapped = Microcontroller.memory["clock_plan"], Microcontroller.memory["mapped"]

    line = "lsl"
    decode = kernels.decode
    hardware = ("stream", "source")
    examples = ({"channels": (("biceps", "mV"), ("triceps", "mV", "EMG 2")), "stream": "EMG"},)

    def configure(self) -> None:
        super().configure()
        if not is_row(self.channels) or not 1 <= len(self.channels) <= CHANNELS_LIMIT:
            raise ValueError(f'channels must contain 1 to {CHANNELS_LIMIT} channels, as in channels=(("emg", "mV"),)')
        for number, each in enumerate(self.channels, 1):
            if not is_row(each) or not 2 <= len(each) <= 3 or not all(isinstance(text, str) for text in each):
                raise ValueError(f"channel {number} must be (name, unit) or (name, unit, label), got {each!r}")
        own = type(self).outputs
        taken = {*own, *type(self).parameters, *type(self).memory, *_RESERVED_NAMES}
        self.fields = tuple((name, "float64", unit) for name, unit, *_ in self.channels) + CLOCKS
        self.declared = fields.read(self.fields, taken)
        self.outputs = {each.name: each.output() for each in self.declared} | own
        self.plan = fields.plan(self.declared, True, True)
        self.buffer = (0.0,) * 128
        self.clock_plan = fields.clock(self.declared, "stamp", 0.0)

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
        return {name: Interval(0.0) for name in ("age", "received", "lost", "late", "corrupt", *positive)}

    def emulator(self, **parameters: Any) -> Any:
        same: dict[str, Any] = {"bus": self.bus, "fields": self.fields, "format": "lines", "clock": "stamp"}
        return EmulatedMicrocontroller(**same | parameters)


_RESERVED_NAMES = {name for name in dir(StreamDevice) if not name.startswith("_")} | {"fields", "declared"}

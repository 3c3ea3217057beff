"""Common parts of streams that a process of its own receives, and passes to the loop as lines of text."""

from __future__ import annotations

from typing import Any

from blocks.sensors import fields
from blocks.sensors.microcontroller import EmulatedMicrocontroller, Microcontroller
from cext.kernels.devices import microcontroller as kernels
from graph import Interval, Param, StreamDevice
from graph.narrowing import is_row

CHANNELS_LIMIT = 48  # per stream


class ReceivedStream(StreamDevice):
    """Channels of a stream, each in an output of its declared unit, and the age of the newest sample."""

    abstract = True
    clocks: tuple[tuple[str, str, str], ...]  # fields after the channels, the first one with the sender's clock

    channels = Param(
        (),
        "1",
        'channels, such as ("biceps", "mV"), or ("biceps", "mV", "EMG 1") with the label in the stream',
        required=True,
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

    decode = kernels.decode

    def configure(self) -> None:
        super().configure()
        if not is_row(self.channels) or not 1 <= len(self.channels) <= CHANNELS_LIMIT:
            raise ValueError(f'channels must contain 1 to {CHANNELS_LIMIT} channels, as in channels=(("emg", "mV"),)')
        for number, each in enumerate(self.channels, 1):
            if not is_row(each) or not 2 <= len(each) <= 3 or not all(isinstance(text, str) for text in each):
                raise ValueError(
                    f'channel {number} must be (name, unit) or (name, unit, label), as in channels=(("emg", "mV"),) '
                    f"with a comma after a single one, got {each!r}"
                )
        own = type(self).outputs
        taken = {*own, *type(self).parameters, *type(self).memory, *_RESERVED_NAMES}
        self.fields = tuple((name, "float64", unit) for name, unit, *_ in self.channels) + self.clocks
        self.declared = fields.read(self.fields, taken)
        self.outputs = {each.name: each.output() for each in self.declared} | own
        self.plan = fields.plan(self.declared, True, True)
        self.buffer = (0.0,) * 128
        self.clock_plan = fields.clock(self.declared, self.clocks[0][0], 0.0)

    def output_range(self) -> dict[str, Interval]:
        return {name: Interval(0.0) for name in ("age", "received", "lost", "late", "corrupt")}

    def emulator(self, **parameters: Any) -> Any:
        clock = self.clocks[0][0]
        same: dict[str, Any] = {"bus": self.bus, "fields": self.fields, "format": "lines", "clock": clock}
        return EmulatedMicrocontroller(**same | parameters)


_RESERVED_NAMES = {name for name in dir(StreamDevice) if not name.startswith("_")} | {"fields", "declared", "clocks"}

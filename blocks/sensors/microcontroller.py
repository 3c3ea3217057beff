"""Microcontroller on a serial line that sends packets of typed fields."""

from __future__ import annotations

from typing import Any

from blocks._plumbing.timeouts import timeout_param
from blocks.sensors import fields
from blocks.serial_lines import speed_of
from cext.kernels import no_io
from cext.kernels.devices import microcontroller as kernels
from graph import Input, Interval, Memory, Output, Param, StreamDevice

FIELD_BYTES_LIMIT = 250  # per packet
CHECKSUM_BYTES = 2
FIELD_NUMBERS_LIMIT = 200  # per packet
PACKET_BYTES_LIMIT = {"cobs": 256, "lines": 1024}  # encoded packet or line


class Microcontroller(StreamDevice):
    """Microcontroller, such as a Teensy or an Arduino, with one output per transmitted field: y = scale · value.

    `format="cobs"`: a counter (one byte), the fields in order, least significant byte first, and CRC-16/CCITT-FALSE of
    both; stuffed by COBS, so a zero byte ends a packet and occurs nowhere else. `format="lines"`: counter and numbers
    as text separated by commas, one line per packet; lines that start with # are comments. Lost packets are detected by
    the counter, corrupt ones by checksum and length. docs/reference/inputs.md has sketches for the microcontroller,
    one with a load cell and one with an inertial sensor.
    """

    fields = Param(
        (),
        "1",
        'fields of a packet, such as ("force", "int32", "N", 0.01), ("accel", "int16[3]", "m/s²", '
        "0.0048); unit and scale are 1 by default",
        required=True,
    )
    format = Param("cobs", "1", "format of the packets", choices=tuple(PACKET_BYTES_LIMIT))
    counter = Param(True, "1", "true if packets start with a counter, modulo 256", fixed=True, kernel=False)
    clock = Param(
        "",
        "1",
        "name of the field with the device clock, a scalar in a unit of time, which determines `sample_time`",
        dtype=str,
    )
    clock_wrap = Param(
        0.0,
        "s",
        "wrap period of the device clock; 0 means that of its type for unsigned integers, otherwise never",
        min=0.0,
        fixed=True,
        kernel=False,
    )
    port = Param("", "1", "path of the serial port, such as /dev/ttyACM0; set in the rig file", dtype=str)
    serial = Param(
        "", "1", "last characters of the USB serial number, instead of `port`; set in the rig file", dtype=str
    )
    baudrate = Param(
        115200,
        "1/s",
        "bitrate of the line in bit/s; ignored by USB devices that are not serial adapters",
        min=50,
        max=4_000_000,
        fixed=True,
        kernel=False,
    )
    packet_rate = Param(
        0.0,
        "Hz",
        "packet rate of the device, for its emulator and the line's capacity in `check`; 0 if unknown",
        min=0.0,
        fixed=True,
        kernel=False,
    )
    start = Param("", "1", "bytes sent on connect and after every reconnect", dtype=str)
    timeout = timeout_param("packet")

    age = Output("s", "time since the newest packet")
    received = Output("1", "number of packets", dtype=int)
    lost = Output("1", "number of missing packets, according to the counter", dtype=int)
    late = Output("1", "number of packets that came after a newer one, or twice; they give no value", dtype=int)
    corrupt = Output("1", "number of packets with a wrong checksum or length, or an invalid number", dtype=int)
    sample_time = Output(
        "s", "creation time of the newest packet on the clock of the run; its arrival without a device clock"
    )
    clock_drift = Output("1", "relative slowness of the device clock")
    plan = Memory((), "1 for text lines, 1 with a counter, bytes of the fields, then type and scale of each field")
    parsed = Memory((0.0, 0.0, 0.0), "bytes of the partial packet, 1 if its start was received, 1 if it is too long")
    sequence = Memory(
        (-1.0, 0.0, 0.0), "next counter, packets in a row that were not ahead, arrival of the newest in s"
    )
    buffer = Memory((), "bytes of the partial packet")
    clock_plan = Memory((-1.0, 0.0, 0.0), "index of the device clock, s per count, wrap period in s")
    mapped = Memory((0.0,) * kernels.clock_doubles, "map of the device clock")

    decode = kernels.decode
    hardware = ("port", "serial", "baudrate")
    examples = (
        {"fields": (("force", "int24", "N", 0.01), ("accel", "int16[3]", "m/s²", 0.0048))},
        {"fields": (("x", "float32"),), "format": "lines"},
    )

    def configure(self) -> None:
        super().configure()
        own = type(self).outputs
        self.declared = fields.read(self.fields, {*own, *type(self).parameters, *type(self).memory, *_RESERVED_NAMES})
        self.outputs = {each.name: each.output() for each in self.declared} | own
        sizes = sum(each.size for each in self.declared), sum(each.numbers for each in self.declared)
        if sizes[0] > FIELD_BYTES_LIMIT or sizes[1] > FIELD_NUMBERS_LIMIT:
            raise ValueError(
                f"fields: a packet is limited to {FIELD_BYTES_LIMIT} bytes and {FIELD_NUMBERS_LIMIT} numbers, and "
                f"these fields have {sizes[0]} and {sizes[1]}"
            )
        self.plan = fields.plan(self.declared, self.format == "lines", self.counter)
        self.buffer = (0.0,) * (PACKET_BYTES_LIMIT[self.format] // 8)
        self.clock_plan = fields.clock(self.declared, self.clock, self.clock_wrap)

    def opening(self) -> dict[str, Any]:
        setup = (self.start.encode(),) if self.start else ()
        return {"port": self.port, "serial": self.serial, "baudrate": self.baudrate, "setup": setup}

    def sends(self) -> list[tuple[float, int]]:
        if not self.packet_rate:
            return []
        if self.format == "lines":  # at least a digit and a separator per number
            return [(self.packet_rate, 2 * (self.counter + sum(each.numbers for each in self.declared)))]
        length = self.counter + sum(each.size for each in self.declared) + CHECKSUM_BYTES
        return [(self.packet_rate, length + 1 + length // 254 + 1)]

    def line_speed(self) -> float:
        return speed_of(self.port, self.baudrate)

    def output_range(self) -> dict[str, Interval]:
        # a number in a text line can exceed the type of its field
        bounded = {each.name: each.range for each in self.declared if self.format == "cobs"}
        return {name: Interval(0.0) for name in ("age", "received", "lost", "late", "corrupt")} | {
            name: span for name, span in bounded.items() if span is not None
        }

    def emulator(self, **parameters: Any) -> Any:
        return EmulatedMicrocontroller.of(self, **parameters)


class EmulatedMicrocontroller(StreamDevice):
    """Emulated microcontroller that sends its inputs as fields every `period`.

    Numbers are rounded to the types of the fields. The device clock is the time of the plant plus its input.
    """

    fields = Microcontroller.parameters["fields"]
    format = Microcontroller.parameters["format"]
    counter = Microcontroller.parameters["counter"]
    clock, clock_wrap = Microcontroller.parameters["clock"], Microcontroller.parameters["clock_wrap"]
    period = Param(0.005, "s", "period of the packets", above=0.0, fixed=True)

    silent = Input("1", "true stops all packets", default=False, dtype=bool)
    dropped = Input("1", "share of lost packets, 0 to 1", default=0.0)
    broken = Input("1", "share of packets with a wrong bit, 0 to 1", default=0.0)
    plan = Memory((), "1 for text lines, 1 with a counter, bytes of the fields, then type and scale of each field")
    state = Memory((0.0,) * 5, "next counter and its time, random state, first and last pending byte")
    waiting = Memory((), "pending bytes")
    clock_plan = Memory((-1.0, 0.0, 0.0), "index of the device clock, s per count, wrap period in s")

    decode = no_io.ignore_all
    encode = kernels.emulated_encode
    examples = Microcontroller.examples

    @classmethod
    def of(cls, microcontroller: Microcontroller, **parameters: Any) -> EmulatedMicrocontroller:
        """Return the emulator of one Microcontroller. parameters : override those of the block"""
        same = ("bus", "fields", "format", "counter", "clock", "clock_wrap")
        own = {name: getattr(microcontroller, name) for name in same}
        if microcontroller.packet_rate:
            own["period"] = 1.0 / microcontroller.packet_rate
        return cls(**own | parameters)

    def configure(self) -> None:
        super().configure()
        own = type(self).inputs
        self.declared = fields.read(self.fields, {*own, *type(self).parameters, *type(self).memory, *_RESERVED_NAMES})
        self.inputs = {each.name: each.input() for each in self.declared} | own
        self.plan = fields.plan(self.declared, self.format == "lines", self.counter)
        self.clock_plan = fields.clock(self.declared, self.clock, self.clock_wrap)
        self.waiting = (0.0,) * (PACKET_BYTES_LIMIT[self.format] // 8)


_RESERVED_NAMES = {name for name in dir(StreamDevice) if not name.startswith("_")}

"""A microcontroller at a serial line: whatever it measures, in typed fields."""

from blocks.sensors import fields
from blocks.serial_lines import speed_of
from cext.kernels import no_io
from cext.kernels.devices import microcontroller as kernels
from graph import Input, Interval, Memory, Output, Param, StreamDevice

LONGEST = 250  # bytes of a packet's fields
CHECKSUM = 2  # bytes
MOST = 200  # numbers of a packet
BYTES = {"cobs": 256, "lines": 1024}  # that a packet or line may have on its way


class Microcontroller(StreamDevice):
    """A Teensy, an Arduino or the like that sends packets of typed fields over serial; each field is an output with its
    unit.

    `format="cobs"`: a counter (one byte), the fields one after another, least significant byte first, and
    CRC-16/CCITT-FALSE of both; stuffed by COBS, so that a zero ends a packet and is nowhere else. `format="lines"`:
    counter and numbers as text with commas between, a line each; lines that begin with # are remarks. An output is what
    was sent times the field's scale. Packets that were lost are counted by the counter, those that are corrupt by
    checksum and length. docs/sensors.md has the sketch for the other end.
    """

    fields = Param(
        (),
        "1",
        'what is in a packet: ("force", "int32", "N", 0.01), ("accel", "int16[3]", "m/s²", '
        "0.0048); unit and scale are 1 by default",
        required=True,
    )
    format = Param("cobs", "1", "of the packets", choices=tuple(BYTES))
    counter = Param(True, "1", "whether a packet begins with a counter, modulo 256", fixed=True, kernel=False)
    clock = Param(
        "",
        "1",
        "name of the field that is its clock, in a unit of time, one number: then sample_time follows it",
        dtype=str,
    )
    clock_wrap = Param(
        0.0,
        "s",
        "after which that begins anew; 0: where its type does, of whole numbers without a sign, else never",
        min=0.0,
        fixed=True,
        kernel=False,
    )
    port = Param("", "1", "path of its serial port, such as /dev/ttyACM0; a rig says which", dtype=str)
    serial = Param("", "1", "last characters of its USB serial number, instead of a port; a rig says which", dtype=str)
    baudrate = Param(
        115200,
        "1/s",
        "bit/s of the line; USB ports that are no adapters do not care",
        min=50,
        max=4_000_000,
        fixed=True,
        kernel=False,
    )
    packet_rate = Param(
        0.0,
        "Hz",
        "at which it sends, as its program has it, so that `check` tells whether its line can carry that; 0: not known",
        min=0.0,
        fixed=True,
        kernel=False,
    )
    start = Param("", "1", "text that it is told at the start, and again when it comes back", dtype=str)
    timeout = Param(
        0.1, "s", "silence after which the run ends in the safe stop; 0 for never", min=0.0, fixed=True, kernel=False
    )

    age = Output("s", "since the newest packet was heard")
    received = Output("1", "packets so far", dtype=int)
    lost = Output("1", "packets so far that the counter misses", dtype=int)
    corrupt = Output("1", "packets so far with a wrong checksum, length or number", dtype=int)
    sample_time = Output(
        "s", "when the newest packet was made, on the clock of the run; without a clock of its own, when it came"
    )
    clock_drift = Output("1", "by how much its clock is slower than the computer's")
    plan = Memory(
        (), "whether they are lines, whether there is a counter, bytes of the fields, then type and scale of each field"
    )
    parsed = Memory(
        (0.0, 0.0, 0.0, -1.0),
        "bytes of the packet that is coming, whether its beginning was heard, whether it is too long, next counter",
    )
    buffer = Memory((), "those bytes")
    clock_plan = Memory(
        (-1.0, 0.0, 0.0), "which of the numbers is its clock, s of a count, s after which it begins anew"
    )
    mapped = Memory((0.0,) * kernels.clock_doubles, "map of its clock")

    decode = kernels.decode
    hardware = ("port", "serial", "baudrate")
    examples = (
        {"fields": (("force", "int24", "N", 0.01), ("accel", "int16[3]", "m/s²", 0.0048))},
        {"fields": (("x", "float32"),), "format": "lines"},
    )

    def configure(self):
        super().configure()
        own = type(self).outputs
        self.declared = fields.read(self.fields, {*own, *type(self).parameters, *type(self).memory, *_WORDS})
        self.outputs = {each.name: each.output() for each in self.declared} | own
        sizes = sum(each.size for each in self.declared), sum(each.numbers for each in self.declared)
        if sizes[0] > LONGEST or sizes[1] > MOST:
            raise ValueError(
                f"a packet has at most {LONGEST} bytes and {MOST} numbers, and these fields have "
                f"{sizes[0]} and {sizes[1]}"
            )
        self.plan = fields.plan(self.declared, self.format == "lines", self.counter)
        self.buffer = (0.0,) * (BYTES[self.format] // 8)
        self.clock_plan = fields.clock(self.declared, self.clock, self.clock_wrap)

    def opening(self):
        setup = (self.start.encode(),) if self.start else ()
        return {"port": self.port, "serial": self.serial, "baudrate": self.baudrate, "setup": setup}

    def sends(self):
        if not self.packet_rate:
            return []
        if self.format == "lines":  # a digit and what ends it
            return [(self.packet_rate, 2 * (self.counter + sum(each.numbers for each in self.declared)))]
        length = self.counter + sum(each.size for each in self.declared) + CHECKSUM
        return [(self.packet_rate, length + 1 + length // 254 + 1)]

    def line_speed(self):
        return speed_of(self.port, self.baudrate)

    def output_range(self):
        return {name: Interval(0.0) for name in ("age", "received", "lost", "corrupt")}

    def emulator(self, **parameters):
        return EmulatedMicrocontroller.of(self, **parameters)


class EmulatedMicrocontroller(StreamDevice):
    """A microcontroller that is not there: it sends its fields every `period`, in the same bytes, for a plant. Numbers
    are rounded as its types are.
    """

    fields = Microcontroller.parameters["fields"]
    format = Microcontroller.parameters["format"]
    counter = Microcontroller.parameters["counter"]
    period = Param(0.005, "s", "between its packets", above=0.0, fixed=True)

    silent = Input("1", "it sends nothing", default=False, dtype=bool)
    dropped = Input("1", "share of its packets that get lost, 0 to 1", default=0.0)
    broken = Input("1", "share of its packets in which a bit is wrong, 0 to 1", default=0.0)
    plan = Memory(
        (), "whether they are lines, whether there is a counter, bytes of the fields, then type and scale of each field"
    )
    state = Memory((0.0,) * 5, "next counter, when it is due, luck of packets, bytes that wait: from, until")
    waiting = Memory((), "those bytes")

    decode = no_io.ignore_all
    encode = kernels.emulated_encode
    examples = Microcontroller.examples

    @classmethod
    def of(cls, microcontroller, **parameters):
        """The emulator of one block of a robot."""
        return cls(
            **{name: getattr(microcontroller, name) for name in ("bus", "fields", "format", "counter")} | parameters
        )

    def configure(self):
        super().configure()
        own = type(self).inputs
        self.declared = fields.read(self.fields, {*own, *type(self).parameters, *type(self).memory, *_WORDS})
        self.inputs = {each.name: each.input() for each in self.declared} | own
        self.plan = fields.plan(self.declared, self.format == "lines", self.counter)
        self.waiting = (0.0,) * (BYTES[self.format] // 8)


_WORDS = {word for word in dir(StreamDevice) if not word.startswith("_")}

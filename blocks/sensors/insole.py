"""Pressure insoles: what presses where under a foot, and the steps that show in it."""

import math

from cext.kernels import no_io
from cext.kernels.devices import insole as kernels
from graph import Block, Input, Interval, Memory, Output, Param, StreamDevice

SIDES = {"left": 0, "right": 1}
LARGEST = 65534 * 10.0  # Pa that a cell can say


def plan_of(block):
    """For the kernels: rows, columns, side, length, breadth, force from which on there is a centre, whether a read is a
    datagram, whether frames have a time.
    """
    return (
        float(block.rows),
        float(block.columns),
        float(SIDES[block.side]),
        block.length,
        block.breadth,
        getattr(block, "least", 0.0),
        float(getattr(block, "transport", "udp") == "udp"),
        float(getattr(block, "clock", False)),
    )


def room(block):
    """Doubles that hold a frame's bytes."""
    return (18 + 2 * block.rows * block.columns + 7) // 8


class Insole(StreamDevice):
    """A pressure insole whose frames come over UDP or TCP, from its maker's program or a bridge to it: force, centre of
    pressure, sums of regions.

    A frame has the pressures of all cells, row by row from the heel, with a number and a checksum; docs/sensors.md has
    its bytes and a bridge to begin with. F = Σ p A over the cells, and the centre of pressure is Σ p A r / F: x forward
    from the heel's end, y to the wearer's left from the middle. Regions are cut across the foot, from the heel on. A
    centre is NaN under less than `least`.
    """

    side = Param("left", "1", "whose frames are taken", choices=tuple(SIDES))
    transport = Param(
        "udp",
        "1",
        "how they come: udp, to the port of `address`, or tcp, from a bridge that waits there",
        choices=("udp", "tcp"),
    )
    address = Param(
        "127.0.0.1:5005",
        "1",
        "where this computer listens (udp; 0.0.0.0:5005 for any of its networks), or the bridge does (tcp)",
        dtype=str,
    )
    rows = Param(31, "1", "of cells, from the heel to the toes", min=1, max=120, fixed=True, kernel=False)
    columns = Param(9, "1", "of cells", min=1, max=60, fixed=True, kernel=False)
    length = Param(0.27, "m", "of the field of cells", above=0.0, max=1.0, fixed=True, kernel=False)
    breadth = Param(0.09, "m", "of it", above=0.0, max=1.0, fixed=True, kernel=False)
    regions_at = Param(
        (0.3, 0.6, 0.85),
        "1",
        "where regions end, as shares of the length from the heel: heel, midfoot, forefoot; the rest are the toes",
    )
    least = Param(20.0, "N", "under which a centre of pressure means nothing", min=0.0, fixed=True, kernel=False)
    clock = Param(
        False,
        "1",
        "whether the sender puts its clock into its frames: then sample_time follows it",
        fixed=True,
        kernel=False,
    )
    timeout = Param(
        0.1, "s", "silence after which the run ends in the safe stop; 0 for never", min=0.0, fixed=True, kernel=False
    )

    force = Output("N", "on the whole insole")
    centre = Output("m", "of pressure: forward from the heel's end, to the left from the middle", shape=(2,))
    regions = Output("N", "on each region, from the heel on", shape=(4,))
    age = Output("s", "since the newest frame was heard")
    received = Output("1", "frames so far", dtype=int)
    lost = Output("1", "frames so far that their numbers miss", dtype=int)
    corrupt = Output("1", "frames so far with a wrong checksum or size", dtype=int)
    dead = Output("1", "places without a cell, or with a broken one", dtype=int)
    sample_time = Output(
        "s", "when the newest frame was measured, on the clock of the run; without a clock of its own, when it came"
    )
    clock_drift = Output("1", "by how much its clock is slower than the computer's")
    plan = Memory(
        (),
        "rows, columns, side, length, breadth, least force, whether each read is a datagram, whether there is a clock",
    )
    bounds = Memory((), "rows at which regions begin")
    parsed = Memory(
        (0.0, -1.0, 0.0), "bytes of the frame that is coming, number of the next, whether one has ended in front of it"
    )
    buffer = Memory((), "those bytes")
    mapped = Memory((0.0,) * kernels.clock_doubles, "map of its clock")

    line = "net"
    decode = kernels.decode
    hardware = ("address",)

    def configure(self):
        super().configure()
        ends = self.regions_at
        if (
            not isinstance(ends, tuple)
            or not all(isinstance(x, float) and 0.0 < x < 1.0 for x in ends)
            or list(ends) != sorted(set(ends))
        ):
            raise ValueError(f"regions_at are shares of the length between 0.0 and 1.0, rising, got {ends!r}")
        self.outputs = {name: port for name, port in type(self).outputs.items()}
        self.outputs["regions"] = Output("N", "on each region, from the heel on", shape=(len(ends) + 1,)).named(
            "regions"
        )
        self.plan, self.bounds = plan_of(self), tuple(math.ceil(x * self.rows - 1e-9) + 0.0 for x in (0.0, *ends))
        self.buffer = (0.0,) * room(self)

    def opening(self):
        return {"transport": self.transport, "address": self.address}

    def output_range(self):
        most = LARGEST * self.length * self.breadth * (1.0 + 1e-9)
        cells = float(self.rows * self.columns)
        return {
            "force": Interval(0.0, most),
            "regions": Interval(0.0, most),
            "centre": Interval(-self.breadth, max(self.length, self.breadth)),
            "age": Interval(0.0),
            "received": Interval(0.0),
            "lost": Interval(0.0),
            "corrupt": Interval(0.0),
            "dead": Interval(0.0, cells),
        }

    def emulator(self, **parameters):
        return EmulatedInsole.of(self, **parameters)


class EmulatedInsole(StreamDevice):
    """An insole that is not there: a force spread about a centre of pressure, in the same frames, for a plant. Near an
    edge its centre is drawn inwards.
    """

    side, rows, columns = (Insole.parameters[name] for name in ("side", "rows", "columns"))
    length, breadth = Insole.parameters["length"], Insole.parameters["breadth"]
    period = Param(0.01, "s", "between its frames", above=0.0, fixed=True)

    force = Input("N", "on the insole", default=0.0)
    centre = Input(
        "m", "of pressure: forward from the heel's end, to the left from the middle", shape=(2,), default=(0.1, 0.0)
    )
    silent = Input("1", "it sends nothing", default=False, dtype=bool)
    dropped = Input("1", "share of its frames that get lost, 0 to 1", default=0.0)
    broken = Input("1", "share of its frames in which a byte is wrong, 0 to 1", default=0.0)
    plan = Memory((), "rows, columns, side, length, breadth, nothing, nothing")
    state = Memory((0.0,) * 5, "number of the next frame, when it is due, luck of frames, bytes that wait: from, until")
    waiting = Memory((), "those bytes")

    line = "net"
    decode = no_io.ignore_all
    encode = kernels.emulated_encode

    @classmethod
    def of(cls, insole, **parameters):
        """The emulator of one block of a robot."""
        return cls(
            **{name: getattr(insole, name) for name in ("bus", "side", "rows", "columns", "length", "breadth")}
            | parameters
        )

    def configure(self):
        super().configure()
        self.plan, self.waiting = plan_of(self), (0.0,) * room(self)


class FootContact(Block):
    """Heel strike and toe off of one foot, from the force under it: on the ground from `press` on until less than
    `release`.

    A heel strike is a first contact in which the heel has at least `heel_share` of the force; both are true for one
    tick. A change is believed for `shortest` before there may be another. NaN changes nothing.
    """

    press = Param(50.0, "N", "force from which on the foot is on the ground", above=0.0)
    release = Param(30.0, "N", "force under which it no longer is", min=0.0)
    heel_share = Param(0.5, "1", "of the force that is on the heel at a heel strike", min=0.0, max=1.0)
    shortest = Param(0.1, "s", "between two changes", min=0.0)

    force = Input("N", "under the foot")
    heel = Input("N", "of it, under the heel")
    contact = Output("1", "whether the foot is on the ground", dtype=bool)
    heel_strike = Output("1", "whether it came down on the heel in this tick", dtype=bool)
    toe_off = Output("1", "whether it left the ground in this tick", dtype=bool)
    state = Memory((0.0, 1e9), "whether it is on the ground, s since that has changed")

    kernel = kernels.contact

    def configure(self):
        if self.release > self.press:
            raise ValueError(f"release is at most press, {self.press:g} N, got {self.release:g} N")

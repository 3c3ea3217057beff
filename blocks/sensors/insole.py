"""Pressure insoles: force, centre of pressure and regions under a foot, and step detection."""

from __future__ import annotations

import math
from typing import Any

from blocks.sensors.microcontroller import Microcontroller
from cext.kernels import no_io
from cext.kernels.devices import insole as kernels
from graph import Block, Input, Interval, Memory, Output, Param, StreamDevice
from graph.narrowing import is_tuple

SIDES = {"left": 0, "right": 1}
CELL_PRESSURE_LIMIT = 65534 * 10.0  # Pa, largest encodable pressure


def plan_of(block: Any) -> tuple[float, ...]:
    """Return the plan of the kernels.

    The plan is: rows, columns, side, length, breadth, minimum force for a centre, 1 if each read is a datagram, 1 if
    frames have a time.
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


def frame_bytes(block: Any) -> int:
    """Return the number of bytes of a frame."""
    return 18 + 2 * block.rows * block.columns


def frame_doubles(block: Any) -> int:
    """Return the number of doubles that hold the bytes of a frame."""
    return (frame_bytes(block) + 7) // 8


class Insole(StreamDevice):
    """Pressure insole over UDP or TCP: force F = Σ p A, centre of pressure Σ p A r / F, forces of regions.

    Frames come from the vendor's program or a bridge to it. A frame contains the pressures of all cells, row by row
    from the heel, with a number and a checksum; docs/reference/inputs.md describes its bytes and a bridge for XSENSOR
    insoles. The centre of pressure is x forward from the end of the heel and y to the wearer's left from the middle; it
    is NaN for a force below `least`. Regions divide the foot across its length, from the heel on.
    """

    side = Param("left", "1", "side of the insole, as in its frames", choices=tuple(SIDES))
    transport = Param(
        "udp",
        "1",
        "transport: udp, received on the port of `address`, or tcp, from a bridge that listens there",
        choices=("udp", "tcp"),
    )
    address = Param(
        "127.0.0.1:5005",
        "1",
        "address on which this computer (udp; 0.0.0.0:5005 for all its networks) or the bridge (tcp) listens",
        dtype=str,
    )
    rows = Param(31, "1", "number of rows of cells, from heel to toes", min=1, max=120, fixed=True, kernel=False)
    columns = Param(9, "1", "number of columns of cells", min=1, max=60, fixed=True, kernel=False)
    length = Param(0.27, "m", "length of the cell array", above=0.0, max=1.0, fixed=True, kernel=False)
    breadth = Param(0.09, "m", "breadth of the cell array", above=0.0, max=1.0, fixed=True, kernel=False)
    regions_at = Param(
        (0.3, 0.6, 0.85),
        "1",
        "ends of the regions as shares of the length from the heel: heel, midfoot, forefoot; the rest is the toes",
    )
    least = Param(20.0, "N", "force below which the centre of pressure is NaN", min=0.0, fixed=True, kernel=False)
    clock = Param(
        False,
        "1",
        "true if frames contain the sender's clock, which then determines `sample_time`",
        fixed=True,
        kernel=False,
    )
    timeout = Microcontroller.parameters["timeout"]

    force = Output("N", "total force")
    centre = Output("m", "centre of pressure: forward from the end of the heel, left from the middle", shape=(2,))
    regions = Output("N", "force on each region, from the heel on", shape=(4,))
    age = Output("s", "time since the newest frame")
    received = Output("1", "number of frames", dtype=int)
    lost = Output("1", "number of missing frames, according to their numbers", dtype=int)
    late = Output("1", "number of frames that came after a newer one, or twice; they give no value", dtype=int)
    corrupt = Output("1", "number of frames with a wrong checksum or size", dtype=int)
    dead = Output("1", "number of missing or broken cells", dtype=int)
    sample_time = Output(
        "s", "time of the newest frame on the clock of the run; its arrival if frames contain no clock"
    )
    clock_drift = Output("1", "relative slowness of the sender's clock")
    plan = Memory((), "rows, columns, side, length, breadth, least force, 1 if each read is a datagram, 1 with a clock")
    bounds = Memory((), "first row of each region")
    parsed = Memory((0.0, 0.0), "bytes of the partial frame, 1 if a frame ended before it")
    sequence = Memory(
        (-1.0, 0.0, 0.0), "number of the next frame, frames in a row that were not ahead, arrival of the newest in s"
    )
    buffer = Memory((), "bytes of the partial frame")
    mapped = Memory((0.0,) * kernels.clock_doubles, "map of the sender's clock")

    line = "net"
    decode = kernels.decode
    hardware = ("address",)

    def configure(self) -> None:
        super().configure()
        ends = self.regions_at
        if (
            not is_tuple(ends)
            or not all(isinstance(x, float) and 0.0 < x < 1.0 for x in ends)
            or list(ends) != sorted(set(ends))
        ):
            raise ValueError(f"regions_at must be strictly increasing floats between 0.0 and 1.0, got {ends!r}")
        self.outputs = {name: port for name, port in type(self).outputs.items()}
        self.outputs["regions"] = Output("N", "force on each region, from the heel on", shape=(len(ends) + 1,)).named(
            "regions"
        )
        self.plan, self.bounds = plan_of(self), tuple(math.ceil(x * self.rows - 1e-9) + 0.0 for x in (0.0, *ends))
        self.buffer = (0.0,) * frame_doubles(self)

    def opening(self) -> dict[str, Any]:
        return {"transport": self.transport, "address": self.address}

    def output_range(self) -> dict[str, Interval]:
        force_limit = CELL_PRESSURE_LIMIT * self.length * self.breadth * (1.0 + 1e-9)
        cells = float(self.rows * self.columns)
        return {
            "force": Interval(0.0, force_limit),
            "regions": Interval(0.0, force_limit),
            "centre": Interval(-self.breadth, max(self.length, self.breadth)),
            "age": Interval(0.0),
            "received": Interval(0.0),
            "lost": Interval(0.0),
            "late": Interval(0.0),
            "corrupt": Interval(0.0),
            "dead": Interval(0.0, cells),
        }

    def emulator(self, **parameters: Any) -> Any:
        return EmulatedInsole.of(self, **parameters)


class EmulatedInsole(StreamDevice):
    """Emulated pressure insole: a force distributed about a centre of pressure.

    Near an edge the measured centre is shifted inwards, and the force is preserved.
    """

    side, rows, columns = (Insole.parameters[name] for name in ("side", "rows", "columns"))
    length, breadth = Insole.parameters["length"], Insole.parameters["breadth"]
    period = Param(0.01, "s", "period of the frames", above=0.0, fixed=True)

    force = Input("N", "force on the insole", default=0.0)
    centre = Input(
        "m",
        "centre of pressure: forward from the end of the heel, left from the middle",
        shape=(2,),
        default=(0.1, 0.0),
    )
    silent = Input("1", "true stops all frames", default=False, dtype=bool)
    dropped = Input("1", "share of lost frames, 0 to 1", default=0.0)
    broken = Input("1", "share of frames with a wrong byte, 0 to 1", default=0.0)
    plan = Memory((), "rows, columns, side, length, breadth, unused, unused")
    state = Memory((0.0,) * 5, "number and time of the next frame, random state, first and last pending byte")
    waiting = Memory((), "pending bytes")

    line = "net"
    decode = no_io.ignore_all
    encode = kernels.emulated_encode

    @classmethod
    def of(cls, insole: Insole, **parameters: Any) -> EmulatedInsole:
        """Return the emulator of one Insole. parameters : override those of the insole"""
        return cls(
            **{name: getattr(insole, name) for name in ("bus", "side", "rows", "columns", "length", "breadth")}
            | parameters
        )

    def configure(self) -> None:
        super().configure()
        self.plan, self.waiting = plan_of(self), (0.0,) * frame_doubles(self)
        self.message_bytes = frame_bytes(self)


class FootContact(Block):
    """Ground contact of one foot with hysteresis: true from force >= `press` until force < `release`.

    A heel strike is a first contact in which the heel carries at least `heel_share` of the force; `heel_strike` and
    `toe_off` are true for one tick. Changes are at least `shortest` apart. Direct feedthrough; NaN leaves the state
    unchanged.
    """

    rules = ("release <= press",)

    press = Param(50.0, "N", "force above which contact begins", above=0.0)
    release = Param(30.0, "N", "force below which contact ends", min=0.0)
    heel_share = Param(0.5, "1", "minimum share of the force on the heel at a heel strike", min=0.0, max=1.0)
    shortest = Param(0.1, "s", "minimum time between two changes", min=0.0)

    force = Input("N", "force under the foot")
    heel = Input("N", "force under the heel")
    contact = Output("1", "true while the foot is on the ground", dtype=bool)
    heel_strike = Output("1", "true in the tick of a heel strike", dtype=bool)
    toe_off = Output("1", "true in the tick of toe-off", dtype=bool)
    state = Memory((0.0, 1e9), "1 while on the ground, time in s since the last change")

    kernel = kernels.contact

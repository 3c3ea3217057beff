"""BNO085 on a serial line, in its mode UART-RVC."""

from __future__ import annotations

import math
from typing import Any

from blocks.sensors.microcontroller import Microcontroller
from blocks.serial_lines import speed_of
from cext.kernels import no_io
from cext.kernels.devices import bno085 as kernels
from graph import Input, Interval, Memory, Output, StreamDevice

RATE, MESSAGE_BYTES, BAUDRATE = 100.0, 19, 115200  # Hz, of a message, 1/s
RANGES = {
    "yaw": Interval(-math.pi, math.pi),
    "pitch": Interval(-math.pi / 2, math.pi / 2),
    "roll": Interval(-math.pi, math.pi),
    "accel": Interval(-9.80665e-3 * 32768, 9.80665e-3 * 32768),
}


class BNO085RVC(StreamDevice):
    """BNO085 or BNO080 in its mode UART-RVC: orientation and specific force at 100 Hz, 115200 bit/s.

    The pins PS1 = 0 and PS0 = 1 select this mode at power-on; it needs no settings. The orientation is that of the
    sensor's own fusion, as rotations about z (yaw), then y (pitch), then x (roll). Yaw is relative to that at power-on.
    A sensor that restarts does not report it: yaw jumps, and its index begins again, which counts as lost or late
    messages. (Hillcrest, BNO080 Data Sheet 1000-3927, 1.3.5.2)
    """

    port, serial, timeout = (Microcontroller.parameters[name] for name in ("port", "serial", "timeout"))

    yaw = Output("rad", "rotation about z since power-on", circle=(-math.pi, math.pi))
    pitch = Output("rad", "rotation about y")
    roll = Output("rad", "rotation about x", circle=(-math.pi, math.pi))
    accel = Output("m/s²", "specific force", shape=(3,))
    age = Output("s", "time since the newest message")
    received = Output("1", "number of messages", dtype=int)
    lost = Output("1", "number of missing messages, according to their index", dtype=int)
    late = Output("1", "number of messages that came after a newer one, or twice; they give no value", dtype=int)
    corrupt = Output("1", "number of messages with a wrong checksum, or an angle outside its range", dtype=int)
    filled = Memory(0.0, "bytes of the partial message")
    sequence = Memory((-1.0, 0.0, 0.0), "next index, messages in a row that were not ahead, arrival of the newest in s")
    buffer = Memory((0.0,) * 3, "bytes of the partial message")

    decode = kernels.decode
    hardware = ("port", "serial")

    def opening(self) -> dict[str, Any]:
        return {"port": self.port, "serial": self.serial, "baudrate": BAUDRATE, "setup": ()}

    def sends(self) -> list[tuple[float, int]]:
        return [(RATE, MESSAGE_BYTES)]

    def line_speed(self) -> float:
        return speed_of(self.port, BAUDRATE)

    def output_range(self) -> dict[str, Interval]:
        return RANGES | {name: Interval(0.0) for name in ("age", "received", "lost", "late", "corrupt")}

    def emulator(self, **parameters: Any) -> Any:
        return EmulatedBNO085RVC.of(self, **parameters)


class EmulatedBNO085RVC(StreamDevice):
    """Emulated BNO085 in its mode UART-RVC: one message of its inputs every 10 ms."""

    yaw = Input("rad", "rotation about z, from -π to π", default=0.0)
    pitch = Input("rad", "rotation about y, from -π/2 to π/2", default=0.0)
    roll = Input("rad", "rotation about x, from -π to π", default=0.0)
    accel = Input("m/s²", "specific force", shape=(3,), default=(0.0, 0.0, 9.80665))
    silent = Input("1", "true stops all messages", default=False, dtype=bool)
    dropped = Input("1", "share of lost messages, 0 to 1", default=0.0)
    broken = Input("1", "share of messages with a wrong byte, 0 to 1", default=0.0)
    state = Memory((0.0,) * 3, "index and time of the next message, random state")

    decode = no_io.ignore_all
    encode = kernels.emulated_encode

    @classmethod
    def of(cls, sensor: BNO085RVC, **parameters: Any) -> EmulatedBNO085RVC:
        """Return the emulator of one BNO085RVC. parameters : override those of the block"""
        return cls(**{"bus": sensor.bus} | parameters)

"""MicroStrain sensors on serial lines, as a device family."""

import random
import struct

from blocks.imus.microstrain import mip
from blocks.imus.microstrain.block import MicroStrain
from blocks.imus.microstrain.emulator import EmulatedMicroStrain
from graph.family import Benchmark, Family

CHUNK = 64  # bytes of a frame of a run


def stream(samples: int, rate: float) -> bytes:
    """Return bytes as a sensor sends them: for each sample a packet of its sensors and one of its filter."""
    chance = random.Random(1)

    def floats(count: int) -> bytes:
        return struct.pack(f">{count}f", *(chance.gauss(0.0, 1.0) for _ in range(count)))

    packets: list[bytes] = []
    for number in range(samples):
        when = struct.pack(">dHH", 1000.0 + number / rate, 0, 1)
        packets.append(
            mip.packet(0x80, (0x12, when), (0x04, floats(3)), (0x05, floats(3)), (0x06, floats(3)), (0x14, floats(3)))
        )
        packets.append(mip.packet(0x82, (0x11, when), (0x03, floats(4) + b"\0\1")))
    return b"".join(packets)


def parse(data: bytes) -> dict[str, list[float]]:
    """Decode such bytes in Python, in the chunks in which a run receives them; return the last packet's values."""
    rest = b""
    values: dict[str, list[float]] = {}
    for at in range(0, len(data), CHUNK):
        packets, rest, _ = mip.split(rest + data[at : at + CHUNK])
        for packet in packets:
            values = mip.decode(packet)
    return values


class MicroStrainFamily(Family):
    """IMUs by MicroStrain on a serial line."""

    name = "MicroStrain"
    sensors = (MicroStrain,)
    benchmark = Benchmark(MicroStrain, EmulatedMicroStrain, stream=stream, parse=parse)


FAMILY = MicroStrainFamily()

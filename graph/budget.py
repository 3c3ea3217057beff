"""Load of CAN and SPI buses, and of serial lines.

A frame with an 11-bit identifier and n bytes has 47 + 8 n bits, one with a 29-bit identifier 67 + 8 n, including the
three bits between frames. Stuffing adds one bit after five equal bits: at worst (33 + 8 n) / 4 or (53 + 8 n) / 4, on
average about one for 16 data bits. A frame of CAN FD, which has more than eight bytes of data, has 30 or 49 bits at the
bitrate, and 32 + 8 n at the data bitrate (37 + 8 n above 16 bytes); its stuffing ends with the data. (ISO 11898-1.) A
byte on a serial line has ten bits, including start and stop bit. On SPI, the kernel waits 10 µs between the frames of a
transfer unless the driver of the controller sets another time (spi_transfer_cs_change_delay_exec of Linux).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from msgspec import Struct

from graph.device import Device
from graph.stream import StreamDevice

if TYPE_CHECKING:
    from graph.block import Block

SERIAL_BITS_PER_BYTE = 10
CLASSIC_BYTES = 8  # of data, without CAN FD
SPI_GAP = 10e-6  # s between the frames of a transfer
DAMPING_BUS_LOAD = 0.8  # share of the bitrate that a damped safe stop uses


class BusLoad(Struct, frozen=True):
    """Load of a CAN or SPI bus.

    bitrate, data_bitrate : bit/s, the second one 0 without a rate switch; frames : commands and replies per second
    typical, worst : share of the bitrate with average and worst-case stuffing; of SPI without and with the gaps
    """

    bus: str
    bitrate: float
    frames: float
    typical: float
    worst: float
    data_bitrate: float = 0.0


class LineLoad(Struct, frozen=True):
    """Least load of a device's serial line. speed : bit/s; messages, bytes : messages and bytes per second"""

    device: object
    speed: float
    messages: float
    bytes: float

    @property
    def share(self) -> float:
        """Share of the speed."""
        return SERIAL_BITS_PER_BYTE * self.bytes / self.speed


def rate_ratio(bitrate: float, data_bitrate: float) -> float:
    """Return bitrate / data bitrate: how many bits of the bitrate a bit of the data phase lasts."""
    return bitrate / (data_bitrate or bitrate)


def frame_bits(length: int, extended: int, ratio: float = 1.0) -> tuple[float, float]:
    """Return the (typical, worst) number of bits that a frame lasts, including the gap.

    length : data bytes; more than eight are sent as CAN FD
    ratio : bitrate / data bitrate
    """
    if length > CLASSIC_BYTES:
        head, data = (36 if extended else 17), 8 * length
        fast = 5 + data + (27 if length <= 16 else 32)
        stuffed = (head - 1) // 4
        bits = head + 13 + ratio * fast
        return bits + ratio * data / 15.6, bits + stuffed + ratio * ((head + 5 + data - 1) // 4 - stuffed)
    header, stuffed = (67, 53) if extended else (47, 33)
    bits = header + 8 * length
    return bits + 8 * length / 15.6, bits + (stuffed + 8 * length) // 4


def bus_loads(devices: Sequence[Device], rate: float) -> list[BusLoad]:
    """Return a BusLoad for each bus with traffic, sorted by name. rate : Hz, of the ticks"""
    loads: list[BusLoad] = []
    devices = [device for device in devices if device.medium == "can"]
    for bus in sorted({device.bus for device in devices}):
        here = [device for device in devices if device.bus == bus]
        frames = [(rate, *frame) for device in here for frame in device.traffic()] + [
            report for device in here for report in device.reports()
        ]
        if frames:
            bitrate = min(device.bitrate for device in here)
            data_bitrate = min((device.data_bitrate for device in here if device.data_bitrate), default=0.0)
            ratio = rate_ratio(bitrate, data_bitrate)
            bits = [(often, *frame_bits(length, extended, ratio)) for often, length, extended in frames]
            typical, worst = (sum(line[0] * line[which] for line in bits) / bitrate for which in (1, 2))
            loads.append(BusLoad(bus, bitrate, sum(often for often, *_ in bits), typical, worst, data_bitrate))
    return loads


def spi_loads(devices: Sequence[Device]) -> list[BusLoad]:
    """Return a BusLoad for each SPI bus, sorted by name."""
    loads: list[BusLoad] = []
    devices = [device for device in devices if device.medium == "spi"]
    for bus in sorted({device.bus for device in devices}):
        here = [device for device in devices if device.bus == bus]
        shifts = [shift for device in here for shift in device.shifts()]
        typical = sum(often * 8 * size / here[0].bitrate for often, size, _ in shifts)
        gaps = sum(often * frames * SPI_GAP for often, _, frames in shifts)
        frames = sum(often * frames for often, _, frames in shifts)
        if shifts:
            loads.append(BusLoad(bus, here[0].bitrate, frames, typical, typical + gaps))
    return loads


def damping_round(bus: str, blocks: Sequence[Block]) -> float:
    """Return the shortest period in s of the damping frames on a bus, with one reply to each."""
    damped = [
        (block, stop)
        for block in blocks
        if isinstance(block, Device) and block.bus == bus and (stop := block.damped_stop()) is not None
    ]
    bits = sum(
        2 * frame_bits(len(data), extended, rate_ratio(block.bitrate, block.data_bitrate))[1] / block.bitrate
        for block, stop in damped
        for _, extended, data in stop.bands[0][1]
    )
    return bits / DAMPING_BUS_LOAD


def line_loads(devices: Sequence[Device]) -> list[LineLoad]:
    """Return a LineLoad for each device with a known line speed and known messages."""
    loads: list[LineLoad] = []
    for device in devices:
        if isinstance(device, StreamDevice) and device.line_speed() and device.sends():
            messages = sum(often for often, _ in device.sends())
            loads.append(
                LineLoad(device, device.line_speed(), messages, sum(often * size for often, size in device.sends()))
            )
    return loads

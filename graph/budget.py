"""What a diagram puts on its CAN buses, and what sensors put on their serial lines, against what they carry.

A frame with 11-bit identifier and n bytes takes 47 + 8 n bits on the wire, one with 29 bits 67 + 8 n, the three bits
between frames included. Stuffing adds one bit after each run of five: at worst (33 + 8 n) / 4 or (53 + 8 n) / 4, about
one in 16 data bits on average. (ISO 11898-1.) A byte on a serial line takes ten bits: one to begin, eight, one to end.
"""

from dataclasses import dataclass

from graph.device import Device
from graph.stream import StreamDevice

BITS_OF_A_BYTE = 10
DAMPING_SHARE = 0.8  # of the bitrate, in a safe stop that damps


@dataclass(frozen=True)
class BusLoad:
    """frames : a second, commands and replies. typical, worst : share of the bitrate, with average and with worst
    stuffing.
    """

    bus: str
    bitrate: float
    frames: float
    typical: float
    worst: float


@dataclass(frozen=True)
class LineLoad:
    """What a device sends on its own serial line, at least. messages, bytes : a second; share : of its bit/s"""

    device: object
    speed: float
    messages: float
    bytes: float

    @property
    def share(self):
        return BITS_OF_A_BYTE * self.bytes / self.speed


def frame_bits(length, extended):
    """(typical, worst) bits of a frame of `length` data bytes, the gap to the next included."""
    header, stuffed = (67, 53) if extended else (47, 33)
    bits = header + 8 * length
    return bits + 8 * length / 15.6, bits + (stuffed + 8 * length) // 4


def bus_loads(devices, rate):
    """One BusLoad for each bus that has traffic, by name. rate : ticks a second."""
    loads = []
    devices = [device for device in devices if device.medium == "can"]
    for bus in sorted({device.bus for device in devices}):
        here = [device for device in devices if device.bus == bus]
        frames = [(rate, *frame) for device in here for frame in device.traffic()] + [
            report for device in here for report in device.reports()
        ]
        if frames:
            bitrate = min(device.bitrate for device in here)
            bits = [(often, *frame_bits(*frame)) for often, *frame in frames]
            typical, worst = (sum(line[0] * line[which] for line in bits) / bitrate for which in (1, 2))
            loads.append(BusLoad(bus, bitrate, sum(often for often, *_ in bits), typical, worst))
    return loads


def damping_round(bus, blocks):
    """s that a bus needs at least between rounds of damping frames and one reply to each, at DAMPING_SHARE of what it
    carries.
    """
    damped = [
        (block, stop)
        for block in blocks
        if isinstance(block, Device) and block.bus == bus and (stop := block.damped_stop()) is not None
    ]
    bits = sum(
        2 * frame_bits(len(data), extended)[1] / block.bitrate
        for block, stop in damped
        for _, extended, data in stop.bands[0][1]
    )
    return bits / DAMPING_SHARE


def line_loads(devices):
    """One LineLoad for each device whose line has a speed, and of which it is known what it sends."""
    found = []
    for device in devices:
        if isinstance(device, StreamDevice) and device.line_speed() and device.sends():
            messages = sum(often for often, _ in device.sends())
            found.append(
                LineLoad(device, device.line_speed(), messages, sum(often * size for often, size in device.sends()))
            )
    return found

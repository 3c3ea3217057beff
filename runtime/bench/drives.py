"""Drives on udp_multicast that are held still, as a process of their own: `python -m runtime.bench.drives CHANNEL
ID...`.

Each replies immediately to every frame with its id, as a drive in MIT mode does. Waiting processes may spin on the same
processor.
"""

from __future__ import annotations

import sys
from collections import Counter
from typing import TYPE_CHECKING

import can

from runtime.guardian.wires import keep_apart
from runtime.machine.realtime import Realtime

if TYPE_CHECKING:
    pass

NO_TORQUE = 0x7FF  # code


def node(channel: str):
    bus = can.Bus(interface="udp_multicast", channel=channel)
    keep_apart(bus.fileno())
    return bus


def reply(motor: int, data) -> bytes:
    """Of a drive at zero that gives the torque it is commanded, 30 °C, no error."""
    special = data[:7] == b"\xff" * 7
    torque = NO_TORQUE if special else (data[6] & 15) << 8 | data[7]
    return bytes([motor, 0x7F, 0xFF, 0x7F, 0xF0 | torque >> 8, torque & 0xFF, 70, 0])


def main(channel, *identifiers) -> None:
    bus, own = node(channel), Counter()
    motors = set(map(int, identifiers))
    Realtime("try").obtain()
    print("ready", flush=True)
    while True:
        heard = bus.recv()
        if heard is None:
            continue
        frame = heard.arbitration_id, bytes(heard.data)
        if own[frame]:  # it hands us our own, too
            own[frame] -= 1
        elif heard.arbitration_id in motors and heard.dlc == 8:
            answer = reply(heard.arbitration_id, heard.data)
            own[heard.arbitration_id, answer] += 1
            bus.send(can.Message(arbitration_id=heard.arbitration_id, is_extended_id=False, data=answer))


if __name__ == "__main__":
    main(*sys.argv[1:])

"""Process of emulated drives on udp_multicast, held still: `python -m runtime.setup.bench.drives CHANNEL ID...`.

Each replies immediately to every frame with its id, as a drive in MIT mode does. Waiting processes may spin on the same
processor.
"""

from __future__ import annotations

import sys
from collections import Counter
from typing import TYPE_CHECKING

import can

from runtime.host.machine.realtime import Realtime
from runtime.robot.guardian.wires import keep_apart

if TYPE_CHECKING:
    from can import BusABC

NO_TORQUE = 0x7FF  # code


def node(channel: str) -> BusABC:
    """Return a node on a multicast group. channel : its address"""
    bus = can.Bus(interface="udp_multicast", channel=channel)
    keep_apart(bus.fileno())
    return bus


def reply(motor: int, data: bytes | bytearray) -> bytes:
    """Return the reply of a drive at zero that produces the commanded torque: 30 °C, no error.

    motor : id
    data : data of the command
    """
    special = data[:7] == b"\xff" * 7
    torque = NO_TORQUE if special else (data[6] & 15) << 8 | data[7]
    return bytes([motor, 0x7F, 0xFF, 0x7F, 0xF0 | torque >> 8, torque & 0xFF, 70, 0])


def main(channel: str, *identifiers: str) -> None:
    """Emulate drives until killed, and print a line when they are ready.

    channel : multicast group
    identifiers : ids of the drives
    """
    bus, own = node(channel), Counter()
    motors = set(map(int, identifiers))
    Realtime("try").obtain()
    print("ready", flush=True)
    while True:
        received = bus.recv()
        if received is None:
            continue
        frame = received.arbitration_id, bytes(received.data)
        if own[frame]:  # the interface also returns frames of this node
            own[frame] -= 1
        elif received.arbitration_id in motors and received.dlc == 8:
            answer = reply(received.arbitration_id, received.data)
            own[received.arbitration_id, answer] += 1
            bus.send(can.Message(arbitration_id=received.arbitration_id, is_extended_id=False, data=answer))


if __name__ == "__main__":
    main(*sys.argv[1:])

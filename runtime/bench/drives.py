"""Drives on udp_multicast that stand still, as a process of their own: `python -m runtime.bench.drives CHANNEL ID...`.

Each answers every frame to its id as a CubeMars AK in MIT mode does, and at once: who waits for it spins, perhaps on the same processor.
"""

import sys
from collections import Counter

import can

from runtime.guardian.wires import keep_apart
from runtime.realtime import Realtime

AT_REST = bytes.fromhex("7fff7ff7ff4600")           # of a reply behind the id: everything at zero, 30 °C, no error


def node(channel):
    bus = can.Bus(interface="udp_multicast", channel=channel)
    keep_apart(bus.fileno())
    return bus


def main(channel, *identifiers):
    bus, own = node(channel), Counter()
    answers = {identifier: bytes([identifier]) + AT_REST for identifier in map(int, identifiers)}
    Realtime("try").obtain()
    print("ready", flush=True)
    while True:
        heard = bus.recv()
        frame = heard.arbitration_id, bytes(heard.data)
        if own[frame]:                                          # it hands us our own, too
            own[frame] -= 1
        elif heard.arbitration_id in answers:
            answer = answers[heard.arbitration_id]
            own[heard.arbitration_id, answer] += 1
            bus.send(can.Message(arbitration_id=heard.arbitration_id, is_extended_id=False, data=answer))


if __name__ == "__main__":
    main(*sys.argv[1:])

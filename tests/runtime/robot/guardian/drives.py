"""The drives of a robot on udp_multicast, as a process of their own:
`python -m tests.runtime.robot.guardian.drives CHANNEL ID... [moving]`.

Each answers every frame to its id as an AK10-9 would that stands still, unless that frame is its own. SIGUSR1 gives
them a fault of their encoder, SIGUSR2 takes it back, SIGALRM makes them hotter than any may be. With `moving` each
drives a limb of 0.35 kg·m² at 8 rad/s. The process has real-time priority if it may: no load of a computer delays a
drive.
"""

import os
import signal
import socket
import sys
import time
from collections import Counter
from contextlib import suppress

import can

from runtime.robot.emulation.priority import take_priority
from runtime.robot.guardian.wires import keep_apart
from tests.blocks.actuators import reference
from tests.played_drive import PlayedDrive

AK10_9 = reference.ranges(velocity=50.0, torque=65.0)
SO_RCVBUFFORCE, RECEIVE_BUFFER = 33, 1 << 22  # an option of Linux that Python does not name; bytes


def open_bus(channel):
    bus = can.Bus(channel, interface="udp_multicast")
    keep_apart(bus.fileno())
    with socket.socket(fileno=os.dup(bus.fileno())) as own, suppress(OSError):  # root: for a node that a load delays
        own.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER)
    return bus


def main(channel, *identifiers):
    bus, sent = open_bus(channel), Counter()
    moving = identifiers[-1] == "moving"
    motors, fault, temperature = set(map(int, identifiers[: -1 if moving else None])), [0], [30.0]
    limbs = {motor: PlayedDrive(AK10_9, motor, now=time.monotonic_ns()) for motor in motors} if moving else {}
    signal.signal(signal.SIGUSR1, lambda *_: fault.__setitem__(0, 5))
    signal.signal(signal.SIGUSR2, lambda *_: fault.__setitem__(0, 0))
    signal.signal(signal.SIGALRM, lambda *_: temperature.__setitem__(0, 105.0))
    take_priority()
    print("ready", flush=True)
    while True:
        heard = bus.recv()
        frame = heard.arbitration_id, bytes(heard.data)
        if sent[frame]:
            sent[frame] -= 1
        elif heard.arbitration_id in motors and not heard.is_extended_id and heard.dlc == 8:
            if moving:
                answer = limbs[heard.arbitration_id].hear(frame[1], time.monotonic_ns())
            else:
                answer = reference.held_reply(AK10_9, heard.arbitration_id, 0.1, frame[1], temperature[0], fault[0])
            sent[heard.arbitration_id, bytes(answer)] += 1
            bus.send(can.Message(arbitration_id=heard.arbitration_id, is_extended_id=False, data=answer))


if __name__ == "__main__":
    main(*sys.argv[1:])

"""RobStride drives on udp_multicast, as a process of their own:
`python -m tests.runtime.robot.guardian.robstride_drives CHANNEL ID...`.

Each answers every frame to its id as an RS03 would that stands still, with its mode, and a read with the value that was
written last.
"""

import sys

import can

from blocks.actuators.robstride.models import MODELS
from runtime.robot.emulation.priority import take_priority
from tests.blocks.actuators import robstride_reference as reference
from tests.runtime.robot.guardian.drives import open_bus

RS03 = reference.ranges(MODELS["RS03"])
STOPPED, RUNNING = 0, 2


def main(channel, *identifiers):
    bus = open_bus(channel)
    modes, written = dict.fromkeys(map(int, identifiers), STOPPED), {}
    take_priority()
    print("ready", flush=True)
    while True:
        heard = bus.recv()
        kind, motor = heard.arbitration_id >> 24, heard.arbitration_id & 255
        if motor not in modes or not heard.is_extended_id or heard.dlc != 8:
            continue
        modes[motor] = {3: RUNNING, 4: STOPPED}.get(kind, modes[motor])
        if kind == 18:
            written[motor, bytes(heard.data[:2])] = bytes(heard.data[4:])
        if kind == 17:
            index = bytes(heard.data[:2])
            data = index + bytes(2) + written.get((motor, index), bytes(4))
            bus.send(
                can.Message(
                    arbitration_id=17 << 24 | motor << 8 | heard.arbitration_id >> 8 & 255,
                    is_extended_id=True,
                    data=data,
                )
            )
            continue
        identifier, data = reference.reply(RS03, motor, position=0.1, mode=modes[motor])
        bus.send(can.Message(arbitration_id=identifier & ~reference.EXTENDED, is_extended_id=True, data=data))


if __name__ == "__main__":
    main(*sys.argv[1:])

"""One OpenIMU on a CAN bus, watched live: set up as arming would, which lasts until its power is gone, and read by its own block."""

import time

from blocks.imus import OpenImu
from cext.handover import feed
from graph import Diagram, compile
from runtime.errors import BadInput
from runtime.tools.scan import refuse_company
from runtime.tools.streaming import column

EXTENDED, TAKEN = 0x80000000, 1            # cext/abi.pxd
SET_UP = 0.1                    # s between two attempts to set it up
PATIENCE = 1.0                  # s until it has told its settings


class WatchedOpenImu:
    """BadInput where it does not tell its settings, or somebody commands drives on its bus.

    bus : runtime.tools.bus.ToolBus; parameters : of OpenImu
    """

    def __init__(self, bus, address, **parameters):
        self.bus = bus
        refuse_company(bus)
        with Diagram("stream", rate=OpenImu.parameters["rate"].default) as diagram:
            self.block = OpenImu(address=address, name=f"imu_{address}", **parameters)
        schedule = compile(diagram)
        self.arena, self.table = schedule.arena.copy(), schedule.devices[0].table
        self.slots = dict(zip(self.block.outputs, self.table.slots))
        self.channels = ["accel", "gyro", *(["mag"] if self.block.types & 8 else []), *(["roll", "pitch"] if self.block.slope else [])]
        deadline, heard = time.monotonic() + PATIENCE, False
        while self.ask(0.01) is None:
            if time.monotonic() > deadline:
                where = f"address {address} on {bus.bus.channel}"
                raise BadInput(
                    f"{where} speaks, and does not tell its settings: is it a {self.block.model}? --untold reads it as it is" if heard else
                    f"nobody has {where}; the command `scan` tells who is there")
            if self.block.told:
                for frame in self.block.enable_frames():
                    bus.send(frame, "settings of an OpenIMU")
            heard = bool(self.drain(SET_UP)) or heard

    def drain(self, patience):
        """What decode says to each frame of its own that comes."""
        frames = self.bus.listen(patience, lambda frames: any(frame[0] & 0xFF == self.block.address for frame in frames))
        answers = {}
        for identifier, extended, data in frames:
            if extended and identifier & 0xFF == self.block.address:
                said = feed(self.block.decode, self.arena, self.table, data, 64, time.monotonic_ns(), identifier | EXTENDED)
                for answer, count in said.items():
                    answers[answer] = answers.get(answer, 0) + count
        return answers

    def ask(self, patience):
        """{channel: its values} once a whole sample has come, None if none has in time."""
        deadline = time.monotonic() + patience
        while (left := deadline - time.monotonic()) > 0.0:
            if self.drain(left).get(TAKEN):
                return {name: self.told(name) for name in self.channels}
        return None

    def told(self, name):
        slot, shape = self.slots[name], self.block.outputs[name].shape
        return self.arena[slot : slot + (shape[0] if shape else 1)].tolist()

    def columns(self, name):
        return [column(f"{name}.{channel}{place}", self.block.outputs[channel].unit) for channel in self.channels
                for place in ([f"[{index}]" for index in range(3)] if self.block.outputs[channel].shape else [""])]

    def row(self, answer):
        return [value for values in answer.values() for value in values]

    def line(self, answer):
        return "  ".join(f"{name} {' '.join(f'{value:8.3f}' for value in values)} {self.block.outputs[name].unit}" for name, values in answer.items())


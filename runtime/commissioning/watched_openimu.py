"""One OpenIMU on a CAN bus, watched live: set up as arming would, which lasts until its power is gone, and read by its
own block.
"""

import time

from blocks.imus import OpenImu
from graph import Diagram
from runtime.base.errors import BadInput
from runtime.commissioning.scan import refuse_company
from runtime.commissioning.watched import WatchedBlocks

EXTENDED, TAKEN = 0x80000000, 1  # cext/abi.pxd
SET_UP = 0.1  # s between two attempts to set it up
PATIENCE = 1.0  # s until it has told its settings


class WatchedOpenImu(WatchedBlocks):
    """BadInput where it does not tell its settings, or somebody commands drives on its bus.

    bus : runtime.commissioning.bus.ToolBus; parameters : of OpenImu
    """

    def __init__(self, bus, address, **parameters):
        self.bus = bus
        refuse_company(bus)
        with Diagram("stream", rate=OpenImu.parameters["rate"].default) as diagram:
            self.block = OpenImu(address=address, name=f"imu_{address}", **parameters)
        super().__init__(
            diagram,
            lambda block: [
                "accel",
                "gyro",
                *(["mag"] if block.types & 8 else []),
                *(["roll", "pitch"] if block.slope else []),
            ],
        )
        deadline, heard = time.monotonic() + PATIENCE, False
        while self.ask(0.01) is None:
            if time.monotonic() > deadline:
                where = f"address {address} on {bus.bus.channel}"
                raise BadInput(
                    f"{where} speaks, and does not tell its settings: is it a {self.block.model}? --untold reads it "
                    "as it is"
                    if heard
                    else f"nobody has {where}; the command `scan` tells who is there"
                )
            if self.block.told:
                for frame in self.block.enable_frames():
                    bus.send(frame, "settings of an OpenIMU")
            heard = bool(self.drain(SET_UP)) or heard

    def drain(self, patience):
        """What decode says to each frame of its own that comes."""
        frames = self.bus.listen(
            patience, lambda frames: any(frame[0] & 0xFF == self.block.address for frame in frames)
        )
        answers = {}
        for identifier, extended, data in frames:
            if extended and identifier & 0xFF == self.block.address:
                for answer, count in self.feed(self.fed[0], data, time.monotonic_ns(), identifier | EXTENDED).items():
                    answers[answer] = answers.get(answer, 0) + count
        return answers

    def ask(self, patience):
        """{path of a port: its values} once a whole sample has come, None if none has in time."""
        deadline = time.monotonic() + patience
        while (left := deadline - time.monotonic()) > 0.0:
            if self.drain(left).get(TAKEN):
                return self.answer()
        return None

"""One sensor on a CAN bus that follows SAE J1939, shown live: set up as for a run, until its power goes, and read by
its own block.
"""

import time

from graph import Diagram
from runtime.base.errors import BadInput
from runtime.commissioning.scan import refuse_company
from runtime.commissioning.watched import WatchedBlocks

EXTENDED, TAKEN = 0x80000000, 1  # cext/abi.pxd
SET_UP = 0.1  # s between two attempts to set it up
SETTINGS_TIMEOUT = 1.0  # s until it has returned its settings


class WatchedNode(WatchedBlocks):
    """BadInput where it does not return its settings, or another controller commands drives on its bus.

    bus : runtime.commissioning.bus.ToolBus; kind : graph.family.Node; parameters : of its block
    """

    def __init__(self, bus, kind, address, **parameters):
        self.bus = bus
        refuse_company(bus)
        with Diagram("stream", rate=kind.block.parameters["rate"].default) as diagram:
            self.block = kind.block(address=address, name=f"imu_{address}", **parameters)
        super().__init__(diagram, kind.channels)
        deadline, heard = time.monotonic() + SETTINGS_TIMEOUT, False
        while self.ask(0.01) is None:
            if time.monotonic() > deadline:
                where = f"address {address} on {bus.bus.channel}"
                raise BadInput(
                    f"{where} sends, but does not return its settings: is it a {self.block.model}? {kind.silent}"
                    if heard
                    else f"no sensor has {where}; `scan` lists those on the bus"
                )
            for frame in kind.set_up(self.block):
                bus.send(frame, f"settings of an {kind.name}")
            heard = bool(self.drain(SET_UP)) or heard

    def drain(self, patience):
        """Return {value that decode returned: how often} for its own frames received within some time."""
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

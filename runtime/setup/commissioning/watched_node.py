"""Live display of one SAE J1939 sensor on a CAN bus, configured as for a run and decoded by its block.

The configuration is lost when the sensor loses power.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from graph import Diagram
from runtime.host.errors import BadInput
from runtime.setup.commissioning.scan import refuse_company
from runtime.setup.commissioning.watched import WatchedBlocks

if TYPE_CHECKING:
    from graph.family import Node
    from runtime.robot.rig.tool_bus import ToolBus

EXTENDED, TAKEN = 0x80000000, 1  # cext/abi.pxd
SET_UP_INTERVAL = 0.1  # s between two attempts to configure the sensor
SETTINGS_TIMEOUT = 1.0  # s until the sensor has returned its settings


class WatchedNode(WatchedBlocks):
    """One J1939 sensor.

    bus : runtime.robot.rig.tool_bus.ToolBus
    kind : graph.family.Node
    parameters : parameters of the sensor's block

    Raises BadInput if the sensor does not return its settings or another controller commands drives on the bus.
    """

    def __init__(self, bus: ToolBus, kind: Node, address: int, **parameters: Any) -> None:
        self.bus = bus
        refuse_company(bus)
        with Diagram("stream", rate=kind.block.parameters["rate"].default) as diagram:
            self.block = kind.block(address=address, name=f"imu_{address}", **parameters)
        super().__init__(diagram, kind.channels)
        deadline, responded = time.monotonic() + SETTINGS_TIMEOUT, False
        while self.ask(0.01) is None:
            if time.monotonic() > deadline:
                where = f"address {address} on {bus.bus.channel}"
                raise BadInput(
                    f"{where} sends frames but does not return its settings: check that it is a "
                    f"{self.block.model}. {kind.silent}"
                    if responded
                    else f"no sensor responds at {where}; `scan` lists the sensors on the bus"
                )
            for frame in kind.set_up(self.block):
                bus.send(frame, f"settings of an {kind.name}")
            responded = bool(self.drain(SET_UP_INTERVAL)) or responded

    def drain(self, timeout: float) -> dict[int, int]:
        """Return {value returned by the decoder: count} for the sensor's frames received within `timeout` s."""
        frames = self.bus.listen(timeout, lambda frames: any(frame[0] & 0xFF == self.block.address for frame in frames))
        answers = {}
        for identifier, extended, data in frames:
            if extended and identifier & 0xFF == self.block.address:
                for answer, count in self.feed(self.fed[0], data, time.monotonic_ns(), identifier | EXTENDED).items():
                    answers[answer] = answers.get(answer, 0) + count
        return answers

    def ask(self, timeout: float) -> dict[str, list[float]] | None:
        """Return {path of a port: its values} after a complete sample, or None after `timeout` s without one."""
        deadline = time.monotonic() + timeout
        while (left := deadline - time.monotonic()) > 0.0:
            if self.drain(left).get(TAKEN):
                return self.answer()
        return None

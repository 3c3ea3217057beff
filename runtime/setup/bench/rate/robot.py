"""The robot of the search: so many actuators on one bus, commanded zero torque."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from graph import Diagram

UNLIMITED = 1e12  # bit/s: the compiler is not to refuse what is to be tried
CODES = 0.6  # of a code: where the driver truncates zero to the code below the middle, this is the one above
ACTUATORS_LIMIT = 8


def robot(make: Callable[[int], Any], ids: Iterable[int], rate: float, upper: bool = False) -> Diagram:
    """Return the diagram of actuators that receive zero torque.

    make : function of a CAN id that returns an actuator
    ids : CAN ids
    rate : Hz
    upper : whether zero is encoded as the code above the middle of its range, as Epically Powerful does
    """
    with Diagram("rate", rate=rate) as diagram:
        for can_id in ids:
            block = make(can_id)
            block.bitrate = UNLIMITED
            block(**(_zero_from_above(block) if upper else {"torque_command": 0.0}))
    return diagram


def _zero_from_above(block: Any) -> dict[str, float]:
    position, velocity, _, _, torque = block.wire
    return {
        "position_command": CODES * 2.0 * position / 0xFFFF,
        "velocity_command": CODES * 2.0 * velocity / 0xFFF,
        "torque_command": CODES * 2.0 * torque / 0xFFF,
    }


def plant(diagram: Diagram, rate: float) -> Diagram:
    """Return a plant of the emulated drives, held still. rate : Hz"""
    with Diagram("drives", rate=rate) as drives:
        for block in diagram:
            if hasattr(block, "emulator") and block.addresses():
                block.emulator()(position=0.0, velocity=0.0)
    return drives

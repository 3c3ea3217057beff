"""Offset, sign and range of a motor at its joint, for the rig file. The operator moves the joint; the motor is off.

stand straight      the position is the offset
bend the joint      the direction of motion is the sign
full motion         its ends are the range that is checked before arming
"""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Any

from blocks.families import families, family_of
from runtime.host.console.confirm import discard_typed, enter_pressed
from runtime.host.console.terminal import print_lines
from runtime.host.errors import BadInput
from runtime.setup.commissioning.scan import refuse_company

if TYPE_CHECKING:
    from graph.family import Answer
    from runtime.robot.rig.tool_bus import ToolBus

QUERY_INTERVAL = 0.02  # s
SILENCE_TIMEOUT = 0.5  # s without an answer
STILL_RANGE = 0.05  # rad, motion of a joint at rest within STILL_TIME
STILL_TIME = 0.3  # s
MIN_MOTION = 0.2  # rad, smallest motion with a clear direction


class Motor:
    """Drive of a joint, polled with the frame that disables its motor.

    block : actuator block with the parameters of the diagram and the rig file
    """

    def __init__(self, bus: ToolBus, block: Any) -> None:
        self.bus, self.block = bus, block
        family = family_of(block)
        if family is None:
            known = ", ".join(drive.block.__name__ for each in families() for drive in each.drives)
            raise BadInput(
                f"{block.path} is a {type(block).__name__}, which this command does not support. Supported: {known}"
            )
        self.query = family.stop_query(block)
        assert self.query.frame is not None  # the query of a block sends a frame
        self.frame = self.query.frame
        refuse_company(bus)

    def answer(self) -> Answer:
        """Return the newest Answer. Raises BadInput if the drive does not respond."""
        answer = self.bus.ask(self.frame, "disable", self.query.read, timeout=SILENCE_TIMEOUT / 2)
        if answer is None:
            raise BadInput(
                f"{self.block.path}: id {self.block.can_id} does not respond on {self.bus.bus.channel}; "
                "`scan` lists the drives on the bus"
            )
        return answer

    def angle(self) -> float:
        """Return the motor's position in rad at the joint, before sign and offset."""
        return self.answer().position / self.block.gear_ratio


def until_entered(motor: Motor, instruction: str) -> list[tuple[float, float]]:
    """Return [(time in s, angle in rad)] of a joint until the operator presses Enter."""
    print_lines([f"{instruction}, then press Enter"])
    discard_typed()
    seen = []
    live = sys.stdout.isatty()
    while not enter_pressed():
        seen.append((time.monotonic(), motor.angle()))
        if live and len(seen) % 5 == 0:
            sys.stdout.write(f"\r  {seen[-1][1]:8.3f} rad ")
            sys.stdout.flush()
        time.sleep(QUERY_INTERVAL)
    seen.append((time.monotonic(), motor.angle()))
    if live:
        sys.stdout.write("\r")
    return seen


def at_rest(motor: Motor, name: str) -> float:
    """Return the mean angle in rad over STILL_TIME. Raises BadInput if the joint moves.

    name : pose named in the message
    """
    end, angles = time.monotonic() + STILL_TIME, []
    while time.monotonic() < end:
        angles.append(motor.angle())
        time.sleep(QUERY_INTERVAL)
    if max(angles) - min(angles) > STILL_RANGE:
        moved = max(angles) - min(angles)
        raise BadInput(
            f"{name}: the joint moved by {moved:.2f} rad; hold it still and run the command again; nothing was written"
        )
    return sum(angles) / len(angles)


def find(motor: Motor) -> dict[str, Any]:
    """Guide the operator through the three steps.

    Returns {"invert": bool, "offset": rad, "range": [low, high] in rad} of the joint. Raises BadInput if it moved
    too little.
    """
    until_entered(motor, "1 of 3: motor off. Stand straight, so that the joint is at zero")
    straight = at_rest(motor, "straight")
    print_lines([f"  straight at {straight:.3f} rad of the motor"])
    until_entered(motor, "2 of 3: bend the joint in the positive direction (for a knee: flexion) and hold it")
    bent = at_rest(motor, "bent")
    if abs(bent - straight) < MIN_MOTION:
        raise BadInput(
            f"the joint moved by {abs(bent - straight):.2f} rad; the sign needs at least {MIN_MOTION:g} rad; "
            "nothing was written"
        )
    sign = 1.0 if bent > straight else -1.0
    way = "in the direction of the joint" if sign > 0 else "in the opposite direction"
    print_lines([f"  bent by {abs(bent - straight):.3f} rad; the motor turns {way}"])
    seen = until_entered(motor, "3 of 3: move the joint through its full motion, to both ends")
    angles = [sign * (angle - straight) for _, angle in seen]
    low, high = min(angles), max(angles)
    if high - low < MIN_MOTION:
        raise BadInput(
            f"the joint moved by {high - low:.2f} rad; the full motion needs at least {MIN_MOTION:g} rad; "
            "nothing was written"
        )
    return {"invert": sign < 0, "offset": round(sign * straight, 4), "range": [round(low, 3), round(high, 3)]}

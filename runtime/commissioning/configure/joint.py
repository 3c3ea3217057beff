"""Offset, sign and range of a motor at its joint, for the rig file, measured while the joint is moved by hand with the
motor off.

    stand straight      the position there is the offset
    bend the joint      the direction of its motion is the sign
    the full motion     its ends are the range, with which the table before arming compares
"""

import sys
import time

from blocks.families import families, family_of
from runtime.base.errors import BadInput
from runtime.commissioning.scan import refuse_company
from runtime.console.confirm import enter_pressed
from runtime.console.terminal import tell

PERIOD = 0.02  # s between two questions
SILENT = 0.5  # s without an answer
STILL = 0.05  # rad that a joint that stands still may move in WINDOW
WINDOW = 0.3  # s
BENT = 0.2  # rad, smallest motion with a clear direction


class Motor:
    """The drive of a joint, asked again and again with the frame that takes its torque away.

    block : actuator of a family, as the diagram and the rig have it
    """

    def __init__(self, bus, block):
        self.bus, self.block = bus, block
        family = family_of(block)
        if family is None:
            known = ", ".join(drive.block.__name__ for each in families() for drive in each.drives)
            raise BadInput(f"{block.path} is a {type(block).__name__}: this command knows {known}")
        self.query = family.stop_query(block)
        refuse_company(bus)

    def answer(self):
        """The newest Answer. BadInput where it is silent."""
        found = self.bus.ask(self.query.frame, "disable", self.query.read, patience=SILENT / 2)
        if found is None:
            raise BadInput(
                f"{self.block.path}: id {self.block.can_id} does not answer on {self.bus.bus.channel}; "
                "`scan` lists the drives that do"
            )
        return found

    def angle(self):
        """rad of the motor at the joint, before sign and offset."""
        return self.answer().position / self.block.gear_ratio


def until_entered(motor, instruction):
    """Return [(time, angle)] of a joint until the operator presses Enter."""
    tell([f"{instruction}, then press Enter"])
    seen = []
    live = sys.stdout.isatty()
    while not enter_pressed():
        seen.append((time.monotonic(), motor.angle()))
        if live and len(seen) % 5 == 0:
            sys.stdout.write(f"\r  {seen[-1][1]:8.3f} rad ")
            sys.stdout.flush()
        time.sleep(PERIOD)
    seen.append((time.monotonic(), motor.angle()))
    if live:
        sys.stdout.write("\r")
    return seen


def at_rest(motor, name):
    """The mean angle of a joint that is held still from now on. BadInput if it is not."""
    end, angles = time.monotonic() + WINDOW, []
    while time.monotonic() < end:
        angles.append(motor.angle())
        time.sleep(PERIOD)
    if max(angles) - min(angles) > STILL:
        moved = max(angles) - min(angles)
        raise BadInput(
            f"{name}: the joint moved by {moved:.2f} rad; hold it still, and begin again; nothing was written"
        )
    return sum(angles) / len(angles)


def find(motor):
    """{invert, offset, range} of a joint."""
    until_entered(motor, "1 of 3: motor off. Stand straight, so that the joint is at zero")
    straight = at_rest(motor, "straight")
    tell([f"  straight at {straight:.3f} rad of the motor"])
    until_entered(motor, "2 of 3: bend the joint the way that shall count as positive (a knee: flex it), and hold it")
    bent = at_rest(motor, "bent")
    if abs(bent - straight) < BENT:
        raise BadInput(
            f"the joint went {abs(bent - straight):.2f} rad; at least {BENT:g} rad is needed to find the sign; "
            "nothing was written"
        )
    sign = 1.0 if bent > straight else -1.0
    way = "with the joint" if sign > 0 else "the other way"
    tell([f"  bent by {abs(bent - straight):.3f} rad; the motor turns {way}"])
    seen = until_entered(motor, "3 of 3: move the joint through its full motion, to both ends")
    angles = [sign * (angle - straight) for _, angle in seen]
    low, high = min(angles), max(angles)
    if high - low < BENT:
        raise BadInput(f"the joint moved by {high - low:.2f} rad: that is no full motion; nothing was written")
    return {"invert": sign < 0, "offset": round(sign * straight, 4), "range": [round(low, 3), round(high, 3)]}

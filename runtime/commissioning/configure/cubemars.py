"""The zero of a CubeMars: where it is becomes its position 0. It is the one thing of these drives that can be set up on
the bus.

    MIT mode               FF..FE after a disable; then the drive may be silent for a second. Whether it is kept when
    the power goes is the
                           firmware's matter, and a look after that tells
    servo mode, V3.0       origin, until the power goes; with --save into the drive's flash memory

A drive that is under current or moves is left alone.
"""

from dataclasses import dataclass

from blocks.actuators.cubemars import asking, frames
from blocks.actuators.mit_frames import SET_ZERO
from runtime.base.errors import BadInput
from runtime.commissioning.scan import servo_drives
from runtime.console.confirm import confirm
from runtime.console.terminal import tell

STILL = 0.02  # rad that it may seem to move between two looks
CLOSE = 0.02  # rad from zero
LOOK = 0.25  # s: a drive in servo mode reports at 1 Hz to 500 Hz, mostly at 50 or more
SILENCE = 1.5  # s after which a drive in MIT mode answers again


@dataclass
class Found:
    """position : rad; current : A, None where a drive does not tell; look : gives the next Answer, or None; frame :
    sets the zero
    """

    family: str
    position: float
    current: float | None
    look: object
    frame: tuple


def carry_out(bus, wanted):
    """Returns whether it was confirmed; None where the id is no CubeMars. BadInput where it is one that cannot have its
    zero now.

    bus : ToolBus; wanted : as of runtime.commissioning.configure.apply
    """
    found = find(bus, wanted.can_id, wanted.save)
    if found is None:
        return None
    if found.family == asking.MIT and wanted.save:
        raise BadInput(
            f"--save: id {wanted.can_id} is a CubeMars in MIT mode, which has no frame to save; leave it out"
        )
    refuse_running(found, wanted.can_id)
    kept = {True: "and it is kept when its power goes", False: "until its power goes"}[wanted.save]
    if found.family == asking.MIT:
        kept = "whether it is kept when its power goes, a `scan` after that tells"
    tell([f"id {wanted.can_id}, {found.family}", f"  position: {found.position:.4f} rad -> 0 rad, {kept}"])
    if not confirm("change that", wanted.yes):
        tell(["nothing was changed"])
        return True
    bus.send(found.frame, "set zero")
    bus.listen(LOOK)
    after = None
    for _ in range(round(SILENCE / LOOK)):
        if (after := found.look()) is not None:
            break
    fine = after is not None and abs(after.position) < CLOSE
    told = "not told" if after is None else f"{after.position:.4f} rad"
    tell([f"done: position is {told}" if fine else f"NOT done: position is {told}"])
    return fine


def find(bus, can_id, permanent):
    """The Found of an id, None where it is nobody, or no CubeMars."""

    def report():
        return servo_drives(bus.listen(LOOK)).get(can_id)

    def echo():
        return servo_drives([*bus.listen(0.0), *asked(bus, can_id)]).get(can_id)

    def state():
        return bus.ask(
            asking.question(can_id), "disable", lambda *frame: asking.answer(*frame, can_id), patience=LOOK, attempts=1
        )

    for look in (report, state, echo):
        answer = look()
        if answer is not None and answer.family == asking.ROBSTRIDE_MIT:
            return None
        if answer is not None:
            frame = (can_id, False, SET_ZERO) if answer.family == asking.MIT else frames.origin(can_id, permanent)
            return Found(answer.family, answer.position, answer.current, look, frame)
    return None


def asked(bus, can_id):
    """What a V3.0 board that reports when it is asked says to a disable."""
    bus.send(asking.question_of_v3(can_id), "disable of V3.0 boards")
    return bus.listen(LOOK)


def refuse_running(found, can_id):
    """BadInput if it moves, or holds something."""
    again = found.look()
    if again is None:
        raise BadInput(
            f"id {can_id} has not answered a second time: whether it runs is not known, so nothing was changed"
        )
    current = max((abs(current) for current in (found.current, again.current) if current is not None), default=0.0)
    if not abs(again.position - found.position) < STILL or not current < frames.QUIET:
        holding = f", {current:.2f} A" if current else ""
        raise BadInput(
            f"id {can_id} runs (from {found.position:.3f} to {again.position:.3f} rad{holding}): stop "
            "what drives it first; "
            "nothing was changed"
        )

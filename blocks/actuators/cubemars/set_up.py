"""Zero of a CubeMars drive: its present position becomes 0. No other setting is available over CAN.

    MIT mode               FF..FE after a disable; then the drive may be silent for a second. Whether the zero is kept
                           without power depends on the firmware; a query after the next power cycle shows it
    servo mode, V3.0       origin, until power-off; with save, in the drive's flash memory

A drive that carries current or moves is not changed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from blocks.actuators.cubemars import frames, queries
from blocks.actuators.mit_frames import SET_ZERO
from blocks.actuators.queries import disable_in_mit_mode
from graph.dialogue import Confirm, Dialogue, Frame, Listen, Rejected, Send, Show, ask
from graph.family import Answer

if TYPE_CHECKING:
    from graph.family import Request

STILL_TOLERANCE = 0.02  # rad between two queries
ZERO_TOLERANCE = 0.02  # rad
QUERY_TIME = 0.25  # s: a drive in servo mode reports at 1 Hz to 500 Hz, mostly at 50 or more
SILENT_TIME = 1.5  # s after which a drive in MIT mode responds again
VENDOR_PROGRAM = (
    "the id, mode and limits of a CubeMars can be set only with CubeMars' software; over CAN only --zero is available. "
    "Connect the drive's serial port with the vendor's R-Link adapter, set the id and the mode (MIT or servo) on the "
    "page of CAN settings, and save them"
)


@dataclass
class Target:
    """A drive whose zero can be set. query : dialogue that returns the next Answer, or None; frame : sets the zero"""

    answer: Answer
    query: Callable[[], Dialogue]
    frame: Frame


def set_up(request: Request) -> Dialogue:
    """Dialogue of graph.family.Family.set_up."""
    if request.other_than("--zero", "--save") or not request.zero:
        read = reader(request.can_id)
        if (yield from ask(disable_in_mit_mode(request.can_id), "disable", read, attempts=1)) is None:
            return None
        raise Rejected(f"id {request.can_id}: {VENDOR_PROGRAM}")
    target: Target | None = yield from find(request.can_id, request.save)
    if target is None:
        return None
    family, in_mit_mode = target.answer.family, target.answer.family == queries.MIT
    if in_mit_mode and request.save:
        raise Rejected(f"--save: id {request.can_id} is a CubeMars in MIT mode, which has no save command. Omit --save")
    yield from refuse_running(target, request.can_id)
    kept = "permanently" if request.save else "until the power is removed"
    if in_mit_mode:
        kept = "permanently or until the power is removed, depending on the firmware: run `scan` after a power cycle"
    position = target.answer.position
    yield Show((f"id {request.can_id}, {family}", f"  position: {position:.4f} rad -> 0 rad, {kept}"))
    if not (yield Confirm("apply these changes")):
        return True
    yield Send(target.frame, "set zero")
    yield Listen(QUERY_TIME)
    after: Answer | None = None
    for _ in range(round(SILENT_TIME / QUERY_TIME)):
        after = yield from target.query()
        if after is not None:
            break
    position = None if after is None else after.position
    confirmed = position is not None and abs(position) < ZERO_TOLERANCE
    reported = "not reported" if position is None else f"{position:.4f} rad"
    yield Show((f"done: position is {reported}" if confirmed else f"NOT done: position is {reported}",))
    return confirmed


def reader(can_id: int) -> Callable[..., Any]:
    """Return a function that reads the state of a drive from a frame, for `graph.dialogue.ask`."""
    return partial(queries.state, can_id=can_id)


def find(can_id: int, permanent: bool) -> Dialogue:
    """Return the Target of an id, None where no CubeMars drive responds."""

    def report() -> Dialogue:
        return queries.reports((yield Listen(QUERY_TIME))).get(can_id)

    def state() -> Dialogue:
        frame = disable_in_mit_mode(can_id)
        return (yield from ask(frame, "disable", reader(can_id), timeout=QUERY_TIME, attempts=1))

    def echo() -> Dialogue:
        yield Send(queries.disable_v3(can_id), queries.V3_PURPOSE)
        return queries.reports((yield Listen(QUERY_TIME))).get(can_id)

    for query in (report, state, echo):
        answer = yield from query()
        if answer is not None:
            in_mit_mode = answer.family == queries.MIT
            frame = (can_id, False, SET_ZERO) if in_mit_mode else frames.origin(can_id, permanent)
            return Target(answer, query, frame)
    return None


def refuse_running(target: Target, can_id: int) -> Dialogue:
    """Raise Rejected if the drive moves or carries current."""
    first, again = target.answer, (yield from target.query())
    if again is None:
        raise Rejected(
            f"id {can_id} did not reply a second time, so it may be moving; nothing was changed. Run the command again"
        )
    current = max((abs(current) for current in (first.current, again.current) if current is not None), default=0.0)
    if not abs(again.position - first.position) < STILL_TOLERANCE or not current < frames.QUIET:
        holding = f", {current:.2f} A" if current else ""
        raise Rejected(
            f"id {can_id} is running (from {first.position:.3f} to {again.position:.3f} rad{holding}); nothing was "
            "changed. End the program that commands it first"
        )

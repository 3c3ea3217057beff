"""Orders of a page, and how the run is asked. A message that is none of these is refused.

    {"do": "stop"}                                      any page
    {"do": "operate", "take": true}                     a page that may operate: take the controls, or give them back
    {"do": "set", "id": 7, "changes": [[0, 0.5], ...]}  the operator: change live parameters together, by index
    {"do": "mark", "id": 8, "note": "new shoes"}        the operator: mark this tick, with a note or ""
    {"do": "seen", "at": 1234567}                       a page that may operate: it has the frame of this time

The loop decides: it compares each value with bounds of its own. An order with an `id` is answered:

    {"type": "answer", "id": 7, "taken": true, "tick": 812, "text": ""}
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

import msgspec

from cext.schedule.mailbox_writer import CHANGE_LIMIT, Writer

if TYPE_CHECKING:
    from runtime.record.panel.view import View

POLL_PERIOD = 0.005  # s
TAKE_TIMEOUT = 2.0  # s, to which TAKE_TICKS are added, for the run to take a request
TAKE_TICKS = 4
ORIGIN = "panel"
NOTE_LENGTH = 200  # characters


class Stop(msgspec.Struct, tag_field="do", tag="stop", forbid_unknown_fields=True):
    """Stop the run."""


class Operate(msgspec.Struct, tag_field="do", tag="operate", forbid_unknown_fields=True):
    """Take the controls, or give them back."""

    take: bool


class Set(msgspec.Struct, tag_field="do", tag="set", forbid_unknown_fields=True):
    """Change live parameters in one tick."""

    id: int
    changes: list[tuple[int, float]]


class Mark(msgspec.Struct, tag_field="do", tag="mark", forbid_unknown_fields=True):
    """Mark the tick."""

    id: int
    note: Annotated[str, msgspec.Meta(max_length=NOTE_LENGTH)] = ""


class Seen(msgspec.Struct, tag_field="do", tag="seen", forbid_unknown_fields=True):
    """Confirm a frame, whose time in µs is `at`."""

    at: int


ORDERS = msgspec.json.Decoder(Stop | Operate | Set | Mark | Seen)


class Mailbox:
    """The panel's way to the run. view : View of the run"""

    def __init__(self, view: View) -> None:
        self.view, self.shared = view, view.shared
        self.writer = Writer(view.shared, ORIGIN)
        self.noted: Callable[[], None] = lambda: None  # called after a note
        self.notes: list[dict[str, Any]] = []  # on marks, which the recorder has not been sent yet
        self.asking: set[asyncio.Future[dict[str, Any]]] = set()

    def stop(self, page: int) -> None:
        """Request the end of the run. Waits for nothing. page : number of the page that asks"""
        self.writer.stop(page)

    def problem(self, order: Set) -> str:
        """Return why an order cannot be carried out, "" if the loop is to decide."""
        parameters, indices = self.view.table.parameters, [index for index, _ in order.changes]
        if not 0 < len(order.changes) <= CHANGE_LIMIT:
            return f"expected 1 to {CHANGE_LIMIT} changes"
        if len(set(indices)) < len(indices) or not all(0 <= index < len(parameters) for index in indices):
            return "no such live parameter"
        if any(parameters[index].path in self.view.withheld for index in indices):
            return "a page never arms a drive: use `set`"
        return ""

    async def carry_out(self, order: Set | Mark, page: int) -> dict[str, Any]:
        """Pass an order of a page on to the loop, and wait for its answer. Returns the answer for the page."""
        problem = self.problem(order) if isinstance(order, Set) else ""
        if problem:
            return answered(order, problem)
        asking = asyncio.ensure_future(self.ask(order, page))
        self.asking.add(asking)
        asking.add_done_callback(self.asking.discard)
        return await asyncio.shield(asking)  # the letter is read and freed although its page is gone

    async def ask(self, order: Set | Mark, page: int) -> dict[str, Any]:
        """Post a letter, and wait until the loop has answered it."""
        until = time.monotonic() + TAKE_TIMEOUT + TAKE_TICKS / self.view.plan["rate"]
        ticket = None
        while ticket is None:
            ticket = self.writer.set(order.changes, page) if isinstance(order, Set) else self.writer.mark(page)
            if ticket is None:
                if time.monotonic() > until:
                    return answered(order, "the mailbox of the run is full")
                await asyncio.sleep(POLL_PERIOD)
        while (answer := self.writer.answer(ticket)) is None:
            late = time.monotonic() > until or self.shared.closed
            if late and self.writer.withdraw(ticket):
                return answered(order, "the run has not taken it")
            await asyncio.sleep(POLL_PERIOD)
        verdict, tick, number = answer
        if verdict == "taken":
            if isinstance(order, Mark) and order.note.strip():
                self.notes.append({"number": number, "tick": tick, "text": printable(order.note), "by": f"page {page}"})
                self.noted()
            return {**answered(order, ""), "tick": tick, "number": number}
        broken = self.view.table.broken(self.shared, dict(order.changes)) if isinstance(order, Set) else []
        return answered(order, "the run has ended" if verdict == "over" else "; ".join(broken) or verdict)


def answered(order: Set | Mark, problem: str) -> dict[str, Any]:
    """Return the answer to an order. problem : "" if it was carried out"""
    return {"type": "answer", "id": order.id, "taken": not problem, "text": problem}


def printable(note: str) -> str:
    """Return a note in one line, without control characters."""
    return " ".join("".join(character if character.isprintable() else " " for character in note).split())

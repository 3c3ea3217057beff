"""One open page: the messages to it, and its orders."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import msgspec
from websockets.exceptions import ConnectionClosed

from runtime.record.panel.access import OPERATE
from runtime.record.panel.orders import ORDERS, Mark, Operate, Seen, Set, Stop, answered
from runtime.record.panel.view import encode

if TYPE_CHECKING:
    from collections.abc import Mapping

    from websockets.asyncio.server import ServerConnection

MESSAGE_RATE, MESSAGE_BURST = 50.0, 100.0  # messages of a page per second; and at once
SEEN_LIMIT = 64  # newest frames that a page may confirm
WAITING_LIMIT = 128  # orders of a page that wait for the run


class Page:
    """One open page.

    server : runtime.record.panel.server.Server
    number : of the page, from 1
    role : "view" or "operate": what its token allows
    events : messages that it has not been sent yet
    orders : its orders that wait, carried out one after the other, so that the last value of a slider stays
    subscriptions : {channel: number} that a client of Foxglove has asked for
    """

    subscriptions: Mapping[int, int] = {}

    def __init__(self, server: Any, connection: ServerConnection, number: int, role: str) -> None:
        self.server, self.connection, self.number, self.role = server, connection, number, role
        self.events: deque[str | bytes] = deque()
        self.orders: asyncio.Queue[Set | Mark] = asyncio.Queue(WAITING_LIMIT)
        self.sent: deque[int] = deque(maxlen=SEEN_LIMIT)  # times of the frames that it has not confirmed, in µs
        self.budget, self.at = MESSAGE_BURST, time.monotonic()
        self.refused = 0

    @property
    def name(self) -> str:
        """Name of the page for people."""
        return f"page {self.number}"

    def greet(self) -> None:
        """Send what a page needs once."""
        view = self.server.view
        hello = {**view.hello(), "page": self.name, "role": self.role, "link": self.server.link(self.role)}
        self.events += [encode(hello), *map(encode, view.events)]

    def renew(self) -> None:
        """Take what is new in the run, before it is sent. A page is sent the newest frame, whatever came before it."""

    def tell(self, text: str, event: dict[str, Any]) -> None:
        """Send an event of the recording. text : in the form for pages, "" for one that they do not show"""
        if text:
            self.events.append(text)

    async def send(self) -> None:
        """Send the events, the newest status and the newest frame, as fast as the page takes them."""
        status = ""
        with suppress(ConnectionClosed):
            while True:
                while self.events:
                    await self.connection.send(self.events.popleft())
                if status is not self.server.status:
                    status = self.server.status
                    await self.connection.send(status)
                at, frame = self.server.frame
                if frame:
                    self.sent.append(at)
                    await self.connection.send(frame)
                await self.server.news.wait()

    def take(self, message: str | bytes) -> bool:
        """Carry out an order. Returns False for a message that was refused."""
        server = self.server
        try:
            order = ORDERS.decode(message) if isinstance(message, str) else None
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            order = None
        if isinstance(order, Stop):  # from each page, whatever its role and rate
            server.mailbox.stop(self.number)
            return True
        if isinstance(order, Seen) and self.has_seen(order.at):  # at most as many as the server has sent frames
            if self is server.operator:
                server.show_link(self, 1000 * order.at)
            return True
        if not self.in_budget():
            return server.refuse("rate")
        if order is None or isinstance(order, Seen):
            return server.refuse("malformed")
        if self.role != OPERATE:
            return server.refuse("role")
        if isinstance(order, Operate):
            if order.take and self is not server.operator:
                server.hand_over(self, "taken")
            elif not order.take and self is server.operator:
                server.hand_over(None, "returned")
            return True
        if self is not server.operator:
            return server.refuse("role")
        self.queue(order)
        return True

    def queue(self, order: Set | Mark) -> None:
        """Let an order wait for its turn."""
        try:
            self.orders.put_nowait(order)
        except asyncio.QueueFull:
            self.answer(order, answered(order, "too many requests wait for the run"))

    async def carry_out(self) -> None:
        """Pass the orders to the run, one after the other, and the answers to the page."""
        while True:
            order = await self.orders.get()
            self.answer(order, await self.server.mailbox.carry_out(order, self.number))

    def answer(self, order: Set | Mark, answer: dict[str, Any]) -> None:
        """Send the answer to an order."""
        self.events.append(encode(answer))
        self.server.wake()

    def has_seen(self, at: int) -> bool:
        """Take the confirmation of a frame. Returns False for one that was not sent, or confirmed already."""
        if at not in self.sent:
            return False
        while self.sent.popleft() != at:
            pass
        return True

    def in_budget(self) -> bool:
        """Count a message. Returns whether the page is within its rate."""
        now = time.monotonic()
        self.budget = min(MESSAGE_BURST, self.budget + (now - self.at) * MESSAGE_RATE) - 1.0
        self.at = now
        if self.budget < 0.0:
            self.budget = 0.0
            return False
        return True

"""The server of the panel: files of the page over HTTP, frames and orders over WebSocket, on one port.

Each page has a task of its own that sends the newest frame: a stalled page misses frames, and delays no other. What a
page sends is limited in size and rate; malformed messages are refused and counted, and a page that
sends too many of them is closed.

The loop watches the page with the controls, if the diagram demands it: the server shows it the time of the newest frame
that this page has confirmed. A frame that was held up on its way counts with the time at which it was made, in both
directions. The page confirms it when its own code has it, which a page that is frozen does not, although its connection
is alive; browsers slow down the timers of a page in the background, but not its messages.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import msgspec
from websockets.exceptions import ConnectionClosed

from runtime.record.panel import access
from runtime.record.panel.access import OPERATE, VIEW
from runtime.record.panel.orders import ORDERS, Mailbox, Mark, Operate, Seen, Set, Stop, answered
from runtime.record.panel.site import PAGE_FOLDER, SOCKET, Site, files_of
from runtime.record.panel.view import FRAME_PERIOD, STATUS_PERIOD, encode

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection

    from runtime.record.panel.view import View

FILES = {
    **files_of(PAGE_FOLDER, "index.html", "page.js", "diagram.js", "painter.js", "parameters.js"),
    **{f"/{name}": (PAGE_FOLDER, name) for name in ("subject.css", "subject.js")},
    "/subject": (PAGE_FOLDER, "subject.html"),
}
WATCHING = "/watching"  # socket of pages that only show and stop the run, whatever their token
MESSAGE_LIMIT = 4096  # bytes of a message of a page
MESSAGE_RATE, MESSAGE_BURST = 50.0, 100.0  # messages of a page per second; and at once
SEEN_LIMIT = 64  # newest frames that a page may confirm
LINK_FRAMES = 15  # that a page has confirmed before the run relies on it: one that loads has work to do
WAITING_LIMIT = 128  # orders of a page that wait for the run
REFUSED_LIMIT = 50  # messages of one page that are refused, after which it is closed
TOKEN_TIMEOUT = 5.0  # s for the first message, which has the token
POLICY, TRY_LATER, GOING_AWAY, NOT_CLOSED = 1008, 1013, 1001, 1006  # codes of RFC 6455


class Page:
    """One open page.

    number : of the page, from 1
    role : "view" or "operate": what its token allows
    events : messages that it has not been sent yet
    orders : its orders that wait, carried out one after the other, so that the last value of a slider stays
    """

    def __init__(self, connection: ServerConnection, number: int, role: str) -> None:
        self.connection, self.number, self.role = connection, number, role
        self.events: deque[str] = deque()
        self.orders: asyncio.Queue[Set | Mark] = asyncio.Queue(WAITING_LIMIT)
        self.sent: deque[int] = deque(maxlen=SEEN_LIMIT)  # times of the frames that it has not confirmed, in µs
        self.budget, self.at = MESSAGE_BURST, time.monotonic()
        self.refused = 0

    @property
    def name(self) -> str:
        """Name of the page for people."""
        return f"page {self.number}"

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


class Server(Site):
    """The server of one run.

    view : View of the run
    host : address that it listens on
    secret : of the run, for the tokens
    """

    def __init__(self, view: View, host: str, secret: str) -> None:
        super().__init__(host, FILES, MESSAGE_LIMIT, (SOCKET, WATCHING))
        self.view, self.mailbox = view, Mailbox(view)
        self.tokens = {} if self.local else access.tokens(secret)
        self.opened = 0
        self.operator: Page | None = None
        self.confirmed = 0  # frames by the operator's page, at most LINK_FRAMES
        self.closing = False
        self.frame, self.status = (0, b""), ""
        self.news = asyncio.Event()

    def addresses(self) -> dict[str, str]:
        """Return {role: address for a browser}."""
        return {role: f"{self.address}#{token}" for token, role in self.tokens.items()} or {OPERATE: self.address}

    # WebSocket

    async def serve_page(self, connection: ServerConnection) -> None:
        """Serve one page until its connection ends."""
        role = OPERATE if self.local else await self.role_of(connection)
        if role is None:
            self.refused["token"] += 1
            await connection.close(POLICY, "wrong token")
            return
        assert connection.request is not None
        if connection.request.path == WATCHING:
            role = VIEW
        self.opened += 1
        page = self.pages[self.opened] = Page(connection, self.opened, role)
        if role == OPERATE and self.operator is None:
            self.operator = page
        page.events += [encode({**self.view.hello(), "page": page.name, "role": role}), *map(encode, self.view.events)]
        self.refresh()
        tasks = [asyncio.create_task(task) for task in (self.send_to(page), self.carry_out(page))]
        try:
            async for message in connection:
                if not self.take(page, message):
                    page.refused += 1
                    if page.refused > REFUSED_LIMIT:
                        await connection.close(POLICY, "too many refused messages")
        except ConnectionClosed:
            pass
        finally:
            for task in tasks:
                task.cancel()
            del self.pages[page.number]
            if self.operator is page:
                cut = connection.close_code == NOT_CLOSED
                self.hand_over(None, "ended" if self.closing else "cut" if cut else "closed")
            self.refresh()

    async def role_of(self, connection: ServerConnection) -> str | None:
        """Return the role of a page from its first message, which is the token; None without a valid one."""
        self.pending += 1
        try:
            token = await asyncio.wait_for(connection.recv(), TOKEN_TIMEOUT)
        except (asyncio.TimeoutError, ConnectionClosed):
            return None
        finally:
            self.pending -= 1
        return access.role_of(token if isinstance(token, str) else "", self.tokens)

    async def send_to(self, page: Page) -> None:
        """Send the events, the newest status and the newest frame to a page, as fast as it takes them."""
        status = ""
        with suppress(ConnectionClosed):
            while True:
                while page.events:
                    await page.connection.send(page.events.popleft())
                if status is not self.status:
                    status = self.status
                    await page.connection.send(status)
                at, frame = self.frame
                if frame:
                    page.sent.append(at)
                    await page.connection.send(frame)
                await self.news.wait()

    def take(self, page: Page, message: str | bytes) -> bool:
        """Carry out an order. Returns False for a message that was refused."""
        try:
            order = ORDERS.decode(message) if isinstance(message, str) else None
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            order = None
        if isinstance(order, Stop):  # from each page, whatever its role and rate
            self.mailbox.stop(page.number)
            return True
        if isinstance(order, Seen) and page.has_seen(order.at):  # at most as many as the server has sent frames
            if page is self.operator:
                self.show_link(page, 1000 * order.at)
            return True
        if not page.in_budget():
            return self.refuse("rate")
        if order is None or isinstance(order, Seen):
            return self.refuse("malformed")
        if page.role != OPERATE:
            return self.refuse("role")
        if isinstance(order, Operate):
            if order.take and page is not self.operator:
                self.hand_over(page, "taken")
            elif not order.take and page is self.operator:
                self.hand_over(None, "returned")
            return True
        if page is not self.operator:
            return self.refuse("role")
        try:
            page.orders.put_nowait(order)
        except asyncio.QueueFull:
            self.reply(page, answered(order, "too many requests wait for the run"))
        return True

    def hand_over(self, page: Page | None, why: str) -> None:
        """Give the controls to a page, or to none. why : as of SharedState.unlink_page, for the page that had them"""
        if self.operator is not None and self.confirmed == LINK_FRAMES:
            self.view.shared.unlink_page(why, self.operator.number, 0 if page is None else page.number)
        self.operator, self.confirmed = page, 0
        self.refresh()

    def show_link(self, page: Page, at: int) -> None:
        """Show the loop that the page with the controls has confirmed a frame. at : ns of CLOCK_MONOTONIC"""
        if self.confirmed == LINK_FRAMES:
            self.view.shared.beat_page(at)
            return
        self.confirmed += 1
        if self.confirmed == LINK_FRAMES:
            self.view.shared.link_page(page.number, at)

    def refuse(self, why: str) -> bool:
        """Count a refused message. Returns False."""
        self.refused[why] += 1
        return False

    async def carry_out(self, page: Page) -> None:
        """Pass the orders of a page to the run, one after the other, and the answers to the page."""
        while True:
            self.reply(page, await self.mailbox.carry_out(await page.orders.get(), page.number))

    def reply(self, page: Page, message: dict[str, Any]) -> None:
        """Send a message to one page."""
        page.events.append(encode(message))
        self.wake()

    # News

    def tell(self, message: dict[str, Any]) -> None:
        """Send a message to all pages."""
        text = encode(message)
        for page in self.pages.values():
            page.events.append(text)
        self.wake()

    def refresh(self) -> None:
        """Renew the status."""
        pages = [
            {"name": page.name, "role": page.role, "operates": page is self.operator} for page in self.pages.values()
        ]
        self.status = encode({**self.view.status(), "pages": pages, "refused": sum(self.refused.values())})
        self.wake()

    def wake(self) -> None:
        """Let every task send what is new."""
        self.news.set()
        self.news = asyncio.Event()

    async def publish(self, besides: Callable[[], None]) -> None:
        """Renew frame and status continuously. besides : what else is called each time"""
        state, due = None, 0.0
        while True:
            now = time.monotonic()
            self.frame = self.view.frame()
            if now >= due or self.view.shared.state != state:
                state, due = self.view.shared.state, now + STATUS_PERIOD
                self.refresh()
            else:
                self.wake()
            besides()
            await asyncio.sleep(FRAME_PERIOD)

    async def close(self) -> None:
        """Send the last status to all pages, and close them."""
        self.closing = True
        self.frame = self.view.frame()
        self.refresh()
        await asyncio.sleep(FRAME_PERIOD)
        await super().close()

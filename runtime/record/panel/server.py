"""The server of the panel: files of the page over HTTP, frames and orders over WebSocket, on one port.

Each page has a task of its own that sends the newest frame: a stalled page misses frames, and delays no other. What a
page sends is limited in size and rate; malformed messages are refused and counted, and a page that
sends too many of them is closed. Clients of Foxglove are pages too, with messages of their own.

The loop watches the page with the controls, if the diagram demands it: the server shows it the time of the newest frame
that this page has confirmed. A frame that was held up on its way counts with the time at which it was made, in both
directions. The page confirms it when its own code has it, which a page that is frozen does not, although its connection
is alive; browsers slow down the timers of a page in the background, but not its messages.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from websockets.exceptions import ConnectionClosed

from runtime.record.panel import access
from runtime.record.panel.access import OPERATE, VIEW
from runtime.record.panel.foxglove import PROTOCOLS, Client, Feed
from runtime.record.panel.orders import Mailbox
from runtime.record.panel.pages import Page
from runtime.record.panel.site import PAGE_FOLDER, SOCKET, Site, files_of
from runtime.record.panel.view import FRAME_PERIOD, STATUS_PERIOD, encode

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request

    from runtime.record.panel.view import View

FILES = {
    **files_of(PAGE_FOLDER, "index.html", "page.js", "diagram.js", "painter.js", "parameters.js"),
    **{f"/{name}": (PAGE_FOLDER, name) for name in ("subject.css", "subject.js")},
    "/subject": (PAGE_FOLDER, "subject.html"),
}
WATCHING = "/watching"  # socket of pages that only show and stop the run, whatever their token
MESSAGE_LIMIT = 1 << 14  # bytes of a message of a page, which may name all parameters
LINK_FRAMES = 15  # that a page has confirmed before the run relies on it: one that loads has work to do
REFUSED_LIMIT = 50  # messages of one page that are refused, after which it is closed
TOKEN_TIMEOUT = 5.0  # s for the first message, which has the token
POLICY, TRY_LATER, GOING_AWAY, NOT_CLOSED = 1008, 1013, 1001, 1006  # codes of RFC 6455


class Server(Site):
    """The server of one run.

    view : View of the run
    host : address that it listens on
    secret : of the run, for the tokens
    """

    def __init__(self, view: View, host: str, secret: str) -> None:
        super().__init__(host, FILES, MESSAGE_LIMIT, (SOCKET, WATCHING), PROTOCOLS)
        self.view, self.mailbox = view, Mailbox(view)
        self.tokens = access.tokens(secret)
        self.feed: Any = None  # for clients of Foxglove, once there is one
        self.opened = 0
        self.operator: Page | None = None
        self.confirmed = 0  # frames by the operator's page, at most LINK_FRAMES
        self.closing = False
        self.frame, self.status = (0, b""), ""
        self.news = asyncio.Event()

    def addresses(self) -> dict[str, str]:
        """Return {role: address for a browser}."""
        if self.local:
            return {OPERATE: self.address}
        return {role: f"{self.address}#{token}" for token, role in self.tokens.items()}

    def link(self, role: str) -> str:
        """Return the address for a client of Foxglove."""
        token = next(token for token, other in self.tokens.items() if other == role)
        return f"{self.address.replace('http', 'ws', 1)}?{token}"

    # WebSocket

    async def serve_page(self, connection: ServerConnection) -> None:
        """Serve one page until its connection ends."""
        role = await self.role_of(connection)
        if role is None:
            self.refused["token"] += 1
            await connection.close(POLICY, "wrong token")
            return
        if connection.subprotocol and self.feed is None:
            self.feed = await asyncio.to_thread(Feed, self.view)  # which imports Protobuf
        self.opened += 1
        kind = Client if connection.subprotocol else Page
        page = self.pages[self.opened] = kind(self, connection, self.opened, role)
        if role == OPERATE and self.operator is None and kind is Page:
            self.operator = page
        page.greet()
        self.refresh()
        tasks = [asyncio.create_task(task) for task in (page.send(), page.carry_out())]
        try:
            async for message in connection:
                if not page.take(message):
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
        assert connection.request is not None
        path, _, token = connection.request.path.partition("?")
        if connection.subprotocol:
            return access.role_of(token, self.tokens) or VIEW
        if not self.local:
            self.pending += 1
            try:
                first = await asyncio.wait_for(connection.recv(), TOKEN_TIMEOUT)
            except (asyncio.TimeoutError, ConnectionClosed):
                return None
            finally:
                self.pending -= 1
            role = access.role_of(first if isinstance(first, str) else "", self.tokens)
        else:
            role = OPERATE
        return role and (VIEW if path == WATCHING else role)

    def admits(self, request: Request, protocol: bool) -> bool:
        """Return whether a page or a client of Foxglove may connect.

        A program of this account may watch the run without a token. A browser states where its page is from, and a page
        of another site needs a token.
        """
        if not protocol:
            return super().admits(request, protocol)
        token = request.path.partition("?")[2]
        if token or not self.local:
            return access.role_of(token, self.tokens) is not None
        return "Origin" not in request.headers

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

    # News

    def take_event(self, event: dict[str, Any]) -> None:
        """Send an event of the recording to all pages."""
        shown = self.view.take_event(event)
        text = "" if shown is None else encode(shown)
        for page in self.pages.values():
            page.tell(text, event)
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

    def look(self) -> None:
        """Take what is new in the run."""
        self.view.row.keeps = any(page.subscriptions for page in self.pages.values())
        self.frame = self.view.frame()
        for page in self.pages.values():
            page.renew()

    async def publish(self, besides: Callable[[], None]) -> None:
        """Renew frame and status continuously. besides : what else is called each time"""
        state, due = None, 0.0
        while True:
            now = time.monotonic()
            self.look()
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
        self.look()
        self.refresh()
        await asyncio.sleep(FRAME_PERIOD)
        await super().close()

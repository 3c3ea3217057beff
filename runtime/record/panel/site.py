"""The site of a page: its files over HTTP and its WebSocket, on one port, and which connections it accepts."""

from __future__ import annotations

import asyncio
import errno
import logging
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress
from http import HTTPStatus
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from websockets.asyncio.server import serve
from websockets.datastructures import Headers
from websockets.http11 import Response
from websockets.typing import Subprotocol

from runtime.record.panel import access

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request

FIRST_PORT, PORTS = 8470, 10  # that are tried in turn
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
}
SECURITY = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
SOCKET = "/socket"
ADMITTED = "Only the panel's own page may connect, and a program whose address has a token of this run."
PAGE_LIMIT = 16
WRITE_LIMIT = 1 << 16  # bytes that wait for a stalled page
OPEN_TIMEOUT = 5.0  # s
PING_PERIOD = 2.0  # s
CLOSE_TIMEOUT = 0.3  # s


def files_of(package: str, *names: str) -> dict[str, tuple[str, str]]:
    """Return {"/NAME": (package, NAME)} of files of a page, the first of which is "/"."""
    return {f"/{name}" if place else "/": (package, name) for place, name in enumerate(names)}


PAGE_FOLDER = "runtime.record.panel.page"
HEAD = b"<!-- head.html -->\n"  # place of that file in each page
SHARED = {  # what all pages have in common
    **{f"/{name}": (PAGE_FOLDER, name) for name in ("page.css", "plots.js", "text.js")},
    "/uPlot.js": (PAGE_FOLDER, "uPlot.iife.min.js"),
    "/uPlot.css": (PAGE_FOLDER, "uPlot.min.css"),
}


class Site(ABC):
    """Server of one kind of page.

    host : address that it listens on
    files : {path of a request: (package, name of a file in it)}, besides SHARED
    message_limit : bytes of a message of a page
    sockets : paths of its WebSockets
    protocols : subprotocols that it speaks on any path
    """

    def __init__(
        self,
        host: str,
        files: Mapping[str, tuple[str, str]],
        message_limit: int,
        sockets: Iterable[str] = (SOCKET,),
        protocols: Iterable[str] = (),
    ) -> None:
        self.host, self.files, self.message_limit = host, {**SHARED, **files}, message_limit
        self.sockets, self.protocols = sockets, protocols
        self.local = access.is_local(host)
        self.pages: dict[int, Any] = {}
        self.pending = 0  # connections whose token has not arrived
        self.refused: Counter[str] = Counter()

    @abstractmethod
    async def serve_page(self, connection: ServerConnection) -> None:
        """Serve one page until its connection ends."""

    async def listen(self, port: int) -> None:
        """Listen on a port. Raises OSError."""
        logger = logging.getLogger("tickwork.panel")
        logger.addHandler(logging.NullHandler())
        logger.propagate = False
        self.server = await serve(
            self.serve_page,
            self.host,
            port,
            process_request=self.answer_request,
            select_subprotocol=lambda connection, offered: self.protocol_of(offered),
            compression=None,
            max_size=self.message_limit,
            max_queue=16,
            write_limit=WRITE_LIMIT,
            open_timeout=OPEN_TIMEOUT,
            ping_interval=PING_PERIOD,
            ping_timeout=2 * PING_PERIOD,
            close_timeout=CLOSE_TIMEOUT,
            server_header=None,
            logger=logger,
        )
        self.port = self.server.sockets[0].getsockname()[1]

    async def listen_first(self, port: int | None) -> None:
        """Listen on a port, or else on the first free one from FIRST_PORT on. Raises OSError with a text for people."""
        ports = [port] if port else range(FIRST_PORT, FIRST_PORT + PORTS)
        for each in ports:
            try:
                await self.listen(each)
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise OSError(error.errno, f"cannot listen on {self.host} port {each}: {error.strerror}") from None
            else:
                return
        which = f"port {port} is" if port else f"the ports {FIRST_PORT} to {ports[-1]} are"
        raise OSError(errno.EADDRINUSE, f"cannot listen on {self.host}: {which} in use")

    @property
    def address(self) -> str:
        """Address for a browser."""
        host = access.reachable(self.host)
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/"

    def answer_request(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer a request for a file; return None to open a WebSocket."""
        path = request.path.partition("?")[0]
        if self.local and not self.is_own(connection):
            return self.deny("account", HTTPStatus.FORBIDDEN, "This page belongs to another account of this computer.")
        offered = request.headers.get("Sec-WebSocket-Protocol", "").split(",")
        protocol = self.protocol_of([each.strip() for each in offered])
        if path in self.sockets or protocol:
            if not self.admits(request, protocol is not None):
                return self.deny("origin", HTTPStatus.FORBIDDEN, ADMITTED)
            if max(len(self.pages), self.pending) >= PAGE_LIMIT:
                return self.deny("pages", HTTPStatus.SERVICE_UNAVAILABLE, f"At most {PAGE_LIMIT} pages may be open.")
            return None
        if path not in self.files:
            return self.deny("path", HTTPStatus.NOT_FOUND, "The panel has no such page.")
        package, name = self.files[path]
        body = (files(package) / name).read_bytes()
        if HEAD in body:
            body = body.replace(HEAD, (files(PAGE_FOLDER) / "head.html").read_bytes())
        return response(HTTPStatus.OK, KINDS[name[name.rindex(".") :]], body)

    def protocol_of(self, offered: Iterable[str]) -> Subprotocol | None:
        """Return the subprotocol that a client is answered with, None for a page."""
        return next((Subprotocol(each) for each in self.protocols if each in offered), None)

    def admits(self, request: Request, protocol: bool) -> bool:
        """Return whether a WebSocket is opened. protocol : whether a subprotocol is spoken on it"""
        return access.same_origin(request.headers.get("Origin"), request.headers.get("Host"), self.local)

    def is_own(self, connection: ServerConnection) -> bool:
        """Return whether a connection is of this account."""
        peer, here = connection.remote_address, connection.local_address
        return access.of_this_account(peer[1], here[1])

    def deny(self, why: str, code: HTTPStatus, text: str) -> Response:
        """Count a refused request. Returns the response to it."""
        self.refused[why] += 1
        return response(code, "text/plain; charset=utf-8", text.encode() + b"\n")

    async def close(self) -> None:
        """Close all connections."""
        self.server.close()
        with suppress(asyncio.TimeoutError):
            await asyncio.wait_for(self.server.wait_closed(), 2 * CLOSE_TIMEOUT)


def response(code: HTTPStatus, kind: str, body: bytes) -> Response:
    """Return a response with the headers of every page."""
    headers = Headers({**SECURITY, "Content-Type": kind, "Content-Length": str(len(body)), "Connection": "close"})
    return Response(code.value, code.phrase, headers, body)

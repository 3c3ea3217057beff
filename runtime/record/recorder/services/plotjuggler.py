"""PlotJuggler over UDP: one datagram per tick, as JSON nested by block path.

    {"timestamp": 1767262212.34, "left": {"knee": {"position": 0.52, "torque": 3.1}, "imu": {"accel": [0.1, 0.2, 9.8]}}}

With batches a datagram is a list of such messages, each with its own timestamp (PlotJuggler 3.16 or later). Non-finite
values become null, which PlotJuggler skips; NaN in JSON stops its server. A message that exceeds one datagram is
divided by subsystem, with the same timestamp. Sending never blocks: datagrams that cannot be sent or delivered are
counted and dropped.
"""

import re
import socket
from collections.abc import Sequence
from contextlib import suppress
from time import monotonic
from typing import Any

import msgspec.json

from runtime.record.recorder.service import Service
from runtime.robot.loading.signal_selection import select

DATAGRAM_LIMIT = 65507  # bytes, UDP over IPv4
TIMESTAMP = "timestamp"
REOPEN_PERIOD = 1.0  # s, while the network fails
LISTENER_MINIMUM = 50  # delivered datagrams from which a listener counts as present
_ELEMENT = re.compile(r"^(.*?)((?:\[\d+\])+)$")


class PlotJugglerSender(Service):
    """Serves blocks.sinks.PlotJuggler."""

    def open(self) -> None:
        parameters = self.sink["parameters"]
        host, port = parameters["host"], parameters["port"]
        try:
            addresses = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        except socket.gaierror as error:
            raise OSError(error.errno, f"unknown host {host!r} ({error.strerror})") from None
        addresses.sort(key=lambda entry: entry[0] != socket.AF_INET)  # PlotJuggler listens on IPv4, also for localhost
        *self.kind, _, self.address = addresses[0]
        self.again, self.cut = 0.0, 0
        self.socket = self.open_socket()
        places = select(self.sink["columns"], parameters.get("signals", ""))
        self.messages = [Message([self.sink["columns"][place] for place in places], places)]
        self.began = 0.0 if parameters.get("time") == "relative" else None  # s since 1970 at tick 0
        self.decimation, self.batch = parameters.get("decimation", 1), parameters.get("batch", 1)
        # last: tick of the newest sample over the decimation; waiting: messages of the next datagram
        self.last, self.waiting = None, []
        self.sent = self.lost = 0
        self.problem, self.reported, self.returned = None, False, False
        # no report of a missing listener for a block of the diagram itself
        self.silent = not self.sink.get("wanted", True)

    def row(self, tick: int, time: float, values: list[float]) -> None:
        if self.decimation > 1:
            if tick // self.decimation == self.last:
                return
            self.last = tick // self.decimation
        if self.began is None:
            self.began = self.epoch()
        time += self.began
        index = 0
        while index < len(self.messages):
            datagram = self.messages[index].encode(time, values)
            if len(datagram) > DATAGRAM_LIMIT and self.messages[index].divisible:
                self.messages[index : index + 1] = self.messages[index].split()
                continue
            if self.batch == 1:
                self.send(datagram)
            else:
                self.gather(datagram)
            index += 1

    def reopen(self) -> None:
        """Open a new socket with the present address of this machine."""
        self.socket.close()
        self.socket = self.open_socket()

    def open_socket(self) -> socket.socket:
        """Return a new socket to the address of PlotJuggler."""
        made = socket.socket(*self.kind)
        made.setblocking(False)
        with suppress(OSError):  # no network yet
            made.connect(self.address)  # so that a refused datagram raises ConnectionRefusedError
        return made

    def gather(self, message: bytes) -> None:
        """Add a message to the next datagram, which is sent once full."""
        if self.waiting and sum(map(len, self.waiting)) + len(self.waiting) + len(message) + 2 > DATAGRAM_LIMIT:
            self.flush()
        self.waiting.append(message)
        if len(self.waiting) >= self.batch * len(self.messages):
            self.flush()

    def flush(self) -> None:
        if self.waiting:
            waiting, self.waiting = self.waiting, []
            self.send(b"[" + b",".join(waiting) + b"]")

    def send(self, datagram: bytes) -> None:
        """Send a datagram without waiting, or count it as lost."""
        for _ in range(2):
            try:
                self.socket.sendto(datagram, self.address)
                self.sent += 1
                if self.cut:
                    self.reopen()  # connected, to be notified if no process listens
                    self.report_recovery()
                    self.cut = 0
                return
            except ConnectionRefusedError as error:  # of the previous datagram; this one was not sent
                self.sent -= 1
                gone = self.sent - self.lost > LISTENER_MINIMUM
                self.silent = self.silent and not gone
                self.lose(
                    f"no process listens at {self.where}{' any more' if gone else ''}: "
                    "start the UDP server in PlotJuggler",
                    error,
                )
            except OSError as error:
                self.silent = False
                self.lose(f"cannot send to {self.where} ({error.strerror})", error)
                self.cut += 1
                if monotonic() >= self.again:  # the address of this machine may have changed
                    self.again = monotonic() + REOPEN_PERIOD
                    self.reopen()
                return

    def lose(self, reason: str, error: OSError) -> None:
        """Count a lost datagram and report the first one."""
        if not self.silent and not self.reported:
            self.reported = True
            self.report(f"{reason}; the run continues")
        self.lost += 1
        self.problem = error.strerror

    def report_recovery(self) -> None:
        """Report the first recovery of the network; later ones are not reported."""
        if not self.returned:
            self.returned = True
            self.report(f"sending works again; {self.cut} datagrams were lost")

    def report(self, text: str) -> None:
        """Print a line on the terminal."""
        self.say(f"tickwork: {self.sink.get('path', 'PlotJuggler')}: {text}")

    @property
    def where(self) -> str:
        """Address of PlotJuggler, as text."""
        return f"{self.address[0]} port {self.address[1]}"

    def close(self) -> dict[str, Any]:
        self.flush()
        self.socket.close()
        return {"datagrams": self.sent, "lost": self.lost, "trouble": self.problem, "to": self.where}


class Message:
    """A nested dict that is built once and filled every tick.

    columns : columns of the sink
    positions : their indices among the values of the sink
    """

    def __init__(self, columns: Sequence[dict[str, Any]], positions: Sequence[int] | None = None) -> None:
        self.columns = list(columns)
        self.positions = list(range(len(self.columns))) if positions is None else positions
        self.content: dict = {TIMESTAMP: 0.0}
        self.places = [self.place(column["path"]) for column in self.columns]
        self.kinds = [{"int": whole, "bool": truth}.get(column["dtype"]) for column in self.columns]

    def place(self, path: str) -> tuple[dict | list, Any]:
        """Return (container, key) of a column's value. A path that conflicts with another becomes a top-level key."""
        names = re.split(r"[/.]", path)
        match = _ELEMENT.match(names[-1])
        indices = [int(i) for i in re.findall(r"\d+", match[2])] if match else []
        if match:
            names[-1] = match[1]
        container = self.content
        for name in names[:-1]:
            if not isinstance(container, dict) or not isinstance(container.setdefault(name, {}), dict):
                return self.content, self.free(path)
            container = container[name]
        key: Any = names[-1]  # str in a dict, int in a list
        for index in indices:
            if isinstance(container, dict):
                container = container.setdefault(key, [])
            else:
                if container[key] is None:
                    container[key] = []
                container = container[key]
            if not isinstance(container, list):
                return self.content, self.free(path)
            container.extend([None] * (index + 1 - len(container)))
            key = index
        if isinstance(container, dict) and key in container:
            key, container = self.free(path), self.content
        container[key] = None
        return container, key

    def free(self, path: str) -> str:
        """Return an unused top-level key that begins with a path, and reserve it."""
        while path in self.content:
            path += "_"
        self.content[path] = None
        return path

    def encode(self, time: float, values: Sequence[float]) -> bytes:
        """Return the message as JSON. time : s; values : values of the sink"""
        self.content[TIMESTAMP] = time
        for (container, key), position, kind in zip(self.places, self.positions, self.kinds):
            value = values[position]
            container[key] = value if kind is None else kind(value)
        return msgspec.json.encode(self.content)  # NaN and infinities become null

    @property
    def divisible(self) -> bool:
        """Whether the message has several columns."""
        return len(self.columns) > 1

    def split(self) -> "list[Message]":
        """Return two messages with the columns of about half of the outermost subsystems each, or else in halves."""
        names = [re.split(r"[/.]", column["path"]) for column in self.columns]
        groups: list[list[int]] = []
        for depth in range(min(map(len, names))):
            by_name: dict[tuple[str, ...], list[int]] = {}
            for index, path in enumerate(names):
                by_name.setdefault(tuple(path[: depth + 1]), []).append(index)
            groups = list(by_name.values())
            if len(groups) > 1:
                break
        if len(groups) < 2:
            groups = [[index] for index in range(len(self.columns))]
        first = groups.pop(0)
        while len(groups) > 1 and len(first) + len(groups[0]) <= len(self.columns) / 2:
            first += groups.pop(0)
        halves = first, [index for group in groups for index in group]
        return [Message([self.columns[i] for i in half], [self.positions[i] for i in half]) for half in halves]


def whole(value: float) -> int | None:
    """Return a number as an int, None if it is not finite."""
    return int(value) if abs(value) < float("inf") else None


def truth(value: float) -> bool | None:
    """Return a number as a bool, None for NaN."""
    return bool(value) if value == value else None


SERVICE = PlotJugglerSender

"""PlotJuggler over UDP: a datagram a tick, JSON nested by block path.

    {"timestamp": 1767262212.34, "left": {"knee": {"position": 0.52, "torque": 3.1}, "imu": {"accel": [0.1, 0.2, 9.8]}}}

With batches a datagram is a list of such messages, each with its own timestamp, which PlotJuggler 3.16 and later take.
Whatever is not finite becomes null, which PlotJuggler skips; NaN in JSON would stop its server. What does not fit into
one datagram goes as several, a subsystem each, with the same timestamp. Sending never waits: a datagram that the
network does not take, or that nobody listens for, is counted and forgotten.
"""

import re
import socket
from contextlib import suppress
from time import monotonic
from typing import Any

import msgspec.json

from runtime.recorder.service import Service
from runtime.recording.signal_selection import chosen

DATAGRAM = 65507  # bytes, the most that UDP over IPv4 carries
STAMP = "timestamp"
RETRY = 1.0  # s between sockets, while the network takes nothing
WATCHED = 50  # datagrams that were taken: somebody was there
_ELEMENT = re.compile(r"^(.*?)((?:\[\d+\])+)$")


class PlotJugglerSender(Service):
    """Serves blocks.sinks.PlotJuggler."""

    def open(self):
        parameters = self.sink["parameters"]
        host, port = parameters["host"], parameters["port"]
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        except socket.gaierror as error:
            raise OSError(error.errno, f"there is no host {host!r} ({error.strerror})") from None
        found.sort(key=lambda entry: entry[0] != socket.AF_INET)  # "localhost" is both, and PlotJuggler listens on IPv4
        *self.kind, _, self.address = found[0]
        self.again, self.cut = 0.0, 0
        self.socket = self.connected()
        places = chosen(self.sink["columns"], parameters.get("signals", ""))
        self.messages = [Message([self.sink["columns"][place] for place in places], places)]
        self.began = 0.0 if parameters.get("time") == "relative" else None  # of the timestamps: s since 1970 at tick 0
        self.decimation, self.batch = parameters.get("decimation", 1), parameters.get("batch", 1)
        # the newest sample's tick over the decimation; messages of the datagram to come
        self.last, self.waiting = None, []
        self.sent = self.lost = 0
        self.trouble, self.said, self.returned = None, False, False
        # a block that the diagram has anyhow: who does not look on need not be told of it
        self.silent = not self.sink.get("wanted", True)

    def row(self, tick, time, values):
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
            if len(datagram) > DATAGRAM and self.messages[index].divisible:
                self.messages[index : index + 1] = self.messages[index].split()
                continue
            if self.batch == 1:
                self.send(datagram)
            else:
                self.gather(datagram)
            index += 1

    def reopen(self):
        """A new socket, with the address that this computer has now for its own."""
        self.socket.close()
        self.socket = self.connected()

    def connected(self):
        made = socket.socket(*self.kind)
        made.setblocking(False)
        with suppress(OSError):  # a network that is not there yet
            made.connect(self.address)  # so that a refused datagram raises ConnectionRefusedError
        return made

    def gather(self, message):
        """Into the datagram to come, which goes once it is full."""
        if self.waiting and sum(map(len, self.waiting)) + len(self.waiting) + len(message) + 2 > DATAGRAM:
            self.flush()
        self.waiting.append(message)
        if len(self.waiting) >= self.batch * len(self.messages):
            self.flush()

    def flush(self):
        if self.waiting:
            waiting, self.waiting = self.waiting, []
            self.send(b"[" + b",".join(waiting) + b"]")

    def send(self, datagram):
        for _ in range(2):
            try:
                self.socket.sendto(datagram, self.address)
                self.sent += 1
                if self.cut:
                    self.reopen()  # connected, so that we hear when nobody listens
                    self.tell_return()
                    self.cut = 0
                return
            except ConnectionRefusedError as error:  # of the one before; this one has not gone yet
                self.sent -= 1
                gone = self.sent - self.lost > WATCHED
                self.silent = self.silent and not gone
                self.lose(
                    f"nobody listens at {self.where}{' any more' if gone else ''}: in PlotJuggler start the UDP server",
                    error,
                )
            except OSError as error:
                self.silent = False
                self.lose(f"the network does not take what is sent to {self.where} ({error.strerror})", error)
                self.cut += 1
                if monotonic() >= self.again:  # this computer may have come back with another address
                    self.again = monotonic() + RETRY
                    self.reopen()
                return

    def lose(self, words, error):
        """Count a datagram. The first is told."""
        if not self.silent and not self.said:
            self.said = True
            self.tell(f"{words}; the run goes on")
        self.lost += 1
        self.trouble = error.strerror

    def tell_return(self):
        """That the network is there again: the first time, so that one which comes and goes does not fill the
        screen.
        """
        if not self.returned:
            self.returned = True
            self.tell(f"the network takes it again; {self.cut} datagrams were lost")

    def tell(self, words):
        self.say(f"tickwork: {self.sink.get('path', 'PlotJuggler')}: {words}")

    @property
    def where(self):
        return f"{self.address[0]} port {self.address[1]}"

    def close(self):
        self.flush()
        self.socket.close()
        return {"datagrams": self.sent, "lost": self.lost, "trouble": self.trouble, "to": self.where}


class Message:
    """A nested dict that is made once and filled every tick.

    columns : of the sink; positions : which of the sink's values they are
    """

    def __init__(self, columns, positions=None):
        self.columns = list(columns)
        self.positions = list(range(len(self.columns))) if positions is None else positions
        self.content: dict = {STAMP: 0.0}
        self.places = [self.place(column["path"]) for column in self.columns]
        self.kinds = [{"int": whole, "bool": truth}.get(column["dtype"]) for column in self.columns]

    def place(self, path) -> tuple[dict | list, Any]:
        """(container, key) where a column's value goes. A path that is taken, or in the way, becomes a key of its
        own.
        """
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

    def free(self, path):
        while path in self.content:
            path += "_"
        self.content[path] = None
        return path

    def encode(self, time, values):
        self.content[STAMP] = time
        for (container, key), position, kind in zip(self.places, self.positions, self.kinds):
            value = values[position]
            container[key] = value if kind is None else kind(value)
        return msgspec.json.encode(self.content)  # NaN and infinities become null

    @property
    def divisible(self):
        return len(self.columns) > 1

    def split(self):
        """Two messages or more with the same columns: by the outermost name that divides them, in halves if none
        does.
        """
        names = [re.split(r"[/.]", column["path"]) for column in self.columns]
        groups = {}
        for depth in range(min(map(len, names))):
            groups = {}
            for index, path in enumerate(names):
                groups.setdefault(tuple(path[: depth + 1]), []).append(index)
            if len(groups) > 1:
                break
        if len(groups) < 2:
            half = len(self.columns) // 2
            groups = {0: range(half), 1: range(half, len(self.columns))}
        return [
            Message([self.columns[i] for i in group], [self.positions[i] for i in group]) for group in groups.values()
        ]


def whole(value):
    return int(value) if abs(value) < float("inf") else None


def truth(value):
    return bool(value) if value == value else None

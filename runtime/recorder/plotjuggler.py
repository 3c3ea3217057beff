"""PlotJuggler over UDP: a datagram a tick, JSON nested by block path.

    {"timestamp": 12.34, "left": {"knee": {"position": 0.52, "torque": 3.1}, "imu": {"accel": [0.1, 0.2, 9.8]}}}

With batches a datagram is a list of such messages, each with its own timestamp, which PlotJuggler 3.16 and later take. Whatever is not
finite becomes null, which PlotJuggler skips; NaN in JSON would stop its server. What does not fit into one datagram goes as several, a
subsystem each, with the same timestamp. Sending never waits: a datagram that the network does not take is counted and forgotten.
"""

import re
import socket

import msgspec.json

from runtime.recorder.service import Service

DATAGRAM = 65507                # bytes, the most that UDP over IPv4 carries
STAMP = "timestamp"
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
        found.sort(key=lambda entry: entry[0] != socket.AF_INET)        # "localhost" is both, and PlotJuggler listens on IPv4
        family, kind, protocol, _, self.address = found[0]
        self.socket = socket.socket(family, kind, protocol)
        self.socket.setblocking(False)
        self.messages = [Message(self.sink["columns"])]
        self.decimation, self.batch = parameters.get("decimation", 1), parameters.get("batch", 1)
        self.last, self.waiting = None, []      # the newest sample's tick over the decimation; messages of the datagram to come
        self.sent = self.lost = 0
        self.trouble = None

    def row(self, tick, time, values):
        if self.decimation > 1:
            if tick // self.decimation == self.last:
                return
            self.last = tick // self.decimation
        index = 0
        while index < len(self.messages):
            datagram = self.messages[index].encode(time, values)
            if len(datagram) > DATAGRAM and self.messages[index].divisible:
                self.messages[index:index + 1] = self.messages[index].split()
                continue
            if self.batch == 1:
                self.send(datagram)
            else:
                self.gather(datagram)
            index += 1

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
        try:
            self.socket.sendto(datagram, self.address)
            self.sent += 1
        except OSError as error:
            if not self.lost:
                self.say(f"tickwork: {self.sink.get('path', 'PlotJuggler')}: the network does not take what is sent to {self.address[0]} port {self.address[1]} "
                         f"({error.strerror}); the run goes on")
            self.lost += 1
            self.trouble = error.strerror

    def close(self):
        self.flush()
        self.socket.close()
        return {"datagrams": self.sent, "lost": self.lost, "trouble": self.trouble, "to": f"{self.address[0]} port {self.address[1]}"}


class Message:
    """A nested dict that is made once and filled every tick.

    columns : of the sink; positions : which of the sink's values they are
    """

    def __init__(self, columns, positions=None):
        self.columns = list(columns)
        self.positions = list(range(len(self.columns))) if positions is None else positions
        self.content = {STAMP: 0.0}
        self.places = [self.place(column["path"]) for column in self.columns]
        self.kinds = [{"int": whole, "bool": truth}.get(column["dtype"]) for column in self.columns]

    def place(self, path):
        """(container, key) where a column's value goes. A path that is taken, or in the way, becomes a key of its own."""
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
        key = names[-1]
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
        return msgspec.json.encode(self.content)                # NaN and infinities become null

    @property
    def divisible(self):
        return len(self.columns) > 1

    def split(self):
        """Two messages or more with the same columns: by the outermost name that divides them, in halves if none does."""
        names = [re.split(r"[/.]", column["path"]) for column in self.columns]
        groups = {}
        for depth in range(min(map(len, names))):
            groups = {}
            for index, path in enumerate(names):
                groups.setdefault(tuple(path[:depth + 1]), []).append(index)
            if len(groups) > 1:
                break
        if len(groups) < 2:
            half = len(self.columns) // 2
            groups = {0: range(half), 1: range(half, len(self.columns))}
        return [Message([self.columns[i] for i in group], [self.positions[i] for i in group]) for group in groups.values()]


def whole(value):
    return int(value) if abs(value) < float("inf") else None


def truth(value):
    return bool(value) if value == value else None

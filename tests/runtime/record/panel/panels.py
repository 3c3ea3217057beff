"""Runs with a panel, and pages of it without a browser."""

import contextlib
import json
import re
import socket
import struct
import threading
import time
from collections import deque

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from runtime.record.panel.server import LINK_FRAMES
from tests.runtime.runs import Files, started, write
from tests.runtime.terminals import patient

# A knee that turns, a gain that may be changed, and a rule that holds between two limits.
ROBOT = """
import math

from blocks.actuators import CubeMars
from blocks.limiters import TorqueLimiter
from blocks.recorders import CsvRecorder
from graph import Block, Diagram, Input, Output, Param, subsystem


class Law(Block):
    "Torque that goes to and fro."

    gain = Param(1.0, "N·m", "amplitude of the torque", min=0.0, max=3.0, live=True)
    position = Input("rad")
    torque = Output("N·m")

    def step(self, position, t):
        {law}


with Diagram("robot", rate=200) as diagram:
    for number, side in enumerate(("left", "right"), 1):
        with subsystem(side):
            knee = CubeMars("AK10-9-V2.0", bus="legs", can_id=number, range=(-12.5, 12.5), wake_shift=0.0, name="knee")
            knee(torque_command=TorqueLimiter(limit=5.0)(Law(name="law")(knee.position)))
    CsvRecorder()
"""
SWING = "return self.gain * math.sin(5.0 * t)"


class Run:
    """A run with a panel. addresses : of the panel, by role"""

    def __init__(self, process, folder):
        self.process, self.folder, self.lines, self.addresses = process, folder, [], {}

    def await_line(self, pattern, timeout=30.0):
        """Read standard error until a line matches. Returns the match."""
        until = time.monotonic() + timeout
        while time.monotonic() < until:
            line = self.process.stderr.readline()
            assert line, f"the run has ended: {self.lines}"
            self.lines.append(line)
            if found := re.search(pattern, line):
                return found
        raise AssertionError(self.lines)

    @property
    def address(self):
        return next(iter(self.addresses.values()))

    def page(self, role=None, **headers):
        return Page.open(self.addresses[role] if role else self.address, **headers)

    def end(self, timeout=30):
        """Wait for the end. Returns (exit code, standard error)."""
        _, rest = self.process.communicate(timeout=timeout)
        return self.process.returncode, "".join(self.lines) + rest

    @property
    def files(self):
        return Files(self.folder / "recordings")


def free_port():
    """A port that no other test has been given."""
    with socket.create_server(("127.0.0.1", 0)) as made:
        return made.getsockname()[1]


@contextlib.contextmanager
def running(folder, *options, law=SWING, host="127.0.0.1", more=""):
    """A run in a process of its own, once its panel listens. It is stopped at the end if it still runs.

    more : further lines of its diagram
    """
    write(folder, ROBOT.format(law=law) + more)
    with started(
        "robot.py", "--panel", f"{host}:{free_port()}", "--record", "recordings", *options, cwd=folder
    ) as process:
        run = Run(process, folder)
        try:
            found = run.await_line(r"panel: (.*)")[1]
            run.addresses = {
                role or "all": address for role, address in re.findall(r"(?:to (\w+) )?(http\S+[^,\s])", found)
            }
            yield run
        finally:
            if process.poll() is None:
                process.terminate()
                process.communicate(timeout=30)


class Page:
    """A page without a browser: sends orders, and keeps what arrives."""

    confirms = False  # whether it confirms frames

    def __init__(self, connection, token):
        self.socket, self.hello, self.status, self.frames, self.events, self.answers = (
            connection,
            None,
            None,
            [],
            [],
            {},
        )
        if token:
            connection.send(token)
        self.until(lambda: self.hello and self.status)

    @classmethod
    def open(cls, address, place="/socket", **headers):
        base, _, token = address.partition("#")
        host = base.removeprefix("http://").rstrip("/")
        origin = headers.pop("origin", f"http://{host}")
        return cls(connect(f"ws://{host}{place}", origin=origin, compression=None, **headers).__enter__(), token)

    def take(self, timeout=10.0):
        """Take one message."""
        message = self.socket.recv(timeout=timeout)
        if isinstance(message, bytes):
            tick, state, at, *values = struct.unpack(f"<{len(message) // 8}d", message)
            if self.confirms:
                self.confirm(int(at))
            values, self.extremes = values[: len(values) // 3], values[len(values) // 3 :]
            self.frames.append((int(tick), self.hello["states"][int(state)], values))
            return
        message = json.loads(message)
        kind = message.pop("type")
        if kind == "hello":
            self.hello = message
        elif kind == "status":
            self.status = message
        elif kind == "event":
            self.events.append(message)
        else:
            self.answers[message["id"]] = message

    def until(self, condition, timeout=20.0):
        """Take messages until a condition holds."""
        end = time.monotonic() + timeout
        while not (value := condition()):
            assert time.monotonic() < end, (self.status, self.events, self.answers)
            self.take()
        return value

    def until_closed(self):
        """Take messages until the connection is closed. Returns the code."""
        with contextlib.suppress(ConnectionClosed):
            while True:
                self.take()
        return self.socket.close_code

    def send(self, **order):
        self.socket.send(json.dumps(order))

    def ask(self, do, **order):
        """Send an order, and return its answer."""
        number = len(self.answers) + 1000
        self.send(do=do, id=number, **order)
        return self.until(lambda: self.answers.get(number))

    def index(self, path):
        """Index of a live parameter."""
        return [each["path"] for each in self.hello["parameters"]].index(path)


class Watched(Page):
    """A page that a run watches: it takes and confirms frames by itself.

    lag : s by which it is late; frozen : whether its code stands still while its connection is alive
    """

    confirms, lag, frozen = True, 0.0, False

    def __init__(self, connection, token):
        self.seen = []  # (time of the wall clock, time of the frame) of its confirmations
        self.late = deque()
        super().__init__(connection, token)
        self.thread = threading.Thread(target=self.serve, daemon=True)
        self.thread.start()

    def confirm(self, at):
        self.late.append((time.time() + self.lag, at))
        while self.late and self.late[0][0] <= time.time() and not self.frozen:
            at = self.late.popleft()[1]
            if not self.seen or self.seen[-1][1] < at:
                self.seen.append((time.time(), at))
                self.send(do="seen", at=at)

    def serve(self):
        with contextlib.suppress(ConnectionClosed, OSError, TimeoutError):
            while True:
                self.take(60.0)

    def until(self, condition, timeout=20.0):
        """Wait until a condition holds."""
        if not hasattr(self, "thread"):
            return super().until(condition, timeout)
        return patient(condition, timeout)

    def operate(self):
        """Take the controls, and confirm frames with them until the run may be armed."""
        self.send(do="operate", take=True)
        self.until(lambda: {"name": self.hello["page"], "role": "operate", "operates": True} in self.status["pages"])
        count = len(self.seen)
        self.until(lambda: len(self.seen) > count + LINK_FRAMES + 1)


class Proxy:
    """A way to a port of this computer that can be cut, or hold every byte.

    flowing : threading.Event, cleared while it holds the bytes
    """

    def __init__(self, port):
        self.to, self.ends, self.flowing = port, [], threading.Event()
        self.flowing.set()
        self.server = socket.create_server(("127.0.0.1", 0))
        self.port = self.server.getsockname()[1]

    def __enter__(self):
        threading.Thread(target=self.accept, daemon=True).start()
        return self

    def __exit__(self, *exception):
        self.server.close()
        self.cut()
        self.flowing.set()

    def accept(self):
        with contextlib.suppress(OSError):
            while True:
                here, _ = self.server.accept()
                try:
                    there = socket.create_connection(("127.0.0.1", self.to))
                except OSError:
                    here.close()
                    continue
                self.ends += [here, there]
                for one, other in ((here, there), (there, here)):
                    one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    threading.Thread(target=self.pump, args=(one, other), daemon=True).start()

    def pump(self, one, other):
        with contextlib.suppress(OSError):
            while data := one.recv(1 << 16):
                self.flowing.wait()
                other.sendall(data)
        for end in (one, other):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def cut(self):
        """Cut every connection, without the farewell of its protocol."""
        while self.ends:
            end = self.ends.pop()
            with contextlib.suppress(OSError):
                end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                end.shutdown(socket.SHUT_RDWR)

"""The process that feeds Rerun from a socket, because Rerun's queues can block.

    order    4 bytes of length, a letter, and its content: P, the plan as JSON; R, rows of doubles (tick, time, values);
             E, an event as JSON; Q, the end
    answer   a line of JSON: {"ready": ...} or {"error": ...}; then {"gone": ...} if the viewer has closed, or
             {"done": {"rows": number of rows shown, "problem": null}}

It ends after the last order, or when the recorder has died or the viewer has closed.
"""

from __future__ import annotations

import json
import os
import select
import socket
import time
from contextlib import suppress
from struct import Struct
from typing import Any

from runtime.host.ending import ignore_signals

HEAD = Struct("<IB")
VIEWER_CHECK_PERIOD = 1.0  # s
FLUSH_PERIOD = 0.2  # s
PORT_TIMEOUT = 5.0  # s, for the server of the previous part to release its ports
FLUSH_TIMEOUT = 5.0  # s, after which the viewer or disk counts as failed
RECEIVE_SIZE = 1 << 20  # bytes
PLAN, ROWS, EVENT, QUIT = b"PREQ"


class Gone(Exception):
    """The viewer no longer takes data. The text is the reason in one line."""


def main(answers: int, control: int, descriptor: int) -> None:
    """Run the process. answers : descriptor of a pipe; control : pidfd of the recorder; descriptor : socket"""
    ignore_signals()
    os.nice(5)
    quiet()
    ready = False
    try:
        orders = Orders(descriptor, control)
        order = orders.next(None)
        assert order is not None  # without a timeout
        plan = json.loads(order[1])
        feed = Feed(plan, PORT_TIMEOUT if plan["part"] > 1 else 0.0)
        ready = say(answers, {"ready": feed.notice})
        follow(orders, feed)
        say(answers, {"done": {"rows": feed.count, "problem": None}})
    except Gone as error:
        say(answers, {"gone": str(error)})
    except Exception as error:  # of Rerun, disk or network: reported by the recorder
        say(
            answers,
            {"gone" if ready else "error": getattr(error, "strerror", None) or str(error) or type(error).__name__},
        )
    os._exit(0)  # Rerun would wait for a viewer that has gone


def follow(orders: Orders, feed: Feed) -> None:
    """Carry out orders up to the last one."""
    look_at = flush_at = 0.0
    while True:
        now = time.monotonic()
        if now >= look_at:
            feed.look()
            look_at = now + VIEWER_CHECK_PERIOD
        if now >= flush_at:
            feed.flush()
            flush_at = now + FLUSH_PERIOD
        order = orders.next(FLUSH_PERIOD)
        if order is None:
            continue
        kind, content = order
        if kind == ROWS:
            feed.rows(content)
        elif kind == EVENT:
            feed.event(json.loads(content))
        elif kind == QUIT:
            break
    feed.finish()


class Orders:
    """Receiver of complete orders from the socket."""

    def __init__(self, descriptor, control):
        self.socket = socket.socket(fileno=descriptor)
        self.socket.setblocking(False)
        self.received = bytearray()
        self.over = self.dead = False
        self.poll = select.poll()
        self.poll.register(self.socket, select.POLLIN)
        self.poll.register(control, select.POLLIN)
        self.control = control

    def next(self, timeout: float | None) -> tuple[int, bytes] | None:
        """Return (kind, content) of the next order, None after `timeout` s. The death of the recorder is an end."""
        while True:
            if len(self.received) >= HEAD.size:
                length, kind = HEAD.unpack_from(self.received)
                if len(self.received) >= HEAD.size + length:
                    content = bytes(self.received[HEAD.size : HEAD.size + length])
                    del self.received[: HEAD.size + length]
                    return kind, content
            if self.over:
                return QUIT, b""
            ready = self.poll.poll(0 if self.dead else None if timeout is None else timeout * 1e3)
            if not ready and not self.dead:
                return None
            if any(descriptor == self.control for descriptor, _ in ready):
                self.dead = True
                self.poll.unregister(self.control)
            try:
                data = self.socket.recv(RECEIVE_SIZE)
                self.over = not data
                self.received += data
            except BlockingIOError:
                self.over = self.dead
            except ConnectionError:
                self.over = True


class Feed:
    """Rerun's recording of a run.

    plan : plan of the run, with the fields of a Target as `target` and the path of the file as `path`
    timeout : s to wait for the ports of a server

    notice : line for the terminal
    count : number of rows shown
    """

    def __init__(self, plan, timeout=0.0):
        import rerun as rr

        from runtime.record.recorder.rerun import viewer
        from runtime.record.recorder.rerun.blueprint import blueprint
        from runtime.record.recorder.rerun.scene import Scene
        from runtime.record.recorder.rerun.stream import Stream
        from runtime.record.recorder.rerun.target import host_in_url, url

        kind, place, port = (plan["target"][key] for key in ("kind", "place", "port"))
        self.path, self.count, self.notice = plan["path"], 0, ""
        self.process, self.watched, self.mortal = None, None, kind == "serve"
        self.width = 2 + len(plan["signals"])
        scene = Scene(plan["name"], plan["signals"], plan["limits"])
        recording = rr.RecordingStream(f"tickwork {plan['name']}", recording_id=plan["stem"])
        layout = blueprint(scene)
        if kind == "file":
            recording.save(self.path, default_blueprint=layout)
        else:
            if kind == "viewer":
                self.process, host = viewer.viewer(port)
            elif kind == "serve":
                self.process, host = viewer.serve(place, port, plan["web_port"], timeout)
                there = viewer.reached_at(place)
                self.notice = (
                    "Rerun in a browser: "
                    f"http://{host_in_url(there)}:{plan['web_port']}/?url={url(there, port).replace('+', '%2B')}"
                )
            else:
                host = place
                viewer.meet(host, port)
            self.watched = host, port
            self.where = f"the viewer on {host} port {port}"
            recording.connect_grpc(url(host, port), default_blueprint=layout)
        recording.send_recording_name(plan["stem"])
        self.recording, self.stream = recording, Stream(recording, scene, plan["rate"])
        self.answers = viewer.answers
        self.flush()

    def rows(self, content: bytes) -> None:
        """Show rows. content : doubles of each: tick, time in s, values"""
        import numpy as np

        rows = np.frombuffer(content).reshape(-1, self.width)
        self.stream.rows(rows[:, 0].astype("i8"), rows[:, 1].copy(), rows[:, 2:])
        self.count += len(rows)

    def event(self, event: dict[str, Any]) -> None:
        """Show an event."""
        self.stream.event(event)

    def look(self) -> None:
        """Raise Gone if the viewer has closed."""
        if self.process is not None and self.process.poll() is not None:
            raise Gone("the server has ended" if self.mortal else "the viewer was closed")
        if self.watched is not None and not self.answers(*self.watched):
            raise Gone(f"{self.where} no longer responds")

    def flush(self) -> None:
        """Wait until Rerun has taken the data. Raises Gone."""
        try:
            self.recording.flush(timeout_sec=FLUSH_TIMEOUT)
        except RuntimeError:
            self.look()  # raises a more specific reason
            raise Gone(
                f"cannot write {self.path}: check whether the disk is full"
                if self.path
                else f"{self.where} no longer accepts data"
            ) from None

    def finish(self) -> None:
        """Flush, and write the end of a file."""
        self.flush()
        if self.path:
            self.recording.disconnect()  # writes the end of the file


def quiet() -> None:
    """Discard the output of Rerun, which would go to the terminal of the run."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    os.close(nowhere)


def say(descriptor: int, message: dict[str, Any]) -> bool:
    """Send a message to the recorder, if it still runs. Returns True."""
    with suppress(OSError):  # the recorder has ended
        os.write(descriptor, json.dumps(message).encode() + b"\n")
    return True

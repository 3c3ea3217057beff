"""The process that feeds Rerun: rows and events come over a socket, and go into Rerun's own queues, which may block it
as they like.

    order       4 bytes of length, a letter, and its content: P, the plan as JSON; R, rows of doubles (tick, time,
    values); E, an event as JSON; Q, all is told answers     lines of JSON: {"ready": ...} or {"error": ...}, then
    {"gone": ...} if the viewer has gone, or at the end
                {"done": {"rows": how many were shown, "problem": null}}

It ends when all is shown, when the recorder has died, or when its viewer has gone.
"""

import json
import os
import select
import socket
import time
from struct import Struct

from runtime.base.ending import ignore_signals

HEAD = Struct("<IB")
LOOK = 1.0  # s between looks at the viewer
FLUSH = 0.2  # s between flushes
SERVER_END = 5.0  # s for the server of the part before to have ended
PATIENCE = 5.0  # s for a flush, before the viewer or the disk counts as gone
RECEIVE = 1 << 20  # bytes at once
PLAN, ROWS, EVENT, QUIT = b"PREQ"


class Gone(Exception):
    """Nobody takes what is told any more. The text says who, in one line."""


def main(answers, control, descriptor):
    """File descriptors of the pipe for answers, a pidfd of the recorder, and the socket."""
    ignore_signals()
    os.nice(5)
    quiet()
    ready = False
    try:
        orders = Orders(descriptor, control)
        order = orders.next(None)
        assert order is not None  # without a timeout
        plan = json.loads(order[1])
        feed = Feed(plan, SERVER_END if plan["part"] > 1 else 0.0)
        ready = say(answers, {"ready": feed.told})
        follow(orders, feed)
        say(answers, {"done": {"rows": feed.count, "problem": None}})
    except Gone as error:
        say(answers, {"gone": str(error)})
    except Exception as error:  # Rerun's, the disk's, the network's: told, as nobody sees this process
        say(
            answers,
            {"gone" if ready else "error": getattr(error, "strerror", None) or str(error) or type(error).__name__},
        )
    os._exit(0)  # Rerun would wait for a viewer that has gone


def follow(orders, feed):
    """Until all is told."""
    look_at = flush_at = 0.0
    while True:
        now = time.monotonic()
        if now >= look_at:
            feed.look()
            look_at = now + LOOK
        if now >= flush_at:
            feed.flush()
            flush_at = now + FLUSH
        order = orders.next(FLUSH)
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
    """What comes over the socket, in whole orders."""

    def __init__(self, descriptor, control):
        self.socket = socket.socket(fileno=descriptor)
        self.socket.setblocking(False)
        self.heard = bytearray()
        self.over = self.dead = False
        self.poll = select.poll()
        self.poll.register(self.socket, select.POLLIN)
        self.poll.register(control, select.POLLIN)
        self.control = control

    def next(self, timeout):
        """(kind, content) within s, or None. The end of the recorder is the last order."""
        while True:
            if len(self.heard) >= HEAD.size:
                length, kind = HEAD.unpack_from(self.heard)
                if len(self.heard) >= HEAD.size + length:
                    content = bytes(self.heard[HEAD.size : HEAD.size + length])
                    del self.heard[: HEAD.size + length]
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
                data = self.socket.recv(RECEIVE)
                self.over = not data
                self.heard += data
            except BlockingIOError:
                self.over = self.dead
            except ConnectionError:
                self.over = True


class Feed:
    """What is told, in Rerun. patience : s for ports to become free; plan : of the run, with `target`, as
    runtime.recorder.rerun.target.Target has it, and `path` of the file

    told : what the person at the terminal shall know
    count : rows that were shown
    """

    def __init__(self, plan, patience=0.0):
        import rerun as rr

        from runtime.recorder.rerun import viewer
        from runtime.recorder.rerun.blueprint import blueprint
        from runtime.recorder.rerun.scene import Scene
        from runtime.recorder.rerun.stream import Stream
        from runtime.recorder.rerun.target import bracketed, url

        kind, place, port = (plan["target"][key] for key in ("kind", "place", "port"))
        self.path, self.count, self.told = plan["path"], 0, ""
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
                self.process, host = viewer.serve(place, port, plan["web_port"], patience)
                there = viewer.reached_at(place)
                self.told = (
                    "Rerun in a browser: "
                    f"http://{bracketed(there)}:{plan['web_port']}/?url={url(there, port).replace('+', '%2B')}"
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

    def rows(self, content):
        import numpy as np

        rows = np.frombuffer(content).reshape(-1, self.width)
        self.stream.rows(rows[:, 0].astype("i8"), rows[:, 1].copy(), rows[:, 2:])
        self.count += len(rows)

    def event(self, event):
        self.stream.event(event)

    def look(self):
        """Gone, where the viewer is."""
        if self.process is not None and self.process.poll() is not None:
            raise Gone("the server has ended" if self.mortal else "the viewer was closed")
        if self.watched is not None and not self.answers(*self.watched):
            raise Gone(f"{self.where} no longer answers")

    def flush(self):
        try:
            self.recording.flush(timeout_sec=PATIENCE)
        except RuntimeError:
            self.look()  # which may tell it better
            raise Gone(
                f"cannot write {self.path}: is the disk full?" if self.path else f"{self.where} takes nothing any more"
            ) from None

    def finish(self):
        self.flush()
        if self.path:
            self.recording.disconnect()  # which writes the end of the file


def quiet():
    """Rerun tells its troubles on standard error, which is the terminal of the run."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    os.close(nowhere)


def say(descriptor, message):
    """Returns True: it has been said, to whoever listens."""
    try:
        os.write(descriptor, json.dumps(message).encode() + b"\n")
    except OSError:  # nobody listens any more
        pass
    return True

"""The process that feeds Rerun: rows and events come over a socket, and go into Rerun's own queues, which may block it as they like.

    order       4 bytes of length, a letter, and its content: P, the plan as JSON; R, rows of doubles (tick, time, values); E, an event as JSON; Q, all is told
    answers     lines of JSON: {"ready": ...} or {"error": ...}, then {"gone": ...} if the viewer has gone, or at the end
                {"done": {"rows", "last": tick, "events": how many of the run's, "problem": what is missing, or null}}

It ends when all is told, when the recorder has died, or when its viewer has gone. That of a recorder which goes on is ready at once, as that has a
ring to drain; it waits for the last word of the one before, then takes from the flight logs what that had not come to, or where a server has
gone with it all, and goes on with what comes over its own socket.
"""

import json
import os
import select
import signal
import socket
import time
from struct import Struct

HEAD = Struct("<IB")
LOOK = 1.0                      # s between looks at the viewer
FLUSH = 0.2                     # s between flushes
LAST_WORD = 30.0                # s for the process of a recorder that has died to show what it has heard
SERVER_END = 5.0                # s for a server that ends with that process to have ended
PATIENCE = 5.0                  # s for a flush, before the viewer or the disk counts as gone
RECEIVE = 1 << 20               # bytes at once
PLAN, ROWS, EVENT, QUIT = b"PREQ"


class Gone(Exception):
    """Nobody takes what is told any more. The text says who, in one line."""


def main(answers, control, descriptor, before):
    """File descriptors of the pipe for answers, a pidfd of the recorder, the socket, and the pipe for answers of the one before, or -1."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    os.nice(5)
    quiet()
    ready = False
    try:
        orders = Orders(descriptor, control)
        plan = json.loads(orders.next(None)[1])
        if before >= 0:
            ready = say(answers, {"ready": ""})
            word = last_word(before)
            feed = Feed(plan, SERVER_END)
            feed.go_on({} if feed.mortal else word)
        else:
            feed = Feed(plan)
            ready = say(answers, {"ready": feed.told})
        follow(orders, feed)
        say(answers, {"done": {"rows": feed.count, "last": feed.last, "events": max(feed.events, feed.shown), "problem": feed.problem}})
    except Gone as error:
        say(answers, {"gone": str(error)})
    except Exception as error:                          # Rerun's, the disk's, the network's: told, as nobody sees this process
        say(answers, {"gone" if ready else "error": getattr(error, "strerror", None) or str(error) or type(error).__name__})
    os._exit(0)                                         # Rerun would wait for a viewer that has gone


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


def last_word(before):
    """How far the process of the recorder that has died has come: what it says in the end; {} where it has died, too."""
    heard, deadline = b"", time.monotonic() + LAST_WORD
    poll = select.poll()
    poll.register(before, select.POLLIN)
    while poll.poll(max(0.0, deadline - time.monotonic()) * 1e3):
        data = os.read(before, 1 << 16)
        if not data:
            break
        heard += data
    words = [json.loads(line) for line in heard.split(b"\n") if line]
    return next((word["done"] for word in words if "done" in word), {})


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
                self.dead = True                        # another has its end of the socket, too, so that it does not hang up
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
    """What is told, in Rerun. patience : s for ports to become free; plan : of the run, with `target`, as runtime.rerun.target.Target has it, and `path` of the file

    told : what the person at the terminal shall know
    count, last : rows, and the tick of the newest of the run, None before the first
    events : how many of the run were told, here or by the one before
    problem : what is missing, in a line
    """

    def __init__(self, plan, patience=0.0):
        import rerun as rr

        from runtime.rerun import viewer
        from runtime.rerun.blueprint import blueprint
        from runtime.rerun.scene import Scene
        from runtime.rerun.stream import Stream
        from runtime.rerun.target import bracketed, url

        kind, place, port = (plan["target"][key] for key in ("kind", "place", "port"))
        self.path, self.count, self.last, self.told = plan["path"], 0, None, ""
        self.plan, self.problem = plan, None
        self.events, self.shown = 0, 0          # of the run, and of these by the one before
        self.going_on = False                   # whether the next row is the first behind those of another recorder
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
                self.told = f"Rerun in a browser: http://{bracketed(there)}:{plan['web_port']}/?url={url(there, port).replace('+', '%2B')}"
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

    def go_on(self, before):
        """Where another has come to, with what that should have been told. before : its last word"""
        from runtime.rerun.catching_up import orders

        self.last, self.shown, self.going_on = before.get("last"), before.get("events", 0), True
        for order in orders(self.plan["logs"], [signal["index"] for signal in self.plan["signals"]], self.last):
            if isinstance(order, dict):
                self.event(order)
            else:
                self.show(order)
            self.flush()

    def rows(self, content):
        import numpy as np

        rows = np.frombuffer(content).reshape(-1, self.width)
        if self.going_on and len(rows):
            self.going_on = False
            self.tell_gap(int(rows[0, 0]))
        self.show(rows if self.last is None else rows[rows[:, 0] > self.last])

    def show(self, rows):
        """rows : array of tick, time and values"""
        if len(rows):
            self.stream.rows(rows[:, 0].astype("i8"), rows[:, 1].copy(), rows[:, 2:])
            self.count, self.last = self.count + len(rows), int(rows[-1, 0])

    def tell_gap(self, first):
        """first : tick of the first row that the recorder itself has handed over"""
        begin = 0 if self.last is None else self.last + 1
        if first > begin:
            self.problem = f"ticks {begin} to {first - 1} are missing: a recorder died before Rerun had taken them"
            self.stream.text(first, first / self.plan["rate"], self.problem, "WARN")

    def event(self, event):
        self.events += 1
        if self.events > self.shown:
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
            self.look()                                 # which may tell it better
            raise Gone(f"cannot write {self.path}: is the disk full?" if self.path else f"{self.where} takes nothing any more") from None

    def finish(self):
        self.flush()
        if self.path:
            self.recording.disconnect()                 # which writes the end of the file


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
    except OSError:                                     # nobody listens any more
        pass
    return True

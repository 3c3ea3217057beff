"""The service for Rerun: sends rows and events to a separate process over a non-blocking socket.

Data that the process does not take is queued up to 64 MiB; further batches are dropped and counted. In virtual time the
run waits instead. Each part of a recording has a process and a Rerun recording of its own.
"""

import json
import os
import select
import socket
from array import array
from collections import deque
from dataclasses import asdict
from importlib.util import find_spec
from time import monotonic
from typing import Any

from runtime.host.child_process import ChildProcess
from runtime.host.console.styles import count
from runtime.host.optional_dependencies import need
from runtime.record.recorder.rerun.process import EVENT, HEAD, PLAN, QUIT, ROWS
from runtime.record.recorder.rerun.target import parse
from runtime.record.recorder.service import Service
from runtime.record.storage.files import INCOMPLETE, create

BATCH_DURATION = 0.05  # s
BATCH_ROW_LIMIT = 2000
QUEUE_LIMIT = 64 << 20  # bytes
READY_TIMEOUT = 25.0  # s, to import Rerun and start a viewer
END_TIMEOUT = 20.0  # s, to show the rest at the end
STALL_TIMEOUT = 20.0  # s in virtual time without any data taken
SOCKET_BUFFER_SIZE = 1 << 20  # bytes


class RerunError(OSError):
    """Rerun cannot show the run. The text is the reason in one line."""

    def __init__(self, text: str) -> None:
        super().__init__(0, text)


class Feeder(ChildProcess):
    """The process runtime.record.recorder.rerun.process. descriptor : its end of the socket"""

    def __init__(self, descriptor: int) -> None:
        super().__init__("runtime.record.recorder.rerun.process", (descriptor,), (descriptor,))

    def answer(self, timeout: float) -> dict[str, Any] | None:
        """Return the next answer; {"gone": ...} if the process has died, None after `timeout` s."""
        try:
            answer = self._answer(timeout)
        except TimeoutError:
            return None
        return {"gone": "its process died"} if answer is None else answer


class RerunSender(Service):
    """Serves blocks.sinks.Rerun."""

    elsewhere = True

    def open(self) -> None:
        parameters = self.sink["parameters"]
        target = parse(parameters["target"], parameters["port"])
        if find_spec("rerun") is None:
            need("rerun", "--rerun")
        path = None
        if target.kind == "file":
            path, descriptor = create(target.place.removesuffix(".rrd"), ".rrd")
            os.close(descriptor)
            self.files[path] = ""
        self.rows = self.lost = 0
        self.batch = array("d")
        self.sent = monotonic()
        self.waiting, self.held = deque(), 0
        self.socket, theirs = socket.socketpair()
        self.socket.setblocking(False)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SOCKET_BUFFER_SIZE)
        self.poll = select.poll()
        self.poll.register(self.socket, select.POLLOUT)
        self.child = None
        with theirs:
            self.child = Feeder(theirs.fileno())
        plan = {
            "name": self.plan["name"],
            "stem": self.plan["stem"],
            "rate": self.plan["rate"],
            "signals": self.sink["columns"],
            "limits": self.plan.get("limits", {}),
            "target": asdict(target),
            "path": path,
            "web_port": parameters["web_port"],
            "part": self.plan.get("part", 1),
        }
        self.put(PLAN, json.dumps(plan).encode())
        self.drain(READY_TIMEOUT)
        answer = self.child.answer(READY_TIMEOUT) or {"error": f"it was not ready within {READY_TIMEOUT:g} s"}
        if "ready" not in answer:
            self.end_process()
            raise RerunError(str(answer.get("error") or answer.get("gone")))
        self.greeting = answer["ready"]

    def row(self, tick: int, time: float, values: list[float]) -> None:
        batch = self.batch
        batch.append(tick)
        batch.append(time)
        batch.extend(values)
        self.rows += 1
        now = monotonic()
        if now - self.sent > BATCH_DURATION or len(batch) > BATCH_ROW_LIMIT * (2 + len(values)):
            self.hand_over(now)

    def event(self, event: dict[str, Any]) -> None:
        self.hand_over(monotonic())
        self.put(EVENT, json.dumps(event).encode())

    def flush(self) -> None:
        if self.greeting:
            self.say(f"tickwork: {self.greeting}")
            self.greeting = ""
        self.hand_over(monotonic())
        assert self.child is not None
        answer = self.child.answer(0.0)
        if answer is not None:
            raise RerunError(answer.get("gone", "it has ended"))

    def hand_over(self, now: float) -> None:
        """Send the rows of the open batch. now : s of the monotonic clock"""
        self.sent = now
        if self.batch:
            self.put(ROWS, self.batch.tobytes())
            self.batch = array("d")
        self.drain(STALL_TIMEOUT if self.plan["virtual"] else 0.0)

    def put(self, kind: int, content: bytes) -> None:
        """Add a message to the queue. Rows are dropped and counted while the queue is full."""
        if self.held > QUEUE_LIMIT and kind == ROWS:
            self.lost += len(content) // (8 * (2 + len(self.sink["columns"])))
            return
        self.waiting.append(memoryview(HEAD.pack(len(content), kind) + content))
        self.held += len(content)

    def drain(self, timeout: float) -> None:
        """Send the queue until the socket is full; wait up to `timeout` s each time it is."""
        while self.waiting:
            try:
                taken = self.socket.send(self.waiting[0])
            except BlockingIOError:
                if timeout == 0.0 or not self.poll.poll(timeout * 1e3):
                    return
                continue
            except OSError:
                assert self.child is not None
                answer = self.child.answer(1.0) or {}
                raise RerunError(answer.get("gone") or answer.get("error") or "its process died") from None
            self.held -= taken
            if taken == len(self.waiting[0]):
                self.waiting.popleft()
            else:
                self.waiting[0] = self.waiting[0][taken:]

    def close(self) -> dict[str, Any]:
        if self.child is None:
            return {}
        shown, problem = 0, None
        try:
            self.hand_over(monotonic())
            self.put(QUIT, b"")
            self.drain(END_TIMEOUT)
            answer: dict = self.child.answer(END_TIMEOUT) or {"gone": f"not all data was shown after {END_TIMEOUT:g} s"}
            done = answer.get("done", {"problem": answer.get("gone")})
            shown, problem = done.get("rows"), done["problem"]
        except RerunError as error:
            problem = error.strerror
        self.end_process()
        result = {"rows": self.rows, "lost": self.lost}
        if self.lost:
            slow = f"{self.lost} of {self.rows} rows were not shown because Rerun was too slow"
            problem = f"{slow}; {problem}" if problem else slow
        for path in self.files:
            self.files[path] = (
                f"{count(shown, 'tick')} of {count(len(self.sink['columns']), 'signal')}, for Rerun"
                if problem is None
                else INCOMPLETE
            )
        return result | ({"problem": f"{self.sink['path']}: {problem}"} if problem else {})

    def end_process(self) -> None:
        """End the process that feeds Rerun."""
        self.socket.close()
        child, self.child = self.child, None
        if child is not None:
            child.end()


SERVICE = RerunSender

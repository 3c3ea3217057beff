"""Connection of the recorder to a companion: a process beside the run that uses its keys, signals and recording.

Both ends send messages of JSON. The companion sends what it needs, as a whole, and again after a second, because a
writer that has replaced a dead one starts without it:

    status      text of the status line
    keys        names of keys, as in runtime.host.console.keys, that it receives
    help        line on these keys
    watch       indices of recorded signals that it receives
    fallback    [[index of a live parameter, value], ...] that are set if it dies, [] to change nothing
    partial     whether the fallback is only the first step towards the last accepted parameters
    question    number of the newest question to the operator

and {"event": {...}} for the recording, whose "lines" are printed. It receives

    key, question, read     name of a key, number of the question that was shown before, ns of CLOCK_MONOTONIC
    rows                    [[time in s, value, ...], ...] of consecutive ticks

Neither end waits for the other: rows that the companion does not take are lost.
"""

from __future__ import annotations

import json
import select
import socket
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from cext.recording.ring_batch import Batch
from cext.schedule.mailbox_writer import Writer
from runtime.host.console.status_layout import part

if TYPE_CHECKING:
    from cext.memory.shared_state import SharedState
    from runtime.host.console.keys import Key
    from runtime.record.recorder.part import Recording

MESSAGE_LIMIT = 1 << 17  # bytes
ROWS_LIMIT = 256  # rows of a message
NOTHING = {"status": "", "keys": (), "help": "", "watch": (), "fallback": (), "partial": False, "question": 0}
LOST = "the companion process of the run has ended before the run"


class Companion:
    """The recorder's end of the connection.

    descriptor : file descriptor of a socket of type SOCK_SEQPACKET
    recording, shared : recording and shared state of the run
    control : pidfd of the control process
    """

    def __init__(self, descriptor: int, recording: Recording, shared: SharedState, control: int) -> None:
        self.socket = socket.socket(fileno=descriptor)
        self.recording, self.shared = recording, shared
        self.needs: dict[str, Any] = dict(NOTHING)
        self.alive = True
        self.shown_at = 0  # ns of CLOCK_MONOTONIC, of the newest question
        self.fallback: list[tuple[int, float]] = []  # that the mailbox has no room for
        self.control = select.poll()
        self.control.register(control, select.POLLIN)

    def look(self) -> None:
        """Take the messages that have arrived."""
        if self.fallback and Writer(self.shared).set(self.fallback) is not None:
            self.fallback = []
        while self.alive:
            try:
                message = self.socket.recv(MESSAGE_LIMIT, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            except ConnectionResetError:  # it has died with unread messages; its own are still to be received
                continue
            if not message:
                self.alive = False
                if not self.run_has_ended():
                    self.replace()
                return
            content = json.loads(message)
            event = content.pop("event", None)
            if event is not None:
                self.recording.take_event(event)
            if content.get("question", self.needs["question"]) != self.needs["question"]:
                self.shown_at = time.monotonic_ns()  # after its lines
            self.needs.update(content)

    def run_has_ended(self) -> bool:
        """Return whether the run is being stopped, has ended, or its control process has died."""
        return self.shared.state in ("stopping", "safe") or self.shared.closed or bool(self.control.poll(0))

    def replace(self) -> None:
        """Set the parameters for this case, and report the end of the companion."""
        changes = [tuple(pair) for pair in self.needs["fallback"]]
        if changes and Writer(self.shared).set(changes) is None:
            self.fallback = changes
        then = "its last accepted parameters are restored" if changes else "no parameter was changed"
        if changes and self.needs["partial"]:
            then = "the parameters were moved towards the last accepted ones, by the largest step"
        self.needs = dict(NOTHING)
        self.recording.take_event(
            {
                "event": "companion",
                "tick": self.shared.statistics()["last_tick"],
                "problem": LOST,
                "lines": [f"tickwork: {LOST}; {then}. The run continues; space stops it"],
            }
        )

    def press(self, key: str, pressed: Key | None = None) -> bool:
        """Send a key, if the companion uses it. Returns whether it does. pressed : keys pressed, with their times"""
        if key not in self.needs["keys"]:
            return False
        times = {}
        if pressed is not None:
            question = self.needs["question"]
            times = {"question": question if pressed.since >= self.shown_at else question - 1, "read": pressed.read}
        self._send({"key": key, **times})
        return True

    def take(self, records: list[Any], rate: float) -> None:
        """Send the watched signals of the rows among records. rate : Hz"""
        columns = self.needs["watch"]
        if not columns:
            return
        for item in records:
            if isinstance(item, Batch):
                rows = [[time, *values] for time, _, *values in item.table(rate, columns, [False] * len(columns))]
                for first in range(0, len(rows), ROWS_LIMIT):
                    self._send({"rows": rows[first : first + ROWS_LIMIT]})

    def _send(self, message: dict[str, Any]) -> None:
        with suppress(OSError):  # it is behind, or has ended, which `look` reports
            self.socket.send(json.dumps(message).encode(), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)

    def parts(self) -> list[Any]:
        """Return the parts of the status line."""
        return [part(8.4, self.needs["status"], colour="bold")] if self.needs["status"] else []

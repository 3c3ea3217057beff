"""The service of the panel: starts its process (runtime.record.panel), and passes events of the recording to it.

The process reads rows, state and live parameters from the shared state itself. If it dies, it is started once more.
"""

from __future__ import annotations

import io
import json
import os
import socket
from contextlib import suppress
from typing import Any

import segno

from runtime.host.child_process import ChildProcess
from runtime.host.console.stderr import Terminal
from runtime.record.panel.access import OPERATE
from runtime.record.recorder.service import Service
from runtime.record.recorder.services.csv import place_of

READY_TIMEOUT = 20.0  # s, to import its libraries and listen
END_TIMEOUT = 1.0  # s, to show the end of the run
START_LIMIT = 2
EVENT_LIMIT = 60_000  # bytes of an event
PLANNED = ("folder", "stem", "rate", "duration", "simulated", "drawing", "phases", "buses", "bitrates", "data_bitrates")
CHOSEN = ("host", "port", "lost", "marks", "subject", "target", "stride")  # parameters of the block


class PanelError(OSError):
    """The panel cannot serve the page. The text is the reason in one line."""

    def __init__(self, text: str) -> None:
        super().__init__(0, text)


class PanelProcess(ChildProcess):
    """The process runtime.record.panel.process. shared, events : file descriptors that it inherits"""

    def __init__(self, shared: int, events: int, plan: dict[str, Any]) -> None:
        super().__init__("runtime.record.panel.process", (shared, events), (shared, events))
        with suppress(BrokenPipeError):  # `answer` reports its death
            self._send(json.dumps(plan).encode() + b"\n")

    def answer(self, timeout: float) -> dict[str, Any] | None:
        """Return the next answer; None after `timeout` s. Raises PanelError if the process has died."""
        try:
            answer = self._answer(timeout)
        except TimeoutError:
            return None
        if answer is None:
            raise PanelError("its process died")
        return answer


class PanelService(Service):
    """Serves blocks.sinks.Panel."""

    def open(self) -> None:
        if subject := self.sink["parameters"]["subject"]:
            place_of("subject", subject, self.plan["signals"])
        self.starts, self.lost = 0, 0
        self.greeting: list[str] = []
        self.child: PanelProcess | None = None
        self.kept = self.before
        self.start()
        assert self.child is not None
        answer = self.child.answer(READY_TIMEOUT)
        if answer is None:
            self.end_process(0.0)
            raise PanelError(f"it was not ready within {READY_TIMEOUT:g} s")
        self.greet(answer)

    def start(self) -> None:
        """Start the process."""
        assert self.shared is not None
        self.starts += 1
        parameters = self.sink["parameters"]
        labels = {column["path"]: column.get("labels", []) for column in self.sink["columns"]}
        plan = {
            **{key: self.plan.get(key) for key in PLANNED},
            "limits": self.plan.get("limits", {}),
            "hot": self.plan.get("hot", {}),
            "drives": self.plan.get("drives", {}),
            **{key: parameters[key] for key in CHOSEN},
            "port_before": self.kept.get("port", 0),
            "secret": self.plan.get("secret") or os.urandom(16).hex(),
            "signals": [{**signal, "labels": labels.get(signal["path"], [])} for signal in self.plan["signals"]],
        }
        self.socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.socket.setblocking(False)
        with theirs:
            self.child = PanelProcess(self.shared.fd, theirs.fileno(), plan)

    def greet(self, answer: dict[str, Any]) -> None:
        """Keep the lines on its addresses, which `flush` prints. Raises PanelError."""
        if "error" in answer:
            self.end_process(0.0)
            raise PanelError(answer["error"])
        self.kept = {"port": answer["port"]}  # pages connect again where they were
        addresses = answer["ready"]
        texts = [f"to {role} {address}" if len(addresses) > 1 else address for role, address in addresses.items()]
        terminal = Terminal()
        drawn = len(addresses) > 1 and terminal.interactive and terminal.unicode
        self.greeting = ["tickwork: panel: " + ", ".join(texts), *(qr_code(addresses[OPERATE]) if drawn else ())]

    def event(self, event: dict[str, Any]) -> None:
        if event["event"] == "end":
            self.flush()  # the last notes come before it
        self.put(json.dumps(event).encode())

    def put(self, message: bytes) -> None:
        """Send an event without waiting, or count it as lost."""
        try:
            if len(message) > EVENT_LIMIT:
                raise OSError
            self.socket.send(message)
        except OSError:
            self.lost += 1

    def flush(self) -> None:
        for line in self.greeting:
            self.say(line)
        self.greeting = []
        if self.child is None:
            return
        try:
            while (answer := self.child.answer(0.0)) is not None:
                if "note" in answer:
                    self.record({"event": "note", **answer["note"]})
                else:
                    self.greet(answer)
        except PanelError:
            if self.child is None:  # it cannot listen
                raise
            self.end_process(0.0)
            if self.starts >= START_LIMIT:
                raise PanelError("its process died again; pages no longer show or stop the run") from None
            self.say("tickwork: the process of the panel died and is started once more; the run continues")
            self.start()

    def close(self) -> dict[str, Any]:
        if self.child is None:
            return {}
        self.put(b'{"event": "complete"}')
        self.end_process(END_TIMEOUT)
        return {"starts": self.starts, "lost": self.lost}

    def end_process(self, timeout: float) -> None:
        """End the process, at the latest after `timeout` s."""
        self.socket.close()
        child, self.child = self.child, None
        if child is not None:
            child.end(timeout)


def qr_code(text: str) -> list[str]:
    """Return the lines of a QR code for a dark terminal."""
    drawn = io.StringIO()
    segno.make(text, error="l", micro=False).terminal(drawn, border=2, compact=True)
    return drawn.getvalue().splitlines()


SERVICE = PanelService

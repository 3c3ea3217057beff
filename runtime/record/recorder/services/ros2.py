"""ROS 2: starts the process runtime.record.recorder.ros2_bridge, and passes events of the recording to it.

The process reads the rows from the shared state itself, so that neither the run nor the recorder waits for the network.
"""

from __future__ import annotations

import json
import socket
from contextlib import suppress
from typing import Any

from runtime.host.child_process import ChildProcess
from runtime.record.recorder.service import Service
from runtime.record.storage.changes import event_text
from runtime.robot.loading.signal_selection import select

READY_TIMEOUT = 20.0  # s
END_TIMEOUT = 2.0  # s
LEVELS = {"warning": 1, "fault": 2, "end": 2}  # level of an event in diagnostics


class Ros2Error(OSError):
    """The bridge cannot publish. The text is the reason in one line."""

    def __init__(self, text: str) -> None:
        super().__init__(0, text)


class Bridge(ChildProcess):
    """The process. shared, events : file descriptors that it inherits"""

    def __init__(self, shared: int, events: int, plan: dict[str, Any]) -> None:
        super().__init__("runtime.record.recorder.ros2_bridge", (shared, events), (shared, events))
        with suppress(BrokenPipeError):  # `answer` reports its death
            self._send(json.dumps(plan).encode() + b"\n")

    def answer(self, timeout: float) -> dict[str, Any]:
        """Return its next answer; {"error"} after `timeout` s, or if it has died."""
        with suppress(TimeoutError):
            return self._answer(timeout) or {"error": "its process died"}
        return {"error": f"no answer of its process within {timeout:g} s"}

    @property
    def ended(self) -> bool:
        """Whether it has ended."""
        return self._child.poll() is not None


class Ros2Service(Service):
    """Serves blocks.sinks.Ros2."""

    def open(self) -> None:
        assert self.shared is not None
        columns = self.sink["columns"]
        plan = {
            **{key: self.plan[key] for key in ("name", "rate")},
            **{key: self.sink["parameters"][key] for key in ("router", "domain", "namespace", "decimation")},
            "width": len(self.plan["signals"]),
            "columns": [columns[place] for place in select(columns, self.sink["parameters"]["signals"])],
        }
        self.socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.socket.setblocking(False)
        with theirs:
            self.bridge: Bridge | None = Bridge(self.shared.fd, theirs.fileno(), plan)
        answer = self.bridge.answer(READY_TIMEOUT)
        if "ready" not in answer:
            self.end_process()
            raise Ros2Error(answer["error"])
        self.greeting = f"tickwork: {self.sink['path']}: {answer['ready']}"

    def event(self, event: dict[str, Any]) -> None:
        if event["event"] in LEVELS:
            level = 0 if event.get("status") == "ok" else LEVELS[event["event"]]
            with suppress(OSError):  # it is behind, or has ended, which `flush` reports
                self.socket.send(json.dumps({"text": event_text(event), "level": level}).encode())

    def flush(self) -> None:
        if self.greeting:
            self.say(self.greeting)
            self.greeting = ""
        if self.bridge is not None and self.bridge.ended:
            self.end_process()
            raise Ros2Error("its process died; the run continues without it")

    def close(self) -> dict[str, Any]:
        if self.bridge is None:
            return {}
        self.socket.shutdown(socket.SHUT_WR)
        answer = self.bridge.answer(END_TIMEOUT)
        self.end_process()
        return answer.get("done", {"problem": f"{self.sink['path']}: {answer.get('error')}"})

    def end_process(self) -> None:
        """End the process."""
        self.socket.close()
        bridge, self.bridge = self.bridge, None
        if bridge is not None:
            bridge.end()


SERVICE = Ros2Service

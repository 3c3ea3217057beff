"""The CAN log: every frame of every CAN bus in the format of `candump -L`, written by python-can.

    (1763683200.004512) legs 001#7FFF7FF0000007FF T

The time is the wall clock; in virtual time it begins at 0. R: received; T: sent by the run. Frames are in
the order in which the control process handled them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TextIO, cast

from runtime.record.recorder.service import Service
from runtime.record.storage.files import WholeFile, create
from runtime.record.storage.format import BUS_BYTE, Frame

if TYPE_CHECKING:
    from runtime.record.recorder.plan_types import Plan

FLUSH_FRAMES = 1000


def on_can(plan: Plan) -> list[bool]:
    """Return for each bus whether it is CAN."""
    return [medium == "can" for medium in plan.get("media", ["can"] * len(plan["buses"]))]


class CanLog(Service):
    """The CAN log of a recording."""

    title = "CAN log"

    @classmethod
    def applies(cls, plan: Plan) -> bool:
        return plan.get("can_log", False) and any(on_can(plan))

    def open(self) -> None:
        self.on_can = on_can(self.plan)
        self.file = WholeFile(*create(self.stem, ".can.log"), self.durable)
        self.files[self.file.path] = ""
        self.frames = 0
        self.began = None

    def begin(self, about: dict[str, Any]) -> None:
        """Import python-can, which takes a tenth of a second."""
        from can import Message
        from can.io.canutils import CanutilsLogWriter

        self.writer = CanutilsLogWriter(cast(TextIO, self.file))  # it calls `write` and `close`
        self.message = Message(data=b"", check=False)  # reused for every frame

    def frame(self, payload: bytes) -> None:
        if not self.on_can[payload[BUS_BYTE]]:
            return
        frame = Frame.unpack(payload)
        if self.began is None:
            self.began = 0 if self.plan["virtual"] or self.shared is None else self.shared.wall
        message = self.message
        message.timestamp = (self.began + frame.time) * 1e-9
        message.arbitration_id = frame.id
        message.is_extended_id = frame.extended
        message.is_remote_frame = frame.remote
        message.is_error_frame = frame.error
        message.is_fd = frame.fd
        message.bitrate_switch = frame.rate_switch
        message.error_state_indicator = frame.error_state
        message.is_rx = not frame.sent
        message.channel = self.plan["buses"][frame.bus]
        message.data = bytearray(frame.data)
        message.dlc = len(frame.data)
        self.writer.last_timestamp = None  # otherwise python-can delays earlier frames of other buses
        self.writer.on_message_received(message)
        self.frames += 1
        if self.frames % FLUSH_FRAMES == 0:
            self.file.flush()

    def flush(self) -> None:
        self.file.flush()

    def close(self) -> dict[str, Any]:
        self.file.close()
        self.files[self.file.path] = f"{self.frames} CAN frames"
        return {"file": self.file.path, "frames": self.frames}


SERVICE = CanLog

"""Dialogues with devices, as generators that contain no I/O: they yield what to send and receive the replies.

    def state(can_id):
        frames = yield Listen(0.1)                                # on a CAN bus
        answer = yield from ask(frame, "disable", read)
        reply = yield Exchange(b"?", 0.25)                        # on a serial line

The runtime carries a dialogue out on a bus or a port; a test sends it the answers of a device. A CAN frame is
(arbitration id, is extended, data).
"""

from collections.abc import Callable, Generator
from typing import Any

from msgspec import Struct

Frame = tuple[int, bool, bytes]  # arbitration id, is extended, data
Reader = Callable[[int, bool, bytes], Any]  # reply that a frame contains, or None
Dialogue = Generator[Any, Any, Any]


class Rejected(ValueError):
    """A dialogue that cannot be completed: the message states the cause, `hint` the remedy."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


class NoReply(Exception):
    """The device at a serial line has not replied."""


class Send(Struct, frozen=True):
    """Send one CAN frame. why : purpose, for the report. Yields whether the frame was sent."""

    frame: Frame
    why: str


class Listen(Struct, frozen=True):
    """Receive CAN frames for `seconds`, or until `until(frames)` is true. Yields the list of frames."""

    seconds: float
    until: Callable[[list[Frame]], bool] | None = None


class Exchange(Struct, frozen=True):
    """Write `data` to a serial line. Yields the next bytes.

    It yields b"" if none arrived within `timeout` s of the last write. Without data it waits for more bytes of the same
    answer.
    """

    data: bytes = b""
    timeout: float = 0.0


class Show(Struct, frozen=True):
    """Show lines to the operator. Yields None."""

    lines: tuple[str, ...]


class Confirm(Struct, frozen=True):
    """Ask the operator for permission, as in "apply these changes". Yields True or False."""

    what: str


def ask(frame: Frame, why: str, read: Reader, timeout: float = 0.1, attempts: int = 2) -> Dialogue:
    """Send a frame until a reply arrives; return read(identifier, is extended, data) of the first answer, or None.

    read : returns None for a frame that is not a reply; timeout : s to wait after each attempt
    """
    for _ in range(attempts):
        yield Send(frame, why)
        frames = yield Listen(timeout, lambda frames: any(read(*frame) is not None for frame in frames))
        for received in frames:
            if (answer := read(*received)) is not None:
                return answer
    return None

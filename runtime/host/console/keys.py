"""Keys of the terminal of a run in the foreground.

The control process reads them (cext.safety.terminal_keys), without echo, and stops the run at a space. The recorder
takes them from the shared state and carries out the other commands. It restores the terminal if the control process has
been killed.
"""

from __future__ import annotations

import os
import re
import termios
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from cext.memory.shared_state import SharedState

STDIN, STDOUT = 0, 1
# tcgetattr: local flags to clear, and the indices of the local flags and of the control characters
LINE_MODE, LOCAL, CHARACTERS = termios.ICANON | termios.ECHO, 3, 6

NAMES = {b" ": "space", b"\t": "tab", b"\x1b[Z": "shift tab", b"\n": "enter", b"\r": "enter"}
# last bytes of arrow key sequences, with any modifier keys
ARROWS = {b"A": "up", b"B": "down", b"C": "right", b"D": "left"}
KEY = re.compile(rb"\x1b\[[0-9;]*[A-Za-z~]|\x1bO[A-Za-z]|\x1b[^\x1b[O]|[^\x1b]", re.DOTALL)
SEQUENCE_LIMIT = 32  # bytes; a longer unfinished sequence is discarded


def own_terminal() -> int | None:
    """Open the terminal of this process's standard input and output, and return its descriptor.

    Returns None if they are not a terminal, or not the controlling one.
    """
    if not (os.isatty(STDIN) and os.isatty(STDOUT)):
        return None
    try:
        os.tcgetpgrp(STDIN)  # fails unless it is the controlling terminal
        return os.open("/dev/tty", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return None


def key_mode(attributes: list[Any]) -> list[Any]:
    """Return terminal attributes for single keys without echo. attributes : attributes as returned by tcgetattr

    Ctrl-C still raises SIGINT, and a read without a key does not report the end of the file to other readers.
    """
    changed: list[Any] = [*attributes[:CHARACTERS], list(attributes[CHARACTERS])]
    changed[LOCAL] &= ~LINE_MODE
    changed[CHARACTERS][termios.VMIN], changed[CHARACTERS][termios.VTIME] = 1, 0
    return changed


def terminal_attributes(descriptor: int) -> list[Any] | None:
    """Return the attributes of a terminal; None if it is closed."""
    try:
        return termios.tcgetattr(descriptor)
    except termios.error:
        return None


def restore(descriptor: int, attributes: list[Any]) -> None:
    """Restore a terminal's attributes, if it is in the key mode derived from them."""
    try:
        if termios.tcgetattr(descriptor) == key_mode(attributes):
            termios.tcsetattr(descriptor, termios.TCSANOW, attributes)
    except termios.error:  # the terminal is closed
        pass


class Key(NamedTuple):
    """Key that was pressed.

    name : "space", "tab", "shift tab", "enter", "up", "down", "left", "right", or a character
    since, read : ns of CLOCK_MONOTONIC; it was pressed after the first, and read at the second
    question : SharedState.question before it was pressed
    """

    name: str
    since: int
    read: int
    question: int


class Keyboard:
    """Keys that the control process has read. shared : SharedState of the run"""

    def __init__(self, shared: SharedState) -> None:
        # not at the top: the control process imports this module before the compiled ones
        from cext.safety.terminal_keys import KeyQueue

        self.queue = KeyQueue(shared)
        self.unread: list[tuple[int, int, int, int]] = []

    @property
    def in_foreground(self) -> bool:
        """Whether the run is in the foreground of its terminal."""
        return self.queue.listening

    def read(self) -> list[Key]:
        """Return the keys since the last call. The times of a key are those of the first byte of its sequence."""
        self.unread += self.queue.take()
        data = bytes(byte for byte, *_ in self.unread)
        keys: list[Key] = []
        end = 0
        while match := KEY.match(data, end):
            keys.append(Key(key_name(match[0]), *self.unread[match.start()][1:]))
            end = match.end()
        self.unread = self.unread[end:] if len(self.unread) - end < SEQUENCE_LIMIT else []
        return keys


def key_name(sequence: bytes) -> str:
    """Return the name of a key. sequence : bytes that the terminal sends for it"""
    if sequence in NAMES:
        return NAMES[sequence]
    if len(sequence) > 2 and sequence[:1] == b"\x1b":
        return ARROWS.get(sequence[-1:], "")
    return sequence.decode("ascii", "replace")

"""Single-key input, without echo, from the terminal of a run in the foreground.

The recorder process reads the keys through a descriptor that the control process opened, since it has no controlling
terminal. Job control does not stop it from reading; it therefore reads only while the run is in the foreground, and
restores the terminal only if its mode is still the one that was set here, so that it never overwrites the settings of
another process.
"""

from __future__ import annotations

import os
import re
import select
import termios
from typing import Any

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
    """Return terminal attributes for single keys without echo. attributes : of tcgetattr

    Ctrl-C still raises SIGINT, and a read without a key does not report the end of the file to other readers.
    """
    changed = [*attributes[:CHARACTERS], list(attributes[CHARACTERS])]
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


class Keyboard:
    """Keys of a terminal that is shared with the shell.

    descriptor : of the terminal, as own_terminal returns it
    process : ID of the process whose terminal it is
    in_foreground : whether the run was in the foreground at the last `follow`
    in_key_mode : whether the terminal is in key mode
    """

    def __init__(self, descriptor: int, process: int) -> None:
        self.descriptor, self.process = descriptor, process
        self.in_foreground = self.in_key_mode = False
        self.attributes = None  # to restore
        self.unread = b""
        self.poll = select.poll()
        self.poll.register(descriptor, select.POLLIN)

    def foreground(self) -> bool:
        """Return whether the process runs in the foreground of its terminal."""
        try:
            with open(f"/proc/{self.process}/stat") as file:
                state, _, group, _, _, terminal_group = file.read().rpartition(")")[2].split()[:6]
        except OSError:
            return False
        return group == terminal_group and state not in "TZX"

    def follow(self) -> None:
        """Enter key mode when the run comes to the foreground, leave it when the run leaves the foreground."""
        try:
            self.in_foreground = self.foreground()
            if not self.in_foreground:
                self.close()
                return
            now = termios.tcgetattr(self.descriptor)
            # unless a shell has restored key mode itself
            if self.attributes is None or now != key_mode(self.attributes):
                termios.tcsetattr(self.descriptor, termios.TCSANOW, key_mode(now))
                self.attributes = now
            if not self.in_key_mode:
                termios.tcflush(self.descriptor, termios.TCIFLUSH)  # typed for another program
                self.in_key_mode = True
        except termios.error:  # the terminal is closed
            self.in_key_mode = False

    def read(self) -> list[str]:
        """Return the names of the keys pressed since the last call.

        A name is "space", "tab", "shift tab", "enter", "up", "down", "left", "right", or a character.
        """
        if not self.in_key_mode:
            return []
        try:
            [(_, state)] = self.poll.poll(0) or [(0, 0)]
            if state & select.POLLIN and self.foreground():
                self.unread += os.read(self.descriptor, 4096)
        except BlockingIOError:  # another process has read the input
            pass
        except OSError:  # the terminal is closed
            self.in_key_mode = False
        keys, end = [], 0
        while match := KEY.match(self.unread, end):
            keys.append(key_name(match[0]))
            end = match.end()
        self.unread = self.unread[end:] if len(self.unread) - end < SEQUENCE_LIMIT else b""
        return keys

    def close(self) -> None:
        """Restore the terminal."""
        if self.in_key_mode and self.attributes is not None:
            restore(self.descriptor, self.attributes)
            self.in_key_mode = False


def key_name(sequence: bytes) -> str:
    """Return the name of a key. sequence : bytes that the terminal sends for it"""
    if sequence in NAMES:
        return NAMES[sequence]
    if len(sequence) > 2 and sequence[:1] == b"\x1b":
        return ARROWS.get(sequence[-1:], "")
    return sequence.decode("ascii", "replace")

"""Output to standard error that never blocks or ends the recorder: it skips a full or broken terminal."""

from __future__ import annotations

import os
import select
from typing import TYPE_CHECKING

from runtime.host.console.terminal import ERASE, harmless, readable

if TYPE_CHECKING:
    from collections.abc import Mapping


STDOUT, STDERR = 1, 2
NO_WRAP, WRAP = "\x1b[?7l", "\x1b[?7h"  # what passes the last column is not continued on the next line


class Terminal:
    """Standard error of a process.

    interactive : it is a terminal that supports drawing
    coloured, unicode : it supports colours, UTF-8
    """

    def __init__(self, descriptor: int = STDERR, environment: Mapping[str, str] = os.environ) -> None:
        self.descriptor = descriptor
        dumb = environment.get("TERM", "") in ("", "dumb")
        self.interactive = os.isatty(descriptor) and not dumb
        self.coloured = self.interactive and not environment.get("NO_COLOR")
        locale = next((environment[name] for name in ("LC_ALL", "LC_CTYPE", "LANG") if environment.get(name)), "")
        self.unicode = "utf" in locale.lower() or not locale  # UTF-8 is also Python's default
        self.poll = select.poll()
        self.drawn = False
        try:
            self.poll.register(descriptor, select.POLLOUT)
        except OSError:
            self.interactive = False

    @property
    def columns(self) -> int:
        """Width of the terminal; 80 if it is unknown."""
        try:
            return os.get_terminal_size(self.descriptor).columns or 80
        except OSError:
            return 80

    def write(self, text: str) -> bool:
        """Write if this does not block. A terminal stopped by Ctrl-S would otherwise block the recorder.

        Returns whether the whole text was written.
        """
        try:
            if any(state & select.POLLOUT for _, state in self.poll.poll(0)):
                encoding = "utf-8" if self.unicode else "ascii"
                data = readable(text, encoding).encode(encoding)
                return os.write(self.descriptor, data) == len(data)
        except OSError:
            self.interactive = False  # the terminal is closed
        return False

    def draw(self, text: str) -> None:
        """Replace the status line.

        A window that becomes narrower breaks the line into several. The cursor stays at its start, so that all of them
        are erased; and a line that is too long for a width that is not known yet is cut off.
        """
        if self.interactive:
            self.write(f"\r{NO_WRAP}{harmless(text, self.coloured)}{WRAP}\x1b[J\r")
            self.drawn = True

    def erase(self) -> None:
        """Remove the status line, if one is drawn."""
        if self.drawn:
            self.write(ERASE)
            self.drawn = False

    def say(self, line: str) -> bool:
        """Write a permanent line above the status line. Returns whether it was written."""
        self.erase()
        return self.write(harmless(line, self.coloured) + "\n")

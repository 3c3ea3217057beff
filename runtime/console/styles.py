"""Text for a terminal or a pipe: as wide as the terminal and in colour there; in a pipe one fact a line, however
long.
"""

import os
import re
import shutil
import sys
import textwrap
from dataclasses import dataclass

from runtime.console.terminal import relative

LEAST, INDENT = 20, 8  # columns: beside a head, and where a text goes for which they are too few
_INK = re.compile(r"\x1b\[[0-9]*m")


@dataclass(frozen=True)
class Paper:
    """What text is written on. width : columns, or None for no end."""

    width: int | None = None
    colour: bool = False

    def ink(self, text, code):
        return f"\x1b[{code}m{text}\x1b[0m" if self.colour and text else text

    def bold(self, text):
        return self.ink(text, 1)

    def faint(self, text):
        return self.ink(text, 2)

    def good(self, text):
        return self.ink(text, 32)

    def bad(self, text):
        return self.ink(text, 31)

    def dubious(self, text):
        return self.ink(text, 33)

    def hang(self, head, text, ink=str, indent=None):
        """Lines: the head, then the text beside it, continued where the paper ends: below its own beginning, or
        `indent` columns in.
        """
        column = length(head)
        indent = column if indent is None else indent
        if self.width is None or not text or column + len(text) <= self.width:
            return [head + ink(text)]
        if self.width - column < LEAST:  # too little is left beside the head
            return [head.rstrip(), *self.hang(" " * INDENT, text, ink)] if column > INDENT else [head + ink(text)]
        room = self.width - indent
        first, *rest = textwrap.wrap(
            text,
            room,
            initial_indent=" " * max(0, column - indent),
            break_long_words=False,
            break_on_hyphens=False,
            drop_whitespace=True,
        )
        return [head + ink(first.lstrip()), *(" " * indent + ink(piece) for piece in rest)]

    def cut(self, text):
        """One line that does not reach beyond the paper."""
        return text if self.width is None or len(text) <= self.width else text[: self.width - 1].rstrip() + "…"


def paper(stream=None):
    """The Paper that a stream ends on."""
    stream = stream or sys.stdout
    if not stream.isatty():
        return Paper()
    return Paper(
        shutil.get_terminal_size().columns, not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    )


def length(text):
    """Columns that a text takes, its colours aside."""
    return len(_INK.sub("", text))


def count(number, thing):
    """'1 block', '2 blocks'."""
    return f"{number} {thing}" + ("" if number == 1 else "s")


def place(location):
    """A Location as a person in the working folder types it."""
    return relative(str(location))

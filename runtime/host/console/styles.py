"""Styled text for a terminal or a pipe.

On a terminal, lines are wrapped to its width and coloured; in a pipe, each fact is one line of any length.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from runtime.host.console.terminal import relative

if TYPE_CHECKING:
    from typing import TextIO

    from graph.diagnostics import Location

TEXT_WIDTH_MINIMUM, NARROW_INDENT = 20, 8  # columns: of text beside a head; indent of text below a head instead
FOLD_INDENT = 4  # columns
_STYLE = re.compile(r"\x1b\[[0-9]*m")
_LABEL = re.compile(r"\s{1,6}\S+( \S+)*\s\s+|\s+")  # the first of several columns, or an indent


@dataclass(frozen=True)
class Console:
    """Width and colour support of an output. width : columns, or None for unlimited"""

    width: int | None = None
    colour: bool = False

    def style(self, text: str, code: int) -> str:
        """Return a text with a style. code : SGR code of ANSI terminals, such as 1 for bold"""
        return f"\x1b[{code}m{text}\x1b[0m" if self.colour and text else text

    def bold(self, text: str) -> str:
        """Return a text in bold."""
        return self.style(text, 1)

    def faint(self, text: str) -> str:
        """Return a text in faint characters."""
        return self.style(text, 2)

    def ok(self, text: str) -> str:
        """Return a text in green."""
        return self.style(text, 32)

    def error(self, text: str) -> str:
        """Return a text in red."""
        return self.style(text, 31)

    def warn(self, text: str) -> str:
        """Return a text in yellow."""
        return self.style(text, 33)

    def hang(self, head: str, text: str, style: Callable[[str], str] = str, indent: int | None = None) -> list[str]:
        """Return lines with the head and, beside it, the text, wrapped at the width with a hanging indent.

        style : function that styles the text
        indent : columns of the continuation lines; the length of the head by default
        """
        column = length(head)
        indent = column if indent is None else indent
        if self.width is None or not text or column + len(text) <= self.width:
            return [head + style(text)]
        if self.width - column < TEXT_WIDTH_MINIMUM:
            if column > NARROW_INDENT:
                return [head.rstrip(), *self.hang(" " * NARROW_INDENT, text, style)]
            return [head + style(text)]
        room = self.width - indent
        first, *rest = textwrap.wrap(
            text,
            room,
            initial_indent=" " * max(0, column - indent),
            break_long_words=False,
            break_on_hyphens=False,
            drop_whitespace=True,
        )
        return [head + style(first.lstrip()), *(" " * indent + style(piece) for piece in rest)]

    def fold(self, line: str) -> list[str]:
        """Return a line without styles as lines of at most the width, with a hanging indent below its second column."""
        head = _LABEL.match(line)
        return self.hang(head[0], line[head.end() :]) if head else self.hang("", line, indent=FOLD_INDENT)

    def cut(self, text: str) -> str:
        """Return a text shortened to the width."""
        return text if self.width is None or len(text) <= self.width else text[: self.width - 1].rstrip() + "…"


def console_for(stream: TextIO | None = None) -> Console:
    """Return the Console of a stream, by default of standard output."""
    stream = stream or sys.stdout
    if stream is None or stream.closed or not stream.isatty():  # closed by a block
        return Console()
    return Console(
        shutil.get_terminal_size().columns, not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    )


def length(text: str) -> int:
    """Return the columns that a text takes, without its styles."""
    return len(_STYLE.sub("", text))


def count(number: int, thing: str) -> str:
    """Return a number with its noun, such as '1 block' or '2 blocks'."""
    return f"{number} {thing}" + ("" if number == 1 else "s")


def place(location: Location) -> str:
    """Return a Location with its path relative to the working folder."""
    return relative(str(location))

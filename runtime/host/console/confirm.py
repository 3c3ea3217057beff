"""Confirmation by the operator on standard input. What was typed before a question was shown does not answer it."""

from __future__ import annotations

import select
import sys
import termios
from contextlib import suppress

from runtime.host.console.terminal import print_lines
from runtime.host.errors import BadInput


def confirm(question: str, yes: bool) -> bool:
    """Return whether the operator confirms a question.

    question : the action to confirm, without a question mark
    yes : confirm without asking

    Raises BadInput if standard input is not a terminal.
    """
    if yes:
        return True
    if sys.stdin is None or not sys.stdin.isatty():
        raise BadInput(
            f"{question}: cannot ask for confirmation: standard input is not a terminal. Pass --yes to skip the "
            "question"
        )
    print_lines([f"{question}? yes or no"])
    discard_typed()
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def discard_typed() -> None:
    """Discard what was typed before on a terminal."""
    with suppress(OSError, ValueError, AttributeError, termios.error):  # a pipe, or a notebook's standard input
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)


def enter_pressed() -> bool:
    """Return whether a line was entered. Raises BadInput at the end of standard input."""
    if not select.select([sys.stdin], [], [], 0)[0]:
        return False
    if not sys.stdin.readline():
        raise BadInput("standard input ended before all steps were done; nothing was written")
    return True

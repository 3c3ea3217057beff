"""Asking a person: yes or no, and Enter when something has been done."""

import select
import sys

from runtime.base.errors import BadInput
from runtime.console.terminal import tell


def sure(question, yes):
    """Whether a person agrees. BadInput where there is nobody to ask. yes : nobody is asked"""
    if yes:
        return True
    if sys.stdin is None or not sys.stdin.isatty():
        raise BadInput(
            f"{question}: nobody is here to say yes (standard input is no terminal); --yes does it without asking"
        )
    tell([f"{question}? yes or no"])
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def entered():
    """Whether a line has been entered. BadInput once nothing more can come."""
    if not select.select([sys.stdin], [], [], 0)[0]:
        return False
    if not sys.stdin.readline():
        raise BadInput("standard input has ended before everything was done; nothing was written")
    return True

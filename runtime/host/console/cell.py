"""Status line below the cell of a notebook."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import Any


def in_cell() -> bool:
    """Return whether this process is the kernel of a notebook whose cells show standard output."""
    return "ipykernel" in sys.modules and hasattr(sys.stdout, "pub_thread")


class Cell:
    """Output of a cell, with what runtime.host.console.progress.Progress needs of a terminal."""

    interactive, unicode, columns = True, True, 100

    def __init__(self) -> None:
        self._shown: Any = None  # IPython.display.DisplayHandle

    def draw(self, text: str) -> None:
        """Replace the status line."""
        display = import_module("IPython.display").display
        content = {"text/plain": text}
        if self._shown is None:
            self._shown = display(content, raw=True, display_id=True)
        else:
            self._shown.update(content, raw=True)

    def erase(self) -> None:
        """Empty the status line, if one is drawn."""
        if self._shown is not None:
            self.draw("")

"""Progress of a long operation, on one line of the terminal or below a cell, which is refreshed in place."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from runtime.host.console.cell import Cell, in_cell
from runtime.host.console.status_layout import bar
from runtime.host.console.stderr import Terminal
from runtime.host.console.terminal import one_line

SHOW_DELAY = 1.0  # s
REFRESH = 0.1  # s
BAR_WIDTH, BAR_WIDTH_MINIMUM = 20, 8  # characters
ENDING_RESERVE = " 100 %, 1000 s left"  # the longest ending; with it reserved, the bar keeps its width


class Progress:
    """Progress of an operation that takes more than a second.

    with Progress("converting trial.mcap") as progress: ... progress(0.4)

    It draws on standard error if that is a terminal, or below the cell of a notebook, and erases its line at the end.
    """

    def __init__(
        self, what: str, terminal: Terminal | Cell | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.what, self.clock = one_line(what), clock
        self.terminal = terminal or (Cell() if in_cell() else Terminal())
        self.began = self.clock()
        self.next = self.began + SHOW_DELAY

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *exception: object) -> None:
        self.terminal.erase()

    def __call__(self, share: float) -> None:
        """Show the progress. share : fraction of the operation that is done, 0 to 1"""
        now = self.clock()
        if now < self.next or not self.terminal.interactive:
            return
        self.next = now + REFRESH
        share = min(1.0, max(0.0, share))
        left = f", {(now - self.began) * (1.0 - share) / share:.0f} s left" if share > 0.02 else ""
        self.terminal.draw(self.line(share, left, self.terminal.columns - 1))

    def line(self, share: float, left: str, width: int) -> str:
        """Return the line in `width` columns: a narrow line gets a shorter bar, then a shortened name."""
        ending = f" {100 * share:.0f} %{left}"
        narrow = min(BAR_WIDTH, max(BAR_WIDTH_MINIMUM, width - len(self.what) - 1 - len(ENDING_RESERVE)))
        text = f" {bar(share, self.terminal.unicode, narrow)}{ending}"
        what, most = self.what, max(0, width - BAR_WIDTH_MINIMUM - 1 - len(ENDING_RESERVE))
        if len(what) > most:
            what = what[: max(0, most - 1)] + ("…" if self.terminal.unicode else "~")
        return f"{what}{text}"[: max(0, width)]

    def part(self, first: float, last: float) -> Callable[[float], None]:
        """Return a progress function for a step that covers the shares from `first` to `last`."""
        return lambda share: self(first + (last - first) * share)


def rounds(what: str, repeats: int) -> Iterator[int]:
    """Yield numbers below `repeats` and show the progress: for _ in rounds("measuring", 15): ..."""
    with Progress(what) as progress:
        for number in range(repeats):
            progress(number / repeats)
            yield number

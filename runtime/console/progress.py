"""How far something is that takes a while: one line on the terminal, refreshed in place, once it has taken a second."""

import time

from runtime.console.status_layout import bar
from runtime.console.stderr import Terminal

PATIENCE = 1.0  # s before anything is shown
REFRESH = 0.1  # s
BAR, LEAST = 20, 8  # characters, at most and at least
ROOM = " 100 %, 1000 s left"  # that the longest ending takes: the bar keeps its width while it changes


class Progress:
    """with Progress("converting trial.mcap") as progress: ... progress(0.4)

    Nothing is shown where standard error is no terminal; the line is gone at the end.
    """

    def __init__(self, what, terminal=None, clock=time.monotonic):
        self.what, self.clock = what, clock
        self.terminal = terminal or Terminal()
        self.began = self.clock()
        self.next = self.began + PATIENCE

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.terminal.erase()

    def __call__(self, share):
        """share : of the whole that is done, 0 to 1"""
        now = self.clock()
        if now < self.next or not self.terminal.interactive:
            return
        self.next = now + REFRESH
        share = min(1.0, max(0.0, share))
        left = f", {(now - self.began) * (1.0 - share) / share:.0f} s left" if share > 0.02 else ""
        self.terminal.draw(self.line(share, left, self.terminal.columns - 1))

    def line(self, share, left, width):
        """In `width` columns: where there are too few the bar gets narrower, then the end of the name goes."""
        told = f" {100 * share:.0f} %{left}"
        narrow = min(BAR, max(LEAST, width - len(self.what) - 1 - len(ROOM)))
        text = f" {bar(share, self.terminal.unicode, narrow)}{told}"
        what, most = self.what, max(0, width - LEAST - 1 - len(ROOM))
        if len(what) > most:
            what = what[: max(0, most - 1)] + ("…" if self.terminal.unicode else "~")
        return f"{what}{text}"[: max(0, width)]

    def part(self, first, last):
        """The same for a step that goes from one share of the whole to another."""
        return lambda share: self(first + (last - first) * share)


def rounds(what, repeats):
    """for _ in rounds("measuring", 15): ... tells between the rounds how far it is."""
    with Progress(what) as progress:
        for number in range(repeats):
            progress(number / repeats)
            yield number

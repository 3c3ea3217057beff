"""Standard error, written to so that it can neither stop nor stall the recorder: a full or broken one is left alone."""

import os
import select

from runtime.console.terminal import harmless, readable

STDOUT, STDERR = 1, 2


class Terminal:
    """
    interactive : it is a terminal that can be drawn on
    coloured, unicode : what it can show
    """

    def __init__(self, descriptor=STDERR, environment=os.environ):
        self.descriptor = descriptor
        dumb = environment.get("TERM", "") in ("", "dumb")
        self.interactive = os.isatty(descriptor) and not dumb
        self.coloured = self.interactive and not environment.get("NO_COLOR")
        locale = next((environment[name] for name in ("LC_ALL", "LC_CTYPE", "LANG") if environment.get(name)), "")
        self.unicode = "utf" in locale.lower() or not locale  # Python, too, takes UTF-8 where nothing is said
        self.poll = select.poll()
        self.drawn = False
        try:
            self.poll.register(descriptor, select.POLLOUT)
        except OSError:
            self.interactive = False

    @property
    def columns(self):
        try:
            return os.get_terminal_size(self.descriptor).columns or 80
        except OSError:
            return 80

    def write(self, text):
        """Write if it can be done at once. A terminal held by Ctrl-S would otherwise hold the recording."""
        try:
            if any(state & select.POLLOUT for _, state in self.poll.poll(0)):
                encoding = "utf-8" if self.unicode else "ascii"
                os.write(self.descriptor, readable(text, encoding).encode(encoding))
        except OSError:
            self.interactive = False  # it has gone away

    def draw(self, text):
        """Replace the status line."""
        if self.interactive:
            self.write(f"\r{harmless(text, self.coloured)}\x1b[K")
            self.drawn = True

    def erase(self):
        if self.drawn:
            self.write("\r\x1b[K")
            self.drawn = False

    def say(self, line):
        """A line that stays."""
        self.erase()
        self.write(harmless(line, self.coloured) + "\n")

"""A plant that runs in real time on its buses until somebody ends it, with a line on the terminal that says how it
goes.
"""

import threading
from contextlib import contextmanager

from cext.bus.timed_bus import SlowBus
from cext.safety.shared_state import SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from runtime.console.stderr import Terminal

REFRESH = 0.2  # s
ROOM = 1 << 16  # bytes of the ring, which nobody reads
BEHIND = 100  # steps that are made up for when the machine was elsewhere


class Service:
    """schedule : of the plant; ends : of its buses; bitrate : bit/s that they are slowed down to, or None"""

    def __init__(self, schedule, ends, bitrate=None):
        self.page = SharedState(ROOM)
        self.slowed = [] if bitrate is None else [SlowBus(end, bitrate) for end in ends]
        ends = [slow.end for slow in self.slowed] or ends
        self.program = Program(schedule, ends)
        self.executor = Executor(self.program, schedule.rate, page=self.page, overrun=f"catch-up:{BEHIND}")
        self.rate = schedule.rate

    def run(self, duration=None):
        """Until a signal, or for so many s. Returns the Outcome."""
        with self.told():
            return self.executor.run(-1 if duration is None else max(1, round(duration * self.rate)))

    @property
    def statistics(self):
        return self.page.statistics()

    @contextmanager
    def told(self):
        """With a status line, where there is a terminal. The loop holds no GIL, so another thread can tell."""
        terminal, over = Terminal(), threading.Event()

        def refresh():
            before = self.page.statistics()
            while not over.wait(REFRESH):
                now = self.page.statistics()
                terminal.draw(line(before, now, self.rate)[: terminal.columns - 1])
                before = now
            terminal.erase()

        thread = threading.Thread(target=refresh, daemon=True)
        if terminal.interactive:
            thread.start()
        try:
            yield
        finally:
            over.set()
            if thread.is_alive():
                thread.join()


def line(before, now, rate):
    """How it goes. before, now : statistics that are REFRESH apart"""
    heard, said = ((now["frames"][kind] - before["frames"][kind]) / REFRESH for kind in ("received", "sent"))
    return (
        f"emulating {(now['last_tick'] + 1) / rate:.1f} s · {heard:.0f} frames/s heard, {said:.0f} answered · "
        f"late {now['lateness']['p99'] * 1e6:.0f} µs · missed {now['missed']} · Ctrl-C ends it"
    )

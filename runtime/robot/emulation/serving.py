"""Real-time run of a plant on its buses until a signal, with a status line on the terminal."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from cext.bus.timed_bus import SlowBus
from cext.memory.shared_state import SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from runtime.host.console.stderr import Terminal
from runtime.robot.emulation.priority import priority_of_loop

if TYPE_CHECKING:
    from cext.bus.memory_bus import BusEnd
    from cext.schedule.outcome import Outcome
    from graph import Schedule

REFRESH = 0.2  # s
RING_BYTES = 1 << 16  # of the ring, which has no reader
CATCH_UP_LIMIT = 100  # steps that run late after a delay


class Service:
    """Plant in real time.

    schedule : schedule of the plant
    ends : ends of its buses, in the order of the schedule
    bitrate : bit/s, to which each bus is slowed down; None for no limit
    data_bitrates : bit/s of the data phase of CAN FD on each bus, 0 for none
    """

    def __init__(
        self,
        schedule: Schedule,
        ends: Sequence[BusEnd],
        bitrate: float | None = None,
        data_bitrates: Sequence[float] | None = None,
    ) -> None:
        self.shared = SharedState(RING_BYTES)
        self.slowed = (
            []
            if bitrate is None
            else [
                SlowBus(end, bitrate, fast and max(fast, bitrate))
                for end, fast in zip(ends, data_bitrates or [0.0] * len(ends))
            ]
        )
        ends = [slow.end for slow in self.slowed] or ends
        self.program = Program(schedule, ends)
        self.executor = Executor(self.program, schedule.rate, shared=self.shared, overrun=f"catch-up:{CATCH_UP_LIMIT}")
        self.rate = schedule.rate

    def run(self, duration: float | None = None) -> Outcome:
        """Run until a signal, or for `duration` s. Returns the Outcome."""
        with self.status_line(), priority_of_loop():
            return self.executor.run(-1 if duration is None else max(1, round(duration * self.rate)))

    @property
    def statistics(self) -> dict[str, Any]:
        """Statistics of the shared state."""
        return self.shared.statistics()

    @contextmanager
    def status_line(self) -> Iterator[None]:
        """Show a status line on a terminal, from another thread, since the loop does not hold the GIL."""
        terminal, over = Terminal(), threading.Event()

        def refresh():
            before = self.shared.statistics()
            while not over.wait(REFRESH):
                now = self.shared.statistics()
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


def line(before: Mapping[str, Any], now: Mapping[str, Any], rate: float) -> str:
    """Return the status line.

    before, now : statistics at an interval of REFRESH
    rate : Hz of the plant
    """
    received, sent = ((now["frames"][kind] - before["frames"][kind]) / REFRESH for kind in ("received", "sent"))
    late = now["lateness"]
    lateness = f"late {late['p99'] * 1e6:.0f} µs · " if late["count"] else ""
    return (
        f"emulating {(now['last_tick'] + 1) / rate:.1f} s · {received:.0f} frames/s received, {sent:.0f} sent · "
        f"{lateness}missed {now['missed']} · Ctrl-C to end"
    )

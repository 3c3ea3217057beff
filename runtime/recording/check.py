"""Check of the messages of a recording, chunk by chunk: sizes, times, frames and events."""

from typing import Any

import numpy as np

from runtime.recording.chunks import NONE, Messages, gathered
from runtime.recording.columns import HEADS, TICK, Damaged, Layout
from runtime.recording.mcap_file import MESSAGE_REST

NO_TIMES = np.zeros(0, dtype=np.int64)


class Check:
    """Check of chunks in order.

    before : {channel: number of messages before the first of these chunks}
    """

    def __init__(self, layout: Layout, before: dict[Any, int]) -> None:
        self.layout = layout
        self.begun = {channel for channel, count in before.items() if count}
        # log times of rows and ticks without counterpart, of the subsystems that begin with the same row as the ticks
        self.open = {
            channel: (NO_TIMES, NO_TIMES)
            for channel, subsystem in layout.subsystems.items()
            if before.get(channel, 0) == before.get(layout.tick, 0)
            and (subsystem.every == 1 or channel not in self.begun)
        }

    def first_damaged(self, chunk: Messages) -> int | None:
        """Return the position of the first message that is invalid or lacks its row; None without one.

        Raises BadInput if the rows are not of the recorded signals.
        """
        bad = [self.first_damaged_row(chunk), first_damaged_content(self.layout, chunk)]
        return min((offset for offset in bad if offset is not None), default=None)

    def first_damaged_row(self, chunk: Messages) -> int | None:
        """Return the position of the first invalid row, or tick without its row. Errors as of `first_damaged`"""
        layout, bad = self.layout, []
        bad += [offsets[0] for channel, offsets in chunk.offsets.items() if channel not in layout.topics]
        times = {}
        for channel, kind in layout.rows.items():
            offsets = chunk.offsets.get(channel, NONE)
            heads = gathered(chunk.data, offsets, HEADS)
            wrong = heads["length"] != MESSAGE_REST + kind.itemsize
            if wrong.any():
                if wrong[0] and channel not in self.begun:
                    raise layout.mismatch()
                bad.append(offsets[int(np.argmax(wrong))])
            if len(offsets):
                self.begun.add(channel)
            times[channel] = heads["log_time"]
        for channel in self.open:
            if layout.subsystems[channel].every == 1 or not bad:  # the others need the number of each tick
                bad += self.ticks_without_row(chunk, channel, times)
        return int(min(bad)) if bad else None

    def ticks_without_row(self, chunk: Messages, channel: int, times: dict[int, Any]) -> list[int]:
        """Return [offset of the first tick whose time is not that of its row in a subsystem].

        channel : of the subsystem
        times : {channel: log times of its messages, in ns}
        """
        rows, ticks = self.open[channel]
        before, every = len(ticks), self.layout.subsystems[channel].every
        times_of_ticks, offsets = times[self.layout.tick], chunk.offsets.get(self.layout.tick, NONE)
        if every > 1:
            recorded = chunk.bodies(self.layout.tick, TICK)["tick"] % every == 0
            times_of_ticks, offsets = times_of_ticks[recorded], offsets[recorded]
        rows, ticks = np.concatenate((rows, times[channel])), np.concatenate((ticks, times_of_ticks))
        both = min(len(rows), len(ticks))
        differ = rows[:both] != ticks[:both]
        self.open[channel] = rows[both:], ticks[both:]
        if not differ.any():
            return []
        return [offsets[max(0, int(np.argmax(differ)) - before)]]


def first_damaged_content(layout: Layout, chunk: Messages) -> int | None:
    """Return the position of the first invalid message with frames or an event; None without one."""
    bad = []
    for content in (lambda: layout.frames(chunk, 0, 0), lambda: layout.events_of(chunk)):
        try:
            content()
        except Damaged as damage:
            bad.append(damage.offset)
    return min(bad, default=None)

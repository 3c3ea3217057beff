"""Check of a recording: which chunks are undamaged, and which of their rows are complete.

A damaged chunk is a gap. The messages of one row may be in two chunks, so that beside a gap the channels begin and end
with different rows: only rows that are complete in every channel are used, by the low 32 bits of the tick in the
`sequence` of their messages.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from runtime.record.storage.chunks import NONE, PLACE, Chunk, Messages, take_records
from runtime.record.storage.columns import HEADS, TICK, Damaged, Layout
from runtime.record.storage.mcap_file import CHUNK_HEAD, INDEX, MESSAGE_REST

NAMED_LIMIT = 3  # gaps that are named in a text


class Inspected(NamedTuple):
    """Content of a chunk.

    limit : position of its first invalid message; None without one
    counts : {channel: number of messages before it}
    numbers : {channel: `sequence` of the messages of rows, as int64}
    ticks : numbers of the ticks, int64
    """

    limit: int | None
    counts: dict[int, int]
    numbers: dict[int, np.ndarray]
    ticks: np.ndarray


def inspect(layout: Layout, chunk: Chunk, messages: Messages) -> Inspected:
    """Check every message of a chunk.

    Raises BadInput if the rows of a chunk with a valid checksum are not those of the recorded signals; ValueError or
    LookupError if it is damaged.
    """
    bad: list[int] = []
    for channel in messages.offsets.keys() - layout.topics.keys():
        if chunk.headless:
            bad.append(messages.offsets[channel][0])
        else:  # the record of the channel is damaged
            del messages.offsets[channel]
    for channel, kind in layout.rows.items():
        offsets = messages.offsets.get(channel, NONE)
        wrong = take_records(messages.data, offsets, HEADS)["length"] != MESSAGE_REST + kind.itemsize
        if wrong.any():
            if wrong[0] and not chunk.headless:
                raise layout.mismatch()
            bad.append(offsets[int(np.argmax(wrong))])
    bad += damaged_content(layout, messages)
    if not bad and layout.tick is not None:
        records = messages.records(layout.tick, TICK)
        ticks = records["body"]["tick"]
        wrong = ticks & 0xFFFFFFFF != records["sequence"]
        wrong[1:] |= ticks[1:] < ticks[:-1]
        bad += messages.offsets[layout.tick][wrong][:1].tolist() if wrong.any() else []
    limit = int(min(bad)) if bad else None
    messages = messages if limit is None else messages.until(limit)
    heads = {
        channel: take_records(messages.data, messages.offsets.get(channel, NONE), HEADS) for channel in layout.rows
    }
    return Inspected(
        limit,
        {channel: len(offsets) for channel, offsets in messages.offsets.items()},
        {channel: records["sequence"].astype(np.int64) for channel, records in heads.items()},
        NONE if layout.tick is None else messages.bodies(layout.tick, TICK)["tick"].astype(np.int64),
    )


def damaged_content(layout: Layout, chunk: Messages) -> list[int]:
    """Return the position of the first invalid message with frames, and of that with an event."""
    bad: list[int] = []
    for content in (lambda: layout.frames(chunk, 0, 0), lambda: layout.events_of(chunk)):
        try:
            content()
        except Damaged as damage:
            bad.append(damage.offset)
    return bad


@dataclass
class Gap:
    """Damaged bytes in a file, and the ticks beside them.

    places : [(first byte, end)]
    before, after : last complete tick before it, first one after it; None without one
    """

    places: list[tuple[int, int]]
    before: int | None
    after: int | None = None


class Check:
    """Check of the chunks of a file in order: adds up complete rows from one gap to the next.

    gaps : [Gap]
    chunks : those that are undamaged, with the messages of complete rows
    count : number of valid messages
    indices : [(first byte, end)] of damaged message indices
    """

    def __init__(self, layout: Layout) -> None:
        self.layout, self.count = layout, 0
        self.gaps: list[Gap] = []
        self.chunks: list[Chunk] = []
        self.indices: list[tuple[int, int]] = []
        self.last: int | None = None  # complete tick
        self.begin()

    def begin(self) -> None:
        """Begin the run of chunks after a gap."""
        self.run: list[Chunk] = []
        self.open = dict.fromkeys(self.layout.rows, NONE)  # {channel: ticks of messages of rows that are not complete}
        self.skipped, self.used = (dict.fromkeys(self.layout.rows, 0) for _ in range(2))  # {channel: messages}
        self.is_aligned = False

    def add(self, chunk: Chunk, found: Inspected) -> None:
        """Add an undamaged chunk, or the part of one before its first invalid message."""
        chunk.limit, chunk.counts = found.limit, found.counts
        self.count += sum(found.counts.values())
        if not chunk.is_indexed:
            self.indices.append((chunk.begin + chunk.length, chunk.end))
        self.run.append(chunk)
        self.chunks.append(chunk)
        near = int(found.ticks[0]) if len(found.ticks) else self.last or 0
        for channel, numbers in found.numbers.items():
            whole = near + (numbers - near + 2**31) % 2**32 - 2**31
            self.open[channel] = np.concatenate((self.open[channel], whole))
        if not self.is_aligned:
            self.align()
        if self.is_aligned and not self.match() or chunk.limit is not None:
            self.lose(chunk.begin + (chunk.limit or 0) * (not chunk.compression), chunk.end)

    def align(self) -> None:
        """Skip the messages before the first complete row, once all channels have reached it."""
        numbers = [self.open[channel] for channel in self.layout.complete]
        if not numbers or not all(map(len, numbers)):
            return
        first = int(max(ticks[0] for ticks in numbers))
        if any(ticks[-1] < first for ticks in numbers):
            return
        for channel, every in self.partial() if self.gaps else ():
            if first % every == 0 and first not in self.open[channel]:  # its message was before that of other channels
                first += 1
                break
        for channel, ticks in self.open.items():
            self.skipped[channel] = int(np.searchsorted(ticks, first))
            self.open[channel] = ticks[self.skipped[channel] :]
        self.is_aligned = True

    def partial(self) -> list[tuple[int, int]]:
        """Return [(channel, ticks from one message to the next)] of the signals at a lower rate."""
        return [(channel, part.every) for channel, part in self.layout.subsystems.items() if part.every > 1]

    def match(self) -> bool:
        """Count the rows that are complete. Returns whether the messages of all channels are of the same rows."""
        complete = self.layout.complete
        both = good = min(len(self.open[channel]) for channel in complete)
        ticks = self.open[self.layout.tick][:both]
        for channel in complete:
            differ = self.open[channel][:both] != ticks
            good = min(good, int(np.argmax(differ))) if differ.any() else good
        for channel, every in self.partial():
            due = np.flatnonzero(ticks[:good] % every == 0)
            own = self.open[channel][: len(due)]
            differ = np.append(ticks[due[: len(own)]] != own, np.ones(len(due) - len(own), dtype=bool))
            good = min(good, int(due[np.argmax(differ)])) if differ.any() else good
        if good:
            if self.gaps and self.gaps[-1].after is None:
                self.gaps[-1].after = int(ticks[0])
            self.last = int(ticks[good - 1])
        counts = {channel: int(np.count_nonzero(ticks[:good] % every == 0)) for channel, every in self.partial()}
        for channel in self.layout.rows:
            count = counts.get(channel, good)
            self.open[channel] = self.open[channel][count:]
            self.used[channel] += count
        return good == both

    def lose(self, begin: int, end: int) -> None:
        """End the run of chunks before damaged bytes, unless they are the index of the last chunk.

        begin, end : range of the bytes in the file
        """
        if self.run:
            last, counts = self.run[-1], self.run[-1].counts.values()
            index = sum(INDEX.size + PLACE.itemsize * count for count in counts if count)
            more = end - (last.begin + last.length + index)  # other writers add empty indices; a chunk is larger
            if begin >= last.begin + last.length and -CHUNK_HEAD.size < more < 2 * CHUNK_HEAD.size:
                self.indices.append((begin, end))
                return
        self.trim(to_end=False)
        if self.gaps and self.gaps[-1].after is None:
            places = self.gaps[-1].places
            if places[-1][1] == begin:
                begin = places.pop()[0]
            places.append((begin, end))
        else:
            self.gaps.append(Gap([(begin, end)], self.last))
        self.begin()

    def trim(self, to_end: bool) -> None:
        """Leave out the messages of incomplete rows. to_end : whether the run ends with the file, not with a gap"""
        for channel in self.layout.rows:
            total = at = sum(chunk.counts.get(channel, 0) for chunk in self.run)
            low = self.skipped[channel]
            if not self.is_aligned and (self.gaps or not to_end):
                low = total
            high = total if to_end else low + self.used[channel]
            at = 0
            for chunk in self.run:
                count = chunk.counts.get(channel, 0)
                first = min(max(low - at, 0), count)
                last = min(max(at + count - high, 0), count - first)
                if first or last:
                    chunk.trim[channel] = (first, last)
                    chunk.counts[channel] = count - first - last
                at += count

    def end(self) -> None:
        """End the last run with the file."""
        self.trim(to_end=True)

    def text(self, rate: float, size: int, last: int | None) -> str:
        """Return the gaps as the end of a sentence; "" without one.

        rate : tick rate in Hz
        size : size of the file, in bytes
        last : last tick of the run; None if it is unknown
        """
        gaps = [*self.gaps, *([Gap(self.indices, -1, 0)] if self.indices else [])]
        texts = [gap_text(gap, rate, last) for gap in gaps[:NAMED_LIMIT]]
        more = len(gaps) - len(texts)
        if more:
            texts.append(f"and {more} more {'gap' if more == 1 else 'gaps'}")
        return f"is damaged: of its {size} bytes, {'; '.join(texts)}" if texts else ""


def gap_text(gap: Gap, rate: float, last: int | None) -> str:
    """Return a Gap as text. Arguments as in Check.text"""
    bytes_text = list_places(f"{begin} to {end - 1}" for begin, end in gap.places)
    first = None if gap.before is None else gap.before + 1
    until = last if gap.after is None else gap.after - 1
    if first is None and until is None:
        ticks = "with all ticks"
    elif until is None:
        ticks = f"with the ticks from {first} ({(first or 0) / rate:g} s) on"
    elif until < (first or 0):
        ticks = "no tick is missing"
    elif first is None:
        ticks = f"with the ticks up to {until} ({until / rate:g} s)"
    else:
        ticks = f"with the ticks {first} to {until} ({first / rate:g} s to {until / rate:g} s)"
    return f"{bytes_text} are lost, {ticks}"


def list_places(places: Iterable[str]) -> str:
    """Return places as text, the first of them by name."""
    names: list[Any] = list(places)
    more = len(names) - NAMED_LIMIT
    return ", ".join([*names[:NAMED_LIMIT], *([f"{more} more"] if more > 0 else [])])

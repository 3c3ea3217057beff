"""Reader: one file of a recording, of which only the required chunks are read.

Opening reads the summary of a complete file, or scans any other file for its chunks. Before the first value is read,
every chunk is checked, once: damaged chunks are gaps, and what the file contains is the same from then on. Any other
file is rejected with a message that names its content.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from runtime.host.errors import BadInput
from runtime.host.optional_dependencies import need
from runtime.record.storage import read_ahead
from runtime.record.storage.batches import NO_FRAMES, Rows
from runtime.record.storage.check import Check, Inspected, inspect
from runtime.record.storage.chunks import MESSAGE_HEAD, Chunk, ExpansionLimit, Messages, TooLarge, load
from runtime.record.storage.columns import Layout
from runtime.record.storage.contents import Contents, read_summary
from runtime.record.storage.correction import correct_byte
from runtime.record.storage.mcap_file import HEAD
from runtime.record.storage.metadata import validate
from runtime.record.storage.records import DAMAGE, LIBRARY, MAGIC, read
from runtime.record.storage.scan import Scan

FRAMES_GROWTH = 4  # size of decoded frames, as a multiple of that of their messages
Result = TypeVar("Result")


class Unbegun(BadInput):
    """A file whose recorder was killed before its first tick."""


@dataclass(frozen=True)
class Recorded:
    """CAN frame.

    time : ns since the start of the run
    drain : number of the bus drain that returned or preceded it, from 1; 0 before the first
    drained : time of that drain, in ns since the start of the run
    row : rows that were complete before it
    payload : bytes of a struct Frame
    """

    time: int
    bus: str
    sent: bool
    drain: int
    drained: int
    row: int
    payload: bytes


class Reader:
    """One file of a recording.

    path : path of the file
    progress : called with the fraction of the file that has been scanned

    about, end, diagram : its attachments; `end` and `diagram` may be None
    began : time of its start, in ns of the file: the wall clock, or 0 in virtual time

    Raises BadInput if the file is not a recording, or one of a newer Tickwork.
    """

    def __init__(self, path: Path, progress: Callable[[float], None]) -> None:
        need("mcap.stream_reader", "reading a recording")
        self.path = path
        if path.is_fifo():  # `open` would wait for its writer
            raise BadInput(f"{path} is a pipe, and a recording is not read in order: pass a file")
        try:
            with open(path, "rb", buffering=0) as stream:
                self.size = os.fstat(stream.fileno()).st_size
                contents = read_summary(stream, self.size) or Scan(stream, self.size, progress).contents
        except FileNotFoundError:
            raise BadInput(f"{path}: No such file or directory{nearby(path)}") from None
        except IsADirectoryError:
            if not any(path.glob("*.mcap")):
                raise BadInput(f"the folder {path} contains no recording (.mcap)") from None
            raise BadInput(f"{path} is a folder: pass the recordings in it, as in {path / '*.mcap'}") from None
        except OSError as error:
            raise BadInput(f"{path}: {error.strerror}") from None
        if contents.about is None:
            raise self.not_a_recording(contents)
        validate(path, contents.about)
        self.layout = Layout(path, contents.about, contents.topics)
        self.about, self.end, self.diagram = contents.about, contents.end, contents.diagram
        self.found = contents

    @cached_property
    def contents(self) -> Contents:
        """Contents of the file, with the chunks that are undamaged."""
        self.check()
        return self.__dict__["contents"]

    def check(self, progress: Callable[[float], None] = lambda share: None) -> None:
        """Check every message of the file, once. progress : called with the fraction that has been checked

        Raises BadInput if the file is not a recording.
        """
        if "contents" in self.__dict__:
            return
        contents, check = self.found, Check(self.layout)
        chunks, others, refused = admit_chunks(contents.chunks, self.size)
        gaps = sorted([*contents.gaps, *others])
        with open(self.path, "rb", buffering=0) as stream:
            found = read_ahead.ahead(
                lambda chunk: self.inspect_chunk(stream.fileno(), chunk), chunks, lambda chunk: chunk.size
            )
            for number, (chunk, content) in enumerate(zip(chunks, found)):
                progress(number / len(chunks))
                while gaps and gaps[0][0] < chunk.at:
                    check.lose(*gaps.pop(0))
                if content is None:
                    check.lose(chunk.at, chunk.end)
                else:
                    check.add(chunk, content)
        for gap in gaps:
            check.lose(*gap)
        check.end()
        contents.chunks = check.chunks
        end: dict[str, Any] = contents.end or {}
        texts = [check.text(self.about["rate"], self.size, end.get("last_tick"))]
        if not check.gaps and contents.written not in (None, check.count) and not refused:
            texts.append(f"is damaged: {check.count} of its {contents.written} messages are readable")
        texts += [f"is damaged: the checksum of its {name} is wrong, and it is not used" for name in contents.broken]
        texts += [*contents.damages, refused]
        self.is_damaged = any(texts)
        begin = -1 if self.about.get("part", 1) == 1 else None
        between = [(begin if gap.before is None else gap.before, gap.after) for gap in check.gaps]
        self.gaps = [(a, b) for a, b in between if a is not None and b is not None and b - a > 1]
        texts.append(contents.trouble.removeprefix(f"{self.path} "))
        unverified = [chunk.counts for chunk in check.chunks if chunk.is_unverified]
        self.unverified = sum(counts.get(self.layout.tick, 0) for counts in unverified)
        if contents.trouble and self.unverified:
            texts[-1] += f"; {self.unverified} of its ticks are not verified by a checksum"
        self.is_unfinished = contents.is_unfinished and not self.is_damaged and not self.unverified
        contents.trouble = f"{self.path} {', and '.join(filter(None, texts))}" if any(texts) else ""
        contents.finished = not contents.trouble
        self.contents = contents

    def inspect_chunk(self, descriptor: int, chunk: Chunk) -> Inspected | None:
        """Read a chunk and check its messages. Returns None for a damaged one. Errors as in `check`"""
        try:
            return inspect(self.layout, chunk, load(descriptor, chunk))
        except (OSError, BadInput):
            raise
        except DAMAGE:
            return None

    @cached_property
    def before(self) -> dict[Any, list[int]]:
        """{channel: number of messages before each chunk, and in all}."""
        channels: list[Any] = [*self.layout.rows, self.layout.events, *self.layout.buses]
        return {
            channel: list(accumulate((chunk.counts.get(channel, 0) for chunk in self.contents.chunks), initial=0))
            for channel in channels
        }

    def __len__(self) -> int:
        """Return the number of complete rows."""
        return min((self.before[channel][-1] for channel in self.layout.complete), default=0)

    @property
    def trouble(self) -> str:
        """Problem with the file, in one line; "" without one."""
        return self.contents.trouble

    @property
    def finished(self) -> bool:
        """Whether the recorder has completed the file."""
        return self.contents.finished

    def not_a_recording(self, contents: Contents) -> BadInput:
        """Return the problem with a file that is not a recording."""
        with open(self.path, "rb") as stream:
            mcap = stream.read(len(MAGIC)) == MAGIC
        if self.size == 0 or mcap and contents.library == LIBRARY:
            return Unbegun(f"{self.path} was truncated before its first tick and contains no data")
        if "about.json" in contents.broken:
            problem = "is damaged: the checksum of its about.json, which lists the signals, is wrong"
        elif mcap:
            problem = (
                f"is an MCAP file of another program ({contents.library or 'unknown'}): pass a recording of Tickwork"
            )
        else:
            beside = self.path.parent / f"{self.path.stem}.mcap"
            cure = f"pass {beside}" if beside != self.path and beside.exists() else "pass the .mcap file of the run"
            problem = f"is not a recording of Tickwork: {cure}"
        return BadInput(f"{self.path} {problem}")

    def ahead(
        self, work: Callable[[int, Messages], Result], numbers: Iterable[int], growth: int = 1
    ) -> Iterator[Result]:
        """Yield the result of work(number, Messages) for chunks, in order, while threads work on the next chunks.

        growth : size of a result, as a multiple of that of the messages

        Raises BadInput if the file has changed since it was checked.
        """
        chunks = self.contents.chunks

        def check_chunk(number: int) -> Result:
            messages = load(stream.fileno(), chunks[number])
            offsets, counts = messages.offsets, chunks[number].counts
            if any(len(offsets.get(channel, ())) != count for channel, count in counts.items()):
                raise ValueError("other messages")
            return work(number, messages)

        with open(self.path, "rb", buffering=0) as stream:
            try:
                yield from read_ahead.ahead(check_chunk, numbers, lambda number: growth * chunks[number].size)
            except (OSError, BadInput):
                raise
            except DAMAGE:
                raise BadInput(f"{self.path} has changed while it was read") from None

    def attachments(self, places: Iterable[tuple[int, int]]) -> Iterator[Any]:
        """Yield attachments as records of the mcap package. places : as in Contents"""
        with open(self.path, "rb", buffering=0) as stream:
            for at, size in places:
                body = correct_byte(os.pread(stream.fileno(), size, at)[HEAD.size :])
                if body is not None:
                    yield read("Attachment", body)

    def with_messages(self, channels: Iterable[int], first: int = 0, last: int | None = None) -> list[int]:
        """Return the numbers of the chunks with messages of channels, of the rows from `first` to `last`."""
        return [
            number
            for number in range(len(self.contents.chunks))
            if any(
                self.before[channel][number] < min(last, self.before[channel][number + 1])
                and self.before[channel][number + 1] > first
                if last is not None
                else self.before[channel][number] < self.before[channel][number + 1]
                for channel in channels
            )
        ]

    def rows(self, places: Iterable[int], first: int = 0, last: int | None = None) -> Rows:
        """Read rows.

        places : places of the signals
        first, last : rows; by default all
        """
        places = list(places)
        last = len(self) if last is None else min(last, len(self))
        rows, layout = Rows.empty(max(0, last - first), len(places)), self.layout
        columns = {place: column for column, place in enumerate(places)}
        fields = {
            channel: [(rows.values[:, columns[place]], str(place)) for place in subsystem.columns if place in columns]
            for channel, subsystem in layout.subsystems.items()
        }
        fields = {channel: targets for channel, targets in fields.items() if targets}
        if layout.tick is not None:
            fields[layout.tick] = [(getattr(rows, name), name) for name in ("tick", "time", "lateness")]

        partial = {channel: fields.pop(channel) for channel in [*fields] if channel not in layout.complete}
        for values, _ in (target for targets in partial.values() for target in targets):
            values.fill(np.nan)
        numbers: Iterable[int] = self.with_messages(fields, first, last)
        if partial and numbers:  # the messages are before the tick of their row, at most one chunk before it
            numbers = range(max(0, min(numbers) - 1), max(numbers) + 1)

        def fill(number: int, chunk: Messages) -> dict[int, Any]:
            for channel, targets in fields.items():
                begin, end = self.before[channel][number : number + 2]
                low, high = max(begin, first), min(end, last)
                if low >= high:
                    continue
                bodies = chunk.bodies(channel, layout.rows[channel])
                for target, name in targets:
                    target[low - first : high - first] = bodies[name][low - begin : high - begin]
            return {channel: chunk.records(channel, layout.rows[channel]) for channel in partial}

        samples = list(self.ahead(fill, numbers))
        for channel, targets in partial.items() if len(rows.tick) else ():
            for records in (records_of[channel] for records_of in samples):
                at, bodies = place_records(records, rows.tick)
                for target, name in targets:
                    target[at] = bodies[name]
        return rows

    def frames(self, numbers: Iterable[int] | None = None) -> Iterator[np.ndarray]:
        """Yield the frames of chunks as arrays of FRAME. numbers : numbers of the chunks; by default all with frames"""
        numbers, decode = self.with_messages(self.layout.buses) if numbers is None else numbers, self.decoder()
        yield from self.ahead(decode, numbers, FRAMES_GROWTH)

    def decoder(self) -> Callable[[int, Messages], np.ndarray]:
        """Return the function that decodes the frames of a chunk."""
        began, layout, rows = self.began, self.layout, self.before.get(self.layout.tick)
        return lambda number, chunk: layout.frames(chunk, began, 0 if rows is None else rows[number])

    def stream(self, with_frames: bool = True) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield (rows as in a Batch, frames as an array of FRAME) of every chunk, in order.

        A row whose messages are in several chunks is yielded with the last of them.

        with_frames : whether the frames are read; else there are none
        """
        open_rows: dict[int, Any] = {
            channel: np.zeros(0, dtype=[*MESSAGE_HEAD, ("body", kind)]) for channel, kind in self.layout.rows.items()
        }

        def none_of(number: int, chunk: Messages) -> np.ndarray:
            return NO_FRAMES

        decode = self.decoder() if self.layout.buses and with_frames else none_of

        def decoded(number: int, chunk: Messages) -> tuple[dict[int, Any], Any]:
            parts = {channel: chunk.records(channel, kind) for channel, kind in self.layout.rows.items()}
            return parts, decode(number, chunk)

        for parts, frames in self.ahead(decoded, range(len(self.contents.chunks)), FRAMES_GROWTH):
            open_rows = {channel: np.concatenate((open_rows[channel], part)) for channel, part in parts.items()}
            yield self.complete_rows(open_rows), frames

    def complete_rows(self, messages: dict[int, Any]) -> np.ndarray:
        """Remove complete rows from messages and return them, as in a Batch. messages : {channel: records}"""
        layout = self.layout
        count = min((len(messages[channel]) for channel in layout.complete), default=0)
        rows = np.full((count, 2 + len(self.about["signals"])), np.nan)
        channels: list[Any] = [layout.tick, *layout.subsystems]  # the ticks first
        for channel in channels if count else ():
            records = messages[channel]
            if channel in layout.complete:
                places, bodies = slice(None), records["body"][:count]
            else:
                places, bodies = place_records(records, rows[:, 0].astype(np.int64))
            messages[channel] = records[len(bodies) :]
            if channel == layout.tick:
                rows[:, 0], rows[:, 1] = bodies["tick"], bodies["lateness"]
            else:
                for signal in layout.subsystems[channel].columns:
                    rows[places, 2 + signal] = bodies[str(signal)]
        return rows

    @cached_property
    def events(self) -> list[dict[str, Any]]:
        """Events, as dicts."""
        numbers = [] if self.layout.events is None else self.with_messages([self.layout.events])
        chunks = self.ahead(lambda _, chunk: self.layout.events_of(chunk), numbers)
        return [event for events in chunks for event in events]

    @cached_property
    def began(self) -> int:
        """Time of the start of the run, in ns of the file."""
        return next((event["wall"] for event in self.events if event["event"] == "begin"), 0)

    def row_from(self, name: str, value: float) -> int:
        """Return the number of the first row whose tick or time is `value` or more. name : "tick" or "time" """
        low, high = 0, len(self)
        while low < high:
            middle = (low + high) // 2
            number = np.searchsorted(self.before[self.layout.tick], middle, side="right") - 1
            begin, end = self.before[self.layout.tick][number : number + 2]
            ticks = getattr(self.rows([], begin, min(end, len(self))), name)
            place = int(np.searchsorted(ticks, value))
            if place == 0:
                high = begin
            elif place == len(ticks):
                low = begin + place
            else:
                return begin + place
        return low


def admit_chunks(chunks: list[Chunk], size: int) -> tuple[list[Chunk], list[tuple[int, int]], str]:
    """Return (chunks that are read, places of the others, why not the first of these as the end of a sentence).

    A wrong byte can make a chunk declare any size.

    size : size of the file, in bytes
    """
    expansion = ExpansionLimit(size)
    read: list[Chunk] = []
    others: list[tuple[int, int]] = []
    reasons: list[str] = []
    for chunk in chunks:
        try:
            if chunk.compression:
                expansion.admit(chunk.size)
            read.append(chunk)
        except TooLarge as error:
            others.append((chunk.at, chunk.end))
            reasons.append(str(error))
    return read, others, reasons[0] if reasons else ""


def place_records(records: Any, ticks: np.ndarray) -> tuple[np.ndarray, Any]:
    """Return (rows, contents) of those message records that belong to rows.

    records : their `sequence` has the low 32 bits of a tick
    ticks : ticks of the rows, at least one
    """
    numbers = ticks[0] + (records["sequence"].astype(np.int64) - ticks[0]) % 2**32
    own = numbers <= ticks[-1]
    return np.searchsorted(ticks, np.asarray(numbers[own], dtype=np.int64)), records["body"][own]


def nearby(path: Path) -> str:
    """Return a suggestion for the name of a file that does not exist."""
    try:
        names = sorted(name for name in os.listdir(path.parent) if name.endswith(".mcap"))
    except OSError:
        return ""
    close = difflib.get_close_matches(path.name, names, n=1)
    return f": did you mean {path.parent / close[0]}?" if close else ""

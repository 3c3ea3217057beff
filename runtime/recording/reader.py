"""Reader: one file of a recording, of which only the required chunks are read.

Opening reads the summary of a complete file, or scans any other file for its chunks. Checksums and messages are checked
when a chunk is read. A file that was cut off, or is damaged, is read up to there. Any other file is rejected with a
message that names its content.
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

from runtime.base.errors import BadInput
from runtime.base.optional_dependencies import need
from runtime.recording import read_ahead
from runtime.recording.batches import NO_FRAMES, Rows
from runtime.recording.check import Check, first_damaged_content
from runtime.recording.chunks import FILE_LIMIT_MINIMUM, FILE_RATIO_LIMIT, MESSAGE_HEAD, ExpansionLimit, Messages, load
from runtime.recording.columns import Layout
from runtime.recording.contents import Contents, summarised
from runtime.recording.mcap_file import HEAD
from runtime.recording.metadata import validate
from runtime.recording.records import DAMAGE, LIBRARY, MAGIC, read
from runtime.recording.scan import Scan

FRAMES_GROWTH = 4  # size of decoded frames, as a multiple of that of their messages
Result = TypeVar("Result")


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

    path : of the file
    progress : called with the fraction of the file that has been scanned

    about, end, diagram : its attachments; `end` and `diagram` may be None
    began : time of its start, in ns of the file: the wall clock, or 0 in virtual time

    Raises BadInput if the file is not a recording, or one of a newer Tickwork.
    """

    def __init__(self, path: Path, progress: Callable[[float], None]) -> None:
        need("mcap.stream_reader", "reading a recording")
        self.path, self.checked = path, False
        if path.is_fifo():  # `open` would wait for its writer
            raise BadInput(f"{path} is a pipe, and a recording is not read in order: pass a file")
        try:
            with open(path, "rb", buffering=0) as stream:
                self.size = os.fstat(stream.fileno()).st_size
                contents = summarised(stream, self.size) or Scan(stream, self.size, False, progress).contents
        except FileNotFoundError:
            raise BadInput(f"{path}: No such file or directory{nearby(path)}") from None
        except IsADirectoryError:
            if not any(path.glob("*.mcap")):
                raise BadInput(f"the folder {path} contains no recording (.mcap)") from None
            raise BadInput(f"{path} is a folder: pass the recordings in it, as in {path / '*.mcap'}") from None
        except OSError as error:
            raise BadInput(f"{path}: {error.strerror}") from None
        if contents.about is None:
            raise BadInput(f"{path} {self.not_a_recording(contents)}")
        validate(path, contents.about)
        self.about = contents.about
        self.take(contents)
        if len(self) * self.row_size > max(FILE_LIMIT_MINIMUM, FILE_RATIO_LIMIT * self.size):
            self.check(progress)

    def take(self, contents: Contents) -> None:
        """Use these contents of the file."""
        self.contents = contents
        self.layout = Layout(self.path, contents.about, contents.topics)
        self.about, self.end, self.diagram = contents.about, contents.end, contents.diagram
        self.row_size = sum(kind.itemsize for kind in self.layout.rows.values())
        channels: list[Any] = [*self.layout.rows, self.layout.events, *self.layout.buses]
        # {channel: number of messages before each chunk, and in all}
        self.before = {
            channel: list(accumulate((chunk.counts.get(channel, 0) for chunk in contents.chunks), initial=0))
            for channel in channels
        }
        self.__dict__.pop("events", None)
        self.__dict__.pop("began", None)

    def __len__(self) -> int:
        """Return the number of complete rows."""
        return min((self.before[channel][-1] for channel in self.layout.complete), default=0)

    def check(self, progress: Callable[[float], None] = lambda share: None) -> bool:
        """Check every message of the file, once.

        progress : called with the fraction that has been checked

        Returns whether the number of rows has changed. Raises BadInput if the file is not a recording.
        """
        if self.checked:
            return False
        self.checked = True
        began, known = self.__dict__.get("began"), len(self)
        self.scan(False, lambda share: None)
        if not self.is_valid(progress):
            self.scan(True, progress)
        if began is not None:
            self.began = began
        return len(self) != known

    def scan(self, deep: bool, progress: Callable[[float], None]) -> None:
        """Use the contents that a scan of the file finds. deep : whether it checks every message"""
        with open(self.path, "rb", buffering=0) as stream:
            contents = Scan(stream, os.fstat(stream.fileno()).st_size, deep, progress).contents
        if contents.about is None:
            raise BadInput(f"{self.path} {self.not_a_recording(contents)}")
        self.take(contents)

    def is_valid(self, progress: Callable[[float], None]) -> bool:
        """Return whether every message of every chunk is valid."""
        chunks, check = self.contents.chunks, Check(self.layout, {})

        def content(number: int, messages: Messages) -> tuple[Messages, int | None]:
            return messages, first_damaged_content(self.layout, messages)

        try:
            for number, (messages, damaged) in enumerate(self.ahead(content, range(len(chunks)))):
                progress(number / len(chunks))
                counts = {channel: len(offsets) for channel, offsets in messages.offsets.items()}
                if (
                    counts != chunks[number].counts
                    or damaged is not None
                    or check.first_damaged_row(messages) is not None
                ):
                    return False
        except (OSError, BadInput):
            raise
        except DAMAGE:
            return False
        return True

    @property
    def trouble(self) -> str:
        """Problem with the file, in one line; "" without one."""
        return self.contents.trouble

    @property
    def finished(self) -> bool:
        """Whether the recorder has completed the file."""
        return self.contents.finished

    def not_a_recording(self, contents: Contents) -> str:
        """Return the problem with a file that is not a recording, as the end of a sentence."""
        with open(self.path, "rb") as stream:
            mcap = stream.read(len(MAGIC)) == MAGIC
        if self.size == 0 or mcap and contents.library == LIBRARY:
            return "was truncated before its first tick and contains no data"
        if mcap:
            return f"is an MCAP file of another program ({contents.library or 'unknown'}): pass a recording of Tickwork"
        beside = self.path.parent / f"{self.path.stem}.mcap"
        cure = f"pass {beside}" if beside != self.path and beside.exists() else "pass the .mcap file of the run"
        return f"is not a recording of Tickwork: {cure}"

    def ahead(
        self, work: Callable[[int, Messages], Result], numbers: Iterable[int], growth: int = 1
    ) -> Iterator[Result]:
        """Yield the result of work(number, Messages) for chunks, in order, while threads work on the next chunks.

        growth : size of a result, as a multiple of that of the messages

        Raises ValueError or LookupError at a damaged chunk, or before.
        """
        chunks = self.contents.chunks
        with open(self.path, "rb", buffering=0) as stream:
            yield from read_ahead.ahead(
                lambda number: work(number, load(stream.fileno(), chunks[number])),
                self.admitted(numbers),
                lambda number: growth * chunks[number].size,
            )

    def admitted(self, numbers: Iterable[int]) -> Iterator[int]:
        """Yield the numbers of chunks. Raises TooLarge at one that exceeds the limit on what the file expands to."""
        expansion = ExpansionLimit(self.size)
        for number in numbers:
            if self.contents.chunks[number].compression:
                expansion.admit(self.contents.chunks[number].size)
            yield number

    def attachments(self, places: Iterable[tuple[int, int]]) -> Iterator[Any]:
        """Yield attachments as records of the mcap package. places : as in Contents"""
        with open(self.path, "rb", buffering=0) as stream:
            for at, size in places:
                yield read("Attachment", os.pread(stream.fileno(), size, at)[HEAD.size :])

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

    def retried(self, read: Callable[[], Result]) -> Result:
        """Return the result of a function that reads chunks; if one is damaged, check the file and read up to there."""
        try:
            return read()
        except (OSError, BadInput):
            raise
        except DAMAGE:
            self.check_once()
            return read()

    def check_once(self) -> None:
        """Check the file, in which a damaged chunk was read. Raises BadInput if it has been checked before."""
        if self.checked:
            raise BadInput(f"{self.path} has changed while it was read") from None
        self.check()

    def rows(self, places: Iterable[int], first: int = 0, last: int | None = None) -> Rows:
        """Read rows.

        places : of the signals
        first, last : rows; by default all
        """
        return self.retried(lambda: self._rows(list(places), first, last))

    def _rows(self, places: list[int], first: int, last: int | None) -> Rows:
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
                if len(bodies) != end - begin:
                    raise ValueError("an index with another number of messages")
                for target, name in targets:
                    target[low - first : high - first] = bodies[name][low - begin : high - begin]
            return {channel: chunk.records(channel, layout.rows[channel]) for channel in partial}

        samples = list(self.ahead(fill, numbers))
        for channel, targets in partial.items() if len(rows.tick) else ():
            for records in (records_of[channel] for records_of in samples):
                at, bodies = placed(records, rows.tick)
                for target, name in targets:
                    target[at] = bodies[name]
        return rows

    def frames(self, numbers: Iterable[int] | None = None) -> Iterator[np.ndarray]:
        """Yield the frames of chunks as arrays of FRAME. numbers : of the chunks; by default all with frames"""
        numbers, decode = self.with_messages(self.layout.buses) if numbers is None else numbers, self.decoder()
        yield from self.ahead(decode, numbers, FRAMES_GROWTH)

    def decoder(self) -> Callable[[int, Messages], np.ndarray]:
        """Return the function that decodes the frames of a chunk."""
        began, layout, before = self.began, self.layout, self.before[self.layout.tick]
        return lambda number, chunk: layout.frames(chunk, began, before[number])

    def stream(self, with_frames: bool = True) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield (rows as in a Batch, frames as an array of FRAME) of every chunk, in order.

        A row whose messages are in several chunks is yielded with the last of them.

        with_frames : whether the frames are read; else there are none
        """
        number = 0
        open_rows: dict[int, Any] = {
            channel: np.zeros(0, dtype=[*MESSAGE_HEAD, ("body", kind)]) for channel, kind in self.layout.rows.items()
        }
        source = None
        while number < len(self.contents.chunks):
            try:
                source = source or self.decoded(number, with_frames)
                parts, frames = next(source)
            except (OSError, BadInput):
                raise
            except DAMAGE:
                self.check_once()
                source = None
                continue
            number += 1
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
                places, bodies = placed(records, rows[:, 0].astype(np.int64))
            messages[channel] = records[len(bodies) :]
            if channel == layout.tick:
                rows[:, 0], rows[:, 1] = bodies["tick"], bodies["lateness"]
            else:
                for signal in layout.subsystems[channel].columns:
                    rows[places, 2 + signal] = bodies[str(signal)]
        return rows

    def decoded(self, first: int, with_frames: bool) -> Iterator[tuple[dict[int, Any], Any]]:
        """Return ({channel: message records}, frames) of each chunk from the first. Arguments as of stream"""
        frames = self.decoder() if self.layout.buses and with_frames else lambda number, chunk: NO_FRAMES

        def decode(number: int, chunk: Messages) -> tuple[dict[int, Any], Any]:
            parts = {channel: chunk.records(channel, kind) for channel, kind in self.layout.rows.items()}
            return parts, frames(number, chunk)

        return self.ahead(decode, range(first, len(self.contents.chunks)), FRAMES_GROWTH)

    @cached_property
    def events(self) -> list[dict[str, Any]]:
        """Events, as dicts."""

        def read() -> list[dict[str, Any]]:
            numbers = [] if self.layout.events is None else self.with_messages([self.layout.events])
            chunks = self.ahead(lambda _, chunk: self.layout.events_of(chunk), numbers)
            return [event for events in chunks for event in events]

        return self.retried(read)

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


def placed(records: Any, ticks: np.ndarray) -> tuple[np.ndarray, Any]:
    """Return (rows, contents) of those message records that belong to rows.

    records : their `sequence` has the low 32 bits of a tick
    ticks : of the rows, at least one
    """
    numbers = ticks[0] + (records["sequence"].astype(np.int64) - ticks[0]) % 2**32
    own = numbers <= ticks[-1]
    return np.searchsorted(ticks, numbers[own]), records["body"][own]


def nearby(path: Path) -> str:
    """Return a suggestion for the name of a file that does not exist."""
    try:
        names = sorted(name for name in os.listdir(path.parent) if name.endswith(".mcap"))
    except OSError:
        return ""
    close = difflib.get_close_matches(path.name, names, n=1)
    return f": did you mean {path.parent / close[0]}?" if close else ""

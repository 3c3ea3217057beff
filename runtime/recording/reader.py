"""Reader: one file of a recording, of which only the chunks that are asked for are read.

Opening reads the summary of a complete file, or scans any other one for its chunks. Checksums and messages are checked
when a chunk is read. A file that was cut off, or is damaged, is read up to there. Anything else is refused with one
line that says what it is.
"""

import difflib
import os
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any

import numpy as np

from runtime.base.errors import BadInput
from runtime.base.optional_dependencies import need
from runtime.recording.batches import NO_FRAMES
from runtime.recording.chunks import FILE_LIMIT_MINIMUM, FILE_RATIO_LIMIT, Expander, load
from runtime.recording.columns import TICK, Layout
from runtime.recording.contents import summarised
from runtime.recording.metadata import validate
from runtime.recording.records import DAMAGE, LIBRARY, MAGIC
from runtime.recording.scan import Scan


@dataclass(frozen=True)
class Recorded:
    """A CAN frame.

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

    def __init__(self, path, progress):
        need("mcap.stream_reader", "reading a recording")
        self.path, self.checked = path, False
        try:
            with open(path, "rb", buffering=0) as stream:
                self.size = os.fstat(stream.fileno()).st_size
                contents = summarised(stream, self.size) or Scan(stream, self.size, False, progress).contents
        except FileNotFoundError:
            raise BadInput(f"{path}: No such file or directory{nearby(path)}") from None
        except IsADirectoryError:
            raise BadInput(f"{path} is a folder: pass the recordings in it, as in {path / '*.mcap'}") from None
        except OSError as error:
            raise BadInput(f"{path}: {error.strerror}") from None
        if contents.about is None:
            raise BadInput(f"{path} {self.what_else(contents)}")
        validate(path, contents.about)
        self.about = contents.about
        self.take(contents)
        if len(self) * self.row_size > max(FILE_LIMIT_MINIMUM, FILE_RATIO_LIMIT * self.size):
            self.check(progress)

    def take(self, contents):
        """Use the contents of the file."""
        self.contents = contents
        self.layout = Layout(self.path, contents.about, contents.topics)
        self.about, self.end, self.diagram = contents.about, contents.end, contents.diagram
        self.row_size = sum(kind.itemsize for kind in self.layout.rows.values())
        # {channel: number of messages before each chunk, and in all}
        self.before = {
            channel: list(accumulate((chunk.counts.get(channel, 0) for chunk in contents.chunks), initial=0))
            for channel in (*self.layout.rows, self.layout.events, *self.layout.buses)
        }
        self.__dict__.pop("events", None)
        self.__dict__.pop("began", None)

    def __len__(self):
        """Return the number of complete rows."""
        return min((self.before[channel][-1] for channel in self.layout.rows), default=0)

    def check(self, progress=lambda share: None):
        """Check every message of the file, once. Raises BadInput if it is no recording."""
        if not self.checked:
            self.checked = True
            with open(self.path, "rb", buffering=0) as stream:
                contents = Scan(stream, os.fstat(stream.fileno()).st_size, True, progress).contents
            if contents.about is None:
                raise BadInput(f"{self.path} {self.what_else(contents)}")
            began, known = self.__dict__.get("began"), len(self)
            self.take(contents)
            if began is not None:
                self.began = began
            return len(self) != known
        return False

    @property
    def trouble(self):
        return self.contents.trouble

    @property
    def finished(self):
        return self.contents.finished

    def what_else(self, contents):
        """Return what a file is that is not a recording."""
        with open(self.path, "rb") as stream:
            mcap = stream.read(len(MAGIC)) == MAGIC
        if self.size == 0 or mcap and contents.library == LIBRARY:
            return "was truncated before its first tick and contains no data"
        if mcap:
            return f"is an MCAP file of another program ({contents.library or 'unknown'}): pass a recording of Tickwork"
        beside = self.path.parent / f"{self.path.stem}.mcap"
        cure = f"pass {beside}" if beside != self.path and beside.exists() else "pass the .mcap file of the run"
        return f"is not a recording of Tickwork: {cure}"

    def chunks(self, numbers):
        """Yield (number, Messages) of chunks. Raises ValueError or LookupError at a damaged one."""
        with open(self.path, "rb", buffering=0) as stream:
            expander = Expander(self.size)
            for number in numbers:
                yield number, load(stream.fileno(), self.contents.chunks[number], expander)

    def with_messages(self, channels, first=0, last=None):
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

    def retried(self, read):
        """Return the result of a function that reads chunks; if one is damaged, check the file and read up to there."""
        try:
            return read()
        except (OSError, BadInput):
            raise
        except DAMAGE:
            if self.checked:
                raise BadInput(f"{self.path} has changed while it was read") from None
            self.check()
            return read()

    def rows(self, places, first=0, last=None) -> tuple[Any, np.ndarray]:
        """Read rows.

        places : of the signals
        first, last : rows; by default all

        Returns (ticks as an array with the fields "tick", "time" and "lateness" in s, float64 array (rows, places)).
        """
        return self.retried(lambda: self._rows(list(places), first, last))

    def _rows(self, places, first, last) -> tuple[Any, np.ndarray]:
        last = len(self) if last is None else min(last, len(self))
        count = max(0, last - first)
        ticks, values = np.zeros(count, dtype=TICK), np.empty((count, len(places)))
        columns = {place: column for column, place in enumerate(places)}
        layout = self.layout
        wanted = {
            channel: [(columns[place], str(place)) for place in subsystem.columns if place in columns]
            for channel, subsystem in layout.subsystems.items()
        }
        wanted = {channel: fields for channel, fields in wanted.items() if fields}
        channels = [] if layout.tick is None else [layout.tick, *wanted]
        for number, chunk in self.chunks(self.with_messages(channels, first, last)):
            for channel in channels:
                begin, end = self.before[channel][number : number + 2]
                low, high = max(begin, first), min(end, last)
                if low >= high:
                    continue
                found = chunk.records(channel, layout.rows[channel])["body"]
                if len(found) != end - begin:
                    raise ValueError("an index with another number of messages")
                found = found[low - begin : high - begin]
                if channel == layout.tick:
                    ticks[low - first : high - first] = found
                else:
                    for column, name in wanted[channel]:
                        values[low - first : high - first, column] = found[name]
        return ticks, values

    def frames(self, numbers=None):
        """Yield (number of the chunk, frames of the chunk as an array of FRAME)."""
        layout = self.layout
        numbers = self.with_messages(layout.buses) if numbers is None else numbers
        for number, chunk in self.chunks(numbers):
            yield number, layout.frames(chunk, self.began, self.before[layout.tick][number])

    def stream(self, with_frames=True):
        """Yield (rows as in a Batch, frames as an array of FRAME) of every chunk, in order.

        A row whose messages are in several chunks comes with the last of them.

        with_frames : whether the frames are read; else there are none
        """
        number, layout = 0, self.layout
        open_rows: dict[int, Any] = {channel: np.zeros(0, dtype=kind) for channel, kind in layout.rows.items()}
        width = 2 + len(self.about["signals"])
        while number < len(self.contents.chunks):
            try:
                [(_, chunk)] = self.chunks([number])
                found = {channel: chunk.records(channel, kind)["body"] for channel, kind in layout.rows.items()}
                frames = NO_FRAMES
                if layout.buses and with_frames:
                    frames = layout.frames(chunk, self.began, self.before[layout.tick][number])
            except OSError:
                raise
            except DAMAGE:
                if self.checked:
                    raise BadInput(f"{self.path} has changed while it was read") from None
                self.check()
                layout = self.layout
                continue
            number += 1
            open_rows = {channel: np.concatenate((open_rows[channel], part)) for channel, part in found.items()}
            count = min(map(len, open_rows.values()), default=0)
            rows = np.empty((count, width))
            for channel, part in open_rows.items():
                if channel == layout.tick:
                    rows[:, 0], rows[:, 1] = part["tick"][:count], part["lateness"][:count]
                else:
                    for place in layout.subsystems[channel].columns:
                        rows[:, 2 + place] = part[str(place)][:count]
            open_rows = {channel: part[count:] for channel, part in open_rows.items()}
            yield rows, frames

    @cached_property
    def events(self):
        """Events: [dict]."""

        def read():
            numbers = [] if self.layout.events is None else self.with_messages([self.layout.events])
            return [event for _, chunk in self.chunks(numbers) for event in self.layout.events_of(chunk)]

        return self.retried(read)

    @cached_property
    def began(self):
        return next((event["wall"] for event in self.events if event["event"] == "begin"), 0)

    def row_from(self, name, value):
        """Return the number of the first row whose tick or time is `value` or more. name : "tick" or "time" """
        low, high = 0, len(self)
        while low < high:
            middle = (low + high) // 2
            number = np.searchsorted(self.before[self.layout.tick], middle, side="right") - 1
            begin, end = self.before[self.layout.tick][number : number + 2]
            ticks = self.rows([], begin, min(end, len(self)))[0][name]
            place = int(np.searchsorted(ticks, value))
            if place == 0:
                high = begin
            elif place == len(ticks):
                low = begin + place
            else:
                return begin + place
        return low


def nearby(path):
    """Return a suggestion for the name of a file that does not exist."""
    try:
        names = sorted(name for name in os.listdir(path.parent) if name.endswith(".mcap"))
    except OSError:
        return ""
    close = difflib.get_close_matches(path.name, names, n=1)
    return f": did you mean {path.parent / close[0]}?" if close else ""

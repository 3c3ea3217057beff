"""Signals, frames, events and metadata of a recording, read from its file when they are used."""

from __future__ import annotations

import copy
import os
import re
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.host.console.terminal import one_line
from runtime.host.errors import UnknownName
from runtime.host.suggestions import suggestion
from runtime.record.storage.batches import NO_FRAMES, Batch, Rows, payloads
from runtime.record.storage.parts import Recording
from runtime.record.storage.reader import Reader, Recorded

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from typing_extensions import Self


DTYPES = {"int": np.int64, "bool": np.bool_}
BATCH_ROWS = 2000  # of a Trial without a file
READ = ("tick", "time", "lateness", "rows", "frames", "events", "end")  # attributes that are read from a file
ELEMENT = re.compile(r"(.*?)((?:\[[\d, ]+\])*)")


def split(path: str) -> tuple[str, str]:
    """Split the path of an element into that of its signal and its index: "imu.gyro[2]" into "imu.gyro" and "[2]"."""
    match = ELEMENT.fullmatch(path)
    return (match[1], match[2]) if match else (path, "")


class TrialData:
    """Recording. Values are read from its file when they are first used, and kept.

    Opening reads the metadata. The first use of anything else checks the whole file: the values that are returned have
    a valid checksum, apart from `unverified`, and those of damaged parts of the file are missing everywhere.

    signals : {path: {"index", "path", "dtype", "unit", "circle", "every"}}, in the order of the row
    rows : (ticks, signals) array of doubles; a signal is NaN in ticks in which it was not recorded
    tick, time, lateness : arrays over the rows; s
    frames : [Recorded], in order
    events : [dict]
    about, end, diagram : metadata of the recording; `end` and `diagram` may be None
    complete, trouble : whether the recording was finished and is undamaged; if not, the problem with the file, in one
        line
    unfinished : whether the recorder was killed, or still records, and nothing is missing up to its last flush
    unverified : number of ticks whose bytes have no checksum, in a file that was cut
    damaged : whether bytes of the file are damaged. The ticks in them are missing
    gaps : [(time of the last tick before it, time of the first one after it)] of damaged bytes, in s
    file : runtime.record.storage.parts.Recording that is read; None for a run without a file
    parts : [Path] of its files: several if another recorder continued it
    seams : for each part but the first, how it continues the one before (runtime.record.storage.parts.Seam)

    Raises BadInput if the file is not a recording, or one of a newer Tickwork.
    """

    def __init__(self, path: str | Path, progress: Callable[[float], None] = lambda share: None) -> None:
        """Open a recording. progress : called with the fraction of an incomplete file that has been scanned"""
        self.path = Path(path)
        self.file: Any = Recording(self.path, lambda part: Reader(part, progress))
        self._recording: Any = self.file  # None if the values are not those of the file
        self._first, self._last = 0, None  # rows of the recording
        self._columns = {}  # {place: (array of signals that were read, its column)}
        self._diagram: Callable[[], dict[str, Any] | None] | dict[str, Any] | None = self._recording.diagram
        self.parts, self.seams = self._recording.paths, self._recording.seams
        self._describe(self._recording.about)

    @classmethod
    def in_memory(
        cls, about: dict[str, Any], end: dict[str, Any], diagram: Callable[[], dict[str, Any] | None], rows: np.ndarray
    ) -> Self:
        """Return the Trial of a run that wrote no file. Its path is the name of the diagram, and it has no frames.

        about : dict with "name", "rate" in Hz, "signals", "buses" and more, as in a recording
        end : dict, as in a recording
        diagram : function that returns the description of the diagram, called on first use
        rows : array (ticks, 2 + signals): tick, lateness in s, and every signal
        """
        made = cls.__new__(cls)
        made.path, made.parts = Path(about["name"]), []
        made.seams, made.frames = [], []
        made.file, made._recording, made._columns = None, None, {}
        made.end, made._diagram = end, diagram
        made.events = [*end["events"], end["end"]]
        made._describe(about)
        made.tick = rows[:, 0].astype(np.int64)
        made.time, made.lateness, made.rows = made.tick / about["rate"], rows[:, 1], rows[:, 2:]
        for place, signal in enumerate(about["signals"]):
            if (every := signal.get("every", 1)) > 1:
                made.rows[made.tick % every != 0, place] = np.nan
        return made

    def __copy__(self) -> Self:
        made = type(self).__new__(type(self))
        made.__dict__.update(self.__dict__)
        return made

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for another process, which opens the file again."""
        state = {**self.__dict__, "_diagram": self.diagram}
        if self.file is None:
            return state
        if self._recording is not None:
            state = {name: value for name, value in state.items() if name not in READ} | {"_columns": {}}
        return state | {"file": os.path.abspath(self.path), "_recording": self._recording is not None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if self.file is not None:
            self.file = Recording(Path(self.file), lambda part: Reader(part, lambda share: None))
            self._recording = self.file if self._recording else None

    def _describe(self, about):
        self.about = about
        self.signals = {signal["path"]: signal for signal in about["signals"]}
        self.places = {path: place for place, path in enumerate(self.signals)}

    def check(self, progress: Callable[[float], None] = lambda share: None) -> None:
        """Check every message of the recording, once. The ticks of damaged parts are missing; see `trouble`.

        progress : called with the fraction that has been checked

        Raises BadInput if the file is not a recording.
        """
        if self.file is not None:
            self.file.check(progress)

    @property
    def complete(self) -> bool:
        """Whether the recording was finished and is undamaged."""
        return self.file is None or self.file.finished

    @property
    def trouble(self) -> str:
        """Problem with the file in one line; '' if it is complete."""
        return "" if self.file is None else self.file.trouble

    @property
    def damaged(self) -> bool:
        """Whether bytes of the file are damaged, apart from a missing end."""
        return self.file is not None and self.file.is_damaged

    @property
    def unfinished(self) -> bool:
        """Whether the only problem is that the recorder was killed, or still records; up to its last flush, no tick
        is missing."""
        return not self.complete and not self.file.problems

    @property
    def unverified(self) -> int:
        """Number of ticks that are not verified by a checksum, since the file was cut or its writer had none."""
        return 0 if self.file is None else self.file.unverified

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Times of the last tick before and of the first tick after damaged bytes of the file, in s."""
        if self.file is None:
            return []
        rate = self.file.about["rate"]
        return [(before / rate, after / rate) for before, after in self.file.gaps]

    @cached_property
    def end(self) -> dict[str, Any] | None:
        """Metadata at the end of the recording; None if it was truncated."""
        return self.file.end

    @cached_property
    def events(self) -> list[dict[str, Any]]:
        """Events in order, such as marks and faults."""
        return within(self._recording.events, self.tick) if self._is_part else self._recording.events

    @property
    def _is_part(self):
        return self._first > 0 or self._last is not None

    @cached_property
    def frames(self) -> list[Recorded]:
        """Recorded frames in order."""
        buses = self.about["buses"]
        return [
            Recorded(time, buses[bus], bool(sent), drain, drained, row, payload)
            for batch in self.batches()
            for (drain, drained, row, time, bus, sent), payload in zip(
                batch.frames[["drain", "drained", "row", "time", "bus", "sent"]].tolist(), payloads(batch.frames)
            )
        ]

    @property
    def began(self) -> int:
        """Time of the start of the run, in ns of the wall clock; 0 in virtual time."""
        return next((event["wall"] for event in self.events if event["event"] == "begin"), 0)

    @cached_property
    def tick(self) -> np.ndarray:
        """Number of each tick, int64."""
        return self._read([])["tick"]

    @cached_property
    def time(self) -> np.ndarray:
        """Time of each tick in s."""
        return self._read([])["time"]

    @cached_property
    def lateness(self) -> np.ndarray:
        """Delay of each tick after its grid point in s."""
        return self._read([])["lateness"]

    @cached_property
    def rows(self) -> np.ndarray:
        """Values of all signals, (ticks, signals); NaN in ticks in which a signal was not recorded."""
        return self._read(range(len(self.signals)))["rows"]

    def _read(self, places):
        """Read and keep the ticks and the values of signals; all of them as the rows. Returns the cached attributes."""
        read = self._recording.rows(places, self._first, self._last)
        for name in ("tick", "time", "lateness"):
            self.__dict__.setdefault(name, getattr(read, name))
        if len(places) == len(self.signals):
            self.__dict__["rows"] = read.values
        self._columns.update((place, (read.values, column)) for column, place in enumerate(places))
        return self.__dict__

    def _keep(self, places):
        """Read those signals that were not read yet."""
        missing = [place for place in dict.fromkeys(places) if place not in self._columns]
        if missing and "rows" not in self.__dict__:
            self._read(missing)

    def values(self, places: Sequence[int]) -> np.ndarray:
        """Return the values of signals as a float64 array (ticks, places). places : places in the row

        The array may share its memory with this Trial: copy it before changing it.
        """
        self._keep(places)
        whole = self.__dict__.get("rows")
        columns = [(whole, place) if whole is not None else self._columns[place] for place in places]
        if not columns:
            return np.empty((len(self), 0))
        source, first = columns[0]
        if all(array is source and column == first + step for step, (array, column) in enumerate(columns)):
            return source[:, first : first + len(columns)]
        return np.column_stack([array[:, column] for array, column in columns])

    def read(self, paths: Iterable[str]) -> dict[str, np.ndarray]:
        """Return {path: array} of several signals, read in one pass. Shapes and types as in `trial[path]`.

        The arrays are read-only, since they share their memory with this Trial. Raises KeyError.
        """
        paths = list(paths)
        self._keep([place for path in paths for place in self.find(path)[0]])
        arrays = {path: self._typed(path) for path in paths}
        for array in arrays.values():
            array.flags.writeable = False
        return arrays

    def _typed(self, path) -> np.ndarray:
        """Return the samples of a signal in their shape and type, which may share their memory with this Trial."""
        values, shape = self.samples(path), self.find(path)[1]
        values = values[:, 0] if shape == () else values.reshape(-1, *shape)
        kind = DTYPES.get(self.dtype(path), np.float64)
        return values if kind is np.float64 or not holds(kind, values) else values.astype(kind)

    def between(self, start: float, stop: float) -> Self:
        """Return the part of this Trial from one time up to another, without reading the rest.

        start, stop : times in s; a tick at `stop` is not included
        """
        made = copy.copy(self)
        if self._recording is None:
            first, last = np.searchsorted(self.time, (start, stop))
            made.tick, made.time, made.lateness = (
                self.tick[first:last],
                self.time[first:last],
                self.lateness[first:last],
            )
            made.rows = self.rows[first:last]
            made.events = within(self.events, made.tick)
            return made
        rows = [self._recording.row_from("time", time) for time in (start, stop)]
        low, high = self._first, len(self._recording) if self._last is None else self._last
        made._first, made._last = (min(max(row, low), high) for row in rows)
        for name in READ:
            made.__dict__.pop(name, None)
        made._columns = {}
        return made

    def row_groups(self, count: int, places: Sequence[int] | None = None) -> Iterator[Rows]:
        """Yield the rows as runtime.record.storage.batches.Rows, in order, without keeping them.

        count : largest number of ticks in a group
        places : places of the signals in the row; by default all
        """
        places = range(len(self.signals)) if places is None else places
        done = 0
        while done < len(self):
            if self._recording is None:
                part = slice(done, done + count)
                group = Rows(self.tick[part], self.time[part], self.lateness[part], self.rows[part, places])
            else:
                first = self._first + done
                group = self._recording.rows(places, first, min(first + count, self._first + len(self)))
            done += len(group.tick)
            yield group

    def batches(self, frames: bool = True) -> Iterator[Batch]:
        """Yield the recording as runtime.record.storage.batches.Batch, in order, in constant memory.

        The last one has no rows: its frames are those after the last row.

        frames : whether the frames are read; else no batch has any
        """
        if self._recording is None:
            for first in range(0, len(self), BATCH_ROWS):
                part = slice(first, first + BATCH_ROWS)
                yield Batch(np.column_stack((self.tick[part], self.lateness[part], self.rows[part])), NO_FRAMES)
            yield Batch(np.empty((0, 2 + len(self.signals))), NO_FRAMES)
            return
        done, last = 0, len(self._recording) if self._last is None else self._last
        for rows, frames_read in self._recording.batches(frames):
            if self._is_part:
                frames_read = frames_read[(frames_read["row"] >= self._first) & (frames_read["row"] < last)].copy()
                frames_read["row"] -= self._first
                done, rows = done + len(rows), rows[max(0, self._first - done) : max(0, last - done)]
            yield Batch(rows, frames_read)

    @property
    def diagram(self) -> dict[str, Any] | None:
        """Description of the diagram, as in graph.store; None if the recording has none."""
        if self._diagram is not None and not isinstance(self._diagram, dict):
            self._diagram = self._diagram()
        return self._diagram

    @property
    def fault(self) -> dict[str, Any] | None:
        """Fault that ended the run: a dict with `status`, `culprit`, `tick` and `report`, the lines of its text.

        None for a run without a fault, or a truncated recording.
        """
        end = (self.end or {}).get("end") or {"status": "ok"}
        return None if end["status"] == "ok" else {key: end.get(key) for key in ("status", "culprit", "tick", "report")}

    @property
    def implausible(self) -> str | None:
        """First limit of the simulated wearer that the run exceeded, as text; None without one."""
        return ((self.end or {}).get("end") or {}).get("implausible")

    def __repr__(self):
        what = ", ".join(f"{name}={value}" for name, value in self.fields.items())
        fault = f", fault: {self.fault['status']}" if self.fault else ""
        fault += ", not plausible" * bool(self.implausible)
        problem = "" if self.complete else ", unfinished" if self.unfinished else ", cut or damaged"
        problem += f", {self.unverified} ticks without a checksum" if self.unverified else ""
        return one_line(
            f"<Trial {self.path.name}: {len(self)} ticks at {self.about['rate']:g} Hz, "
            f"{len(self.names)} signal{'' if len(self.names) == 1 else 's'}{', ' if what else ''}{what}{fault}"
            f"{problem}>"
        )

    def __getitem__(self, path: str) -> np.ndarray:
        """Return the samples of a signal, as (samples,), or (samples, ...) for a vector; float64, int64 or bool.

        There is one sample per tick, or those of `time_of` if the signal was recorded at a lower rate. An int or bool
        with values that its type lacks (NaN, infinities, 2⁶³ and larger) is float64, as recorded. Raises KeyError with
        a suggestion for an unknown name.
        """
        values = self._typed(path)
        return values.copy() if self.every(path) == 1 else values

    def every(self, path: str) -> int:
        """Return the ticks from one sample of a signal to the next; their numbers are multiples of it."""
        return self.row_of(path).get("every", 1)

    def samples(self, path: str) -> np.ndarray:
        """Return the samples of a signal as a float64 array (samples, elements). Raises KeyError."""
        values = self.values(self.find(path)[0])
        every = self.every(path)
        return values if every == 1 else values[self.tick % every == 0]

    def time_of(self, path: str) -> np.ndarray:
        """Return the times of the samples of a signal, in s. Raises KeyError."""
        every = self.every(path)
        return self.time if every == 1 else self.time[self.tick % every == 0]

    def column(self, path: str) -> np.ndarray:
        """Return a signal over the ticks, with NaN in those in which it was not recorded. Raises KeyError."""
        if self.every(path) == 1:
            return self[path]
        places, shape = self.find(path)
        values = self.values(places)
        return (values[:, 0] if shape == () else values.reshape(-1, *shape)).copy()

    def __len__(self) -> int:
        if self._recording is None or "tick" in self.__dict__:
            return len(self.tick)
        return max(0, (len(self._recording) if self._last is None else self._last) - self._first)

    def find(self, path: str) -> tuple[list[int], tuple[int, ...]]:
        """Return (indices in the row, shape of a sample) of a signal, or of an element of it. Raises KeyError.

        Raises TypeError for anything but the path of one signal.
        """
        if not isinstance(path, str):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise TypeError(f"a trial takes the path of one signal, as in trial['knee.position'], got {path!r}")
        if path in self.places:
            return [self.places[path]], ()
        indices = {place: split(name)[1] for name, place in self.places.items() if name.startswith(f"{path}[")}
        if not indices:
            of_block = [name for name in self.names if name.startswith(f"{path}.")]
            hint = suggestion(path, [*self.names, *self.places])
            if of_block:
                hint = f"it is a block with the signals {', '.join(of_block)}"
            elif path in ("t", "time", "tick"):
                hint = f"it is the attribute {'tick' if path == 'tick' else 'time'} of the trial"
            raise UnknownName(f"{self.path.name} has no signal {path!r}", hint)
        last = np.array([[int(number) for number in re.findall(r"\d+", text)] for text in indices.values()]).max(axis=0)
        return list(indices), tuple(int(number) + 1 for number in last)

    @property
    def names(self) -> list[str]:
        """Paths of all signals, each once for all its elements."""
        return list(dict.fromkeys(split(path)[0] for path in self.signals))

    def unit(self, path: str) -> str:
        """Return the SI unit of a signal: "rad"; "1" without dimension. Raises KeyError."""
        return self.row_of(path)["unit"]

    def dtype(self, path: str) -> str:
        """Return the recorded type of a signal: "float", "int" or "bool". Raises KeyError."""
        return self.row_of(path)["dtype"]

    def row_of(self, path: str) -> dict[str, Any]:
        """Return the description of a signal, or of the first element of a vector. Raises KeyError."""
        return self.about["signals"][self.find(path)[0][0]]

    @property
    def fields(self) -> dict[str, str]:
        """Fields of the trial that `--trial` has set: {"subject": "S03", ...}."""
        return dict(self.about["metadata"].get("trial") or {})

    @property
    def marks(self) -> np.ndarray:
        """Times in s of the marks that the key m has set."""
        return np.array([event["tick"] / self.about["rate"] for event in self.events if event["event"] == "mark"])


def holds(kind: type, values: np.ndarray) -> bool:
    """Return whether a type can represent every one of these doubles."""
    low, high = (0.0, 1.0) if kind is np.bool_ else (-(2.0**63), np.nextafter(2.0**63, 0.0))
    return bool(np.all((values >= low) & (values <= high)))  # NaN fails every comparison


def within(events: Iterable[dict[str, Any]], ticks: np.ndarray) -> list[dict[str, Any]]:
    """Return the events from the first tick to the last. ticks : array"""
    return [event for event in events if len(ticks) and ticks[0] <= event.get("tick", -1) <= ticks[-1]]

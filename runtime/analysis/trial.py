"""Trial: a recording with every signal of every tick, the frames, the events and the metadata.

    trial = Trial("recordings/knee_exo_2026-11-21_10-00-00.mcap")
    trial["left/knee.position"]     # array over the ticks
    trial.unit("left/knee.position")        # "rad"
    trial.time                      # s
    trial.time_of("left/knee.position")     # s, of its samples, if it was recorded at a lower rate

A truncated or damaged file is read up to the last complete row; `complete` is then False. It includes the parts that
standby recorders continued.
"""

import copy
import re
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from runtime.base.suggestions import suggestion
from runtime.recording.batches import NO_FRAMES, Batch, Rows, payloads
from runtime.recording.parts import Recording
from runtime.recording.reader import Reader, Recorded

DTYPES = {"int": np.int64, "bool": np.bool_}
BATCH_ROWS = 2000  # of a Trial without a file
ELEMENT = re.compile(r"(.*?)((?:\[[\d, ]+\])*)")


def split(path: str) -> tuple[str, str]:
    """Split the path of an element into that of its signal and its index: "imu.gyro[2]" into "imu.gyro" and "[2]"."""
    match = ELEMENT.fullmatch(path)
    return (match[1], match[2]) if match else (path, "")


class Trial:
    """Recording. What is asked for is read from its file then, and kept.

    signals : {path: {"index", "path", "dtype", "unit", "circle", "every"}}, in the order of the row
    rows : (ticks, signals) array of doubles; a signal is NaN in ticks in which it was not recorded
    tick, time, lateness : arrays over the rows; s
    frames : [Recorded], in order
    events : [dict]
    about, end, diagram : metadata of the recording; `end` and `diagram` may be None
    complete, trouble : whether the recording was finished and is undamaged; if not, the problem with the file, in one
        line. They check the whole file when they are first used
    file : runtime.recording.parts.Recording that is read; None for a run without a file
    parts : [Path] of its files: several if another recorder continued it
    seams : of each part but the first, how it continues (runtime.recording.parts.Seam)

    Raises BadInput if the file is not a recording, or one of a newer Tickwork.
    """

    def __init__(self, path, progress=lambda share: None):
        """Open a recording. progress : called with the fraction of an incomplete file that has been scanned"""
        self.path = Path(path)
        self.file: Any = Recording(self.path, lambda part: Reader(part, progress))
        self._recording: Any = self.file  # None if the values are not those of the file
        self._first, self._last = 0, None  # rows of the recording
        self._columns = {}  # {place: (array of signals that were read, its column)}
        self._diagram = self._recording.diagram
        self.parts, self.seams = self._recording.paths, self._recording.seams
        self._describe(self._recording.about)

    @classmethod
    def in_memory(cls, about, end, diagram, rows):
        """Return the Trial of a run that wrote no file. Its path is the name of the diagram, and it has no frames.

        about : dict with "name", "rate" in Hz, "signals", "buses" and more, as in a recording
        end : dict, as in a recording
        diagram : function that returns the description of the diagram, called on first use
        rows : array (ticks, 2 + signals): tick, lateness in s, and every signal
        """
        made = cls.__new__(cls)
        made.path, made.parts, made.seams, made.frames = Path(about["name"]), [], [], []
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

    def _describe(self, about):
        self.about = about
        self.signals = {signal["path"]: signal for signal in about["signals"]}
        self.places = {path: place for place, path in enumerate(self.signals)}

    def check(self, progress=lambda share: None):
        """Check every message of the recording. A damaged one then ends before the damage; see `trouble`.

        progress : called with the fraction that has been checked

        Raises BadInput if no part of it is readable.
        """
        if self.file is not None and self.file.check(progress) and self._recording is not None:
            self._forget()

    def _forget(self):
        for name in ("tick", "time", "lateness", "rows", "frames", "events", "end"):
            self.__dict__.pop(name, None)
        self._columns = {}
        self.seams = self._recording.seams

    @property
    def complete(self) -> bool:
        self.check()
        return self.file is None or self.file.finished

    @property
    def trouble(self) -> str:
        self.check()
        return "" if self.file is None else self.file.trouble

    @cached_property
    def end(self) -> Any:
        return self.file.end

    @cached_property
    def events(self) -> list:
        return within(self._recording.events, self.tick) if self._is_part else self._recording.events

    @property
    def _is_part(self):
        return self._first > 0 or self._last is not None

    @cached_property
    def frames(self) -> list:
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
        return self._read([])["tick"]

    @cached_property
    def time(self) -> np.ndarray:
        return self._read([])["time"]

    @cached_property
    def lateness(self) -> np.ndarray:
        return self._read([])["lateness"]

    @cached_property
    def rows(self) -> np.ndarray:
        return self._read(range(len(self.signals)))["rows"]

    def _read(self, places):
        """Read and keep the ticks and the values of signals; all of them as the rows. Returns the cached attributes."""
        read = self._recording.rows(places, self._first, self._last)
        if len(read.tick) != len(self.__dict__.get("tick", read.tick)):  # the file is damaged
            self._forget()
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

    def values(self, places) -> np.ndarray:
        """Return the values of signals as a float64 array (ticks, places). places : in the row

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

    def read(self, paths) -> dict[str, np.ndarray]:
        """Return {path: array} of several signals, read in one pass. Shapes and types as of `trial[path]`.

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

    def between(self, start: float, stop: float) -> "Trial":
        """Return the part of this Trial from one time up to another, without reading the rest.

        start, stop : in s; a tick at `stop` is not included
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
        made._forget()
        return made

    def row_groups(self, count, places=None) -> Iterator[Rows]:
        """Yield the rows as runtime.recording.batches.Rows, in order, without keeping them.

        count : of the ticks in a group, at most
        places : of the signals in the row; by default all
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
            if not len(group.tick):  # the file is damaged
                return
            done += len(group.tick)
            yield group

    def batches(self, frames=True):
        """Yield the recording as runtime.recording.batches.Batch, in order, in constant memory.

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
        for rows, found in self._recording.batches(frames):
            if self._is_part:
                found = found[(found["row"] >= self._first) & (found["row"] < last)].copy()
                found["row"] -= self._first
                done, rows = done + len(rows), rows[max(0, self._first - done) : max(0, last - done)]
            yield Batch(rows, found)

    @property
    def diagram(self):
        """Description of the diagram, as of graph.store; None if the recording has none."""
        if callable(self._diagram):
            self._diagram = self._diagram()
        return self._diagram

    @property
    def fault(self):
        """Fault that ended the run: a dict with `status`, `culprit`, `tick` and `report`, the lines of its text.

        None for a run without a fault, or a truncated recording.
        """
        end = (self.end or {}).get("end") or {"status": "ok"}
        return None if end["status"] == "ok" else {key: end.get(key) for key in ("status", "culprit", "tick", "report")}

    def __repr__(self):
        what = ", ".join(f"{name}={value}" for name, value in self.fields.items())
        fault = f", fault: {self.fault['status']}" if self.fault else ""
        return (
            f"<Trial {self.path.name}: {len(self)} ticks at {self.about['rate']:g} Hz, {len(self.names)} "
            f"signals{', ' if what else ''}{what}{fault}>"
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

    def find(self, path):
        """Return (indices in the row, shape of a sample) of a signal, or of an element of it. Raises KeyError."""
        if path in self.places:
            return [self.places[path]], ()
        indices = {place: split(name)[1] for name, place in self.places.items() if name.startswith(f"{path}[")}
        if not indices:
            hint = suggestion(path, [*self.names, *self.places])
            raise KeyError(f"{self.path.name} has no signal {path!r}" + (f": {hint}" if hint else ""))
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

    def row_of(self, path):
        return self.about["signals"][self.find(path)[0][0]]

    @property
    def fields(self) -> dict[str, str]:
        """Fields of the trial that `--trial` has set: {"subject": "S03", ...}."""
        return dict(self.about["metadata"].get("trial") or {})

    @property
    def marks(self) -> np.ndarray:
        """Times in s of the marks that the key m has set."""
        return np.array([event["tick"] / self.about["rate"] for event in self.events if event["event"] == "mark"])

    def resample(self, rate):
        """Return this Trial at a fixed rate in Hz, from its first tick to its last, with missed ticks filled in.

        Floats are interpolated linearly, phases and bearings on the shorter way, quaternions at a constant rate; ints
        and bools keep their newest value. There is no filter: remove components above half the rate first.
        """
        from runtime.analysis.resample import resampled

        return resampled(self, rate)

    def strides(self, path, events=None, points=101, between=None, last=None):
        """Return a signal over the gait cycle, as (strides, points), or (strides, points, ...) for a vector.

        events : times in s at which strides begin, such as heel strikes; or the path of a bool that becomes true there,
            or of a gait phase that falls from 1 to 0 there. By default the phase of the innermost subsystem of the
            signal that has one, while its `walking` is true

        Strides shorter than 0.4 s or longer than 4 s, or with a missing tick, are excluded. Raises KeyError or
        BadInput.
        """
        from runtime.analysis.strides import strides

        return strides(self, path, events, points, between, last)

    def stride_times(self, path, events=None, between=None, last=None):
        """Return the begin and end of those strides, as (strides, 2) in s.

        A stride twice as long as its neighbours is counted as two with a missed event.
        """
        from runtime.analysis.strides import bounds

        self.find(path)
        return bounds(self, path, events, between, last)

    def table(self):
        """Return a pandas DataFrame with a row a tick, `time` as its index, and a column a number.

        `attrs` has the units and the fields of the trial. Raises MissingExtra.
        """
        from runtime.analysis.table import table

        return table(self)


def holds(kind, values):
    """Return whether a type can represent every one of these doubles."""
    low, high = (0.0, 1.0) if kind is np.bool_ else (-(2.0**63), np.nextafter(2.0**63, 0.0))
    return bool(np.all((values >= low) & (values <= high)))  # NaN fails every comparison


def within(events, ticks):
    """Return the events from the first tick to the last. ticks : array"""
    return [event for event in events if len(ticks) and ticks[0] <= event.get("tick", -1) <= ticks[-1]]

"""Trial: a recording with every signal of every tick, the frames, the events and the metadata.

    trial = Trial("recordings/knee_exo_2026-11-21_10-00-00.mcap")
    trial["left/knee.position"]     # array over the ticks
    trial.unit("left/knee.position")        # "rad"
    trial.time                      # s

A truncated or damaged file is read up to the last complete row; `complete` is then False. It includes the parts that
standby recorders continued.
"""

import re
import struct
from pathlib import Path

import numpy as np

from runtime.base.errors import BadInput
from runtime.base.suggestions import suggestion
from runtime.recording import messages
from runtime.recording.batches import FRAME, Batch
from runtime.recording.parts import whole
from runtime.recording.reader import Reader

BATCH_ROWS = 10_000
DTYPES = {"int": np.int64, "bool": np.bool_}
ELEMENT = re.compile(r"(.*?)((?:\[[\d, ]+\])*)")


def split(path: str) -> tuple[str, str]:
    """Split the path of an element into that of its signal and its index: "imu.gyro[2]" into "imu.gyro" and "[2]"."""
    match = ELEMENT.fullmatch(path)
    return (match[1], match[2]) if match else (path, "")


class Trial:
    """Recording that has been read.

    signals : {path: {"index", "path", "dtype", "unit", "circle"}}, in the order of the row
    rows : (ticks, signals) array of doubles
    tick, time, lateness : arrays over the rows; s
    frames : [Recorded], in order
    events : [dict]
    about, end, diagram : metadata of the recording; `end` and `diagram` may be None
    complete, trouble : whether the recording was finished; if not, the problem with the file, in one line
    parts : [Path] of its files: several if another recorder continued it
    seams : of each part but the first, how it continues (runtime.recording.parts.Seam)

    Raises BadInput if the file is not a recording, or one of a newer Tickwork.
    """

    def __init__(self, path, progress=lambda share: None):
        """Read a recording. progress : called with the fraction of the file that has been read"""
        self.path = Path(path)
        reader, self.parts = whole(self.path, Reader, progress)
        self.end, self._diagram = reader.end, reader.diagram
        self.events, self.complete, self.trouble = reader.events, reader.finished, reader.trouble
        self._describe(reader.about)
        ticks = np.frombuffer(b"".join(reader.messages[messages.ROW_END]), dtype=messages.TICK_ROW)
        self.tick, self.time, self.lateness = (
            ticks["tick"].astype(np.int64),
            ticks["time"].astype(float),
            ticks["lateness"].astype(float),
        )
        self.rows = np.full((len(ticks), len(self.signals)), np.nan)
        for subsystem in messages.subsystems(self.about["name"], [(i, path) for i, path in enumerate(self.signals)]):
            try:
                subsystem.fill(self.rows, reader.messages.get(subsystem.topic, [])[: len(ticks)])
            except ValueError:
                raise BadInput(f"{path} is damaged: its rows do not match the signals in its about.json") from None
        self.frames, self.seams = reader.frames, reader.seams

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
        made.end, made._diagram, made.complete, made.trouble = end, diagram, True, None
        made.events = [*end["events"], end["end"]]
        made._describe(about)
        made.tick = rows[:, 0].astype(np.int64)
        made.time, made.lateness, made.rows = made.tick / about["rate"], rows[:, 1], rows[:, 2:]
        return made

    def _describe(self, about):
        self.about = about
        self.signals = {signal["path"]: signal for signal in about["signals"]}
        self.places = {path: place for place, path in enumerate(self.signals)}

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
        """Return a signal over the ticks, as (ticks,), or (ticks, ...) for a vector; float64, int64 or bool.

        An int or bool with values that its type lacks (NaN, infinities, 2⁶³ and larger) is float64, as recorded. Raises
        KeyError with a suggestion for an unknown name.
        """
        places, shape = self.find(path)
        values = self.rows[:, places[0]] if shape == () else self.rows[:, places].reshape(len(self), *shape)
        kind = DTYPES.get(self.dtype(path), np.float64)
        return values if kind is np.float64 or not holds(kind, values) else values.astype(kind)

    def __len__(self) -> int:
        return len(self.tick)

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

    def batches(self, size=BATCH_ROWS):
        """Yield the recording as Batches, in order, in constant memory. size : rows of a batch at most"""
        known = np.zeros(len(self.frames), dtype=FRAME)
        for place, frame in enumerate(self.frames):
            known[place : place + 1] = np.frombuffer(
                struct.pack("=3q", frame.drain, frame.drained, frame.row) + frame.payload, dtype=FRAME
            )
        for first in range(0, max(len(self), 1), size):
            last = min(first + size, len(self))
            rows = np.column_stack((self.tick[first:last], self.lateness[first:last], self.rows[first:last]))
            begin, end = np.searchsorted(known["row"], (first, last))
            yield Batch(rows, known[begin : end if last < len(self) else len(known)])

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

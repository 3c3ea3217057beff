"""A recording, read back: every signal of every tick, the frames, what happened, and what the recording says of itself.

    trial = Trial("recordings/knee_exo_2026-11-21_10-00-00.mcap")
    trial["left/knee.position"]     # array over the ticks
    trial.unit("left/knee.position")        # "rad"
    trial.time                      # s

A file that was cut off or damaged anywhere is read up to the last complete row before; `complete` then is False. What
another recorder has gone on with belongs to it.
"""

import re
from pathlib import Path

import numpy as np

from runtime.base.errors import BadInput
from runtime.base.suggestions import suggestion
from runtime.recording import messages
from runtime.recording.parts import whole
from runtime.recording.reader import Reader

DTYPES = {"int": np.int64, "bool": np.bool_}
ELEMENT = re.compile(r"(.*?)((?:\[[\d, ]+\])*)")


def split(path: str) -> tuple[str, str]:
    """Split the path of an element into that of its signal and its index: "imu.gyro[2]" into "imu.gyro" and "[2]"."""
    match = ELEMENT.fullmatch(path)
    return (match[1], match[2]) if match else (path, "")


class Trial:
    """
    signals : {path: {"index", "path", "dtype", "unit", "circle"}}, in the order of the row
    rows : (ticks, signals) array of doubles
    tick, time, lateness : arrays over the rows; s
    frames : [Recorded], in order
    events : [dict]
    about, end, diagram : what the recording says of itself; `end` and `diagram` are None where it does not
    complete, trouble : whether the recording was finished; if not, what is the matter with the file, in a line
    parts : [Path] it was read from: several where the recorder was killed and another went on
    seams : of each but the first of them, how it goes on (runtime.recording.parts.Seam)

    BadInput if the file is no recording, or one of a newer Tickwork.
    """

    def __init__(self, path, progress=lambda share: None):
        """progress : called with the share of the file that has been read"""
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
                raise BadInput(
                    f"{path} is damaged: its rows are not of the signals that its about.json tells of"
                ) from None
        self.frames, self.seams = reader.frames, reader.seams

    @classmethod
    def in_memory(cls, about, end, diagram, rows):
        """Return the Trial of a run that wrote no file. Its path is the name of the diagram, and it has no frames.

        about : dict with "name", "rate" in Hz, "signals", "buses" and more, as a recording has it
        end : dict, likewise
        diagram : function that returns the description of the diagram, called when that is first read
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
        """Description of the diagram that ran, as graph.store has it; None where the recording has none."""
        if callable(self._diagram):
            self._diagram = self._diagram()
        return self._diagram

    @property
    def fault(self):
        """The fault that ended the run: a dict with its `status`, `culprit`, `tick` and `report`, the lines of text
        about it; None for a run without a fault, or one whose recording was cut off.
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

    def __getitem__(self, path):
        """A signal over the ticks: (ticks,), or (ticks, ...) for one with elements. float64; int64 or bool where that
        is what it is.

        An int or bool of which a tick holds what its type has not got (NaN, an infinity, a number from 2⁶³ on) is
        float64, as it was recorded. KeyError, with a suggestion, where there is none of that name.
        """
        places, shape = self.find(path)
        values = self.rows[:, places[0]] if shape == () else self.rows[:, places].reshape(len(self), *shape)
        kind = DTYPES.get(self.dtype(path), np.float64)
        return values if kind is np.float64 or not holds(kind, values) else values.astype(kind)

    def __len__(self):
        return len(self.tick)

    def find(self, path):
        """(places in the row, shape of a sample) of a signal, or of one element of it. KeyError"""
        if path in self.places:
            return [self.places[path]], ()
        indices = {place: split(name)[1] for name, place in self.places.items() if name.startswith(f"{path}[")}
        if not indices:
            hint = suggestion(path, [*self.names, *self.places])
            raise KeyError(f"{self.path.name} has no signal {path!r}" + (f": {hint}" if hint else ""))
        last = np.array([[int(number) for number in re.findall(r"\d+", text)] for text in indices.values()]).max(axis=0)
        return list(indices), tuple(int(number) + 1 for number in last)

    @property
    def names(self):
        """Paths of all signals, each once, however many elements it has."""
        return list(dict.fromkeys(split(path)[0] for path in self.signals))

    def unit(self, path):
        """Canonical SI string of a signal: "rad", "N·m"; "1" for a plain number."""
        return self.row_of(path)["unit"]

    def dtype(self, path):
        """ "float", "int" or "bool"."""
        return self.row_of(path)["dtype"]

    def row_of(self, path):
        return self.about["signals"][self.find(path)[0][0]]

    @property
    def fields(self):
        """What the trial is, as `--trial` has said: {"subject": "S03", ...}."""
        return dict(self.about["metadata"].get("trial") or {})

    @property
    def marks(self):
        """s, of each moment that was marked with the key m."""
        return np.array([event["tick"] / self.about["rate"] for event in self.events if event["event"] == "mark"])

    def resample(self, rate):
        """The same Trial at a fixed rate in Hz, from its first tick to its last; what ticks it had missed is filled in.

        Floats go on straight lines between samples, phases and bearings the shorter way round, ints and bools keep
        their newest value, quaternions turn at a constant rate. There is no filter: what is faster than half the rate
        must have been taken out before.
        """
        from runtime.analysis.resample import resampled

        return resampled(self, rate)

    def strides(self, path, events=None, points=101):
        """A signal over the gait cycle: (strides, points), and the elements of the signal behind.

        events : s, when each stride begins, such as heel strikes; or the path of a bool, which becomes true there; or
            of a gait phase, which falls from 1 to 0 there. By default the phase that the subsystem of the signal has,
            or the next around it, while its `walking` is true.

        Strides that are shorter than 0.4 s or longer than 4 s, or in which a tick is missing, are left out. KeyError,
        BadInput
        """
        from runtime.analysis.strides import strides

        return strides(self, path, events, points)

    def stride_times(self, path, events=None):
        """When each of those strides begins and ends: (strides, 2), s. One that lasts twice as long as its neighbours
        is two, between which an event was missed.
        """
        from runtime.analysis.strides import bounds

        self.find(path)
        return bounds(self, path, events)

    def table(self):
        """A pandas DataFrame: a row a tick, `time` its index, a column a number; `attrs` has the units and the fields
        of the trial. MissingExtra
        """
        from runtime.analysis.table import table

        return table(self)


def holds(kind, values):
    """Whether a type has every one of these doubles."""
    low, high = (0.0, 1.0) if kind is np.bool_ else (-(2.0**63), np.nextafter(2.0**63, 0.0))
    return bool(np.all((values >= low) & (values <= high)))  # NaN fails every comparison

"""Recordings as a table: one of them, or several below each other with the fields of each trial.

    trials = load("trials/*.mcap")
    trials["left/knee.torque"]          # array over the rows of all
    trials["subject"]                   # of each row
    trials[0]                           # the first Trial
"""

import glob
import os

import numpy as np

from runtime.errors import BadInput
from runtime.extras import need
from runtime.recordings.parts import heads
from runtime.recordings.trial import Trial


def load(path):
    """A Trial; or Trials of a pattern or a list of paths. BadInput"""
    if not isinstance(path, (str, os.PathLike)):
        return Trials([Trial(entry) for entry in heads(path)])
    path = os.path.expanduser(path)
    if os.path.exists(path) or not glob.has_magic(path):
        return Trial(path)
    found = sorted(glob.glob(path))
    if not found:
        raise BadInput(f"there is no recording {path}")
    return Trials([Trial(entry) for entry in heads(found)])


class Trials:
    """Several trials as one table, a row a tick of each, in their order.

    trials : [Trial]
    fields : names of what they say of themselves: "subject", "condition", ...
    """

    def __init__(self, trials):
        self.trials = list(trials)
        self.fields = list(dict.fromkeys(name for trial in self.trials for name in trial.fields))

    def __repr__(self):
        return "\n".join([f"<Trials: {len(self)}, {len(self.names)} columns>", *(f"  {trial!r}" for trial in self)])

    def __len__(self):
        """How many trials."""
        return len(self.trials)

    def __iter__(self):
        return iter(self.trials)

    @property
    def names(self):
        """Columns: "trial", the fields, "tick", "time", and the signals of all."""
        return ["trial", *self.fields, "tick", "time", *dict.fromkeys(name for trial in self.trials for name in trial.names)]

    @property
    def time(self):
        return self["time"]

    def __getitem__(self, name):
        """The Trial of a number; or a column over all rows: a signal, a field of the trials ("" where one has not got it), "trial", "tick", "time".

        A signal that some trials have not got is NaN there. KeyError where no trial has it.
        """
        if not isinstance(name, str):
            return self.trials[name]
        if name in ("tick", "time"):
            return np.concatenate([getattr(trial, name) for trial in self.trials])
        if name == "trial" or name in self.fields:
            words = [trial.path.stem if name == "trial" else trial.fields.get(name, "") for trial in self.trials]
            return np.repeat(np.array(words, dtype=str), [len(trial) for trial in self.trials])
        parts = [signal(trial, name) for trial in self.trials]
        shape = next((part.shape[1:] for part in parts if part is not None), None)
        if shape is None:
            return self.trials[0][name]         # which says what it has instead
        return np.concatenate([
            np.full((len(trial), *shape), np.nan) if part is None else part for trial, part in zip(self.trials, parts)])

    def strides(self, path, events=None, points=101):
        """Those of every trial, in their order: (strides, points, ...). events : a path, or nothing, as Trial.strides has it"""
        return np.concatenate([trial.strides(path, events, points) for trial in self.trials])

    def table(self):
        """All as one pandas DataFrame. MissingExtra"""
        pandas = need("pandas", "a table")
        parts = []
        for trial in self.trials:
            part = table(trial).reset_index()
            for place, (name, value) in enumerate([("trial", trial.path.stem), *((name, trial.fields.get(name, "")) for name in self.fields)]):
                part.insert(place, name, value)
            parts.append(part)
        made = pandas.concat(parts, ignore_index=True)
        made.attrs["units"] = {path: unit for part in parts for path, unit in part.attrs["units"].items()}
        return made


def signal(trial, name):
    try:
        return trial[name]
    except KeyError:
        return None


def table(trial):
    """As Trial.table says."""
    pandas = need("pandas", "a table")
    columns = {"tick": trial.tick, **{path: trial[path] for path in trial.signals}}
    made = pandas.DataFrame(columns, index=pandas.Index(trial.time, name="time"))
    made.attrs.update(units={path: entry["unit"] for path, entry in trial.signals.items()}, fields=trial.fields)
    return made

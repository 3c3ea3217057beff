"""Several recordings as one table, one below the other, with the fields of each trial.

trials = load("trials/*.mcap")
trials["left/knee.torque"]          # array over the rows of all trials
trials["subject"]                   # the subject of each row
trials[0]                           # the first Trial
"""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from runtime.host.arguments import is_iterable, is_path, is_set
from runtime.host.errors import BadInput
from runtime.host.optional_dependencies import need
from runtime.record.analysis.table import table
from runtime.record.analysis.trial import Trial
from runtime.record.storage.files import short_names
from runtime.record.storage.parts import heads, newest

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import pandas


def load(path: str | os.PathLike[str] | Iterable[str | os.PathLike[str]]) -> Trial | Trials:
    """Return the Trial of a path or of the newest recording of a folder, or the Trials of a pattern or list of paths.

    Raises BadInput.
    """
    if not isinstance(path, (str, os.PathLike)):
        paths = list(path) if is_iterable(path) else []
        if not paths or not all(map(is_set(is_path), paths)):
            raise BadInput(f"load({f'{path!r}':.300}): name a recording, a pattern, or several recordings")
        return Trials([Trial(entry) for entry in heads([os.fspath(entry) for entry in paths])])
    path = os.path.expanduser(path)
    if os.path.exists(path) or not glob.has_magic(path):
        return Trial(newest(path))
    paths = sorted(glob.glob(path, recursive=True))
    if not paths:
        raise BadInput(f"no such recording: {path}")
    return Trials([Trial(entry) for entry in heads(paths)])


OWN = ("trial", "tick", "time")  # columns of every table


class Trials:
    """Several trials as one table, with one row per tick, in order.

    trials : [Trial]
    labels : name of each trial in the column "trial": its file name, with the folder where file names are equal
    fields : columns of their fields: "subject", "condition", ...; a field with the name of another column is
        "trial.NAME"
    """

    def __init__(self, trials: Iterable[Trial]) -> None:
        self.trials = list(trials)
        self.labels = short_names([trial.path for trial in self.trials])
        self._fields = {
            f"trial.{name}" if name in OWN else name: name for trial in self.trials for name in trial.fields
        }
        self.fields = list(self._fields)

    def __repr__(self):
        return "\n".join([f"<Trials: {len(self)}, {len(self.names)} columns>", *(f"  {trial!r}" for trial in self)])

    def __len__(self) -> int:
        """Return the number of trials."""
        return len(self.trials)

    def __iter__(self) -> Iterator[Trial]:
        return iter(self.trials)

    @property
    def names(self) -> list[str]:
        """Columns: "trial", the fields, "tick", "time", and the signals of all trials."""
        return [
            "trial",
            *self.fields,
            "tick",
            "time",
            *dict.fromkeys(name for trial in self.trials for name in trial.names),
        ]

    @property
    def time(self) -> np.ndarray:
        """Time of each row within its trial, in s."""
        return self["time"]

    def __getitem__(self, name):
        """Return the Trial of a number, or a column over all rows: a signal, a field, "trial", "tick" or "time".

        A signal that a trial or a tick lacks is NaN there, and a field "". Raises KeyError if no trial has it, and
        BadInput if it has different units or shapes.
        """
        if not isinstance(name, str):
            return self.trials[name]
        if name in ("tick", "time"):
            return np.concatenate([getattr(trial, name) for trial in self.trials])
        if name == "trial" or name in self.fields:
            words = self.labels if name == "trial" else self.words(name)
            return np.repeat(np.array(words, dtype=str), [len(trial) for trial in self.trials])
        parts = [_signal(trial, name) for trial in self.trials]
        shape = next((part.shape[1:] for part in parts if part is not None), None)
        if shape is None:
            return self.trials[0][name]  # raises with a suggestion
        self.check(name, parts)
        return np.concatenate(
            [np.full((len(trial), *shape), np.nan) if part is None else part for trial, part in zip(self.trials, parts)]
        )

    def words(self, field: str) -> list[str]:
        """Return the field of each trial, "" if it is missing. field : name of the column"""
        return [trial.fields.get(self._fields[field], "") for trial in self.trials]

    def check(self, name: str, parts: Sequence[np.ndarray | None]) -> None:
        """Raise BadInput if a signal has different units or shapes.

        parts : its values in each trial, None where it is missing
        """
        known = {}
        for trial, label, part in zip(self.trials, self.labels, parts):
            if part is not None:
                elements = f" of {' by '.join(map(str, part.shape[1:]))}" if part.ndim > 1 else ""
                known.setdefault(f"[{trial.unit(name)}]{elements}", label)
        if len(known) > 1:
            kinds = ", ".join(f"{what} in {where}" for what, where in known.items())
            raise BadInput(f"{name} differs between trials: {kinds}. Load trials in which it is equal")

    def strides(self, path: str, events: str | None = None, points: int = 101) -> np.ndarray:
        """Return the strides of every trial in order, as (strides, points, ...).

        events : a path, as for Trial.strides
        """
        self.check(path, [trial[path] for trial in self.trials])
        return np.concatenate([trial.strides(path, events, points) for trial in self.trials])

    def resample(self, rate: float) -> Trials:
        """Return the trials at a fixed rate in Hz, as Trial.resample does."""
        return Trials([trial.resample(rate) for trial in self.trials])

    def table(self) -> pandas.DataFrame:
        """Return all trials as one pandas DataFrame. Raises MissingExtra or BadInput."""
        pandas = need("pandas", "a table")
        for name in dict.fromkeys(name for trial in self.trials for name in trial.names):
            self.check(name, [_signal(trial, name) for trial in self.trials])
        fields = {name: self.words(name) for name in self.fields}
        parts = []
        for number, trial in enumerate(self.trials):
            part = table(trial).reset_index()
            for place, (name, values) in enumerate({"trial": self.labels, **fields}.items()):
                part.insert(place, name, values[number])
            parts.append(part)
        made = pandas.concat(parts, ignore_index=True)
        made.attrs["units"] = {path: unit for part in parts for path, unit in part.attrs["units"].items()}
        return made


def _signal(trial, name):
    """Return a signal over the ticks; None if the trial has none of this name."""
    try:
        return trial.column(name)
    except KeyError:
        return None

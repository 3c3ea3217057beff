"""CSV export, byte for byte as the recorder writes it. Ticks in which no signal was recorded have no line.

A signal is nan in lines without it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from runtime.record.analysis.trial import Trial
from runtime.record.recorder.services.csv import Lines, header
from runtime.record.storage.ascii_units import ascii_name

EXTENSIONS = {"csv": "csv"}
INTEGER_LIMIT = 2.0**63


def check(trial: Trial, kind: str) -> None:
    """Accept every recording. Arguments are not used"""


def write(trial: Trial, path: str, progress: Callable[[float], None]) -> None:
    """Write the file.

    path : path of the file, which is overwritten
    progress : called with the fraction that is done
    """
    columns = [{**signal, "ascii_unit": ascii_name(signal["unit"])} for signal in trial.signals.values()]
    lines, rate, done = Lines(columns), trial.about["rate"], 0
    whole = [2 + index for index, column in enumerate(columns) if column["dtype"] != "float"]
    with open(path, "wb") as file:
        file.write(header(columns, ",").encode())
        every = math.gcd(*(signal.get("every", 1) for signal in columns)) or 1
        for complete, _ in trial.batches(frames=False):
            rows = complete[complete[:, 0] % every == 0]
            if table := exact(rows, rows[:, 0] / rate, whole):
                file.write(lines.text(table))
            else:
                ticks = rows[:, 0].astype(np.int64)
                file.writelines(map(lines.line, (ticks / rate).tolist(), ticks.tolist(), rows[:, 2:].tolist()))
            done += len(complete)
            progress(done / max(1, len(trial)))


def exact(rows: np.ndarray, times: np.ndarray, whole: list[int]) -> list[tuple[Any, ...]]:
    """Return rows for Lines.text; [] if they have values that JSON or an integer lacks.

    rows : as in a Batch
    times : times of the rows, in s
    whole : columns with integers
    """
    if not len(rows) or not np.isfinite(rows[:, 2:]).all() or not (np.abs(rows[:, whole]) < INTEGER_LIMIT).all():
        return []
    columns = [values.tolist() for values in rows.T]
    columns[0], columns[1] = times.tolist(), rows[:, 0].astype(np.int64).tolist()
    for column in whole:
        columns[column] = rows[:, column].astype(np.int64).tolist()
    return list(zip(*columns))

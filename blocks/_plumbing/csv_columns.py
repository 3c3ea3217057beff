"""Columns of CSV files written by recorders and spreadsheets: `time [s],left/knee.position [rad]`."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence

import numpy as np

from graph import units


def read_columns(file: str, time: str, column: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Read (times in s, values, unit in the header or "") from a CSV file.

    time, column : names of columns. OSError or ValueError if the file cannot be used.
    """
    with open(file, newline="", encoding="utf-8-sig") as stream:
        header = stream.readline()
        delimiter = max(",;\t", key=header.count)
        names = [split_unit(name) for name in next(csv.reader([header], delimiter=delimiter), [])]
        columns = [column_index(name, names, file) for name in (time, column)]
        if names[columns[0]][1] not in ("", "s"):
            raise ValueError(f"{file}: column {time!r} must be in s, got {names[columns[0]][1]}")
        samples = []
        for number, row in enumerate(csv.reader(stream, delimiter=delimiter), start=2):
            try:
                samples.append([float(row[index]) for index in columns])
            except (ValueError, IndexError):
                raise ValueError(
                    f"{file}, line {number}: column {time!r} or {column!r} does not contain a number"
                ) from None
    times, values = np.array(samples).reshape(-1, 2).T
    if np.any(np.isinf(values)) or not np.any(np.isfinite(values)):
        raise ValueError(f"{file}: column {column!r} must contain finite numbers")
    return times, values, names[columns[1]][1]


def split_unit(name: str) -> tuple[str, str]:
    """Split 'left/knee.position [rad]' into ('left/knee.position', 'rad'). Invalid units remain in the name."""
    match = re.match(r"(.*\S)\s*\[([^\[\]]*)\]$", name.strip())
    try:
        return (match[1], units.canonical(match[2])) if match and not match[2].isdigit() else (name.strip(), "")
    except ValueError:
        return name.strip(), ""


def column_index(name: str, names: Sequence[tuple[str, str]], file: str) -> int:
    """Return the index of a column. names : (name, unit) of each column. Raises ValueError for an unknown column."""
    for index, (candidate, _) in enumerate(names):
        if candidate == name:
            return index
    raise ValueError(
        f"{file} has no column {name!r}; it has {', '.join(candidate for candidate, _ in names) or 'none'}"
    )

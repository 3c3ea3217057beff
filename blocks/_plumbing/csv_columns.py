"""Columns of CSV files, as recorders and spreadsheets write them: `time [s],left/knee.position [rad]`."""

import csv
import re

import numpy as np

from graph import units


def read_columns(file, time, column):
    """(times in s, values, unit of the column as the header has it or "") of a CSV file. OSError, or ValueError saying
    what is wrong.
    """
    with open(file, newline="", encoding="utf-8-sig") as stream:
        header = stream.readline()
        delimiter = max(",;\t", key=header.count)
        names = [split_unit(name) for name in next(csv.reader([header], delimiter=delimiter), [])]
        at = [place_of(name, names, file) for name in (time, column)]
        if names[at[0]][1] not in ("", "s"):
            raise ValueError(f"{file}: column {time!r} must be in s, and it is in {names[at[0]][1]}")
        found = []
        for number, row in enumerate(csv.reader(stream, delimiter=delimiter), start=2):
            try:
                found.append([float(row[index]) for index in at])
            except (ValueError, IndexError):
                raise ValueError(
                    f"{file}, line {number}: a number is missing in column {time!r} or {column!r}"
                ) from None
    times, values = np.array(found).reshape(-1, 2).T
    if np.any(np.isinf(values)) or not np.any(np.isfinite(values)):
        raise ValueError(f"{file}: column {column!r} must hold finite numbers")
    return times, values, names[at[1]][1]


def split_unit(name):
    """'left/knee.position [rad]' gives ('left/knee.position', 'rad'); what is no unit stays in the name."""
    match = re.match(r"(.*\S)\s*\[([^\[\]]*)\]$", name.strip())
    try:
        return (match[1], units.canonical(match[2])) if match and not match[2].isdigit() else (name.strip(), "")
    except ValueError:
        return name.strip(), ""


def place_of(name, names, file):
    """Return the index of a column. Raises ValueError if the file has none of that name."""
    for index, (found, _) in enumerate(names):
        if found == name:
            return index
    raise ValueError(f"{file} has no column {name!r}; it has {', '.join(found for found, _ in names) or 'none'}")

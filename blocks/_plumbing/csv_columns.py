"""Columns of CSV files written by recorders and spreadsheets, and of OpenSim's .mot and .sto files."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from textwrap import shorten

import numpy as np
from msgspec import Struct

from graph import units


class Table(Struct, frozen=True):
    """Columns of a file: names, units in the header or "", and the text of the rows with their line numbers."""

    file: str
    names: list[str]
    units: list[str]
    rows: list[tuple[int, list[str]]]

    def index(self, *candidates: str) -> int:
        """Return the index of the first of the candidates that is a column. ValueError"""
        for candidate in candidates:
            if candidate in self.names:
                return self.names.index(candidate)
        available = shorten(", ".join(self.names), 200, placeholder=" ...") or "none"
        raise ValueError(f"{self.file} has no column {' or '.join(map(repr, candidates))}; it has {available}")

    def column(self, *candidates: str, empty: float | None = None) -> np.ndarray:
        """Return the numbers of the first of the candidates that is a column.

        empty : value of an empty cell, which is an error without it. ValueError
        """
        index = self.index(*candidates)
        values: list[float] = []
        for line, row in self.rows:
            text = row[index].strip() if index < len(row) else None
            try:
                values.append(empty if text == "" and empty is not None else float(text or ""))
            except ValueError:
                found = f": {text!r}" if text else ""
                comma = "; write numbers with a decimal point" if re.fullmatch(r"[+-]?\d+,\d+", text or "") else ""
                raise ValueError(
                    f"{self.file}, line {line}: column {self.names[index]!r} does not contain a number{found}{comma}"
                ) from None
        return np.array(values)

    def times(self, name: str = "time") -> np.ndarray:
        """Return the column of times in s. ValueError"""
        unit = self.units[self.index(name)]
        if unit not in ("", "s"):
            raise ValueError(f"{self.file}: column {name!r} must be in s, got {unit}")
        return self.column(name)


def read_table(file: str) -> Table:
    """Read a CSV file with a header such as `time [s],left/knee.position [rad]`, or a .mot file behind `endheader`.

    The separator is the one between the first two columns of a recording; in another file, that of comma, semicolon and
    tab that the header has most of, else blanks. OSError or ValueError if the file cannot be read.
    """
    with open(file, "rb") as stream:
        if b"\0" in stream.read(1000):
            raise ValueError(f"{file} is not a CSV file in UTF-8: it has zero bytes; export the table as CSV in UTF-8")
    try:
        lines = Path(file).read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(f"{file} is not a CSV file in UTF-8: {error}; export the table as CSV in UTF-8") from None
    start = next((number for number, line in enumerate(lines, 1) if line.strip() == "endheader"), 0)
    if any(re.fullmatch(r"\s*inDegrees\s*=\s*no\s*", line) for line in lines[:start]):
        raise ValueError(f"{file} is in radians: write it in degrees")
    header = lines[start] if start < len(lines) else ""
    recorded = re.match(r'("?)time \[s\]\1([^"])tick\b', header)
    delimiter = recorded[2] if recorded else max(",;\t", key=header.count)
    if delimiter in header:
        rows = csv.reader(lines[start:], delimiter=delimiter)
    else:
        rows = (line.split() for line in lines[start:])
    cells = [(start + number, row) for number, row in enumerate(rows, 1) if any(map(str.strip, row))]
    if not cells[1:]:
        raise ValueError(f"{file} has no rows: it needs a header with the names of its columns, and rows below it")
    names = [split_unit(name) for name in cells[0][1]]
    return Table(file, [name for name, _ in names], [unit for _, unit in names], cells[1:])


def read_columns(file: str, time: str, column: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Read (times in s, values, unit in the header or "") from a CSV file.

    time, column : names of columns. OSError or ValueError if the file cannot be used.
    """
    table = read_table(file)
    if time not in table.names:
        raise ValueError(f"{file} has no column {time!r}: name that of the times, as in time={table.names[0]!r}")
    times, values = table.times(time), table.column(column)
    if np.any(np.isinf(values)) or not np.any(np.isfinite(values)):
        raise ValueError(f"{file}: column {column!r} must contain finite numbers")
    return times, values, table.units[table.index(column)]


def split_unit(name: str) -> tuple[str, str]:
    """Split 'left/knee.position [rad]' into ('left/knee.position', 'rad'). Invalid units remain in the name."""
    match = re.match(r"(.*\S)\s*\[([^\[\]]*)\]$", name.strip())
    try:
        return (match[1], units.canonical(match[2])) if match and not match[2].isdigit() else (name.strip(), "")
    except ValueError:
        return name.strip(), ""

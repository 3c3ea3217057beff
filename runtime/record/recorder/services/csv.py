"""CSV files: `time [s],tick,left/knee.position [rad],...`, one line per tick.

The unit follows the name in brackets, in ASCII; dimensionless signals have none. Floats have the fewest digits that
convert back to the same number; ints and bools are integers; non-finite values are `nan`, `inf` and `-inf`.

With `text`, states are names, and the last column has the events before each row, and after the last one.
"""

import csv
import io
import os
from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

from msgspec.json import encode

from runtime.host.console.styles import count
from runtime.host.errors import BadInput
from runtime.host.suggestions import suggestion
from runtime.record.recorder.service import Service
from runtime.record.storage.changes import event_text
from runtime.record.storage.files import WholeFile, claim, create

WITHOUT_UNIT = ("1", "any")
NOT_A_NUMBER = b"null"


class CsvWriter(Service):
    """Serves blocks.recorders.CsvRecorder."""

    def open(self) -> None:
        parameters, columns = self.sink["parameters"], self.sink["columns"]
        delimiter = parameters.get("delimiter", ",")
        self.flush_rows = parameters.get("flush_rows", 200)
        self.rows, self.every = 0, self.sink.get("every", 1)
        during = parameters.get("during")
        self.gate = place_of("during", during, columns) if during else None
        names = {place_of("names", path, columns): name for path, name in parameters.get("names", {}).items()}
        self.events: list[str] | None = [] if parameters.get("text") else None
        self.lines = Lines(columns, delimiter) if self.events is None else TextLines(columns, delimiter)
        self.last: tuple[list[Any], bytes] | None = None  # cells and line of the last row, for events that follow it
        self.columns = [column["index"] for column in columns]
        self.whole = [column["dtype"] != "float" for column in columns]
        self.header = header(columns, delimiter, names, self.events is not None)
        self.file: Any = None
        if self.plan["folder"] is None:
            return
        stem = os.path.join(self.plan["folder"], name_of(parameters.get("file")) or self.plan["stem"])
        first = self.plan.get("part", 1) == 1  # later parts keep the file of part 1
        replaces = parameters.get("overwrite", False) and first
        self.file = WholeFile(*create(stem, ".csv", replaces), self.durable)
        claim(self.file.descriptor)  # so that no other recorder replaces it
        self.device_time, self.began = parameters.get("time") == "device" and not self.plan["virtual"], None
        if not replaces:
            self.start()

    def start(self) -> None:
        """Write the header, over what a replaced file contains. Until then, a run that ends leaves that file."""
        if self.file.path not in self.files:
            self.files[self.file.path] = ""
            os.ftruncate(self.file.descriptor, 0)
            self.file.write(self.header)
            self.file.flush()

    def records(self, batch: Any) -> None:
        if self.file is None or not batch.rows:
            return
        self.start()
        rows = batch.table(float(self.plan["rate"]), self.columns, self.whole, self.every)
        if self.gate is not None:
            rows = [row for row in rows if row[2 + self.gate] > 0.0]  # NaN is not true
        if self.device_time and rows:
            if self.began is None:
                self.began = self.epoch()
            for row in rows:
                row[0] += self.began
        while rows:  # flushed at the same rows, whatever the batches
            left = self.flush_rows - self.rows % self.flush_rows
            self.write(rows[:left])
            rows = rows[left:]

    def row(self, tick: int, time: float, values: list[float]) -> None:
        """Write one row, for a run without a ring of batches."""
        if self.file is not None:
            self.start()
            cells = self.lines.cells(time, tick, values)
            if self.events is None:
                self.file.write(self.lines.text([cells]))
            else:
                self.write_with_events(cells)
            self.rows += 1

    def write(self, rows: list[list[float]]) -> None:
        """Write rows, and flush the file if it is due."""
        if self.events is None:
            self.file.write(self.lines.text(rows))
        else:
            for row in rows:
                self.write_with_events(row)
        self.rows += len(rows)
        if self.rows % self.flush_rows == 0:
            self.file.flush()

    def write_with_events(self, row: list[Any]) -> None:
        """Write a row, and the events since the previous one."""
        assert self.events is not None
        cells = [*row, "; ".join(self.events)]
        line = self.lines.text([cells])
        self.events.clear()
        self.last = cells, line
        self.file.write(line)

    def event(self, event: dict[str, Any]) -> None:
        if self.events is not None and (text := event_text(event)):
            self.events.append(text)

    def flush(self) -> None:
        if self.file is not None:
            self.file.flush()

    def discard(self) -> None:
        if self.file is not None and self.file.path not in self.files:
            self.file.let_go()
        else:
            self.close()

    def close(self) -> dict[str, Any]:
        if self.file is None:
            return {"rows": 0}
        self.start()
        if self.events and self.last is not None:
            cells, line = self.last
            self.file.take_back(line)
            self.file.write(self.lines.text([[*cells[:-1], "; ".join(filter(None, [cells[-1], *self.events]))]]))
        self.file.close()
        self.files[self.file.path] = f"{count(self.rows, 'row')} of {count(len(self.sink['columns']), 'signal')}"
        return {"file": self.file.path, "rows": self.rows, "bytes": self.file.size}


def place_of(parameter: str, path: str, columns: list[dict[str, Any]]) -> int:
    """Return the index of the column with a path. parameter : parameter that names the signal. Raises BadInput."""
    paths = [column["path"] for column in columns]
    if path not in paths:
        raise BadInput(
            f"{parameter}: {path!r} is not a recorded signal; "
            f"{suggestion(path, paths) or 'expected one such as mocap.on'}"
        )
    return paths.index(path)


def name_of(file: str | None) -> str:
    """Return the file name of the parameter `file` without .csv, "" for none. Raises BadInput for a path."""
    name = (file or "").strip()
    if os.path.basename(name) != name or name.strip(".") == "" != name:
        raise BadInput(
            f"file: {file!r} is not a file name. The file is written to the folder of the recording, "
            "which --record sets"
        )
    return name.removesuffix(".csv")


class Lines:
    """Converter of rows to lines of CSV. columns : columns of the sink"""

    def __init__(self, columns: list[dict[str, Any]], delimiter: str = ",") -> None:
        self.delimiter = delimiter.encode()
        self.whole = [2 + index for index, column in enumerate(columns) if column["dtype"] != "float"]

    def cells(self, time: float, tick: int, values: Sequence[float]) -> list[Any]:
        """Return the cells of a tick, with ints for ints and bools."""
        cells = [time, tick, *values]
        for index in self.whole:
            if isfinite(cells[index]):
                cells[index] = int(cells[index])
        return cells

    def line(self, time: float, tick: int, values: Sequence[float]) -> bytes:
        """Return the line of a tick as bytes."""
        return self.text([self.cells(time, tick, values)])

    def text(self, rows: Sequence[Sequence[Any]]) -> bytes:
        """Return the lines of rows as bytes. rows : [[time, tick, values with ints for ints and bools]]"""
        text = encode(rows)[2:-2]  # JSON numbers are valid CSV and ten times faster than repr
        if NOT_A_NUMBER in text:
            cells = ([encode(cell) if isfinite(cell) else repr(cell).encode() for cell in row] for row in rows)
            text = b"],[".join(b",".join(row) for row in cells)
        text = text.replace(b"],[", b"\n") + b"\n"
        return text if self.delimiter == b"," else text.replace(b",", self.delimiter)


class TextLines(Lines):
    """Converter of rows whose last cell is text, with names for the states of columns that have `labels`."""

    def __init__(self, columns: list[dict[str, Any]], delimiter: str = ",") -> None:
        super().__init__(columns, delimiter)
        self.separator = delimiter
        self.labels = {2 + index: column["labels"] for index, column in enumerate(columns) if column.get("labels")}

    def text(self, rows: Sequence[Sequence[Any]]) -> bytes:
        lines = io.StringIO()
        writer = csv.writer(lines, delimiter=self.separator, lineterminator="\n")
        for row in rows:
            cells = list(row)
            for place, labels in self.labels.items():
                if cells[place] in range(len(labels)):
                    cells[place] = labels[int(cells[place])]
            writer.writerow(cells)
        return lines.getvalue().encode()


def header(
    columns: list[dict[str, Any]], delimiter: str, own: Mapping[int, str] | None = None, events: bool = False
) -> str:
    """Return the first line.

    own : {index of a column: its name}; events : whether a column with events follows
    """
    names = ["time [s]", "tick"]
    for index, column in enumerate(columns):
        unit = column["ascii_unit"]
        names.append(
            (own or {}).get(index) or (column["path"] if unit in WITHOUT_UNIT else f"{column['path']} [{unit}]")
        )
    names += ["events"] * events
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise BadInput(f"names: {twice[0]!r} is the name of more than one column: give each its own")
    line = io.StringIO()
    csv.writer(line, delimiter=delimiter, lineterminator="\n").writerow(names)
    return line.getvalue()


SERVICE = CsvWriter

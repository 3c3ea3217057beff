"""CSV: `time [s],tick,left/knee.position [rad],...`, a line a tick.

The unit stands in brackets behind the name, in ASCII; plain numbers have none. Floats have the fewest digits that read back
as the same number, ints and bools are whole numbers, and what is not a number is `nan`, `inf` or `-inf`.
"""

import csv
import io
import os

from runtime.recorder.files import LineFile, create
from runtime.recorder.service import Service

WITHOUT_UNIT = ("1", "any")


class CsvWriter(Service):
    """Serves blocks.recorders.CsvRecorder."""

    def open(self):
        parameters, columns = self.sink["parameters"], self.sink["columns"]
        delimiter = parameters.get("delimiter", ",")
        self.flush_rows = parameters.get("flush_rows", 200)
        self.rows = 0
        self.whole = [column["dtype"] != "float" for column in columns]
        self.template = delimiter.join(["%r", "%d", *("%d" if whole else "%r" for whole in self.whole)]) + "\n"
        self.file = None
        if self.plan["folder"] is None:
            return
        stem = os.path.join(self.plan["folder"], parameters.get("file") or self.plan["stem"])
        self.file = LineFile(*create(stem, ".csv"))
        self.files[self.file.path] = ""
        self.file.write(header(columns, delimiter))
        self.file.flush()

    def row(self, tick, time, values):
        if self.file is None:
            return
        try:
            line = self.template % (time, tick, *values)
        except (ValueError, OverflowError):                 # a whole number that is NaN or infinite
            line = self.template.replace("%d", "%r") % (
                time, tick, *(int(v) if whole and abs(v) < float("inf") else v for v, whole in zip(values, self.whole)))
        self.file.write(line)
        self.rows += 1
        if self.rows % self.flush_rows == 0:
            self.file.flush()

    def flush(self):
        if self.file is not None:
            self.file.flush()

    def close(self):
        if self.file is None:
            return {"rows": 0}
        self.file.close()
        self.files[self.file.path] = f"{self.rows} rows of {len(self.sink['columns'])} signals"
        return {"file": self.file.path, "rows": self.rows, "bytes": self.file.size}


def header(columns, delimiter):
    names = ["time [s]", "tick"]
    for column in columns:
        unit = column["ascii_unit"]
        names.append(column["path"] if unit in WITHOUT_UNIT else f"{column['path']} [{unit}]")
    line = io.StringIO()
    csv.writer(line, delimiter=delimiter, lineterminator="\n").writerow(names)
    return line.getvalue()

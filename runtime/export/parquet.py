"""Parquet export: `time`, `tick` and one column a number, as double, int64 or bool.

The metadata of columns have the units, that of the file the recording's metadata.
"""

import json

from runtime.base.optional_dependencies import need

ROW_GROUP = 100_000  # rows
ABOUT = "tickwork"  # key of the file's metadata


def check(trial, kind):
    need("pyarrow.parquet", "a Parquet file")


def write(trial, path, progress):
    arrow, parquet = need("pyarrow", "a Parquet file"), need("pyarrow.parquet", "a Parquet file")
    columns = {"time": (trial.time, "s"), "tick": (trial.tick, "1")}
    columns |= {name: (trial[name], signal["unit"]) for name, signal in trial.signals.items()}
    schema = arrow.schema(
        [
            arrow.field(name, arrow.from_numpy_dtype(values.dtype), metadata={"unit": unit})
            for name, (values, unit) in columns.items()
        ],
        metadata={
            ABOUT: json.dumps(
                {"about": trial.about, "end": trial.end, "events": trial.events, "diagram": trial.diagram},
                ensure_ascii=False,
            )
        },
    )
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for first in range(0, max(1, len(trial)), ROW_GROUP):
            rows = slice(first, first + ROW_GROUP)
            writer.write_table(
                arrow.Table.from_arrays([arrow.array(values[rows]) for values, _ in columns.values()], schema=schema)
            )
            progress(first / max(1, len(trial)))

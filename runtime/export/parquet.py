"""Parquet export: `time`, `tick` and one column a number, as double, int64 or bool.

The metadata of columns have the units, that of the file the recording's metadata.
"""

import json

import numpy as np

from runtime.analysis.trial import DTYPES, holds
from runtime.base.optional_dependencies import need

ROW_GROUP = 100_000  # rows
ABOUT = "tickwork"  # key of the file's metadata
DICTIONARY_LIMIT = 1 << 14  # different values of a signal in a row group
ENCODINGS = {"float64": "BYTE_STREAM_SPLIT", "int64": "DELTA_BINARY_PACKED", "bool": "RLE"}


def check(trial, kind):
    need("pyarrow.parquet", "a Parquet file")


def write(trial, path, progress):
    arrow, parquet = need("pyarrow", "a Parquet file"), need("pyarrow.parquet", "a Parquet file")
    kinds = {"time": np.dtype(float), "tick": np.dtype(np.int64), **types(trial)}
    units = {"time": "s", "tick": "1", **{name: signal["unit"] for name, signal in trial.signals.items()}}
    schema = arrow.schema(
        [
            arrow.field(name, arrow.from_numpy_dtype(kind), metadata={"unit": units[name]})
            for name, kind in kinds.items()
        ],
        metadata={
            ABOUT: json.dumps(
                {"about": trial.about, "end": trial.end, "events": trial.events, "diagram": trial.diagram},
                ensure_ascii=False,
            )
        },
    )
    writer, done = None, 0
    try:
        for rows in groups(trial):
            columns = [rows[:, 0] / trial.about["rate"], rows[:, 0], *rows[:, 2:].T]
            arrays = [np.ascontiguousarray(values, dtype=kind) for values, kind in zip(columns, kinds.values())]
            if writer is None:
                few = {name for name, values in zip(kinds, arrays) if name in trial.signals and has_few(values)}
                writer = parquet.ParquetWriter(
                    path,
                    schema,
                    compression="zstd",
                    use_dictionary=sorted(few),
                    column_encoding={name: ENCODINGS[kind.name] for name, kind in kinds.items() if name not in few},
                )
            writer.write_table(arrow.Table.from_arrays([arrow.array(values) for values in arrays], schema=schema))
            done += len(rows)
            progress(done / max(1, len(trial)))
    finally:
        if writer is not None:
            writer.close()


def types(trial):
    """Return {path: dtype} of the signals. An int or bool with values that its type lacks is a double."""
    kinds = {name: np.dtype(DTYPES.get(signal["dtype"], float)) for name, signal in trial.signals.items()}
    whole = [(2 + place, name) for place, (name, kind) in enumerate(kinds.items()) if kind.kind != "f"]
    if whole:
        for rows, _ in trial.batches(frames=False):
            for column, name in whole:
                if kinds[name].kind != "f" and not holds(kinds[name].type, rows[:, column]):
                    kinds[name] = np.dtype(float)
    return kinds


def has_few(values):
    """Return whether a dictionary of the values is small."""
    return len(np.unique(values)) <= DICTIONARY_LIMIT


def groups(trial):
    """Yield the rows of a Trial, as in a Batch, ROW_GROUP or a few more at once; at least one array."""
    waiting, count, yielded = [], 0, False
    for rows, _ in trial.batches(frames=False):
        waiting.append(rows)
        count += len(rows)
        if count >= ROW_GROUP:
            yield np.concatenate(waiting)
            waiting, count, yielded = [], 0, True
    if count or not yielded:
        yield np.concatenate(waiting)

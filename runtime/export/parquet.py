"""Parquet export: `time`, `tick` and one column a number, as double, int64 or bool.

The metadata of columns have the units, that of the file the recording's metadata.
"""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np

from runtime.analysis.trial import DTYPES, Trial, holds
from runtime.base.optional_dependencies import need
from runtime.recording.batches import Rows

ROW_GROUP = 100_000  # rows
ABOUT = "tickwork"  # key of the file's metadata
DICTIONARY_LIMIT = 1 << 14  # different values of a signal in a row group
ENCODINGS = {"float64": "BYTE_STREAM_SPLIT", "int64": "DELTA_BINARY_PACKED", "bool": "RLE"}


def check(trial: Trial, kind: str) -> None:
    """Raise MissingExtra without pyarrow. kind : not used"""
    need("pyarrow.parquet", "a Parquet file")


def write(trial: Trial, path: str, progress: Callable[[float], None]) -> None:
    """Write the file.

    path : of the file, which is overwritten
    progress : called with the fraction that is done
    """
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
    few, done = with_few_values(trial), 0
    codings = {name: ENCODINGS[kind.name] for name, kind in kinds.items() if name not in few}
    with parquet.ParquetWriter(path, schema, compression="zstd", use_dictionary=few, column_encoding=codings) as writer:
        for rows in trial.row_groups(ROW_GROUP):
            columns = [rows.tick / trial.about["rate"], rows.tick, *rows.values.T]
            arrays = [arrow.array(np.asarray(values, kind)) for values, kind in zip(columns, kinds.values())]
            writer.write_table(arrow.Table.from_arrays(arrays, schema=schema))
            done += len(rows.tick)
            progress(done / len(trial))


def types(trial: Trial) -> dict[str, np.dtype]:
    """Return {path: dtype} of the signals. An int or bool with values that its type lacks is a double."""
    kinds = {name: np.dtype(DTYPES.get(signal["dtype"], float)) for name, signal in trial.signals.items()}
    whole = {name: place for place, (name, kind) in enumerate(kinds.items()) if kind.kind != "f"}
    for rows in trial.row_groups(ROW_GROUP, [*whole.values()]) if whole else ():
        for name, values in zip(whole, rows.values.T):
            if not holds(kinds[name].type, values):
                kinds[name] = np.dtype(float)
    return kinds


def with_few_values(trial: Trial) -> list[str]:
    """Return the paths of the signals for whose values in the first row group a dictionary is small."""
    rows = next(trial.row_groups(ROW_GROUP), Rows.empty(0, len(trial.signals)))
    return [name for name, values in zip(trial.signals, rows.values.T) if len(np.unique(values)) <= DICTIONARY_LIMIT]

"""Parquet export: `time`, `tick` and one column per number, as double, int64 or bool.

The metadata of columns have the units, that of the file the recording's metadata.
"""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np

from runtime.host.optional_dependencies import need
from runtime.record.analysis.trial import Trial
from runtime.record.analysis.trial_data import DTYPES, holds
from runtime.record.storage.batches import Rows

EXTENSIONS = {"parquet": "parquet"}
ROW_GROUP = 100_000  # rows
ABOUT = "tickwork"  # key of the file's metadata
DICTIONARY_LIMIT = 1 << 14  # different values of a signal in a row group
ENCODINGS = {"float64": "BYTE_STREAM_SPLIT", "int64": "DELTA_BINARY_PACKED", "bool": "RLE"}


def check(trial: Trial, kind: str) -> None:
    """Raise MissingExtra without pyarrow. kind : not used"""
    need("pyarrow.parquet", "a Parquet file")


def write(trial: Trial, path: str, progress: Callable[[float], None]) -> None:
    """Write the file.

    path : path of the file, which is overwritten
    progress : called with the fraction that is done
    """
    kinds = {name: np.dtype(DTYPES.get(signal["dtype"], float)) for name, signal in trial.signals.items()}
    while wide := write_as(kinds, trial, path, progress):
        kinds |= dict.fromkeys(wide, np.dtype(float))


def write_as(kinds: dict[str, np.dtype], trial: Trial, path: str, progress: Callable[[float], None]) -> list[str]:
    """Write the file with these types of the signals.

    kinds : {path: dtype}

    Returns the paths of signals with values that their type lacks, after which the file is incomplete.
    """
    arrow, parquet = need("pyarrow", "a Parquet file"), need("pyarrow.parquet", "a Parquet file")
    units = {"time": "s", "tick": "1", **{name: signal["unit"] for name, signal in trial.signals.items()}}
    types = {"time": np.dtype(float), "tick": np.dtype(np.int64), **kinds}
    fields = [arrow.field(name, arrow.from_numpy_dtype(types[name]), metadata={"unit": units[name]}) for name in types]
    about = {"about": trial.about, "end": trial.end, "events": trial.events, "diagram": trial.diagram}
    schema = arrow.schema(fields, metadata={ABOUT: json.dumps(about, ensure_ascii=False)})
    groups, done = trial.row_groups(ROW_GROUP), 0
    rows: Rows | None = next(groups, Rows.empty(0, len(kinds)))
    few = [name for name, values in zip(kinds, rows.values.T) if len(np.unique(values)) <= DICTIONARY_LIMIT]
    codings = {name: ENCODINGS[kind.name] for name, kind in types.items() if name not in few}
    with parquet.ParquetWriter(path, schema, compression="zstd", use_dictionary=few, column_encoding=codings) as writer:
        while rows is not None:
            signals = dict(zip(kinds, rows.values.T))
            wide = [name for name, kind in kinds.items() if kind.kind != "f" and not holds(kind.type, signals[name])]
            if wide:
                return wide
            columns = [rows.tick / trial.about["rate"], rows.tick, *signals.values()]
            arrays = [arrow.array(np.asarray(values, kind)) for values, kind in zip(columns, types.values())]
            writer.write_table(arrow.Table.from_arrays(arrays, schema=schema))
            done += len(rows.tick)
            progress(done / max(1, len(trial)))
            rows = next(groups, None)
    return []

"""Result of a study: a table with a row per trial, in memory and as a Parquet file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.analysis.trial import Trial
from runtime.base.errors import BadInput
from runtime.base.optional_dependencies import need
from runtime.base.suggestions import suggestion
from runtime.session.simulate import simulate
from runtime.studies.description import RESULTS, Study
from runtime.studies.journal import check_identity

if TYPE_CHECKING:
    import pandas

ABOUT = "tickwork"  # key of the file's metadata
PURPOSE = "the table of a study"


class StudyResult:
    """Table of a study: `trial`, the parameters, the objectives, `ticks`, `fault` and `error` of each trial.

        result["work"]          # array over the trials, NaN for a missing value
        result.table()          # pandas DataFrame
        result.run(17)          # the Trial of one row

    study : its description
    rows : [{column: value}], in the order of the trials
    """

    def __init__(self, study: Study, rows: Sequence[dict[str, Any]]) -> None:
        self.study = study
        parameters = [{} for _ in rows] if not rows else list(study.trials())
        self.names = ["trial", *study.parameters, *study.objectives, *RESULTS[1:]]
        self.columns = {name: [{**p, **row}[name] for p, row in zip(parameters, rows)] for name in self.names}

    def __len__(self) -> int:
        return len(self.columns["trial"])

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column as an array over the trials. Raises KeyError with a suggestion."""
        if name not in self.columns:
            hint = suggestion(name, self.names) or f"the columns are {', '.join(self.names)}"
            raise KeyError(f"the study has no column {name!r}: {hint}")
        values = self.columns[name]
        return np.array(values, float) if name in self.study.objectives else np.array(values)

    def run(self, number: int) -> Trial:
        """Run one trial again and return its Trial, whose signals are those of the study bit for bit.

        number : of the trial, from 0
        """
        for place, parameters in enumerate(self.study.trials()):
            if place == number:
                return simulate(self.study.diagram, **self.study.run_of(parameters))
        raise BadInput(f"trial {number}: expected a whole number from 0 to {len(self) - 1}")

    def table(self) -> pandas.DataFrame:
        """Return the table as a pandas DataFrame. Raises MissingExtra."""
        return need("pandas", PURPOSE).DataFrame(self.columns)

    def write(self, path: Path, identity: dict[str, Any]) -> None:
        """Write the Parquet file. identity : the description, which becomes metadata of the file"""
        arrow, parquet = need("pyarrow", PURPOSE), need("pyarrow.parquet", PURPOSE)
        types = dict.fromkeys(self.study.objectives, arrow.float64())
        types |= {"trial": arrow.int64(), "ticks": arrow.int64(), "fault": arrow.string(), "error": arrow.string()}
        arrays = [arrow.array(_alike(values), types.get(name)) for name, values in self.columns.items()]
        table = arrow.Table.from_arrays(arrays, names=self.names)
        parquet.write_table(table.replace_schema_metadata({ABOUT: json.dumps(identity)}), path, compression="zstd")

    def __repr__(self) -> str:
        return f"<StudyResult: {len(self)} trials, {', '.join(self.study.objectives)}>"


def stored(path: Path, study: Study, identity: dict[str, Any]) -> StudyResult:
    """Read the table of this study from a Parquet file. Raises BadInput if the file is that of another study."""
    arrow, parquet = need("pyarrow", PURPOSE), need("pyarrow.parquet", PURPOSE)
    try:
        table = parquet.read_table(path)
        about = json.loads((table.schema.metadata or {})[ABOUT.encode()])
    except (OSError, KeyError, ValueError, arrow.ArrowInvalid):
        raise BadInput(f"{path} is not the table of a study: choose another file, or delete this one") from None
    check_identity(path, about, identity)
    names = ["trial", *study.objectives, *RESULTS[1:]]
    return StudyResult(study, table.select(names).to_pylist())


def _alike(values):
    """Return values of one type: as texts, if texts or booleans are among others. A Parquet column has one type."""
    kinds = {type(value) for value in values}
    if len(kinds) > 1 and (str in kinds or bool in kinds) and type(None) not in kinds:
        return [str(value).lower() if isinstance(value, bool) else str(value) for value in values]
    return [float(value) for value in values] if kinds == {int, float} else values

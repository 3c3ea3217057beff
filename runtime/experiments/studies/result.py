"""Result of a study: a table with a row per trial, in memory and as a Parquet file."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from runtime.experiments.studies.description import RESULTS, Study
from runtime.experiments.studies.journal import check_identity
from runtime.host.console.styles import count
from runtime.host.errors import BadInput
from runtime.host.optional_dependencies import need
from runtime.host.suggestions import suggestion
from runtime.record.analysis.pictures import Pictures
from runtime.record.analysis.trial import Trial
from runtime.session.simulate import simulate

if TYPE_CHECKING:
    import pandas

ABOUT = "tickwork"  # key of the file's metadata
PURPOSE = "the table of a study"


class StudyResult:
    """Table of a study: `trial`, parameters, objectives, `ticks`, `fault`, `error` and `invalid` of each trial.

        result["work"]          # array over the trials, NaN for a missing value
        result.table()          # pandas DataFrame
        result.plot()           # picture of the objectives
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

    def plot(self, *names: str) -> Pictures:
        """Return a picture of objectives, which a notebook shows; `.save("study.png")` writes it.

        names : names of objectives; by default all

        With two grid parameters it has heat maps, otherwise a point per trial over each parameter.

        Raises BadInput for another name.
        """
        for name in names:
            if name not in self.study.objectives:
                hint = (
                    suggestion(name, self.study.objectives) or f"the objectives are {', '.join(self.study.objectives)}"
                )
                raise BadInput(f"the study has no objective {name!r}: {hint}")
        from runtime.experiments.studies import picture  # imports matplotlib

        return Pictures(
            {"study": partial(picture.draw, self.study, self.columns, names or tuple(self.study.objectives))}
        )

    def summary(self) -> Iterator[str]:
        """Yield the lines of a summary: trials, their problems, and the range of each objective with its trials."""
        problems = {kind: [text for text in self.columns[kind] if text is not None] for kind in RESULTS[2:]}
        faults, errors, invalid = map(len, problems.values())
        yield f"{count(len(self), 'trial')}, {count(faults, 'fault')}, {count(errors, 'error')}, {invalid} invalid"
        for kind, texts in problems.items():
            if texts:
                yield f"  first {kind}: {texts[0]}"
        width = max(map(len, self.study.objectives))
        for name in self.study.objectives:
            values = self[name]
            if not np.isfinite(values).any():
                yield f"  {name:<{width}}  no value"
                continue
            finite = np.where(np.isfinite(values), values, np.nan)
            for word, number in (("lowest", np.nanargmin(finite)), ("highest", np.nanargmax(finite))):
                parameters = ", ".join(f"{key}={_short(self.columns[key][number])}" for key in self.study.parameters)
                yield f"  {name:<{width}}  {word:<7} {values[number]:<12.6g} trial {number}: {parameters}".rstrip(": ")

    def run(self, number: int) -> Trial:
        """Run one trial again and return its Trial, whose signals are those of the study bit for bit.

        number : number of the trial, from 0
        """
        for place, parameters in enumerate(self.study.trials()):
            if place == number:
                return simulate(self.study.diagram, **self.study.run_of(parameters))
        raise BadInput(f"trial {number}: expected a whole number from 0 to {len(self) - 1}")

    def table(self) -> pandas.DataFrame:
        """Return the table as a pandas DataFrame. Raises MissingExtra."""
        return need("pandas", PURPOSE).DataFrame(self.columns)

    def write(self, file: BinaryIO, identity: dict[str, Any]) -> None:
        """Write the Parquet file. identity : the description, which becomes metadata of the file"""
        arrow, parquet = need("pyarrow", PURPOSE), need("pyarrow.parquet", PURPOSE)
        types = dict.fromkeys(self.study.objectives, arrow.float64())
        types |= {"trial": arrow.int64(), "ticks": arrow.int64(), **dict.fromkeys(RESULTS[2:], arrow.string())}
        arrays = [arrow.array(_alike(values), types.get(name)) for name, values in self.columns.items()]
        table = arrow.Table.from_arrays(arrays, names=self.names)
        parquet.write_table(table.replace_schema_metadata({ABOUT: json.dumps(identity)}), file, compression="zstd")

    def _repr_html_(self) -> str:
        lines = "\n".join(self.summary())
        return f'<pre style="line-height: 1.3">{escape(lines)}</pre>{self.plot().html()}'

    def __repr__(self) -> str:
        return f"<StudyResult: {len(self)} trials, {', '.join(self.study.objectives)}>"


def load_result(path: Path, study: Study, identity: dict[str, Any]) -> StudyResult:
    """Read the table of this study from a Parquet file. Raises BadInput if the file is that of another study."""
    names = ["trial", *study.objectives, *RESULTS[1:]]
    return StudyResult(study, read_table(path, identity).select(names).to_pylist())


def read_table(path: Path, identity: dict[str, Any]) -> Any:
    """Return the pyarrow.Table of a Parquet file. Raises BadInput if the file is that of another study."""
    arrow, parquet = need("pyarrow", PURPOSE), need("pyarrow.parquet", PURPOSE)
    try:
        table = parquet.read_table(path)
        about = json.loads((table.schema.metadata or {})[ABOUT.encode()])
    except (OSError, KeyError, ValueError, arrow.ArrowInvalid):
        raise BadInput(f"{path} is not the table of a study: choose another file, or delete this one") from None
    check_identity(path, about, identity)
    return table


def _alike(values):
    """Return values of one type: as texts, if texts or booleans are among others. A Parquet column has one type."""
    kinds = {type(value) for value in values}
    if len(kinds) > 1 and (str in kinds or bool in kinds) and type(None) not in kinds:
        return [str(value).lower() if isinstance(value, bool) else str(value) for value in values]
    return [float(value) for value in values] if kinds == {int, float} else values


def _short(value):
    """Return a value of a parameter as text of a summary, a float with six digits."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)

"""Run a study: the trials that are missing, their journal, and the table."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from runtime.experiments.studies.cluster import Cluster
from runtime.experiments.studies.description import Study
from runtime.experiments.studies.engine import Engine, Here, Order, Processes, failure_text
from runtime.experiments.studies.journal import Journal
from runtime.experiments.studies.result import PURPOSE, StudyResult, load_result
from runtime.host.console.progress import Progress
from runtime.host.console.styles import count
from runtime.host.errors import BadInput
from runtime.host.optional_dependencies import need
from runtime.host.replaced_file import replacement

Rows = dict[int, dict[str, Any]]  # number of a trial: its row
Result = TypeVar("Result", bound=StudyResult)


def run(study: Study, output: Path | None = None, workers: int | None = None, dask: str | None = None) -> StudyResult:
    """Run a study, or the rest of one.

    output : path of the Parquet file; None writes no file. A finished table of the same study is read
    workers : number of processes; 0 runs the trials in this process; None is one for each processor
    dask : address of a Dask scheduler, whose workers run the trials instead

    Raises BadInput for a description that cannot run, an error of the first trial, and an exception in user code.
    """

    def result(engine: Engine, rows: Rows, journal: Journal | None) -> StudyResult:
        orders = list(enumerate(study.trials()))
        missing = sum(number not in rows for number, _ in orders)
        with Progress(f"running {count(missing, 'trial')}") as progress:
            complete(engine, orders, rows, journal, progress)
        return StudyResult(study, [rows[number] for number, _ in orders])

    return calculate(study, result, load_result, output, workers, dask)


def calculate(
    study: Study,
    result: Callable[[Engine, Rows, Journal | None], Result],
    stored: Callable[[Path, Any, dict[str, Any]], Result],
    output: Path | None,
    workers: int | None,
    dask: str | None,
    versions: Mapping[str, str] = MappingProxyType({}),
) -> Result:
    """Return a result, which becomes the table `output`, or the finished table of the same study.

    result : calculates it with an engine, the rows of earlier processes, and the journal of new ones
    stored : reads it from its file, of which the study and its identity are given
    versions : {"the version of numpy": ...}, which a study that continues must have as well
    """
    if workers is not None and (type(workers) is not int or workers < 0):
        raise BadInput(f"workers = {workers!r}: expected a number of processes, or 0 for this process")
    if dask is not None and workers is not None:
        raise BadInput("workers and dask exclude each other: the cluster has its own workers")
    identity = study.identity() if workers != 0 or output is not None else {}
    if output is None:
        with _engine(study, workers, dask) as engine:
            return result(engine, {}, None)
    need("pyarrow.parquet", PURPOSE)
    path = journal_of(output)
    if output.exists() and not path.exists():
        return stored(output, study, identity)
    journal = Journal(path, {**identity, **versions})
    try:
        with _engine(study, workers, dask) as engine:
            calculated = result(engine, dict(journal.rows), journal)
        try:
            with replacement(output) as file:
                calculated.write(file, identity)
        except OSError as error:
            raise BadInput(f"cannot write {output}: {error.strerror or error}; {path} has the trials") from None
        journal.remove()
    finally:
        journal.close()
    return calculated


def journal_of(output: Path) -> Path:
    """Return the path of the journal of an unfinished study. output : path of its table"""
    return output.with_name(f"{output.name}.unfinished")


def complete(
    engine: Engine, orders: Iterable[Order], rows: Rows, journal: Journal | None, progress: Callable[[float], None]
) -> None:
    """Run the trials that `rows` lacks, and add their rows to it and to the journal. Raises BadInput.

    progress : is called with the fraction that is done, 0 to 1
    """
    missing, new = [order for order in orders if order[0] not in rows], []
    ended = engine.run(missing)
    try:
        for number, row in enumerate(ended, 1):
            if row["trial"] == 0 and row["error"] is not None and row["ticks"] == 0:
                raise BadInput(failure_text(*missing[0], row["error"]))
            rows[row["trial"]] = row
            new.append(row)
            while journal is not None and 0 in rows and new:  # the description is right if the first trial is
                journal.write(new.pop(0))
            progress(number / len(missing))
    finally:
        ended.close()


def _engine(study: Study, workers: int | None, dask: str | None) -> Engine:
    if dask is not None:
        return Cluster(study, dask)
    return Here(study) if workers == 0 else Processes(study, workers or len(os.sched_getaffinity(0)))

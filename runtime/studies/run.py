"""Run a study: the trials that are missing, their journal, and the table."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from runtime.base.errors import BadInput
from runtime.base.optional_dependencies import need
from runtime.console.progress import Progress
from runtime.console.styles import count
from runtime.studies.cluster import run_on_dask
from runtime.studies.description import Study
from runtime.studies.engine import failed, run_here, run_in_processes
from runtime.studies.journal import Journal
from runtime.studies.result import PURPOSE, StudyResult, stored


def run(study: Study, output: Path | None = None, workers: int | None = None, dask: str | None = None) -> StudyResult:
    """Run a study, or the rest of one.

    output : path of the Parquet file; None writes no file. A finished table of the same study is read
    workers : number of processes; 0 runs the trials in this process; None is one for each processor
    dask : address of a Dask scheduler, whose workers run the trials instead

    Raises BadInput for a description that cannot run, an error of the first trial, and an exception in user code.
    """
    if workers is not None and (type(workers) is not int or workers < 0):
        raise BadInput(f"workers = {workers!r}: expected a number of processes, or 0 for this process")
    if dask is not None and workers is not None:
        raise BadInput("workers and dask exclude each other: the cluster has its own workers")
    identity = study.identity() if workers != 0 or output is not None else {}
    if output is None:
        return StudyResult(study, _rows(study, {}, None, workers, dask))
    need("pyarrow.parquet", PURPOSE)
    path = journal_of(output)
    if output.exists() and not path.exists():
        return stored(output, study, identity)
    journal = Journal(path, identity)
    try:
        result = StudyResult(study, _rows(study, journal.rows, journal, workers, dask))
        temporary = output.with_name(f".{output.name}.new")
        result.write(temporary, identity)
        os.replace(temporary, output)
        journal.remove()
    finally:
        journal.close()
    return result


def journal_of(output: Path) -> Path:
    """Return the path of the journal of an unfinished study. output : path of its table"""
    return output.with_name(f"{output.name}.unfinished")


def _rows(
    study: Study, done: dict[int, dict[str, Any]], journal: Journal | None, workers: int | None, dask: str | None
) -> list[dict[str, Any]]:
    """Return the rows of all trials, in order. done : rows of earlier processes"""
    parameters = list(study.trials())
    missing = [(number, each) for number, each in enumerate(parameters) if number not in done]
    rows, new = dict(done), []
    if dask is not None:
        ended = run_on_dask(study, missing, dask)
    elif workers == 0:
        ended = run_here(study, missing)
    else:
        ended = run_in_processes(study, missing, workers or len(os.sched_getaffinity(0)))
    try:
        with Progress(f"running {count(len(missing), 'trial')}") as progress:
            for number, row in enumerate(ended, 1):
                if row["trial"] == 0 and row["error"] is not None:
                    raise BadInput(failed(0, parameters[0], row["error"]))
                rows[row["trial"]] = row
                new.append(row)
                while journal is not None and 0 in rows and new:  # the description is right if the first trial is
                    journal.write(new.pop(0))
                progress(number / len(missing))
    finally:
        ended.close()
    return [rows[number] for number in range(len(parameters))]

"""Result of an optimisation in simulation: a table with a row per run, and the values of the lowest cost."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from runtime.experiments.optimisation.description import Optimisation
from runtime.experiments.optimisation.finding import at_bound
from runtime.experiments.studies.result import StudyResult, read_table
from runtime.host.console.styles import count
from runtime.record.analysis.pictures import Pictures


class OptimisationResult(StudyResult):
    """Table of an optimisation, as in a StudyResult, with the columns `generation` and `evaluation`.

        result.optimum          # {"profile.peak": 7.3, ...}, the values of the lowest cost
        result.costs            # array over the evaluations, infinite for one that failed
        result.plot()           # picture of costs and parameters over the evaluations
        result.run(17)          # the Trial of one row

    The last two evaluations are those of the estimated optimum and of the initial values.

    optimum : {name: value}
    """

    study: Optimisation

    def __init__(self, study: Optimisation, rows: Sequence[dict[str, Any]]) -> None:
        super().__init__(study, rows)
        self.costs = np.array(costs_of(rows, study.minimised, len(study.runs())))
        self._best = int(np.argmin(self.costs))
        self.optimum = study.proposals[self._best]

    def summary(self) -> Iterator[str]:
        failed = int(np.sum(self.costs == math.inf))
        runs = count(len(self.study.runs()), "run")
        yield f"{count(len(self.costs), 'evaluation')} of {runs} each, {failed} failed"
        if failed:
            number, text = next(pair for pair in enumerate(self._reasons()) if pair[1])
            yield f"  first failure: evaluation {number}: {text}"
        for title, number in (("initial", len(self.costs) - 1), ("lowest", self._best)):
            values = ", ".join(f"{name}={value:.6g}" for name, value in self.study.proposals[number].items())
            yield f"  {self.study.minimised}  {title:<7} {self.costs[number]:<12.6g} evaluation {number}: {values}"
        for each in self.study.varied:
            yield from at_bound(each, each.scaled(self.optimum[each.name]), lambda name, value: f"{value:.6g}")

    def _reasons(self):
        """Return why each evaluation failed, "" for one that has a cost."""
        runs = len(self.study.runs())
        for number, cost in enumerate(self.costs):
            rows = range(number * runs, (number + 1) * runs)
            texts = [self.columns["fault"][row] or self.columns["error"][row] or "" for row in rows]
            yield next(filter(None, texts), "") if cost == math.inf else ""

    def plot(self) -> Pictures:
        """Return a picture of the costs and the parameters over the evaluations, which a notebook shows."""
        return Pictures({"optimisation": self._draw})

    def _draw(self, file: BinaryIO, kind: str) -> None:
        from runtime.experiments.optimisation.picture import figure  # imports matplotlib
        from runtime.record.analysis import picture

        study, last = self.study, -2  # the estimate and the initial values belong to no generation
        costs = self.costs[:last].tolist()
        made = figure(
            study.varied,
            study.proposals[:last],
            costs,
            study.population,
            self.optimum,
            title=study.minimised,
            after=list(zip(("estimate", "initial"), self.costs[last:].tolist())),
            first=0,
        )
        picture.save(made, file, kind)

    def __repr__(self) -> str:
        return f"<OptimisationResult: {len(self.costs)} evaluations, {self.study.minimised}>"


def load_result(path: Path, study: Optimisation, identity: dict[str, Any]) -> OptimisationResult:
    """Read the table of this optimisation from a Parquet file. Raises BadInput if it is that of another one."""
    rows = read_table(path, identity).to_pylist()
    proposals = [{name: row[name] for name in study.over} for row in rows[:: len(study.runs())]]
    return OptimisationResult(replace(study, proposals=proposals), rows)


def costs_of(rows: Sequence[dict[str, Any]], objective: str, runs: int) -> list[float]:
    """Return the cost of each evaluation: the mean over its runs, infinite if one of them has none.

    rows : rows of all runs, in order
    objective : name of the objective to minimise
    runs : runs of each evaluation
    """
    values = [math.nan if row[objective] is None else row[objective] for row in rows]
    means = (math.fsum(values[first : first + runs]) / runs for first in range(0, len(values), runs))
    return [mean if math.isfinite(mean) else math.inf for mean in means]

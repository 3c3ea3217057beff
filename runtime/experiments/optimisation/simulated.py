"""Run an optimisation in simulation: each generation of proposals is run by the engine of a study."""

from __future__ import annotations

import math
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from runtime.experiments.optimisation.description import Optimisation
from runtime.experiments.optimisation.result import OptimisationResult, costs_of, load_result
from runtime.experiments.studies.engine import Engine
from runtime.experiments.studies.journal import Journal
from runtime.experiments.studies.run import Rows, calculate, complete
from runtime.host.console.progress import Progress
from runtime.host.console.styles import count
from runtime.host.errors import BadInput


def run(
    optimisation: Optimisation, output: Path | None = None, workers: int | None = None, dask: str | None = None
) -> OptimisationResult:
    """Run an optimisation, or the rest of one. Arguments and errors as in runtime.experiments.studies.run.run.

    After the last generation, the estimate of the optimum and the initial values are evaluated as well.
    """

    def result(engine: Engine, rows: Rows, journal: Journal | None) -> OptimisationResult:
        optimiser, runs = optimisation.make_optimiser(), optimisation.runs()
        evaluations = optimisation.generations * optimisation.population + 2
        proposals: list[dict[str, float]] = []

        def costs(new: list[dict[str, float]]) -> list[float]:
            first = len(proposals) * len(runs)
            orders = list(enumerate((proposal | each for proposal in new for each in runs), first))
            begun, proposals[:] = len(proposals) / evaluations, [*proposals, *new]
            complete(engine, orders, rows, journal, progress.part(begun, len(proposals) / evaluations))
            return costs_of([rows[number] for number, _ in orders], optimisation.minimised, len(runs))

        with Progress(f"running {count(evaluations * len(runs), 'trial')}") as progress:
            for _ in range(optimisation.generations):
                new = [optimiser.ask() for _ in range(optimisation.population)]
                generation = costs(new)
                if min(generation) == math.inf:
                    raise BadInput(_no_cost(optimisation, rows, len(proposals) - 1, len(runs)))
                for proposal, cost in zip(new, generation):
                    optimiser.tell(proposal, cost)
            costs([optimiser.optimum(), {each.name: float(each.start) for each in optimiser.parameters}])
        number = len(proposals) * len(runs)
        return OptimisationResult(replace(optimisation, proposals=proposals), [rows[each] for each in range(number)])

    return calculate(optimisation, result, load_result, output, workers, dask, _versions(optimisation))


def _versions(optimisation: Optimisation) -> dict[str, str]:
    """Return the versions of the packages on which the proposals depend."""
    package = optimisation.make_optimiser().package
    return {f"the version of {name}": version(name) for name in ("numpy", package) if name}


def _no_cost(optimisation: Optimisation, rows: Rows, evaluation: int, runs: int) -> str:
    """Return the message about a generation without a cost. evaluation : its last one"""
    row = rows[evaluation * runs]
    reason = (
        row["error"] or row["fault"] or row["invalid"] or f"{optimisation.minimised} = {row[optimisation.minimised]}"
    )
    return (
        f"no proposal of generation {evaluation // optimisation.population} has a cost ({reason}): "
        "correct the bounds in `over` or the objective"
    )

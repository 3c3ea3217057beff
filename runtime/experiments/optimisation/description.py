"""Description of an optimisation in simulation: a study whose trials follow from the proposals of an optimiser."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from runtime.experiments.optimisation.optimisers import Optimiser, make_optimiser
from runtime.experiments.optimisation.parameters import Parameter
from runtime.experiments.studies.description import Study, check_keys
from runtime.host.errors import BadInput
from runtime.host.suggestions import suggestion

TABLE = "optimise"
PLACES = ("generation", "evaluation")  # columns of the table


@dataclass(frozen=True)
class Optimisation(Study):
    """Description of an optimisation. The fields are those of a Study, and the keys of the table [optimise].

    Each proposal of the optimiser runs once for every trial of the study: every combination of its grid, samples and
    seeds, such as wearers. The cost of the proposal is the mean over these runs.

    over : {name of a setting: [low, high] or [low, high, initial]}
    cost : name of the objective to minimise; "" is the only one
    optimiser : "cma", "bayesian" or "random"
    generations : number of generations
    population : proposals in a generation
    seed : integer from which the random numbers of the optimiser are derived

    proposals : [{name of a setting: value}] so far
    """

    over: dict[str, list[float]] = field(default_factory=dict)
    cost: str = ""
    optimiser: str = "cma"
    generations: int = 12
    population: int = 9
    seed: int = 0
    proposals: list[dict[str, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.cost and self.cost not in self.objectives:
            hint = suggestion(self.cost, self.objectives) or f"the objectives are {', '.join(self.objectives)}"
            raise BadInput(f"cost = {self.cost!r}: expected the name of an objective; {hint}")
        if not self.cost and len(self.objectives) > 1:
            raise BadInput(f"cost: not given: expected one of the objectives {', '.join(self.objectives)}")
        if type(self.generations) is not int or self.generations < 1:
            raise BadInput(f"generations = {self.generations!r}: expected a whole number, 1 or more")
        self.make_optimiser()

    @property
    def minimised(self) -> str:
        """Name of the objective to minimise."""
        return self.cost or next(iter(self.objectives))

    @property
    def varied(self) -> list[Parameter]:
        """Parameters that the optimiser varies. Raises BadInput."""
        if not isinstance(self.over, Mapping):
            raise BadInput(f"over = {self.over!r}: expected a table of settings, as in {{ gain = [1, 5] }}")
        for name, numbers in self.over.items():
            if not isinstance(numbers, (list, tuple)) or len(numbers) not in (2, 3):
                raise BadInput(f"over: {name} = {numbers!r}: expected [LOW, HIGH] or [LOW, HIGH, INITIAL]")
        return [
            Parameter(name, low, high, initial=initial[0] if initial else None)
            for name, (low, high, *initial) in self.over.items()
        ]

    def make_optimiser(self) -> Optimiser:
        """Return the optimiser at its start. Raises BadInput, and MissingExtra without its package."""
        return make_optimiser(self.optimiser, self.varied, self.seed, self.population)

    def runs(self) -> list[dict[str, Any]]:
        """Return the parameters of the runs of each proposal, without those that the optimiser varies."""
        return list(super().trials())

    @property
    def parameters(self) -> list[str]:
        return [*PLACES, *self.over, *super().parameters]

    def trials(self) -> Iterator[dict[str, Any]]:
        runs = self.runs()
        for number, proposal in enumerate(self.proposals):
            for run in runs:
                yield dict(zip(PLACES, (number // self.population, number))) | proposal | run

    def run_of(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        return super().run_of({name: value for name, value in parameters.items() if name not in PLACES})

    def identity(self) -> dict[str, Any]:
        return {**super().identity(), TABLE: {key: getattr(self, key) for key in KEYS}}


KEYS = ("over", "cost", "optimiser", "generations", "population", "seed")


def read_optimisation(content: Mapping[str, Any]) -> Optimisation:
    """Return the Optimisation of the content of a TOML file with the table [optimise]. Raises BadInput."""
    study = {key: value for key, value in content.items() if key != TABLE}
    check_keys(study)
    table = content[TABLE]
    if not isinstance(table, Mapping):
        raise BadInput(f"{TABLE} = {table!r}: expected a table of names and values")
    for key in table:
        if key not in KEYS:
            hint = suggestion(key, KEYS) or "the keys are " + ", ".join(KEYS)
            raise BadInput(f"{TABLE}: unknown key {key!r}; {hint}")
    return Optimisation(**study, **table)

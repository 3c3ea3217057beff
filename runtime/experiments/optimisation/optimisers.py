"""Optimisers behind one interface: `ask` proposes values of the parameters, `tell` reports their cost."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from runtime.experiments.optimisation.estimate import Fit, fitted
from runtime.experiments.optimisation.parameters import Parameter, distinct
from runtime.host.errors import BadInput
from runtime.host.optional_dependencies import need
from runtime.host.suggestions import suggestion

INITIAL_DEVIATION = 0.25  # of CMA-ES, as a fraction of each parameter's bounds


class Optimiser:
    """Optimiser of the parameters of a run, which minimises a cost.

        values = optimiser.ask()            # {"profile.peak": 7.3, ...}, within the bounds
        optimiser.tell(values, cost)
        optimiser.optimum()                 # its estimate from all costs so far

    `ask` may be called several times before `tell`, up to `population` times in a generation. Values that were asked
    may remain without a cost, and `tell` also takes other values within the bounds.

    parameters : what is varied
    seed : integer from which all random numbers are derived
    population : evaluations of a generation; None is the optimiser's own number

    asked : number of proposals
    told : [(values, cost)] in order
    references : [(number of evaluations before, cost of the initial values)] in order, from which a drift of all costs
        is estimated
    """

    name, package = "", ""  # of the optimiser, and the package that it needs
    population: int

    def __init__(self, parameters: Iterable[Parameter], seed: int = 0, population: int | None = None) -> None:
        self.parameters = distinct(parameters)
        if type(seed) is not int or seed < 0:
            raise BadInput(f"seed = {seed!r}: expected a whole number, 0 or more")
        if population is not None and (type(population) is not int or population < 2):
            raise BadInput(f"population = {population!r}: expected a whole number, 2 or more")
        self.seed = seed
        self.told: list[tuple[dict[str, float], float]] = []
        self.references: list[tuple[int, float]] = []
        self.asked = 0
        self._asked_before: list[int] = []  # of each `tell`
        self._begin(np.random.default_rng(seed), population)

    def ask(self) -> dict[str, float]:
        """Return the next proposal, {name: value}."""
        self.asked += 1
        return {
            parameter.name: parameter.value(fraction)
            for parameter, fraction in zip(self.parameters, self._propose(), strict=True)
        }

    def tell(self, values: Mapping[str, float], cost: float) -> None:
        """Report the cost of an evaluation, which the next proposals take into account.

        values : {name: value} of all parameters, within their bounds
        cost : number to minimise; infinite if the evaluation failed

        Raises BadInput for values outside their bounds, and for a cost that is not a number.
        """
        fractions = []
        for parameter in self.parameters:
            value = values.get(parameter.name)
            if value is None or not parameter.low <= value <= parameter.high:
                raise BadInput(
                    f"{parameter.name} = {value!r}: expected a number from {parameter.low:g} to {parameter.high:g}"
                )
            fractions.append(parameter.scaled(value))
        if not cost > -math.inf:
            raise BadInput(f"cost = {cost!r}: expected a number, or inf for an evaluation that failed")
        self.told.append(
            ({parameter.name: float(values[parameter.name]) for parameter in self.parameters}, float(cost))
        )
        self._asked_before.append(self.asked)
        self._learn(fractions, float(cost))

    @property
    def generation(self) -> int:
        """Number of complete generations."""
        return len(self.told) // self.population

    def tell_reference(self, cost: float) -> None:
        """Report the cost of the initial values at this place among the evaluations; NaN if it was not measured."""
        self.references.append((len(self.told), float(cost)))

    def fit(self) -> Fit | None:
        """Return the quadratic function that is fitted to all costs so far; None if they do not determine a minimum."""
        finite = [(place, values, cost) for place, (values, cost) in enumerate(self.told) if cost < math.inf]
        if not finite:
            return None
        places, values, costs = zip(*finite)
        return fitted(
            np.array([[each.scaled(one[each.name]) for each in self.parameters] for one in values]),
            np.array(costs),
            np.array([each.scaled(each.start) for each in self.parameters]),
            np.array(places) + 0.5,
            np.array([pair for pair in self.references if math.isfinite(pair[1])]).reshape(-1, 2),
        )

    def optimum(self, fit: Fit | None = None) -> dict[str, float]:
        """Return the estimate of the optimum from all costs so far, {name: value}.

        It is the minimum of a quadratic fit. Before the costs determine one it is the best evaluation, and before the
        first cost the initial values.

        fit : what `fit` has returned, if it was called
        """
        fit = fit or self.fit()
        if fit is not None:
            return {each.name: each.value(fraction) for each, fraction in zip(self.parameters, fit.minimum)}
        values, cost = min(self.told, key=lambda pair: pair[1], default=(None, math.inf))
        if values is None or cost == math.inf:
            return {each.name: each.start for each in self.parameters}
        return dict(values)

    def state(self) -> dict[str, Any]:
        """Return the state as plain data for JSON, from which `restored` continues with the same proposals."""
        return {
            "optimiser": self.name,
            "seed": self.seed,
            "population": self.population,
            "parameters": [vars(parameter) for parameter in self.parameters],
            "told": [[asked, values, cost] for asked, (values, cost) in zip(self._asked_before, self.told)],
            "references": [list(pair) for pair in self.references],
        }

    def _begin(self, source: np.random.Generator, population: int | None) -> None:
        """Prepare the first generation, and set `population`."""
        raise NotImplementedError

    def _propose(self) -> Sequence[float]:
        """Return the next proposal, as fractions of the bounds."""
        raise NotImplementedError

    def _learn(self, fractions: Sequence[float], cost: float) -> None:
        """Take a cost into account. fractions : fractions of the bounds"""
        raise NotImplementedError


class Random(Optimiser):
    """Independent uniform proposals: the baseline to which an optimiser is compared."""

    name = "random"

    def _begin(self, source, population):
        self.population = population or 9
        self._source = source

    def _propose(self):
        return self._source.uniform(size=len(self.parameters)).tolist()

    def _learn(self, fractions, cost):
        pass


class CmaEs(Optimiser):
    """Covariance matrix adaptation evolution strategy, CMA-ES (Hansen 2016, arXiv:1604.00772), of the package cma.

    It ranks the costs of each generation, moves the mean of a normal distribution towards the better half, and adapts
    its covariance.
    """

    name = package = "cma"

    def _begin(self, source, population):
        library: Any = need(self.package, "CMA-ES")
        if len(self.parameters) < 2:
            raise BadInput("CMA-ES needs two parameters or more: add one, or choose the optimiser bayesian")
        options = {
            "bounds": [0.0, 1.0],
            "CMA_mirrors": 0,  # pairs of proposals, of which one may remain without a cost
            "randn": lambda *shape: source.standard_normal(shape),
            "seed": math.nan,  # leaves the random numbers of numpy.random alone
            "verbose": -9,
            **({} if population is None else {"popsize": population}),
        }
        start = [parameter.scaled(parameter.start) for parameter in self.parameters]
        self._strategy = library.CMAEvolutionStrategy(start, INITIAL_DEVIATION, options)
        self.population = self._strategy.popsize
        self._waiting, self._evaluated = [], []  # of the present generation: proposals, and (proposal, cost)

    def _propose(self):
        if not self._waiting:
            self._waiting = [point.tolist() for point in self._strategy.ask()]
        return self._waiting.pop(0)

    def _learn(self, fractions, cost):
        self._evaluated.append((np.array(fractions), cost))
        if len(self._evaluated) == self.population:
            points, costs = zip(*self._evaluated)
            finite = [one for one in costs if one < math.inf] or [0.0]
            worst = max(finite) + 1.0  # its rank is that of an infinite cost
            self._strategy.tell(points, [min(one, worst) for one in costs])
            self._waiting, self._evaluated = [], []


class Bayesian(Optimiser):
    """Bayesian optimisation by tree-structured Parzen estimators (Bergstra 2011), of the package Optuna.

    The first proposal is the initial values, and the first generation is random.
    """

    name, package = "bayesian", "optuna"

    def _begin(self, source, population):
        library: Any = need(self.package, "Bayesian optimisation")
        self.population = population or 9
        self._library = library
        self._space = {
            parameter.name: library.distributions.FloatDistribution(0.0, 1.0) for parameter in self.parameters
        }
        sampler = library.samplers.TPESampler(
            n_startup_trials=self.population, constant_liar=True, seed=int(source.integers(2**31))
        )
        verbosity = library.logging.get_verbosity()
        library.logging.set_verbosity(library.logging.WARNING)  # else it prints a line
        try:
            self._study = library.create_study(sampler=sampler)
        finally:
            library.logging.set_verbosity(verbosity)
        start = {parameter.name: parameter.scaled(parameter.start) for parameter in self.parameters}
        self._study.enqueue_trial(start)
        self._pending: list[Any] = []

    def _propose(self):
        trial = self._study.ask(self._space)
        self._pending.append(trial)
        return [trial.params[parameter.name] for parameter in self.parameters]

    def _learn(self, fractions, cost):
        names = [parameter.name for parameter in self.parameters]
        trial = next((one for one in self._pending if [one.params[name] for name in names] == fractions), None)
        if trial is not None:
            self._pending.remove(trial)
        else:  # other values than those that were asked
            self._study.enqueue_trial(dict(zip(names, fractions)))
            trial = self._study.ask(self._space)
        states = self._library.trial.TrialState
        if cost < math.inf:
            self._study.tell(trial, cost)
        else:
            self._study.tell(trial, state=states.FAIL)


OPTIMISERS: dict[str, type[Optimiser]] = {one.name: one for one in (CmaEs, Bayesian, Random)}


def make_optimiser(
    name: str, parameters: Iterable[Parameter], seed: int = 0, population: int | None = None
) -> Optimiser:
    """Return the optimiser of a name: "cma", "bayesian" or "random". Arguments as in Optimiser.

    Raises BadInput, and MissingExtra without the optimiser's package.
    """
    if name not in OPTIMISERS:
        hint = suggestion(name, OPTIMISERS) or f"expected one of {', '.join(OPTIMISERS)}"
        raise BadInput(f"no optimiser {name!r}: {hint}")
    return OPTIMISERS[name](parameters, seed, population)


def restore_optimiser(state: Mapping[str, Any]) -> Optimiser:
    """Return an optimiser that continues from a `state`, with the same proposals.

    Proposals without a cost are made again. Raises BadInput.
    """
    parameters = [Parameter(**fields) for fields in state["parameters"]]
    optimiser = make_optimiser(state["optimiser"], parameters, state["seed"], state["population"])
    for asked, values, cost in state["told"]:
        while optimiser.asked < asked:
            optimiser.ask()
        optimiser.tell(values, cost)
    optimiser.references += [(place, math.nan if cost is None else cost) for place, cost in state["references"]]
    return optimiser

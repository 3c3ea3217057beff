"""Forecast of the result of a protocol: the same evaluations with simulated wearers.

Each wearer has a quadratic cost with a hidden optimum in the middle 80 % of the bounds. The values in the middle of the
bounds cost 14 % more than the lowest on average, as the profiles of Zhang et al. 2017 (Science 356:1280) vary.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from runtime.experiments.optimisation.finding import DEVIATE
from runtime.experiments.optimisation.optimisers import make_optimiser
from runtime.experiments.optimisation.parameters import Parameter
from runtime.experiments.optimisation.protocol import Settings
from runtime.host.console.styles import count

WEARERS = {"cma": 40, "random": 40, "bayesian": 10}  # by the time that an optimiser needs
CURVATURE = 2.65  # sum over the parameters, of the cost relative to its lowest, over the whole ranges
MIDDLE = 0.1, 0.9  # where an optimum lies, as fractions of the bounds
NEAR = 0.05  # excess of the cost, relative to the lowest, that counts as found
USEFUL = 0.7  # fraction of the wearers whose optimum a useful protocol finds
NOISES = 0.02, 0.05, 0.10  # relative to the cost, where that of a measurement is not known


def expectation(plan: Mapping[str, Any]) -> list[str]:
    """Return lines on what the protocol of a plan can resolve; none where the noise of a measurement is not known.

    plan : as runtime.experiments.optimisation.process describes it
    """
    state = plan["state"]["optimiser"]
    parameters = [Parameter(**fields) for fields in state["parameters"]]
    noises = plan["noises"]
    if not noises:
        return []
    population = make_optimiser(state["optimiser"], parameters, 0, state["population"]).population
    settings = Settings.of(plan, population)
    wearers, lines = WEARERS[state["optimiser"]], []
    for noise in noises:
        found, chance = success(state["optimiser"], parameters, state["population"], settings, noise)
        lines += [
            f"forecast, for a noise of {100.0 * noise:.2g} % in each measurement:",
            f"  within {100.0 * NEAR:g} % of the lowest cost for {found} of {wearers} simulated wearers; one random "
            f"choice for {chance:.0f}",
        ]
        if settings.validations:
            least = DEVIATE * noise * math.sqrt(2.0 / settings.validations)
            trials = count(settings.validations, "validation trial")
            lines.append(f"  {trials} of each condition resolve a difference of {100.0 * least:.2g} %")
        if found < USEFUL * wearers:
            lines.append("  measure longer, add generations, or vary fewer parameters")
    return lines


def success(
    name: str, parameters: list[Parameter], population: int | None, settings: Settings, noise: float
) -> tuple[int, float]:
    """Return for how many of the simulated wearers the optimum is found, and by one random choice on average.

    noise : standard deviation of a measurement, relative to the cost
    """
    found, chance, wearers = 0, 0.0, WEARERS[name]
    for seed in range(wearers):
        source = np.random.default_rng(seed)
        optimum = source.uniform(*MIDDLE, len(parameters))
        optimiser = make_optimiser(name, parameters, seed, population)

        def excess(points):
            return CURVATURE / len(parameters) * np.sum((points - optimum) ** 2, axis=-1)

        def measured(values):
            cost = 1.0 + excess(fractions(parameters, values))
            return float(cost * (1.0 + noise * source.standard_normal()))

        initial = {each.name: each.start for each in parameters}
        while True:
            while len(optimiser.references) < settings.references(len(optimiser.told)):
                optimiser.tell_reference(measured(initial))
            if len(optimiser.told) >= settings.evaluations:
                break
            values = optimiser.ask()
            optimiser.tell(values, measured(values))
        found += bool(excess(fractions(parameters, optimiser.optimum())) < NEAR)
        chance += float(np.mean(excess(source.uniform(size=(1000, len(parameters)))) < NEAR))
    return found, chance


def fractions(parameters: list[Parameter], values: Mapping[str, float]) -> np.ndarray:
    """Return values as fractions of the bounds."""
    return np.array([each.scaled(values[each.name]) for each in parameters])

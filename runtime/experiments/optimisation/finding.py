"""Findings of an optimisation: intervals, optima at a bound, and differences below the noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from runtime.experiments.optimisation.estimate import Fit
from runtime.experiments.optimisation.optimisers import Optimiser
from runtime.experiments.optimisation.parameters import Parameter

DEVIATE = 1.96  # standard errors of a difference with a probability of 95 %
WIDTH_LIMIT = 0.5  # width of a parameter's interval, as a fraction of its bounds, above which it is not resolved
FURTHER_LIMIT = 10  # times the present number of measurements: more are not suggested
BOUND_MARGIN = 0.02  # fraction of the bounds within which an optimum is at a bound


def intervals(parameters: Iterable[Parameter], fit: Fit | None) -> dict[str, list[float]]:
    """Return {name: [low, high]} of the intervals of a fit; none without a fit."""
    if fit is None:
        return {}
    return {each.name: [each.value(x) for x in row] for each, row in zip(parameters, fit.intervals())}


def finding(
    optimiser: Optimiser,
    fit: Fit | None,
    value_text: Callable[[str, float], str],
    number: Callable[[float, float], str],
) -> list[str]:
    """Return lines on the optimum: each parameter with its interval, and the cost against that of the initial values.

    value_text : function that returns a value of a parameter with its unit
    number : function that returns a cost and its standard error with their unit
    """
    found, measured = optimiser.optimum(fit), len(optimiser.told)
    if fit is None:
        reason = f"{measured} evaluations determine no minimum of a fit"
        return [f"  no intervals: {reason}, so these are the values with the lowest measured cost"] * bool(measured)
    lines, low_high = [], intervals(optimiser.parameters, fit)
    for each, place in zip(optimiser.parameters, fit.typical):
        low, high = (value_text(each.name, bound) for bound in low_high[each.name])
        text = f"  {each.name}: {value_text(each.name, found[each.name])}, 95 % interval {low} to {high}"
        width = (low_high[each.name][1] - low_high[each.name][0]) / (each.high - each.low)
        if width > WIDTH_LIMIT:
            lines.append(f"{text}; not resolved: {more(measured, width / WIDTH_LIMIT, 'evaluation')}")
        else:
            lines += [text, *at_bound(each, place, value_text)]
    lower = "below" if fit.gain >= 0.0 else "above"
    text = f"  cost: {number(abs(fit.gain), fit.gain_error)} {lower} that of the initial parameters"
    if abs(fit.gain) < DEVIATE * fit.gain_error:
        ratio = DEVIATE * fit.gain_error / abs(fit.gain) if fit.gain else math.inf
        text += f"; not resolved: {more(measured, ratio, 'evaluation')}"
    lines.append(text)
    if fit.drift:
        lines.append(f"  drift over all evaluations, which is taken out: {number(fit.drift, fit.drift_error)}")
    return lines


def at_bound(parameter: Parameter, fraction: float, value_text: Callable[[str, float], str]) -> list[str]:
    """Return the line on a parameter whose optimum is at a bound; none for one between them.

    fraction : place of the optimum between the bounds, from 0 to 1
    """
    if BOUND_MARGIN < fraction < 1.0 - BOUND_MARGIN:
        return []
    which, bound = ("lower", parameter.low) if fraction < 0.5 else ("upper", parameter.high)
    text = f"{parameter.name} is at its {which} bound, {value_text(parameter.name, bound)}"
    return [f"    {text}: the optimum may lie beyond it. If that is safe, choose wider bounds"]


def more(measured: int, ratio: float, word: str) -> str:
    """Return how many more measurements would resolve a difference, as text.

    measured : number of measurements
    ratio : of the uncertainty to the one that resolves it; it decreases with the root of the number
    word : what is measured
    """
    if ratio**2 > FURTHER_LIMIT:
        return f"more than {(FURTHER_LIMIT - 1) * measured} more {word}s would"
    further = max(1, math.ceil(measured * (ratio**2 - 1.0)))
    return f"{further} more {word}{'s' * (further > 1)} would"


def difference(first: list[tuple[float, float]], second: list[tuple[float, float]]) -> tuple[float, float]:
    """Return the difference of the means of two conditions, and its standard error.

    first, second : (cost, standard error) of each trial
    """
    means = [math.fsum(cost for cost, _ in each) / len(each) for each in (first, second)]
    return means[0] - means[1], math.sqrt(_variance(first) + _variance(second))


def _variance(trials):
    """Return the variance of the mean of trials, of their standard errors and their scatter the larger one."""
    count = len(trials)
    mean = math.fsum(cost for cost, _ in trials) / count
    known = math.fsum(error**2 for _, error in trials) / count**2
    scatter = math.fsum((cost - mean) ** 2 for cost, _ in trials) / (count - 1) / count if count > 1 else 0.0
    return max(known if known == known else 0.0, scatter) or math.nan

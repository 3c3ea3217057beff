"""Picture of an optimisation: the cost and the parameters over the evaluations, and the optimum."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from runtime.experiments.optimisation.parameters import Parameter
from runtime.host.replaced_file import replacement
from runtime.record.analysis import picture
from runtime.record.analysis.picture import BLUE, GREEN, GREY, INK, ORANGE, drawable, plain, short
from runtime.record.storage.files import private

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CONDITIONS = {"found": ORANGE, "initial": GREY, "zero": GREEN}  # of validation trials, and their colours
WIDTH, COST_HEIGHT, ROW = 8.0, 2.8, 1.3  # inches
NAME_LIMIT = 22  # characters of a label

Values = Mapping[str, float]  # name of a parameter: value


def write(path: str) -> list[str]:
    """Write the picture beside a state file. Returns the line with its path; no line without an evaluation."""
    state = json.loads(Path(path).read_text())
    told = state["optimiser"]["told"]
    if not told:
        return []
    target = Path(path.removesuffix(".json")).with_suffix(".optimisation.png")
    made = figure(
        [Parameter(**fields) for fields in state["optimiser"]["parameters"]],
        [values for _, values, _ in told],
        [cost for _, _, cost in told],
        state["optimiser"]["population"],
        state["found"],
        errors=state["errors"],
        validated=state["validated"],
    )
    with replacement(target, private) as file:
        picture.save(made, file)
    return [f"picture: {target}"]


def figure(
    parameters: Sequence[Parameter],
    values: Sequence[Values],
    costs: Sequence[float],
    population: int,
    optimum: Values | None,
    title: str = "cost",
    errors: Sequence[float | None] = (),
    validated: Sequence[Any] = (),
) -> Figure:
    """Return the figure of an optimisation.

    values, costs : values and costs of each evaluation, in order; infinite and huge costs are left out
    population : evaluations in a generation
    optimum : drawn as lines, unless it is None
    title : title of the cost
    errors : standard errors of the costs, None if unknown
    validated : [(condition, [cost, ...])] of validation trials
    """
    made = picture.figure(WIDTH, COST_HEIGHT + ROW * len(parameters))
    heights = [COST_HEIGHT, *[ROW] * len(parameters)]
    axes: Any = made.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    numbers = np.arange(1, len(costs) + 1)
    draw_costs(axes[0], numbers, drawable(costs), errors, population)
    draw_validation(axes[0], len(costs), validated)
    axes[0].set_ylabel(plain(short(title, NAME_LIMIT)), fontsize=9, color=INK)
    for axis, parameter in zip(axes[1:], parameters):
        axis.plot(numbers, [each[parameter.name] for each in values], "o", color=BLUE, markersize=4)
        if optimum is not None:
            axis.axhline(optimum[parameter.name], color=ORANGE, linewidth=1.5)
        margin = 0.05 * (parameter.high - parameter.low)
        axis.set_ylim(parameter.low - margin, parameter.high + margin)
        axis.set_ylabel(plain(short(parameter.name, NAME_LIMIT)), fontsize=9, color=INK)
    for axis in axes:
        picture.frame(axis)
        axis.tick_params(colors=INK, labelsize=8.5, length=3)
        for first in range(population, len(costs) + 1, population):
            axis.axvline(first + 0.5, color=GREY, linewidth=0.6, linestyle=":")
    axes[-1].set_xlim(0.3, len(costs) + 0.7 + 3 * bool(validated))
    axes[-1].set_xlabel("evaluation; dotted lines: generations; orange: optimum", fontsize=9, color=INK)
    axes[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    made.align_ylabels()
    return made


def draw_costs(
    axis: Axes, numbers: np.ndarray, costs: np.ndarray, errors: Sequence[float | None], population: int
) -> None:
    """Plot the costs with their standard errors, and the median of each generation. NaN is left out."""
    spread = [0.0 if error is None else error for error in errors] + [0.0] * (len(costs) - len(errors))
    axis.errorbar(numbers, costs, yerr=spread[: len(costs)], fmt="o", color=BLUE, markersize=4, linewidth=1.0)
    for first in range(0, len(costs), population):
        generation = costs[first : first + population]
        if np.isfinite(generation).any():
            axis.plot([first + 0.6, first + len(generation) + 0.4], [np.nanmedian(generation)] * 2, color=BLUE)


def draw_validation(axis: Axes, count: int, validated: Sequence[Any]) -> None:
    """Plot the validation trials at the right, each condition in a colour."""
    for place, condition in enumerate(CONDITIONS):
        costs = [numbers[0] for name, numbers in validated if name == condition and numbers[0] is not None]
        axis.plot([count + 1.5 + place] * len(costs), costs, "D", color=CONDITIONS[condition], markersize=5)
        if costs:
            axis.lines[-1].set_label(condition)
    if validated:
        axis.legend(fontsize=8, title="validation", title_fontsize=8)

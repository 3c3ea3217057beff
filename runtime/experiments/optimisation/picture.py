"""Picture of an optimisation: cost and parameters over the evaluations, cost over each parameter, and the optimum."""

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

CONDITIONS = {"found": ORANGE, "estimate": ORANGE, "initial": GREY, "zero": GREEN}  # of further trials, with colours
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
        intervals=state["intervals"],
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
    after: Sequence[tuple[str, float]] = (),
    errors: Sequence[float | None] = (),
    validated: Sequence[Any] = (),
    intervals: Mapping[str, Sequence[float]] | None = None,
    first: int = 1,
) -> Figure:
    """Return the figure of an optimisation.

    values, costs : values and costs of each evaluation, in order; those with an infinite or huge cost have failed
    population : evaluations in a generation
    optimum : drawn as lines, unless it is None
    title : title of the cost
    after : [(name, cost)] of the evaluations behind those, which belong to no generation
    errors : standard errors of the costs, None if unknown
    validated : [(condition, [cost, ...])] of validation trials
    intervals : {parameter: (low, high)} of the optimum
    first : number of the first evaluation
    """
    made = picture.figure(WIDTH, COST_HEIGHT + ROW * len(parameters))
    heights = [COST_HEIGHT, *[ROW] * len(parameters)]
    axes: Any = made.subplots(len(heights), 2, squeeze=False, height_ratios=heights, width_ratios=[5, 2])
    numbers, shown = first + np.arange(len(costs)), drawable(costs)
    failed = ~np.isfinite(shown)
    draw_costs(axes[0, 0], numbers, shown, errors, population)
    draw_validation(axes[0, 0], numbers[-1], validated)
    for place, (name, cost) in enumerate(after):
        at, colour = numbers[-1] + 1 + place, CONDITIONS[name]
        axes[0, 0].plot([at], drawable([cost]), "D", color=colour, markersize=5, label=f"{at}: {name}")
    axes[0, 0].set_ylabel(plain(short(title, NAME_LIMIT)), fontsize=9, color=INK)
    axes[0, 1].legend(*axes[0, 0].get_legend_handles_labels(), loc="upper left", fontsize=8, frameon=False)
    for (axis, beside), parameter in zip(axes[1:], parameters):
        tried = np.array([each[parameter.name] for each in values])
        axis.sharex(axes[0, 0])
        axis.plot(numbers[~failed], tried[~failed], "o", color=BLUE, markersize=4)
        axis.plot(numbers[failed], tried[failed], "x", color=INK, markersize=6)
        beside.plot(tried, shown, "o", color=BLUE, markersize=4)
        top = np.full(int(np.sum(failed)), 0.97)
        beside.plot(tried[failed], top, "x", color=INK, markersize=6, transform=beside.get_xaxis_transform())
        for line, span in ((axis.axhline, axis.axhspan), (beside.axvline, beside.axvspan)):
            if optimum is not None:
                line(optimum[parameter.name], color=ORANGE, linewidth=1.5)
            if parameter.name in (intervals or {}):
                span(*(intervals or {})[parameter.name], color=ORANGE, alpha=0.15, linewidth=0)
        margin = 0.05 * (parameter.high - parameter.low)
        for limit in (axis.set_ylim, beside.set_xlim):
            limit(parameter.low - margin, parameter.high + margin)
        axis.set_ylabel(plain(short(parameter.name, NAME_LIMIT)), fontsize=9, color=INK)
        beside.set_ylabel(plain(short(title, NAME_LIMIT)), fontsize=9, color=INK)
        beside.set_xlabel(plain(short(parameter.name, NAME_LIMIT)), fontsize=9, color=INK)
    for axis in axes.flat:
        picture.frame(axis)
        axis.tick_params(colors=INK, labelsize=8.5, length=3)
    axes[0, 1].set_axis_off()
    for axis in axes[:-1, 0]:
        axis.tick_params(labelbottom=False)
    for axis in axes[:, 0]:
        for place in range(population, len(costs) + 1, population):
            axis.axvline(first + place - 0.5, color=GREY, linewidth=0.6, linestyle=":")
    axes[-1, 0].set_xlim(first - 0.7, numbers[-1] + 0.7 + 3.3 * bool(validated) + len(after))
    legend = "evaluation; dotted: generations; orange: optimum" + " and its interval" * bool(intervals)
    axes[-1, 0].set_xlabel(legend, fontsize=9, color=INK)
    axes[-1, 0].xaxis.set_major_locator(MaxNLocator(integer=True))
    for axis in axes[1:, 1]:
        axis.xaxis.set_major_locator(MaxNLocator(4))
    made.align_ylabels(axes[:, 0])
    return made


def draw_costs(
    axis: Axes, numbers: np.ndarray, costs: np.ndarray, errors: Sequence[float | None], population: int
) -> None:
    """Plot the costs with their standard errors, the median of each generation, and the lowest so far.

    Evaluations whose cost is NaN are marked at the top.
    """
    spread = [0.0 if error is None else error for error in errors] + [0.0] * (len(costs) - len(errors))
    axis.errorbar(numbers, costs, yerr=spread[: len(costs)], fmt="o", color=BLUE, markersize=4, linewidth=1.0)
    for place in range(0, len(costs), population):
        generation = costs[place : place + population]
        if np.isfinite(generation).any():
            ends = [numbers[place] - 0.4, numbers[place] + len(generation) - 0.6]
            axis.plot(ends, [np.nanmedian(generation)] * 2, color=BLUE)
    failed = ~np.isfinite(costs)
    if not failed.all():
        axis.step(numbers, np.fmin.accumulate(costs), where="post", color=GREEN, linewidth=1.0, label="lowest so far")
    if failed.any():
        top = [0.97] * int(np.sum(failed))
        axis.plot(numbers[failed], top, "x", color=INK, transform=axis.get_xaxis_transform(), label="failed")


def draw_validation(axis: Axes, last: int, validated: Sequence[Any]) -> None:
    """Plot the validation trials at the right, each condition in a colour."""
    for place, condition in enumerate(name for name in CONDITIONS if name != "estimate"):
        costs = [numbers[0] for name, numbers in validated if name == condition and numbers[0] is not None]
        if costs:
            label = f"validation: {condition}"
            axis.plot(
                [last + 1.5 + place] * len(costs), costs, "D", color=CONDITIONS[condition], markersize=5, label=label
            )

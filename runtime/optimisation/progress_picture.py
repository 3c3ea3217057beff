"""Picture of an optimisation with a wearer: cost and parameters over the evaluations, and what was found."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from runtime.analysis import picture
from runtime.analysis.picture import BLUE, GREEN, GREY, ORANGE, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CONDITIONS = {"found": ORANGE, "initial": GREY, "zero": GREEN}  # of validation trials, and their colours
WIDTH, COST_HEIGHT, ROW = 8.0, 2.8, 1.3  # inches


def write(path: str) -> list[str]:
    """Write the picture beside a state file. Returns the line with its path; no line without an evaluation."""
    state = json.loads(Path(path).read_text())
    if not state["optimiser"]["told"]:
        return []
    target = Path(path.removesuffix(".json")).with_suffix(".optimisation.png")
    with target.open("wb") as file:
        picture.save(figure(state), file)
    return [f"picture: {target}"]


def figure(state: dict[str, Any]) -> Figure:
    """Return the figure of a state."""
    optimiser = state["optimiser"]
    values, costs = [values for _, values, _ in optimiser["told"]], [cost for _, _, cost in optimiser["told"]]
    parameters, population = optimiser["parameters"], optimiser["population"]
    made = picture.figure(WIDTH, COST_HEIGHT + ROW * len(parameters))
    heights = [COST_HEIGHT, *[ROW] * len(parameters)]
    axes: Any = made.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    numbers = np.arange(1, len(costs) + 1)
    draw_costs(axes[0], numbers, costs, state["errors"], population)
    draw_validation(axes[0], len(costs), state["validated"])
    for axis, parameter in zip(axes[1:], parameters):
        name = parameter["name"]
        axis.plot(numbers, [each[name] for each in values], "o", color=BLUE, markersize=4)
        if state["found"] is not None:
            axis.axhline(state["found"][name], color=ORANGE, linewidth=1.5)
        axis.set_ylim(parameter["low"], parameter["high"])
        axis.set_ylabel(plain(name), fontsize=9)
        picture.frame(axis)
    for axis in axes:
        for first in range(population, len(costs) + 1, population):
            axis.axvline(first + 0.5, color=GREY, linewidth=0.6, linestyle=":")
    axes[-1].set_xlim(0.3, len(costs) + 0.7 + 3 * bool(state["validated"]))
    axes[-1].set_xlabel("evaluation; dotted lines: generations; orange: found")
    axes[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    return made


def draw_costs(axis: Axes, numbers: np.ndarray, costs: list[float], errors: list[Any], population: int) -> None:
    """Plot the costs with their standard errors, and the mean of each generation."""
    spread = [0.0 if error is None else error for error in errors] + [0.0] * (len(costs) - len(errors))
    axis.errorbar(numbers, costs, yerr=spread[: len(costs)], fmt="o", color=BLUE, markersize=4, linewidth=1.0)
    for first in range(0, len(costs), population):
        generation = costs[first : first + population]
        axis.plot([first + 0.6, first + len(generation) + 0.4], [np.mean(generation)] * 2, color=BLUE, linewidth=2.0)
    axis.set_ylabel("cost", fontsize=9)
    picture.frame(axis)


def draw_validation(axis: Axes, count: int, validated: list[Any]) -> None:
    """Plot the validation trials at the right, each condition in a colour."""
    for place, condition in enumerate(CONDITIONS):
        costs = [numbers[0] for name, numbers in validated if name == condition and numbers[0] is not None]
        axis.plot([count + 1.5 + place] * len(costs), costs, "D", color=CONDITIONS[condition], markersize=5)
        if costs:
            axis.lines[-1].set_label(condition)
    if validated:
        axis.legend(fontsize=8, title="validation", title_fontsize=8)

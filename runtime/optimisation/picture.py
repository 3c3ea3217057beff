"""Picture of an optimisation: the costs over the generations, and the values of each parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from matplotlib.ticker import MaxNLocator

from runtime.analysis import picture
from runtime.analysis.picture import BLUE, GREY, INK, ORANGE, plain, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from runtime.optimisation.parameters import Parameter

WIDTH, HEIGHT = 3.4, 2.5  # inches, of one plot
COLUMNS = 3  # plots beside each other
NAME_LIMIT = 32  # characters of a label


def draw(
    parameters: Sequence[Parameter],
    proposals: Sequence[Mapping[str, float]],
    costs: Sequence[float],
    population: int,
    optimum: Mapping[str, float],
    title: str,
    file: BinaryIO,
    kind: str,
) -> None:
    """Draw an optimisation into a file.

    proposals : {name: value} of each evaluation, in order
    costs : of each evaluation; infinite ones are left out
    population : evaluations in a generation
    optimum : {name: value}, drawn as a line
    title : of the cost
    file : open for writing bytes
    kind : "png" or "svg"
    """
    generations = np.arange(len(costs)) // population
    panels = [(title, np.array(costs, float), None)]
    panels += [(each.name, np.array([values[each.name] for values in proposals]), each) for each in parameters]
    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    figure = picture.figure(WIDTH * columns, 0.4 + HEIGHT * rows)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for (name, values, parameter), axis in zip(panels, axes):
        over_generations(axis, generations, np.where(np.isfinite(values), values, np.nan))
        if parameter is not None:
            margin = 0.04 * (parameter.high - parameter.low)
            axis.set_ylim(parameter.low - margin, parameter.high + margin)
            axis.axhline(optimum[name], color=ORANGE, linewidth=1.5, label="optimum")
        axis.set_title(plain(short(name, NAME_LIMIT)), fontsize=10, color=INK)
        axis.set_xlabel("generation", color=INK)
    if len(axes) > 1:
        axes[1].legend(fontsize=8, frameon=False)
    for axis in axes[len(panels) :]:
        axis.remove()
    picture.save(figure, file, kind)


def over_generations(axis: Axes, generations: np.ndarray, values: np.ndarray) -> None:
    """Plot a point per evaluation, and a line through the medians of the generations. NaN is left out."""
    axis.plot(generations, values, "o", color=GREY, alpha=0.5, markersize=3.5, linestyle="none")
    places = [place for place in np.unique(generations) if np.isfinite(values[generations == place]).any()]
    medians = [np.nanmedian(values[generations == place]) for place in places]
    axis.plot(places, medians, color=BLUE, linewidth=1.5)
    picture.frame(axis)
    axis.tick_params(colors=INK, labelsize=8.5, length=3)
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))

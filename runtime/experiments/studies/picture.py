"""Picture of a study: a heat map over two grid parameters, otherwise each objective over each parameter."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from matplotlib.ticker import MaxNLocator

from runtime.host.console.styles import count
from runtime.record.analysis import picture
from runtime.record.analysis.picture import BLUE, FAINT, GREY, INK, drawable, plain, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from runtime.experiments.studies.description import Study

WIDTH, HEIGHT = 3.4, 2.5  # inches, of one plot
TICK_LIMIT = 12  # labelled values of an axis
CELL_TEXT_LIMIT = 80  # cells of a heat map with their value as text
NAME_LIMIT = 32  # characters of a label
MAP_COLUMNS = 3  # heat maps beside each other

Columns = Mapping[str, Sequence[Any]]  # of the table, by their names


def draw(study: Study, table: Columns, objectives: Sequence[str], file: BinaryIO, kind: str) -> None:
    """Draw the objectives of a study into a file.

    objectives : names
    file : open for writing bytes
    kind : "png" or "svg"
    """
    varied = [name for name in [*study.grid, *study.sample] if len(set(table[name])) > 1]
    if len(varied) == 2 and not study.sample:
        figure = heat_maps(study, table, objectives, varied)
    else:
        figure = curves(study, table, objectives, varied or ["trial"])
    name = getattr(study.diagram, "__name__", None) or os.path.basename(os.fspath(study.diagram))
    figure.suptitle(plain(f"{name}: {count(len(table['trial']), 'trial')}"), fontsize=11, fontweight="bold", color=INK)
    picture.save(figure, file, kind)


def curves(study: Study, table: Columns, objectives: Sequence[str], parameters: Sequence[str]) -> Figure:
    """Return a figure with a point per trial: a row of plots per objective, and a column per parameter.

    A line connects the means of the trials with the same value of a grid parameter.
    """
    rows, columns = len(objectives), len(parameters)
    figure = picture.figure(1.0 + WIDTH * max(columns, 1.4), 0.6 + HEIGHT * rows)
    axes = figure.subplots(rows, columns, sharex="col", sharey="row", squeeze=False)
    for objective, row in zip(objectives, axes):
        values = drawable(table[objective])
        for parameter, axis in zip(parameters, row):
            places, labels = places_of(table[parameter])
            dense = len(values) > 200
            axis.plot(places, values, "o", color=BLUE, alpha=0.35 if dense else 0.7, markersize=2.5 if dense else 4)
            if parameter in study.grid:
                at = np.unique(places)
                axis.plot(at, [mean(values[places == place]) for place in at], color=BLUE, linewidth=1.5)
            if labels:
                label_ticks(axis, "x", labels)
            elif all(isinstance(value, int) for value in table[parameter]):
                axis.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
            dress(axis)
        row[0].set_ylabel(plain(short(objective, NAME_LIMIT)), color=INK)
    for parameter, axis in zip(parameters, axes[-1]):
        axis.set_xlabel(plain(short(parameter, NAME_LIMIT)), color=INK)
    return figure


def heat_maps(study: Study, table: Columns, objectives: Sequence[str], parameters: Sequence[str]) -> Figure:
    """Return a figure with a heat map per objective: the mean over the seeds, for each pair of parameter values."""
    columns = min(MAP_COLUMNS, len(objectives))
    rows = -(-len(objectives) // columns)
    figure = picture.figure(0.6 + 1.3 * WIDTH * columns, 0.6 + 1.2 * HEIGHT * rows)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    below, right = ([study.grid[name].index(value) for value in table[name]] for name in parameters)
    low, high = (list(map(label_of, study.grid[name])) for name in parameters)
    for objective, axis in zip(objectives, axes):
        values, cells = drawable(table[objective]), np.full((len(low), len(high)), np.nan)
        for cell in set(zip(below, right)):
            cells[cell] = mean(values[[pair == cell for pair in zip(below, right)]])
        axis.set_facecolor(FAINT)
        mesh = axis.pcolormesh(cells, cmap="viridis")
        figure.colorbar(mesh, ax=axis)
        if cells.size <= CELL_TEXT_LIMIT:
            name_cells(axis, cells)
        axis.set_title(plain(short(objective, NAME_LIMIT)), fontsize=10, color=INK)
        for side, name, labels in (("y", parameters[0], low), ("x", parameters[1], high)):
            label_ticks(axis, side, labels, offset=0.5)
            axis.set(**{f"{side}label": plain(short(name, NAME_LIMIT))})
        axis.tick_params(colors=INK, labelsize=8.5, length=0)
    for axis in axes[len(objectives) :]:
        axis.remove()
    return figure


def name_cells(axis: Axes, cells: np.ndarray) -> None:
    """Write the value of each cell of a heat map into it, × for a missing one."""
    finite = cells[np.isfinite(cells)]
    middle = (finite.min() + finite.max()) / 2 if finite.size else 0.0
    for (below, right), value in np.ndenumerate(cells):
        missing = not np.isfinite(value)
        axis.text(
            right + 0.5,
            below + 0.5,
            "×" if missing else f"{value:.3g}",
            color=GREY if missing else "white" if value < middle else "black",
            ha="center",
            va="center",
            fontsize=8,
        )


def places_of(values: Sequence[object]) -> tuple[np.ndarray, list[str]]:
    """Return the positions of values on an axis, and their labels; no labels for numbers."""
    if all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values):
        return np.array(values, float), []
    texts = list(map(label_of, values))
    labels = list(dict.fromkeys(texts))
    return np.array([labels.index(text) for text in texts], float), labels


def label_of(value: object) -> str:
    """Return a value of a parameter as the label of an axis."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.4g}" if isinstance(value, (int, float)) else short(str(value), NAME_LIMIT)


def label_ticks(axis: Axes, side: str, labels: Sequence[str], offset: float = 0.0) -> None:
    """Label the positions 0, 1, ... of an axis, at most TICK_LIMIT of them. side : "x" or "y" """
    chosen = range(0, len(labels), -(-len(labels) // TICK_LIMIT))
    axis.set(**{f"{side}ticks": [place + offset for place in chosen]})
    axis.set(**{f"{side}ticklabels": [plain(labels[place]) for place in chosen]})


def dress(axis: Axes) -> None:
    """Draw the frame and the ticks of a plot."""
    picture.frame(axis)
    axis.tick_params(colors=INK, labelsize=8.5, length=3)


def mean(values: np.ndarray) -> float:
    """Return the mean of the finite values, NaN without one."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else np.nan

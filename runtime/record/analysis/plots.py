"""Plots of a recording over time: `python -m runtime plot`.

Red lines mark faults, red areas fault codes of devices, blue lines marks, and dashed grey lines limits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.ticker import MaxNLocator

from runtime.host.errors import BadInput
from runtime.record.analysis import picture
from runtime.record.analysis.picture import COLOURS, GREY, INK, broken, drawable, plain, short
from runtime.record.analysis.resample import at_ticks
from runtime.record.storage.grouping import CURVES, PLAIN, by_unit
from runtime.record.storage.messages import split

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from typing import BinaryIO

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from runtime.record.analysis.trial_data import TrialData


PLOT_LIMIT = 100  # plots of a figure
# of texts above the plots: number of levels, and width of a letter as a fraction of the plot
LEVELS, CHARACTER = 3, 0.0085
NAME_LIMIT, STATE_NAME_LIMIT = 44, 14  # characters beside a plot
FULL_SIZE_NAMES = 9  # names beside a plot in full size
CURVE_COLOURS = (*COLOURS, "#333333", "#999933")
FAULT, MARK = "#C1121F", "#0072B2"
ROW, WIDTH = 1.9, 10.0  # inches


def overview(trial: TrialData) -> dict[str, tuple[list[list[str]], str]]:
    """Return {subsystem: (rows, text)}, one figure each: [[path], ...] by unit, and how many signals are drawn.

    Elements of vectors are separate paths.
    """
    name = trial.about["name"]
    signals = [trial.row_of(path) | {"path": path} for path in trial.names]
    figures = {}
    for title, plots in by_unit(name, signals).items():
        own = [path for path in trial.signals if (split(path)[0] or name) == title]
        states = [path for path in own if states_of(trial, path)]
        rows = [
            [element for path in paths if path not in states for element in elements(trial, path)][:CURVES]
            for _, paths in plots
        ]
        rows = [row for row in rows if row] + [[path] for path in states]  # which no limit leaves out
        drawn, known = sum(map(len, rows)), len(own)
        figures[title] = rows, f"{drawn} of {known} signals" if drawn < known else ""
    return figures


def rows_of(trial: TrialData, paths: Iterable[str]) -> list[list[str]]:
    """Return the rows of named paths, in order: a plot for each unit, or several if it would be too full.

    paths : paths of signals, blocks or subsystems

    Raises KeyError or BadInput.
    """
    kinds = {}
    for path in paths:
        for signal in signals_of(trial, path):
            kind = trial.dtype(signal) != "float", trial.unit(signal), states_of(trial, signal)
            kinds.setdefault(kind, {}).update(dict.fromkeys(elements(trial, signal)))
    rows = [list(some)[first : first + CURVES] for some in kinds.values() for first in range(0, len(some), CURVES)]
    if len(rows) > PLOT_LIMIT:
        raise BadInput(f"{sum(map(len, rows))} signals need {len(rows)} plots, more than {PLOT_LIMIT}: select fewer")
    return rows


def rows_over_each_other(trials: Sequence[TrialData], paths: Iterable[str]) -> list[list[str]]:
    """Return the rows of several trials: a plot for each signal, by default of the angle and torque of each actuator.

    paths : paths of signals, blocks or subsystems

    Raises KeyError or BadInput.
    """
    if len(trials) > len(COLOURS):
        raise BadInput(
            f"{len(trials)} recordings: at most {len(COLOURS)} can be distinguished in one picture. Pass fewer"
        )
    first = trials[0]
    paths = list(paths) or [
        f"{path.removesuffix('.torque')}.{port}"
        for path in first.signals
        if path.endswith(".torque") and f"{path.removesuffix('.torque')}.position" in first.signals
        for port in ("position", "torque")
    ]
    if not paths:
        raise BadInput(f"{first.path.name} has no actuator: name the signals to be drawn over each other")
    found = [element for path in paths for element in alone(first, path)]
    if len(found) > PLOT_LIMIT:
        raise BadInput(f"{len(found)} signals need as many plots, more than {PLOT_LIMIT}: select fewer")
    for trial in trials[1:]:
        for path in found:
            trial.find(path)  # raises with a suggestion
            if trial.unit(path) != first.unit(path):
                units = f"{first.unit(path)} in {first.path.name} and {trial.unit(path)} in {trial.path.name}"
                raise BadInput(f"{path} has the unit {units}: they cannot share an axis")
    return [[path] for path in dict.fromkeys(found)]


def signals_of(trial: TrialData, path: str) -> list[str]:
    """Return the signals of a path: one, or all of a block or subsystem. Raises KeyError."""
    within = [name for name in trial.names if path and name.startswith((f"{path}.", f"{path}/"))]
    if not within:
        trial.find(path)  # raises with a suggestion
    return within or [path]


def alone(trial: TrialData, path: str) -> list[str]:
    """Return the scalar paths of a path: the path itself, or all elements of a block or subsystem. Raises KeyError."""
    signals = signals_of(trial, path)
    return signals if signals == [path] else [element for signal in signals for element in elements(trial, signal)]


def over_time(
    trials: Mapping[str, TrialData],
    rows: Sequence[Sequence[str]],
    title: str,
    file: BinaryIO,
    kind: str,
    subsystem: str = "",
) -> None:
    """Plot signals over time, each trial from its own start.

    trials : {label: trial}; of several, each plot has one signal of them all
    rows : [[path], ...], one plot each
    file : open for writing bytes
    kind : "png", "svg" or "pdf"
    subsystem : the one that the title names
    """
    figure, axes = sheet(len(rows), title)
    for trial in trials.values():
        trial.read(path for paths in rows for path in paths)  # in one pass
    for axis, paths in zip(axes, rows):
        curves = [(trial, path) for trial in trials.values() for path in paths]
        names = [path.removeprefix(f"{subsystem}/") for path in paths] if len(trials) == 1 else list(trials)
        for number, (trial, path) in enumerate(curves):
            _curve(axis, trial, path, number)
        trial = curves[0][0]
        _whole(axis, {trial.dtype(path) for path in paths}, states_of(trial, paths[0]))
        limits = {
            tuple(ends)
            for trial, path in curves
            for ends in [trial.about.get("limits", {}).get(path)]
            if ends is not None
        }
        if len(limits) == 1:  # several would need a legend
            for place, end in enumerate(limits.pop()):
                axis.axhline(
                    end,
                    color=GREY,
                    linewidth=0.9,
                    linestyle=(0, (6, 4)),
                    zorder=1,
                    label="limit" if place == 0 else None,
                )
        axis.set_ylabel(_unit_label(trial.unit(paths[0])), color=INK)
        if len(trials) > 1:
            axis.set_title(plain(paths[0]), loc="left", fontsize=9, color=INK, pad=3)
        _dress(axis)
        full = len(names) > FULL_SIZE_NAMES
        legend = axis.legend(
            fontsize=6.5 if full else 7.5,
            labelspacing=0.25 if full else 0.5,
            frameon=False,
            labelcolor=INK,
            loc="center left",
            bbox_to_anchor=(1.0, 0.5),
        )
        # matplotlib omits labels that begin with _
        for text, name in zip(legend.get_texts(), names):
            text.set_text(plain(short(name, NAME_LIMIT)))
        if not any(np.isfinite(drawable(trial[path])).any() for trial, path in curves):
            axis.set_yticks(())
            axis.annotate(
                "no number", (0.5, 0.5), xycoords="axes fraction", ha="center", va="center", color=GREY, fontsize=9
            )
        for trial in trials.values():
            _problems(axis, trial)
    axes[-1].set_xlabel("time [s]", color=INK)
    ran = [trial for trial in trials.values() if len(trial)]
    if ran:
        first = min(trial.time[0] for trial in ran)
        last = max([*(trial.time[-1] for trial in ran), *(time for trial in ran for time, _, _ in moments(trial))])
        if first == last:  # centre a single tick
            first, last = first - 0.5 / ran[0].about["rate"], last + 0.5 / ran[0].about["rate"]
        axes[-1].set_xlim(first, last + 0.005 * (last - first))  # a fault is after the last tick
    name_troubles(axes[0], trials)
    figure.align_ylabels(axes)
    picture.save(figure, file, kind)


def _curve(axis, trial, path, number):
    """Draw a signal of a trial in the colour of a number."""
    values, every = trial[path], trial.every(path)
    ticks = trial.tick if every == 1 else trial.tick[trial.tick % every == 0]
    axis.plot(
        *broken(ticks, trial.time_of(path), drawable(values), every),
        color=CURVE_COLOURS[number % len(CURVE_COLOURS)],
        linewidth=1.2,
        label=str(number),
        drawstyle="steps-post" if values.dtype != float else "default",
        marker="" if len(values) > 1 else "o",
        linestyle="-" if number < len(CURVE_COLOURS) else "--",
    )


def _problems(axis, trial):
    """Draw faults, marks, and fault codes of devices."""
    for time, _, colour in moments(trial):
        axis.axvline(
            time,
            color=colour,
            linewidth=1.3 if colour == FAULT else 0.9,
            linestyle="-" if colour == FAULT else ":",
            zorder=5,
        )
    for _, first, last in _faulty(trial):
        axis.axvspan(trial.time[first], trial.time[last], color=FAULT, alpha=0.12, linewidth=0)


def _faulty(trial):
    """Return [(path, first row, last row)] of the intervals in which a device reports a fault code."""
    paths = [path for path in trial.names if split(path)[2] == "fault" and trial.find(path)[1] == ()]
    trial.read(paths)  # in one pass
    return [(path, *ends) for path in paths for ends in spells(at_ticks(trial, path) != 0)]


def _codes(trial):
    """Return [(s, text, colour)] of the fault codes, at the start of each."""
    return [
        (trial.time[first], f"{path}: {at_ticks(trial, path)[first]:g}", FAULT) for path, first, _ in _faulty(trial)
    ]


def name_troubles(axis: Axes, trials: Mapping[str, TrialData]) -> None:
    """Write labels above the first plot, on several levels to avoid overlaps.

    Faults come first; marks are labelled while there is space.

    trials : {label: trial}; the label is written if there are several
    """
    first, last = axis.get_xlim()
    taken = [[] for _ in range(LEVELS)]
    start = 13.0 if len(trials) > 1 else 3.0  # points, above the name of the signal
    troubles = [
        (time, f"{label}: {text}" if len(trials) > 1 else text, colour)
        for label, trial in trials.items()
        for time, text, colour in [*moments(trial), *_codes(trial)]
    ]
    for time, text, colour in sorted(troubles, key=lambda moment: (moment[2] != FAULT, moment[0])):
        place, width = (time - first) / (last - first), len(text) * CHARACTER
        late = place > 0.5
        ends = (place - width, place) if late else (place, place + width)
        level = next(
            (
                level
                for level, others in enumerate(taken)
                if all(ends[1] <= other[0] or other[1] <= ends[0] for other in others)
            ),
            None,
        )
        if level is None:
            continue
        taken[level].append(ends)
        axis.annotate(
            plain(text),
            (time, 1.0),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            fontsize=7.5,
            color=colour,
            xytext=(-3 if late else 3, start + 9.5 * level),
            ha="right" if late else "left",
            va="bottom",
        )


def moments(trial: TrialData) -> list[tuple[float, str, str]]:
    """Return [(s, text, colour)] of the labels: faults, marks and cautions."""
    rate, labels = trial.about["rate"], []
    for event in trial.events:
        kind, tick = event.get("event"), max(0, event.get("tick") or 0)
        if kind == "fault" or kind == "end" and event.get("status") != "ok":
            culprit = f" at {event['culprit']}" if event.get("culprit") else ""
            labels.append((tick / rate, f"fault: {event['status']}{culprit}", FAULT))
        elif kind == "mark":
            labels.append((tick / rate, f"mark {event['number']}", MARK))
    return labels


def spells(truths: np.ndarray) -> list[tuple[int, int]]:
    """Return [(first, last)] of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], truths, [False])).astype(np.int8)))
    return [(first, last - 1) for first, last in zip(edges[::2], edges[1::2])]


def elements(trial: TrialData, path: str) -> list[str]:
    """Return the paths of a signal's elements, [path] for a scalar."""
    if path in trial.signals:
        return [path]
    names = list(trial.signals)
    return [names[place] for place in trial.find(path)[0]]


def states_of(trial: TrialData, path: str) -> tuple[str, ...]:
    """Return the names of the values 0, 1, ... of a signal, () if it has none."""
    return tuple(trial.about.get("states", {}).get(path, ()))


def _whole(axis, dtypes, states):
    """Set the ticks of an axis of integers, bools or states."""
    if states:
        axis.set_yticks(range(len(states)), [plain(short(name, STATE_NAME_LIMIT)) for name in states])
        axis.set_ylim(-0.3, len(states) - 0.7)
    elif dtypes == {"bool"}:
        axis.set_yticks((0, 1), ("false", "true"))
        axis.set_ylim(-0.1, 1.1)
    elif dtypes and "float" not in dtypes:
        axis.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))


def _unit_label(unit):
    """Return the unit in brackets for an axis; '' without a unit."""
    return "" if unit in PLAIN else f"[{unit}]"


def sheet(rows: int, title: str) -> tuple[Figure, np.ndarray]:
    """Return a figure with a title, and its axes one below the other."""
    figure = picture.figure(WIDTH, 0.9 + ROW * rows, dpi=130)
    figure.suptitle(plain(title), fontsize=12, fontweight="bold", color=INK)
    return figure, figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]


def _dress(axis):
    """Draw the frame and the ticks of a plot."""
    picture.frame(axis)
    axis.tick_params(colors=INK, labelsize=8.5, length=3)

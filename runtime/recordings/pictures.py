"""`python -m runtime plot`: signals of a recording over time, or over the gait cycle, as a picture.

Faults stand as red lines over all plots, and red where a device reports a fault code; marks are blue, limits grey and dashed.
"""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from runtime.errors import BadInput
from runtime.recorder import picture
from runtime.recorder.picture import FAINT, GREY, INK
from runtime.recordings.grouping import CURVES, PLAIN, by_unit
from runtime.recordings.messages import split
from runtime.recordings.strides import bounds, over

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#333333", "#999933")      # (Okabe and Ito 2008)
FAULT, MARK = "#C1121F", "#0072B2"
ROW, WIDTH = 1.9, 10.0          # inches
JOINT = ("position", "velocity", "torque")


def overview(trial):
    """{subsystem: [[path], ...]}: a picture each, a plot a unit."""
    signals = [trial.row_of(name) | {"path": name} for name in trial.names]
    return {title: [paths for _, paths in plots] for title, plots in by_unit(trial.about["name"], signals).items()}


def rows_of(trial, paths):
    """[[path], ...]: signals that a person has named, a plot a unit, in their order. KeyError"""
    units = {}
    for path in paths:
        units.setdefault(trial.unit(path), []).append(path)
    return list(units.values())


def over_time(trial, rows, title, file, kind, told=""):
    """rows : [[path], ...], a plot each; file : open for writing bytes; kind : "png" or "svg"; told : the subsystem that the title has named already"""
    figure, axes = sheet(len(rows), title)
    for axis, paths in zip(axes, rows):
        curves = [(label, values) for path in paths for label, values in elements(trial, path)][:CURVES]
        for number, (label, values) in enumerate(curves):
            steps = values.dtype != float
            axis.plot(trial.time, values, color=COLOURS[number % len(COLOURS)], linewidth=1.2, drawstyle="steps-post" if steps else "default",
                      linestyle="-" if number < len(COLOURS) else "--", label=label.removeprefix(f"{told}/"))
        limits = {tuple(ends) for path, ends in trial.about.get("limits", {}).items() if path in paths}
        if len(limits) == 1:                    # several would need a legend of their own
            for place, end in enumerate(*limits):
                axis.axhline(end, color=GREY, linewidth=0.9, linestyle=(0, (6, 4)), zorder=1, label="limit" if place == 0 else None)
        axis.set_ylabel(unit_label(trial.unit(paths[0])), color=INK)
        dress(axis)
        axis.legend(fontsize=7.5, frameon=False, labelcolor=INK, loc="center left", bbox_to_anchor=(1.0, 0.5))
        troubles(axis, trial)
    axes[-1].set_xlabel("time [s]", color=INK)
    if len(trial):
        first, last = trial.time[0], max(trial.time[-1], trial.time[0] + 1e-3, *(time for time, _, _ in moments(trial)))
        axes[-1].set_xlim(first, last + 0.005 * (last - first))         # a fault stands behind the last tick
    name_troubles(axes[0], trial)
    figure.align_ylabels(axes)
    save(figure, file, kind)


def troubles(axis, trial):
    """Faults, marks, and fault codes of devices."""
    for time, _, colour in moments(trial):
        axis.axvline(time, color=colour, linewidth=1.3 if colour == FAULT else 0.9, linestyle="-" if colour == FAULT else ":", zorder=5)
    for path in trial.names:
        if split(path)[2] == "fault" and trial.find(path)[1] == ():
            for first, last in spells(trial[path] != 0):
                axis.axvspan(trial.time[first], trial.time[last], color=FAULT, alpha=0.12, linewidth=0)


def name_troubles(axis, trial):
    for time, text, colour in moments(trial):
        late = len(trial) and time > 0.5 * (trial.time[0] + trial.time[-1])
        axis.annotate(text, (time, 1.0), xycoords=("data", "axes fraction"), xytext=(-3 if late else 3, 3), textcoords="offset points", fontsize=7.5,
                      color=colour, ha="right" if late else "left", va="bottom")


def moments(trial):
    """[(s, words, colour)] of what stands in the picture: faults, marks, what a person should have read."""
    rate, found = trial.about["rate"], []
    for event in trial.events:
        kind, tick = event.get("event"), max(0, event.get("tick") or 0)
        if kind == "fault" or kind == "end" and event.get("status") != "ok":
            culprit = f" at {event['culprit']}" if event.get("culprit") else ""
            found.append((tick / rate, f"fault: {event['status']}{culprit}", FAULT))
        elif kind == "mark":
            found.append((tick / rate, f"mark {event['number']}", MARK))
    return found


def spells(truths):
    """[(first, last)] of each run of truths."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], truths, [False])).astype(np.int8)))
    return [(first, last - 1) for first, last in zip(edges[::2], edges[1::2])]


def legs(trial, events=None):
    """What runtime.recorder.picture draws of each joint that walks: its mean stride, from the recorded rows. BadInput where none does."""
    found = []
    for path in trial.names:
        folder, block, port = split(path)
        stem = f"{folder}/{block}".lstrip("/")
        if port != "position" or not all(f"{stem}.{other}" in trial.signals for other in JOINT):
            continue
        spans = bounds(trial, path, events)
        if len(spans):
            found.append(leg(trial, folder, stem, spans))
    if not found:
        raise BadInput(f"{trial.path} holds no whole stride of a joint with position, velocity and torque")
    several = len({one["title"] for one in found}) < len(found)
    return [{**one, "title": one["path"] if several else one["title"]} for one in found]


def leg(trial, folder, stem, spans):
    angle, velocity, torque = (over(trial, f"{stem}.{port}", spans)[:, :, 0] for port in JOINT)
    power = velocity * torque
    lasting = spans[:, 1] - spans[:, 0]
    steps = lasting / (power.shape[1] - 1)
    work = [np.mean(np.sum(0.5 * (part[:, 1:] + part[:, :-1]), axis=1) * steps) for part in (np.maximum(power, 0.0), np.minimum(power, 0.0))]
    curves = {name: statistics(values) for name, values in (("angle", angle), ("torque", torque), ("power", power))}
    return {
        "title": folder or stem, "path": stem, "strides": len(spans), "stride_time": float(np.mean(lasting)),
        "peak_torque": float(np.max(np.abs(torque))), "positive_work": float(work[0]), "negative_work": float(work[1]), "curves": curves}


def statistics(values):
    sd = values.std(axis=0, ddof=1) if len(values) > 1 else np.zeros(values.shape[1])
    return {"mean": values.mean(axis=0).tolist(), "sd": sd.tolist()}


def average_stride(trial, events, file, kind):
    """Angle, assistance and power of every joint that walks."""
    picture.draw(trial.about["name"], legs(trial, events), file, kind)


def over_the_stride(trial, paths, events, file, kind):
    """Mean and standard deviation of signals that a person has named, a plot each."""
    figure, axes = sheet(len(paths), f"{trial.about['name']}: the average stride")
    for number, (axis, path) in enumerate(zip(axes, paths)):
        spans = bounds(trial, path, events)
        if not len(spans):
            raise BadInput(f"{trial.path} holds no whole stride for {path}")
        values = over(trial, path, spans)
        if values.shape[2] != 1:
            raise BadInput(f"{path} has {values.shape[2]} elements: name one, as in {path}[0]")
        mean, sd = (np.array(part) for part in statistics(values[:, :, 0]).values())
        cycle, colour = np.linspace(0.0, 100.0, len(mean)), COLOURS[number % len(COLOURS)]
        axis.fill_between(cycle, mean - sd, mean + sd, color=colour, alpha=0.25, linewidth=0)
        axis.plot(cycle, mean, color=colour, linewidth=2.0, label=f"{path}, {len(spans)} strides")
        axis.set_ylabel(unit_label(trial.unit(path)), color=INK)
        axis.set_xlim(0, 100)
        dress(axis)
        axis.legend(fontsize=8, frameon=False, labelcolor=INK, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
    axes[-1].set_xlabel("gait cycle [%]", color=INK)
    save(figure, file, kind)


def elements(trial, path):
    """[(label, values)] of a signal: one for each of its elements."""
    values = trial[path]
    if values.ndim == 1:
        return [(path, values)]
    places, _ = trial.find(path)
    names = list(trial.signals)
    return [(names[place], trial[names[place]]) for place in places]


def unit_label(unit):
    return "" if unit in PLAIN else f"[{unit}]"


def sheet(rows, title):
    figure = Figure(figsize=(WIDTH, 0.9 + ROW * rows), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=12, fontweight="bold", color=INK)
    return figure, figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]


def dress(axis):
    axis.grid(color=FAINT, linewidth=0.7)
    axis.set_axisbelow(True)
    axis.tick_params(colors=INK, labelsize=8.5, length=3)
    for side, spine in axis.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color("#888888")


def save(figure, file, kind):
    figure.savefig(file, format=kind, metadata={"Software": "Tickwork"} if kind == "png" else {"Creator": "Tickwork", "Date": None})

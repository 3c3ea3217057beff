"""Pictures of the gait cycle for a paper: angle, torque and power of each joint, or named signals.

A picture is a grid of panels. Recordings of one condition have a column per joint with both legs in each panel; several
conditions have a column per leg.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from runtime.host.errors import BadInput
from runtime.record.analysis import picture
from runtime.record.analysis.average_stride import left_out_text, signals_texts
from runtime.record.analysis.condition_table import MINUS, deviation
from runtime.record.analysis.names import SIDES, block_name, port_name, shown_unit, words_of
from runtime.record.analysis.picture import COLOURS, GREY, INK, plain, short
from runtime.record.storage.messages import split

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from typing import BinaryIO

    from runtime.record.analysis.conditions import Condition


UNITS = {"angle": "rad", "torque": "N·m", "power": "W"}
COLUMN, PAGE = 85.0, 180.0  # mm: widths of one and of two columns of a journal
SMALL, NORMAL = 7.0, 8.0  # points
LINE = 1.2  # points
CHARACTER = 1.45  # mm, about the mean width of a small one
HANDLE = 9.0  # mm before a name in the legend


@dataclass
class Curve:
    """Mean over strides in a panel.

    name : in the legend: a leg or a condition
    colour, dash : of the line
    count : number of strides
    mean, sd : arrays at 0, 1, ... 100 % of the stride
    toe_off : fraction of the stride, or None
    """

    name: str
    colour: str
    dash: Any
    count: int
    mean: np.ndarray
    sd: np.ndarray
    toe_off: float | None = None


@dataclass
class Panel:
    """Plot over the gait cycle.

    label : of its axis, with the unit
    curves : [Curve]
    """

    label: str
    curves: list[Curve]


def draw(
    columns: dict[str, list[Panel]], about: str, file: BinaryIO, kind: str = "png", width: float | None = None
) -> None:
    """Write a picture.

    columns : {title: [Panel of each row]}
    about : description, which the file contains and the picture does not show
    file : open for writing bytes
    kind : "png", "svg" or "pdf"
    width : mm; by default a column of a journal, or two for more than two columns of panels
    """
    width = width or (COLUMN if len(columns) <= 2 else PAGE)
    rows = max(map(len, columns.values()))
    entries = legend(columns, int((width - HANDLE) / CHARACTER))
    row = float(np.clip(0.42 * width / len(columns), 24.0, 45.0))  # mm
    across = min(len(entries) + 2, max(1, int(width / (HANDLE + CHARACTER * max(map(len, entries))))))
    below = 10.0 + 3.6 * -(-(len(entries) + 2) // across)
    titled = len(columns) > 1 or next(iter(columns)) in SIDES
    made = picture.figure(width / 25.4, (rows * row + below + 5.0 * titled) / 25.4, dpi=300)
    axes = made.subplots(rows, len(columns), sharex=True, sharey="row", squeeze=False)
    marks: list[Any] = [
        Line2D([], [], color=curve.colour, linestyle=curve.dash, linewidth=LINE) for curve in entries.values()
    ]
    bands, lifts = [], []
    for place, (title, panels) in enumerate(columns.items()):
        for axis, panel in zip(axes[:, place], panels):
            picture.gait_cycle(axis, SMALL, step=25 if len(columns) > 1 else 20)
            bands += [(axis, *plot(axis, curve)) for curve in panel.curves]
            lifts += toe_offs(axis, panel.curves)
            if place == 0:
                axis.set_ylabel(plain(panel.label), color=INK, fontsize=SMALL if len(panel.label) > 22 else NORMAL)
        if titled:
            axes[0][place].set_title(plain(title), fontsize=NORMAL, fontweight="bold", color=INK, pad=4)
        axes[-1][place].set_xlabel("gait cycle (%)", color=INK, fontsize=NORMAL)
    made.align_ylabels(axes[:, 0])
    labels = list(entries)
    height = 0.7 * row * 72 / 25.4  # points of a panel, about
    if any(sd.max() * height / np.ptp(axis.get_ylim()) > 1.5 * LINE for axis, _, sd in bands):
        marks.append(Patch(color=GREY, alpha=0.3, linewidth=0))
        labels.append("± 1 SD")
    else:  # the line would hide them
        for _, band, _ in bands:
            band.remove()
    if lifts:
        marks.append(lifts[0])
        labels.append("toe-off")
    options: dict[str, Any] = {"frameon": False, "labelcolor": INK, "handlelength": 2.2, "columnspacing": 1.2}
    made.legend(marks, labels, loc="outside lower center", ncols=across, fontsize=SMALL, borderpad=0.1, **options)
    picture.save(made, file, kind, about)


def plot(axis: Any, curve: Curve) -> tuple[Any, np.ndarray]:
    """Plot a mean and its band of one standard deviation. Returns the band and its half width."""
    cycle = range(len(curve.mean))
    ends = (curve.mean - curve.sd, curve.mean + curve.sd)
    band = axis.fill_between(cycle, *ends, color=curve.colour, alpha=0.25, linewidth=0, zorder=2)
    axis.plot(cycle, curve.mean, color=curve.colour, linestyle=curve.dash, linewidth=LINE, zorder=3)
    return band, curve.sd


def toe_offs(axis: Any, curves: Sequence[Curve]) -> list[Line2D]:
    """Draw a line at each toe-off, in grey if all are within 1 %. Returns [line for the legend], [] without one."""
    known = [(100.0 * curve.toe_off, curve.colour) for curve in curves if curve.toe_off is not None]
    places = [place for place, _ in known]
    if known and max(places) - min(places) < 1.0:
        known = [(sum(places) / len(places), GREY)]
    for place, colour in known:
        axis.axvline(place, color=colour, linewidth=0.8, linestyle=":", zorder=2)
    return [Line2D([], [], color=GREY, linewidth=0.8, linestyle=":")] if known else []


def legend(columns: dict[str, list[Panel]], limit: int) -> dict[str, Curve]:
    """Return {label: Curve}: each name with its number of strides, of each column if they differ.

    limit : characters of a label
    """
    counts: dict[str, dict[str, set[int]]] = {}
    curves: dict[str, Curve] = {}
    for title, panels in columns.items():
        for panel in panels:
            for curve in panel.curves:
                counts.setdefault(curve.name, {}).setdefault(title, set()).add(curve.count)
                curves.setdefault(curve.name, curve)
    labels = {}
    for name, by_title in counts.items():
        texts = {title: " to ".join(map(str, sorted({min(of), max(of)}))) for title, of in by_title.items()}
        if len(set(texts.values())) == 1:
            count = next(iter(texts.values()))
        else:
            count = ", ".join(f"{number} ({title})" for title, number in texts.items())
        text = f"N = {count} stride{'s' * (count != '1')}"
        labels[plain(f"{short(name, max(12, limit - len(text) - 2))}, {text}" if name else text)] = curves[name]
    return labels


def side_of(path: str) -> str:
    """Return "left" or "right" for a signal of one leg, "" for another."""
    return next((side for side in SIDES if side in path.split("/")[:-1]), "")


def style(side: str) -> tuple[str, Any]:
    """Return (colour, dash) of a leg. side : "left", "right" or "" """
    return (COLOURS[1], (0, (3.5, 1.2))) if side == "right" else (COLOURS[0], "-")  # distinct without colours, too


def joint_name(joint: str, positive: str) -> str:
    """Return the name of an angle for people, such as "knee flexion"."""
    return positive if joint in positive else words_of(f"{joint} {positive}".strip())


def labels(joint: str, positive: str, per_kg: bool = False) -> dict[str, str]:
    """Return {curve: label of its axis}. joint : "" for panels of several joints"""
    angle = joint_name(joint, positive) if joint and positive else f"{words_of(joint)} angle"
    names = {"angle": angle, "torque": f"{words_of(joint)} torque", "power": f"{words_of(joint)} power"}
    units = {name: shown_unit(unit)[0] + "/kg" * (per_kg and name != "angle") for name, unit in UNITS.items()}
    return {name: f"{text.strip()} ({units[name]})" for name, text in names.items()}


def by_joint(legs: Iterable[dict[str, Any]]) -> dict[str, list[Panel]]:
    """Return a column for each joint with a curve for each leg.

    legs : results of AverageStride with `title`, `positive` and `signals`, with at least one stride
    """
    groups: dict[str, list[dict[str, Any]]] = {}
    for leg in legs:
        joint = split(leg["signals"]["angle"])[1]
        name = joint_name(joint, leg["positive"])
        side = side_of(leg["signals"]["angle"])
        if not side or any(side_of(other["signals"]["angle"]) == side for other in groups.get(name, [])):
            name = leg["title"]  # another joint of this name
        groups.setdefault(name, []).append(leg)
    columns = {}
    for name, group in groups.items():
        joint = split(group[0]["signals"]["angle"])[1] if len(groups) == 1 else ""
        columns[name] = [
            Panel(label, [curve_of(leg, curve) for leg in group])
            for curve, label in labels(joint, group[0]["positive"]).items()
        ]
    return columns


def curve_of(leg: dict[str, Any], curve: str) -> Curve:
    """Return the Curve of a leg. leg : as for `by_joint`; curve : "angle", "torque" or "power" """
    side, (_, factor) = side_of(leg["signals"]["angle"]), shown_unit(UNITS[curve])
    mean, sd = (factor * np.array(leg["curves"][curve][part]) for part in ("mean", "sd"))
    return Curve(side, *style(side), leg["strides"], mean, sd, leg["toe_off"])


def by_leg(conditions: Sequence[Condition]) -> dict[str, list[Panel]]:
    """Return a column for each leg with a curve for each condition. Raises BadInput."""
    check(conditions)
    columns: dict[str, list[Panel]] = {}
    for condition, colour in zip(conditions, COLOURS):
        legs = condition.legs()
        for title, leg in legs.items():
            joints = {(each.joint, each.positive) for each in legs.values()}
            texts = labels(*(next(iter(joints)) if len(joints) == 1 else ("", "")), condition.mass is not None)
            panels = columns.setdefault(title, [Panel(text, []) for text in texts.values()])
            for panel, curve in zip(panels, UNITS):
                values = shown_unit(UNITS[curve])[1] * leg.curves(curve)
                panel.curves.append(averaged(condition.label, colour, "-", values, leg.toe_off))
    return columns


def of_signals(conditions: Sequence[Condition], paths: Sequence[str]) -> dict[str, list[Panel]]:
    """Return a column with a panel for each signal, of both legs if there is one condition. paths : of scalars

    Raises BadInput, or KeyError for an unknown signal.
    """
    check(conditions)
    panels: dict[str, Panel] = {}
    for path in paths:
        unit, factor = shown_unit(conditions[0].trial.unit(path))
        block, port = path.rpartition(".")[::2]
        side, several = side_of(path), len(conditions) > 1
        words = [block_name("/".join(part for part in block.split("/") if part not in SIDES)), port_name(port)]
        label = (
            " ".join(word for word in words if word not in ("", "y"))
            + f", {side}" * bool(side and several)
            + f" ({unit})" * bool(unit)
        )
        panel = panels.setdefault(label, Panel(label, []))
        for condition, colour in zip(conditions, COLOURS):
            values = factor * condition.curves(path)
            if several:
                panel.curves.append(averaged(condition.label, colour, "-", values))
            else:
                panel.curves.append(averaged(side, *style(side), values))
    return {"": list(panels.values())}


def averaged(name: str, colour: str, dash: Any, values: np.ndarray, toe_off: float | None = None) -> Curve:
    """Return the Curve of strides. values : (strides, 101)"""
    return Curve(name, colour, dash, len(values), values.mean(axis=0), deviation(values), toe_off)


def check(conditions: Sequence[Condition]) -> None:
    """Raise BadInput for more conditions than COLOURS."""
    if len(conditions) > len(COLOURS):
        raise BadInput(
            f"{len(conditions)} conditions: at most {len(COLOURS)} can be distinguished in one picture. Pass fewer"
        )


def about_legs(name: str, legs: Iterable[dict[str, Any]]) -> str:
    """Return the description of a run: figures and signals of each leg. legs : as for `by_joint`"""
    lines = [f"{name}: mean and standard deviation over the gait cycle"]
    for leg in legs:
        left_out = [f"excluded: {left_out_text(leg)}"] if leg["left_out"] else []
        figures = (leg["strides"], leg["stride_time"], leg["positive_work"], leg["negative_work"])
        peak = f"peak torque {leg['peak_torque']:.1f} N·m"
        lines.append("; ".join([f"{leg['title']}: {figures_text(*figures)}", peak, *signals_texts(leg), *left_out]))
    return "\n".join(lines)


def about_conditions(conditions: Sequence[Condition]) -> str:
    """Return the description of conditions: figures of each leg."""
    lines = ["mean and standard deviation over the gait cycle"]
    for condition in conditions:
        for title, leg in condition.legs().items():
            time, gain, loss = (
                float(np.mean([getattr(stride, name) for stride in leg.strides]))
                for name in ("time", "positive_work", "negative_work")
            )
            unit = "J" if condition.mass is None else "J/kg"
            lines.append(f"{condition.label}, {title}: {figures_text(len(leg.strides), time, gain, loss, unit)}")
    return "\n".join(lines)


def figures_text(count: int, time: float, gain: float, loss: float, unit: str = "J") -> str:
    """Return number, duration (s) and work (J) of strides as text."""
    work = f"work per stride {gain:+.2f} {unit} and {loss:+.2f} {unit}"
    return f"{count} stride{'s' * (count > 1)} of {time:.2f} s, {work}".translate(MINUS)

"""Plots before and after calibration: rates and gravity at rest, and the magnetic field along the three axes."""

from __future__ import annotations

from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from matplotlib.patches import Circle

from runtime.record.analysis import picture
from runtime.record.analysis.picture import BLUE, GREY, INK, ORANGE

if TYPE_CHECKING:
    from matplotlib.axes._axes import Axes

    from runtime.setup.commissioning.calibration.result import Result

BEFORE, AFTER = ORANGE, BLUE
PLANES = ((0, 1), (0, 2), (1, 2))
PLANE_POINTS_LIMIT = 4000


def draw(name: str, result: Result, file: BinaryIO) -> None:
    """Draw a calibration as a PNG.

    name : path of the sensor block
    result : runtime.setup.commissioning.calibration.result.Result
    file : binary file, open for writing
    """
    figure = picture.figure(11.0, 7.4)
    (top,), (bottom,) = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.0, 1.15))
    rest, gravity = top.subplots(1, 2)
    _gyroscope(rest, result)
    _accelerometer(gravity, result)
    for axis, plane in zip(bottom.subplots(1, 3), PLANES):
        _magnetometer(axis, result, plane)
    figure.suptitle(f"{name}: before and after calibration", fontsize=13, fontweight="bold", color=INK)
    marks = [
        rest.scatter([], [], color=BEFORE, label="before", s=24),
        rest.scatter([], [], color=AFTER, label="after", s=24),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=2, fontsize=9, frameon=False, labelcolor=INK)
    picture.save(figure, file)


def _set_titles(axis: Axes, title: str, x: str, y: str) -> None:
    axis.set_title(title, fontsize=10, color=INK)
    axis.set_xlabel(x, color=INK, fontsize=9)
    axis.set_ylabel(y, color=INK, fontsize=9)
    picture.frame(axis)
    axis.tick_params(colors=INK, labelsize=8, length=3)


def _note_missing(axis: Axes, why: str) -> None:
    axis.annotate(
        why, xy=(0.5, 0.5), xycoords="axes fraction", ha="center", va="center", color=GREY, fontsize=9, wrap=True
    )


def _gyroscope(axis: Axes, result: Result) -> None:
    _set_titles(axis, "gyroscope: rate at rest", "axis", "deg/s")
    axis.set_xticks(range(3), "xyz")
    axis.set_xlim(-0.6, 2.6)
    axis.axhline(0.0, color="#AAAAAA", linewidth=0.8, zorder=1)
    for rates, colour, shift in ((result.rates, BEFORE, -0.12), (result.rates_after, AFTER, 0.12)):
        if rates is None or not len(rates):
            continue
        for number in range(3):
            axis.scatter(
                np.full(len(rates), number + shift), np.degrees(rates[:, number]), color=colour, s=18, zorder=3
            )
    if result.rates_after is None:
        _note_missing(axis, "not calibrated")


def _accelerometer(axis: Axes, result: Result) -> None:
    _set_titles(axis, "accelerometer: gravity in each position", "position", "m/s²")
    for gravity, colour in ((result.gravity, BEFORE), (result.gravity_after, AFTER)):
        if gravity is not None:
            axis.scatter(range(1, len(gravity) + 1), gravity, color=colour, s=18, zorder=3)
    axis.axhline(result.standard_gravity, color="#AAAAAA", linewidth=0.8, zorder=1)
    if result.gravity_after is None:
        _note_missing(axis, "not calibrated")


def _magnetometer(axis: Axes, result: Result, plane: tuple[int, int]) -> None:
    names = ["xyz"[number] for number in plane]
    _set_titles(axis, f"magnetometer, {names[0]} and {names[1]}", f"{names[0]} [µT]", f"{names[1]} [µT]")
    axis.set_aspect("equal", adjustable="datalim")
    for field, colour in ((result.field, BEFORE), (result.field_after, AFTER)):
        if field is not None and len(field):
            step = max(1, len(field) // PLANE_POINTS_LIMIT)
            axis.scatter(
                field[::step, plane[0]], field[::step, plane[1]], color=colour, s=2, alpha=0.5, linewidths=0, zorder=3
            )
    if result.field_after is None:
        _note_missing(axis, "not calibrated")
    else:
        axis.add_patch(Circle((0.0, 0.0), result.strength, fill=False, color=GREY, linewidth=0.8, zorder=2))

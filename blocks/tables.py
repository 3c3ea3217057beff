"""Interpolation tables: a curve or a surface through given points, linear between them.

Outside the table the output is the value at the end (clamp), continues along the last line (extrapolate), or ends the
run as a fault (error). All blocks are element-wise, with direct feedthrough and without state; NaN passes, and infinity
becomes NaN.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from blocks._plumbing.ports import UnitOfOutput, finite_numbers
from cext.kernels import tables as kernels
from graph import Block, Input, Interval, Memory, Output, Param, units
from graph.interval import EVERYTHING

ROUNDING = 16 * 2.0**-52  # relative; exceeds the rounding error of one interpolation
BEYOND_CHOICES = ("clamp", "extrapolate", "error")


class LookupTable1D(UnitOfOutput, Block):
    """Curve through points: y = v(u), v linear between the breakpoints (numpy.interp, with `beyond="clamp"`)."""

    breakpoints = Param((0.0, 1.0), "any", "breakpoints of the input: at least two, strictly increasing")
    values = Param((0.0, 1.0), "any", "values of the output, one per breakpoint")
    beyond = Param("clamp", "1", "output outside the table", choices=BEYOND_CHOICES)
    unit = Param(units.ANY, "1", "unit of the output")

    u = Input("any", "position on the curve", shape=...)
    y = Output("any", "value of the curve", shape=...)
    knots = Memory(0.0, "breakpoints")
    heights = Memory(0.0, "values")

    kernel = kernels.curves["clamp"]

    def configure(self) -> None:
        super().configure()
        self.knots = rising_numbers("breakpoints", self.breakpoints)
        self.heights = np.array(finite_numbers("values", self.values))
        if len(self.knots) != len(self.heights):
            raise ValueError(
                f"expected one value per breakpoint, got {len(self.knots)} breakpoints and {len(self.heights)} values"
            )
        self.kernel = kernels.curves[self.beyond]

    def fault_text(self, status: int) -> str:
        """Return the text of the fault of an input outside the table."""
        return f"u is outside the table, {self.knots[0]:g} to {self.knots[-1]:g}"

    def output_range(self, u: Interval) -> Interval:
        low, high = np.clip((u.low, u.high), self.knots[0], self.knots[-1])
        inside = self.heights[(low <= self.knots) & (self.knots <= high)]
        parts = [Interval.point(height) for height in inside] + [self.near(low), self.near(high)]
        if self.beyond == "extrapolate":
            parts += [self.end(x) for x in (u.low, u.high)]
        return Interval(min(part.low for part in parts), max(part.high for part in parts))

    def near(self, x: float) -> Interval:
        """Return the interval of the curve at x inside the table, including rounding, within its segment."""
        i = int(np.clip(np.searchsorted(self.knots, x, side="right") - 1, 0, len(self.knots) - 2))
        (x0, x1), (a, b) = self.piece(i)
        share = (float(x) - x0) / (x1 - x0)
        y, slack = (1.0 - share) * a + share * b, ROUNDING * max(abs(a), abs(b))
        return Interval(max(y - slack, min(a, b)), min(y + slack, max(a, b)))

    def end(self, x: Any) -> Any:
        """Return the interval of the curve from an end of the table to x.

        The last line is rounded like the kernel, which is monotonic.
        """
        (x0, x1), (a, b) = self.piece(0 if x < self.knots[0] else len(self.knots) - 2)
        share = (x - x0) / (x1 - x0)
        if a == b or 0.0 <= share <= 1.0:
            return self.near(np.clip(x, x0, x1))
        return Interval.point(a + share * (b - a) if share < 0.0 else b + (share - 1.0) * (b - a))

    def piece(self, i: int) -> tuple[list[float], list[float]]:
        """Return the ends of segment i and the values there."""
        return self.knots[i : i + 2].tolist(), self.heights[i : i + 2].tolist()


class LookupTable2D(UnitOfOutput, Block):
    """Surface over a grid: y = v(row, column), bilinear between the grid points."""

    rows = Param((0.0, 1.0), "any", "breakpoints of `row`: at least two, strictly increasing")
    columns = Param((0.0, 1.0), "any", "breakpoints of `column`: at least two, strictly increasing")
    values = Param(
        ((0.0, 0.0), (0.0, 1.0)), "any", "values of the output: one tuple per row, with one value per column"
    )
    beyond = Param("clamp", "1", "output outside the table", choices=BEYOND_CHOICES)
    unit = Param(units.ANY, "1", "unit of the output")

    row = Input("any", "position along the rows", shape=...)
    column = Input("any", "position along the columns", shape=...)
    y = Output("any", "value of the surface", shape=...)
    row_knots = Memory(0.0, "breakpoints of the rows")
    column_knots = Memory(0.0, "breakpoints of the columns")
    heights = Memory(0.0, "values, row by row")

    kernel = kernels.surfaces["clamp"]
    free_units = ("row", "column")

    def configure(self) -> None:
        super().configure()
        self.row_knots = rising_numbers("rows", self.rows)
        self.column_knots = rising_numbers("columns", self.columns)
        grid = [finite_numbers("values", row) for row in self.values]
        shape = len(self.row_knots), len(self.column_knots)
        if len(grid) != shape[0] or any(len(row) != shape[1] for row in grid):
            raise ValueError(f"values must be {shape[0]} rows of {shape[1]} numbers, one per column")
        self.heights = np.array(grid).ravel()
        self.kernel = kernels.surfaces[self.beyond]

    def fault_text(self, status: int) -> str:
        """Return the text of the fault of an input outside the table."""
        (top, *_, bottom), (left, *_, right) = self.row_knots, self.column_knots
        return f"row or column is outside the table: rows {top:g} to {bottom:g}, columns {left:g} to {right:g}"

    def output_range(self, row: Interval, column: Interval) -> Interval:
        extends = self.beyond == "extrapolate"
        r, c = (corners(u, knots, extends) for u, knots in ((row, self.row_knots), (column, self.column_knots)))
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(c))):
            return EVERYTHING
        # Between grid lines the surface is bilinear, so its extremes are at the corners of the reachable part of each
        # cell.
        grid = self.heights.reshape(len(self.row_knots), -1)
        (i, s), (j, t) = place(self.row_knots, r), place(self.column_knots, c)
        s, t = s[:, None], t[None, :]
        cells = [grid[np.ix_(i + a, j + b)] for a in (0, 1) for b in (0, 1)]
        with np.errstate(over="ignore", invalid="ignore"):
            farthest = np.max(np.abs(cells)) * np.max(np.abs(s) + np.abs(1.0 - s)) * np.max(np.abs(t) + np.abs(1.0 - t))
            if extends and not farthest < 1e307:
                return EVERYTHING  # an intermediate result of the kernel may overflow
            parts = [
                weight * cell
                for weight, cell in zip(((1.0 - s) * (1.0 - t), (1.0 - s) * t, s * (1.0 - t), s * t), cells)
            ]
            y, slack = sum(parts), ROUNDING * sum(map(np.abs, parts))
            low, high = float(np.min(y - slack)), float(np.max(y + slack))
        return (
            Interval(low, high)
            if extends
            else Interval(max(low, float(np.min(cells))), min(high, float(np.max(cells))))
        )


def rising_numbers(name: str, values: tuple[float, ...]) -> np.ndarray:
    """Return an array of at least two finite, strictly increasing numbers. ValueError for other values."""
    numbers = finite_numbers(name, values)
    if (
        len(numbers) < 2
        or any(b <= a for a, b in zip(numbers, numbers[1:]))
        or not math.isfinite(numbers[-1] - numbers[0])
    ):
        raise ValueError(f"{name} must be at least two strictly increasing numbers, got {values!r}")
    return np.array(numbers)


def corners(u: Interval, knots: np.ndarray, extends: bool) -> np.ndarray:
    """Return the ends of an interval, clipped to the table unless `extends`, and the knots between them."""
    low, high = (u.low, u.high) if extends else np.clip((u.low, u.high), knots[0], knots[-1])
    return np.concatenate(([low, high], knots[(low < knots) & (knots < high)]))


def place(knots: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (segment of each x, its relative position in the segment)."""
    i = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    with np.errstate(over="ignore"):
        return i, (x - knots[i]) / (knots[i + 1] - knots[i])

"""Interpolation tables: a curve or a surface through given points, on straight lines between them.

Beyond the ends of the table the output keeps the value at the end (clamp), goes on along the last line (extrapolate),
or the run ends in a fault (error). All have direct feedthrough and no state, and work element by element; NaN passes,
and infinity becomes NaN.
"""

import math

import numpy as np

from blocks._plumbing.ports import UnitOfOutput, finite_numbers
from cext.kernels import tables as kernels
from graph import Block, Input, Interval, Memory, Output, Param, units
from graph.interval import EVERYTHING

ROUNDING = 16 * 2.0**-52  # relative, more than the few roundings of one interpolation add up to
CHOICES = ("clamp", "extrapolate", "error")


class LookupTable1D(UnitOfOutput, Block):
    """A curve through points: y = v(u), v linear between the breakpoints; numpy.interp where it clamps."""

    breakpoints = Param((0.0, 1.0), "any", "of the input, at least two, rising")
    values = Param((0.0, 1.0), "any", "of the output, one for each breakpoint")
    beyond = Param("clamp", "1", "what happens beyond the ends", choices=CHOICES)
    unit = Param(units.ANY, "1", "unit of the output")

    u = Input("any", "where on the curve", shape=...)
    y = Output("any", "its height there", shape=...)
    knots = Memory(0.0, "the breakpoints")
    heights = Memory(0.0, "the values")

    kernel = kernels.curves["clamp"]

    def configure(self):
        super().configure()
        self.knots = rising_numbers("breakpoints", self.breakpoints)
        self.heights = np.array(finite_numbers("values", self.values))
        if len(self.knots) != len(self.heights):
            raise ValueError(f"there are {len(self.knots)} breakpoints and {len(self.heights)} values")
        self.kernel = kernels.curves[self.beyond]

    def output_range(self, u):
        low, high = np.clip((u.low, u.high), self.knots[0], self.knots[-1])
        inside = self.heights[(low <= self.knots) & (self.knots <= high)]
        found = [Interval.point(height) for height in inside] + [self.near(low), self.near(high)]
        if self.beyond == "extrapolate":
            found += [self.end(x) for x in (u.low, u.high)]
        return Interval(min(each.low for each in found), max(each.high for each in found))

    def near(self, x):
        """Interval of the curve at x, inside the table, with what rounding may add, but within its piece."""
        i = int(np.clip(np.searchsorted(self.knots, x, side="right") - 1, 0, len(self.knots) - 2))
        (x0, x1), (a, b) = self.piece(i)
        share = (float(x) - x0) / (x1 - x0)
        y, slack = (1.0 - share) * a + share * b, ROUNDING * max(abs(a), abs(b))
        return Interval(max(y - slack, min(a, b)), min(y + slack, max(a, b)))

    def end(self, x):
        """Interval of the curve from an end of the table to x; the last line rounds as the kernel does, which keeps
        order.
        """
        (x0, x1), (a, b) = self.piece(0 if x < self.knots[0] else len(self.knots) - 2)
        share = (x - x0) / (x1 - x0)
        if a == b or 0.0 <= share <= 1.0:
            return self.near(np.clip(x, x0, x1))
        return Interval.point(a + share * (b - a) if share < 0.0 else b + (share - 1.0) * (b - a))

    def piece(self, i):
        """Ends of one piece, and the heights there."""
        return self.knots[i : i + 2].tolist(), self.heights[i : i + 2].tolist()


class LookupTable2D(UnitOfOutput, Block):
    """A surface over a grid: y = v(row, column), bilinear between the grid points."""

    rows = Param((0.0, 1.0), "any", "breakpoints of `row`, at least two, rising")
    columns = Param((0.0, 1.0), "any", "breakpoints of `column`, at least two, rising")
    values = Param(
        ((0.0, 0.0), (0.0, 1.0)), "any", "of the output: a tuple for each row, with one value for each column"
    )
    beyond = Param("clamp", "1", "what happens beyond the ends", choices=CHOICES)
    unit = Param(units.ANY, "1", "unit of the output")

    row = Input("any", "where along the rows", shape=...)
    column = Input("any", "where along the columns", shape=...)
    y = Output("any", "height of the surface there", shape=...)
    row_knots = Memory(0.0, "breakpoints of the rows")
    column_knots = Memory(0.0, "breakpoints of the columns")
    heights = Memory(0.0, "values, one row after the other")

    kernel = kernels.surfaces["clamp"]
    free_units = ("row", "column")

    def configure(self):
        super().configure()
        self.row_knots = rising_numbers("rows", self.rows)
        self.column_knots = rising_numbers("columns", self.columns)
        grid = [finite_numbers("values", row) for row in self.values]
        shape = len(self.row_knots), len(self.column_knots)
        if len(grid) != shape[0] or any(len(row) != shape[1] for row in grid):
            raise ValueError(f"values must be {shape[0]} rows of {shape[1]} numbers, one for each column")
        self.heights = np.array(grid).ravel()
        self.kernel = kernels.surfaces[self.beyond]

    def output_range(self, row, column):
        extends = self.beyond == "extrapolate"
        r, c = (corners(u, knots, extends) for u, knots in ((row, self.row_knots), (column, self.column_knots)))
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(c))):
            return EVERYTHING
        # Between grid lines the surface is bilinear, so its extremes are at the corners of what the inputs can reach of
        # each cell.
        grid = self.heights.reshape(len(self.row_knots), -1)
        (i, s), (j, t) = place(self.row_knots, r), place(self.column_knots, c)
        s, t = s[:, None], t[None, :]
        cells = [grid[np.ix_(i + a, j + b)] for a in (0, 1) for b in (0, 1)]
        with np.errstate(over="ignore", invalid="ignore"):
            farthest = np.max(np.abs(cells)) * np.max(np.abs(s) + np.abs(1.0 - s)) * np.max(np.abs(t) + np.abs(1.0 - t))
            if extends and not farthest < 1e307:
                return EVERYTHING  # the kernel may overflow on its way
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


def rising_numbers(name, values):
    """An array of at least two finite numbers that rise. ValueError if they do not."""
    found = finite_numbers(name, values)
    if len(found) < 2 or any(b <= a for a, b in zip(found, found[1:])) or not math.isfinite(found[-1] - found[0]):
        raise ValueError(f"{name} must be at least two numbers, each above the one before, got {values!r}")
    return np.array(found)


def corners(u, knots, extends):
    """The ends of an interval, cut to the table unless it extends, and the knots between them."""
    low, high = (u.low, u.high) if extends else np.clip((u.low, u.high), knots[0], knots[-1])
    return np.concatenate(([low, high], knots[(low < knots) & (knots < high)]))


def place(knots, x):
    """(piece of each x, how far it is on its way through the piece)."""
    i = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    with np.errstate(over="ignore"):
        return i, (x - knots[i]) / (knots[i + 1] - knots[i])

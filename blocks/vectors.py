"""Vectors: concatenation and linear algebra. All have direct feedthrough and no state; NaN passes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from blocks._plumbing.ranges import hull, total
from cext.kernels import vectors as kernels
from graph import Block, Input, Interval, Memory, Output, Param
from graph.arithmetic import Select as Select  # the blocks of gyro[1] and stack(...)
from graph.arithmetic import Stack as Stack
from graph.arithmetic import whole_numbers
from graph.units import multiply


class Concatenate(Block):
    """Concatenation of vectors, as in numpy.concatenate; a size of 1 is a scalar."""

    sizes = Param((3, 3), "1", "lengths of the inputs")

    y = Output("any", "concatenated vector")

    passes_jumps = True
    kernel = kernels.stack

    def configure(self) -> None:
        sizes = whole_numbers("sizes", self.sizes)
        if not sizes:
            raise ValueError("sizes must contain at least one length")
        self.inputs = {
            f"u{i}": Input("any", f"input {i}", shape=(size,) if size > 1 else ()).named(f"u{i}")
            for i, size in enumerate(sizes, start=1)
        }
        self.outputs = {"y": Output("any", "concatenated vector", shape=(sum(sizes),)).named("y")}

    def output_range(self, **inputs: Interval) -> Interval:
        return hull(inputs.values())


class Norm(Block):
    """Euclidean norm: y = √(u₁² + u₂² + ...); infinite if a square exceeds 1e308."""

    u = Input("any", "vector", shape=...)
    y = Output("any", "norm of the vector")

    kernel = kernels.norm

    def output_range(self, u: Interval) -> Interval:
        nearest, farthest = abs(u).low, abs(u).high
        return Interval(length(nearest, self.width), length(farthest, self.width))


class Dot(Block):
    """Dot product: y = a₁ b₁ + a₂ b₂ + ...."""

    a = Input("any", "first vector", shape=...)
    b = Input("any", "second vector", shape=...)
    y = Output("any", "dot product")

    kernel = kernels.dot
    free_units = ("a", "b")

    def output_units(self, a: str, b: str) -> dict[str, str]:
        return {"y": multiply(a, b)}

    def output_range(self, a: Interval, b: Interval) -> Interval:
        return total([a * b] * self.width)


class Cross(Block):
    """Cross product: y = a × b, right-handed."""

    a = Input("any", "first vector", shape=(3,))
    b = Input("any", "second vector", shape=(3,))
    y = Output("any", "cross product", shape=(3,))

    kernel = kernels.cross
    free_units = ("a", "b")

    def output_units(self, a: str, b: str) -> dict[str, str]:
        return {"y": multiply(a, b)}

    def output_range(self, a: Interval, b: Interval) -> Interval:
        return a * b - a * b


class MatrixGain(Block):
    """Product with a constant matrix: y = A u, as A @ u in NumPy.

    y has one element per row of A; it is a scalar if A is a single row of numbers.
    """

    matrix = Param(((1.0, 0.0), (0.0, 1.0)), "any", "matrix A: one tuple per row, or a single row of numbers")
    unit = Param("1", "1", "unit of the matrix; the output unit is its product with the input unit")

    u = Input("any", "vector")
    y = Output("any", "product A u")
    entries = Memory(0.0, "A, row by row")

    kernel = kernels.matrix

    def configure(self) -> None:
        try:
            matrix = np.array(self.matrix, dtype=float)
        except (TypeError, ValueError):
            matrix = np.zeros(0)
        if matrix.ndim not in (1, 2) or not matrix.size or not np.all(np.isfinite(matrix)):
            raise ValueError(f"matrix must be rows of finite numbers of equal length, got {self.matrix!r}")
        self.rows = np.atleast_2d(matrix).tolist()
        self.entries = matrix.ravel()
        self.inputs = {"u": Input("any", "vector", shape=matrix.shape[-1:]).named("u")}
        self.outputs = {"y": Output("any", "product A u", shape=matrix.shape[:-1]).named("y")}

    def output_units(self, u: str) -> dict[str, str]:
        return {"y": multiply(u, self.unit)}

    def output_range(self, u: Interval) -> Interval:
        return hull(total([Interval.point(entry) * u for entry in row]) for row in self.rows)


def length(element: Any, count: Any) -> Any:
    """Return the norm of a vector of `count` equal elements, rounded like the kernel."""
    squares = 0.0
    for _ in range(count):
        squares += element * element
    return math.sqrt(squares)

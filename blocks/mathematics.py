"""Arithmetic on signals. All blocks are element-wise, with direct feedthrough and without state; NaN passes.

An infinity never becomes a finite number: operations that would return one (the minimum of 1 and inf, the sign of inf,
inf to the power -1) return NaN.
"""

from __future__ import annotations

import math

from blocks._plumbing.ports import UnitOfOutput, count_param, finite_numbers, several
from blocks._plumbing.ranges import LIBM, falling, horner, rising
from cext.kernels import mathematics as kernels
from graph import Block, Input, Interval, Memory, Output, Param, units
from graph.arithmetic import Divide as Divide  # the blocks of the operators of signals
from graph.arithmetic import Gain as Gain
from graph.arithmetic import Product as Product
from graph.arithmetic import Sum as Sum
from graph.arithmetic import UnitConversion as UnitConversion
from graph.interval import EVERYTHING


class Abs(Block):
    """Absolute value: y = |u|."""

    u = Input("any", "input", shape=...)
    y = Output("any", "absolute value", shape=...)

    kernel = kernels.magnitude

    def output_range(self, u: Interval) -> Interval:
        return abs(u)


class Sign(Block):
    """Sign: y = 1 for u > 0, -1 for u < 0, 0 for u = 0."""

    u = Input("any", "input", shape=...)
    y = Output("1", "sign: -1, 0 or 1", shape=..., dtype=int)

    kernel = kernels.sign

    def output_range(self, u: Interval) -> Interval:
        return rising(lambda x: math.copysign(1.0, x) if x else 0.0, u)


class Min(Block):
    """Minimum of several signals: y = min(u1, u2, ...). NaN if an input is not finite."""

    count = count_param()

    y = Output("any", "smallest input", shape=...)

    kernel = kernels.min

    def configure(self) -> None:
        self.inputs = several(self.count)

    def output_range(self, **inputs: Interval) -> Interval:
        return Interval(min(u.low for u in inputs.values()), min(u.high for u in inputs.values()))


class Max(Block):
    """Maximum of several signals: y = max(u1, u2, ...). NaN if an input is not finite."""

    count = count_param()

    y = Output("any", "largest input", shape=...)

    kernel = kernels.max

    def configure(self) -> None:
        self.inputs = several(self.count)

    def output_range(self, **inputs: Interval) -> Interval:
        return Interval(max(u.low for u in inputs.values()), max(u.high for u in inputs.values()))


class Round(Block):
    """Rounding to an integer: nearest (half to even, as numpy.rint), floor or ceil."""

    method = Param("nearest", "1", "rounding method", choices=("nearest", "floor", "ceil"))

    u = Input("any", "input", shape=...)
    y = Output("any", "rounded input", shape=..., dtype=int)

    kernel = kernels.roundings["nearest"]

    def configure(self) -> None:
        self.kernel = kernels.roundings[self.method]

    def output_range(self, u: Interval) -> Interval:
        rounded = {"nearest": round, "floor": math.floor, "ceil": math.ceil}[self.method]
        return rising(lambda x: float(rounded(x)) if math.isfinite(x) else x, u)


class SquareRoot(Block):
    """Square root: y = √u, NaN for u < 0.

    The output unit is the root of the input unit, or "any" if that has fractional exponents.
    """

    u = Input("any", "input", shape=...)
    y = Output("any", "square root", shape=...)

    kernel = kernels.square_root

    def output_units(self, u: str) -> dict[str, str]:
        return {"y": unit_to_the(u, 0.5)}

    def output_range(self, u: Interval) -> Interval:
        return rising(math.sqrt, Interval(0.0, math.inf) & u)


class Power(Block):
    """Power with a constant exponent: y = u ^ exponent.

    NaN for u < 0 unless the exponent is an integer; infinite for u = 0 with a negative exponent. The output unit is the
    power of the input unit, or "any" if that has fractional exponents.
    """

    exponent = Param(2.0, "1", "exponent")

    u = Input("any", "base", shape=...)
    y = Output("any", "power of the base", shape=...)

    kernel = kernels.power

    def configure(self) -> None:
        if not math.isfinite(self.exponent):
            raise ValueError(f"exponent: must be finite, got {self.exponent}")

    def output_units(self, u: str) -> dict[str, str]:
        return {"y": unit_to_the(u, self.exponent) if not self.live("exponent") else units.ANY}

    def output_range(self, u: Interval) -> Interval:
        p = self.exponent
        if self.live("exponent"):
            return EVERYTHING
        if p == 0.0:
            return Interval.point(1.0)
        if p % 2.0 == 1.0:  # odd: increasing, or decreasing on both sides of a pole
            if p > 0.0:
                return rising(lambda x: power(x, p), u, LIBM)
            return EVERYTHING if 0.0 in u else falling(lambda x: power(x, p), u, LIBM)
        base = abs(u) if p % 2.0 == 0.0 else Interval(0.0, math.inf) & u
        return (rising if p > 0.0 else falling)(lambda x: power(x, p), base, LIBM) & Interval(0.0, math.inf)


class Polynomial(UnitOfOutput, Block):
    """Polynomial: y = c₀ uⁿ + c₁ uⁿ⁻¹ + ... + cₙ.

    Evaluated by Horner's rule. Coefficients are in decreasing powers, as in numpy.polyval.
    """

    coefficients = Param((1.0, 0.0), "1", "coefficients in decreasing powers")
    unit = Param(units.ANY, "1", "unit of the output")

    u = Input("any", "input", shape=...)
    y = Output("any", "value of the polynomial", shape=...)
    terms = Memory(0.0, "coefficients")

    kernel = kernels.polynomial

    def configure(self) -> None:
        super().configure()
        self.terms = finite_numbers("coefficients", self.coefficients)

    def output_range(self, u: Interval) -> Interval:
        return horner(self.terms, u)


def power(x: float, p: float) -> float:
    """Return x ** p with the results of C where Python raises."""
    try:
        return math.pow(x, p)
    except OverflowError:
        return math.copysign(math.inf, x) if p % 2.0 == 1.0 else math.inf
    except ValueError:  # zero to a negative power
        return math.inf


def unit_to_the(unit: str, exponent: float) -> str:
    """Return a power of a unit, or "any" if that has fractional exponents."""
    if unit == units.ANY:
        return unit
    powers = [(symbol, count * exponent) for symbol, count in units.parse(unit)]
    if any(count % 1.0 for _, count in powers):
        return units.ANY
    return units.canonical("·".join(f"{symbol}^{int(count)}" for symbol, count in powers if count) or units.ONE)

"""Blocks of the operators on signals: `2.0 * a - b`, `gyro[1]`, `angle.to("deg")`, `stack(a, b, c)`.

All have direct feedthrough and no state, and work element by element; NaN passes.
"""

from __future__ import annotations

import functools
import math
import operator
import sys
from collections.abc import Iterable
from typing import Any

import numpy as np

from cext.kernels import mathematics as kernels
from cext.kernels import vectors
from graph import units
from graph.block import Block
from graph.declarations import Input, Memory, Output, Param
from graph.diagnostics import Diagnostic, DiagramError, caller
from graph.diagram import current_scope
from graph.interval import Interval
from graph.narrowing import is_row, is_table, is_tuple
from graph.signal import Operand, Signal
from graph.units import canonical, divide, multiply


class Gain(Block):
    """Product with a constant: y = gain · u. Direct feedthrough; NaN passes."""

    gain = Param(1.0, "any", "factor")
    unit = Param("1", "1", "unit of the factor; the output has the product of both units")

    u = Input("any", "input", shape=...)
    y = Output("any", "gain · u", shape=...)

    passes_jumps = True
    kernel = kernels.gain

    def configure(self) -> None:
        self.unit = canonical(self.unit)

    def output_units(self, u: str) -> dict[str, str]:
        return {"y": multiply(u, self.unit)}

    def output_range(self, u: Interval) -> Interval:
        return self.span("gain") * u


class Sum(Block):
    """Addition and subtraction of any number of signals: y = ± u1 ± u2 .... Direct feedthrough; NaN passes."""

    signs = Param("++", "1", "one + or - for each input")

    y = Output("any", "the sum", shape=...)
    weights = Memory(1.0, "+1 or -1 for each input")

    passes_jumps = True
    kernel = kernels.sum

    def configure(self) -> None:
        if not self.signs or set(self.signs) - {"+", "-"}:
            raise ValueError(f"signs must be one + or - for each input, as in '+-', got {self.signs!r}")
        self.inputs = {
            f"u{i}": Input("any", f"input {i}", shape=...).named(f"u{i}") for i in range(1, len(self.signs) + 1)
        }
        self.weights = [1.0 if sign == "+" else -1.0 for sign in self.signs]
        self.kernel = kernels.additions.get(self.signs, kernels.sum)

    def output_range(self, **inputs: Interval) -> Interval:
        first, *rest = (u if sign == "+" else -u for u, sign in zip(inputs.values(), self.signs))
        for interval in rest:
            first = first + interval
        return first


class Product(Block):
    """Product of two signals: y = a · b.

    Element by element; a scalar is combined with every element. Direct feedthrough; NaN passes.
    """

    a = Input("any", "first factor", shape=..., broadcast=True)
    b = Input("any", "second factor", shape=..., broadcast=True)
    y = Output("any", "a · b", shape=...)

    kernel = kernels.product
    free_units = ("a", "b")

    def output_units(self, a: str, b: str) -> dict[str, str]:
        return {"y": multiply(a, b)}

    def output_range(self, a: Interval, b: Interval) -> Interval:
        return a * b


class Divide(Block):
    """Quotient of two signals: y = a / b.

    Division is that of IEEE 754, except that 1 / inf is NaN: 1 / 0 is infinity and 0 / 0 is NaN. An actuator reports
    either as a fault. Element by element; a scalar is combined with every element.
    """

    a = Input("any", "dividend", shape=..., broadcast=True)
    b = Input("any", "divisor", shape=..., broadcast=True)
    y = Output("any", "a / b", shape=...)

    kernel = kernels.divide
    free_units = ("a", "b")

    def output_units(self, a: str, b: str) -> dict[str, str]:
        return {"y": divide(a, b)}

    def output_range(self, a: Interval, b: Interval) -> Interval:
        return a / b


class UnitConversion(Block):
    """Conversion between two units of one dimension: y = factor · u + offset.

    Example: `UnitConversion("deg", "rad")`.
    """

    source = Param("", "1", "unit of the input", required=True, dtype=str)
    target = Param("", "1", "unit of the output", required=True, dtype=str)

    u = Input("any", "in the unit `source`", shape=...)
    y = Output("any", "in the unit `target`", shape=...)
    factor = Memory(1.0, "number of target units in one source unit")
    offset = Memory(0.0, "output for an input of zero")

    passes_jumps = True
    kernel = kernels.conversion
    examples = ({"source": "deg", "target": "rad"},)

    def configure(self) -> None:
        self.factor, self.offset = units.conversion(self.source, self.target)
        self.inputs = {"u": Input(self.source, "in the unit `source`", shape=...).named("u")}
        self.outputs = {"y": Output(self.target, "in the unit `target`", shape=...).named("y")}

    def output_range(self, u: Interval) -> Interval:
        # exact: the kernel rounds the same operations
        return Interval(self.factor * u.low + self.offset, self.factor * u.high + self.offset)


class Stack(Block):
    """Stack of signals of one shape along a new first axis, as numpy.stack: three scalars make a vector (3,)."""

    count = Param(2, "1", "number of inputs", min=1, max=1000, fixed=True)
    shape = Param((), "1", "shape of each input, () for scalars")

    y = Output("any", "stacked inputs")

    passes_jumps = True
    kernel = vectors.stack

    def configure(self) -> None:
        shape = whole_numbers("shape", self.shape)
        self.inputs = {
            f"u{i}": Input("any", f"input {i}", shape=shape).named(f"u{i}") for i in range(1, self.count + 1)
        }
        self.outputs = {"y": Output("any", "stacked inputs", shape=(self.count, *shape)).named("y")}

    def output_range(self, **inputs: Interval) -> Interval:
        return functools.reduce(Interval.__or__, inputs.values())


class Select(Block):
    """Elements of an array: y = u[index], with a NumPy index. `signal[index]` creates this block.

    A signal of undeclared shape must be a vector, and its index an integer or a list of integers.
    """

    index = Param(
        0,
        "1",
        "index of the elements: an integer or several; with `of`, a NumPy index as `encode_index` returns it",
        dtype=object,
    )
    of = Param(None, "1", "shape of the input, inferred from the wire if omitted", dtype=tuple)

    u = Input("any", "array", shape=...)
    y = Output("any", "selected elements")
    places = Memory(0.0, "indices of the elements in the flattened input")

    passes_jumps = True
    kernel = vectors.select
    examples = ({}, {"index": (1, {"slice": (None, None, None)}), "of": (2, 3)})

    def configure(self) -> None:
        if self.of is None:
            self.plain()
            return
        shape = whole_numbers("of", self.of)
        try:
            taken = np.arange(math.prod(shape)).reshape(shape)[decode_index(self.index)]
        except IndexError as error:
            raise ValueError(f"index: {error}") from None
        if not taken.size:
            raise ValueError("index must select at least one element")
        self.inputs = {"u": Input("any", "array", shape=shape).named("u")}
        self.outputs = {"y": Output("any", "selected elements", shape=taken.shape).named("y")}
        self.places = taken.ravel().tolist()

    def plain(self) -> None:
        """Set the indices for a vector of any length: an integer, or a list of integers."""
        index: Any = self.index
        several = is_row(index)
        self.indices = whole_numbers("index", index if several else (index,), None)
        if not self.indices:
            raise ValueError("index must select at least one element")
        self.outputs = {
            "y": Output("any", "selected elements", shape=(len(self.indices),) if several else ()).named("y")
        }

    def prepare(self, dt: float) -> None:
        if self.of is not None:
            return
        for index in self.indices:
            if not -self.width <= index < self.width:
                raise ValueError(f"index {index} is out of bounds for a vector of length {self.width}")
        self.places = [index % self.width for index in self.indices]

    def output_range(self, u: Interval) -> Interval:
        return u


def encode_index(index: Any) -> Any:
    """Encode an index for JSON: {"slice": (start, stop, step)}, {"list": (...)}, {"ellipsis": True}, int or tuple."""
    if is_tuple(index):
        return tuple(encode_index(item) for item in index)
    if type(index) is slice:
        return {"slice": (index.start, index.stop, index.step)}
    if is_row(index):
        return {"list": tuple(index)}
    if index is ...:
        return {"ellipsis": True}
    if isinstance(index, (str, float)):
        raise TypeError(f"a signal is indexed with whole numbers, as in gyro[1], got {index!r}")
    return operator.index(index)


def decode_index(index: Any) -> Any:
    """Return the NumPy index of an encoded one."""
    if is_tuple(index):
        return tuple(decode_index(item) for item in index)
    if is_table(index):
        return ... if "ellipsis" in index else slice(*index["slice"]) if "slice" in index else list(index["list"])
    return index


def whole_numbers(name: str, values: Iterable[Any], smallest: int | None = 1) -> tuple[int, ...]:
    """Return values as a tuple of ints. Raises ValueError if one is not whole, or below the smallest."""
    try:
        numbers = tuple(operator.index(value) for value in values)
    except TypeError:
        raise ValueError(f"{name} must be whole numbers, got {values!r}") from None
    if smallest is not None and any(value < smallest for value in numbers):
        raise ValueError(f"{name} must be whole numbers from {smallest} up, got {values!r}")
    return numbers


class Convert(Block):
    """Converts to another unit of the same dimension: y = factor · u + offset.

    `signal.to("deg")` makes this block. The unit of the input is inferred from the wire.
    """

    target = Param("", "1", "unit of the output", required=True, dtype=str)

    u = Input("any", "in any unit of the same dimension", shape=...)
    y = Output("any", "in the unit `target`", shape=...)
    factor = Memory(1.0, "number of target units in one input unit")
    offset = Memory(0.0, "output for an input of zero, in the target unit")

    passes_jumps = True
    kernel = kernels.conversion
    examples = ({"target": "deg"},)

    def configure(self) -> None:
        self.target = canonical(self.target)
        self.factor, self.offset = 1.0, 0.0

    def output_units(self, u: str) -> dict[str, str]:
        if u != units.ANY:
            self.factor, self.offset = units.conversion(u, self.target)
        return {"y": self.target}

    def output_range(self, u: Interval) -> Interval:
        return Interval(self.factor * u.low + self.offset, self.factor * u.high + self.offset)


def stack(*signals: Operand) -> Signal:
    """Stack signals or numbers of one shape along a new first axis: three scalars make a vector of shape (3,)."""
    shape = next((signal.declaration.shape for signal in signals if isinstance(signal, Signal)), ())
    return Stack(len(signals), shape=() if shape is ... else shape)(*signals)


def _check_open(*operands: Any) -> None:
    """Raise DiagramError outside a diagram, where arithmetic of signals cannot add a block."""
    if current_scope() is None:
        path = next(operand.path for operand in operands if isinstance(operand, Signal))
        raise DiagramError(
            Diagnostic(
                "TW011",
                "the signal is used in arithmetic, and no diagram is open",
                path=path,
                where=caller(),
                hint="write it inside `with Diagram(...)`; a step takes a signal as an input, and gets its value; it "
                "stores its last output in an attribute of another name",
            )
        )


def plus(a: Operand, b: Operand, signs: str = "++") -> Signal:
    """Add two signals or numbers, or subtract the second with signs="+-"."""
    _check_open(a, b)
    return Sum(signs)(a, b)


def times(signal: Signal, factor: Signal | float) -> Signal:
    """Multiply a signal by another, or by a number without a unit."""
    _check_open(signal)
    return Product()(signal, factor) if isinstance(factor, Signal) else Gain(factor)(signal)


def over(dividend: Any, divisor: Signal | float) -> Signal:
    """Divide signals; a number as divisor makes a Gain of its reciprocal, which keeps the unit.

    Raises ZeroDivisionError for the number 0.
    """
    _check_open(dividend, divisor)
    if isinstance(divisor, Signal):
        return Divide()(dividend, divisor)
    if divisor == 0:
        raise ZeroDivisionError(f"{dividend.path} / 0")
    return Gain(1.0 / divisor)(dividend)


Signal.operators = sys.modules[__name__]

"""Signals: the values that wires carry, and their operators."""

import numbers
from collections import namedtuple
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from types import EllipsisType
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn, TypeAlias, Union

import numpy as np

from graph.signal_misuse import LOGIC, STACK, WithoutValue

Operand: TypeAlias = Union["Signal", float, Sequence[float], np.ndarray]
"""A value that can be wired to an input: a signal, a number, or an array of numbers."""

Index: TypeAlias = int | slice | EllipsisType | list[int]
"""An index of one axis."""


@dataclass(frozen=True)
class Signal(WithoutValue):
    """One output port of one block. Block attributes and calls return signals; user code does not construct them.

    `+`, `-`, `*`, `/`, unary `-`, `[]` and `to` add a block to the diagram and return its output.
    """

    block: Any
    port: str

    operators: ClassVar[Any]  # module graph.arithmetic, which sets it: its blocks have ports, and ports return signals

    @property
    def path(self) -> str:
        """Path of the port in the diagram, "left/knee.position"."""
        return f"{self.block.path}.{self.port}"

    @property
    def declaration(self) -> Any:
        """The Output that declares the port's unit, shape and dtype."""
        return self.block.outputs[self.port]

    def __eq__(self, other: object) -> bool:
        """Return whether both are the same port. Raises TypeError for a number, which is never equal."""
        if isinstance(other, Signal):
            return self.block is other.block and self.port == other.port
        if isinstance(other, (numbers.Number, np.ndarray)):
            self.reject("== or != with a number", LOGIC.format('Compare("==") or Compare("!=")'))
        return NotImplemented

    def __repr__(self) -> str:
        return f"<Signal {self.path} [{self.declaration.unit}]>"

    def __add__(self, other: Operand) -> "Signal":
        return self.operators.plus(self, other)

    def __radd__(self, other: Operand) -> "Signal":
        return self.operators.plus(other, self)

    def __sub__(self, other: Operand) -> "Signal":
        return self.operators.plus(self, other, "+-")

    def __rsub__(self, other: Operand) -> "Signal":
        return self.operators.plus(other, self, "+-")

    def __mul__(self, other: "Signal | float") -> "Signal":
        return self.operators.times(self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: "Signal | float") -> "Signal":
        return self.operators.over(self, other)

    def __rtruediv__(self, other: Operand) -> "Signal":
        return self.operators.over(other, self)

    def __neg__(self) -> "Signal":
        return self.operators.times(self, -1.0)

    def __getitem__(self, index: Index | tuple[Index, ...]) -> "Signal":
        """Select elements with a NumPy index: `gyro[1]`, `gyro[:2]`, `gyro[[0, 2]]`, `matrix[1, 0]`, `matrix[:, 2]`.

        A signal of undeclared shape is a vector; it takes an int or a list of ints.
        """
        shape = self.declaration.shape
        if shape == ():
            raise TypeError(f"{self.path} is a scalar, which has no elements; {STACK}")
        if shape is not ...:
            return self.operators.Select(self.operators.encode_index(index), shape)(self)
        if isinstance(index, (slice, tuple)) or index is ...:
            raise TypeError(
                f"{self.path}: slices and indices of several axes require a declared shape. List the elements "
                "instead, as in [[0, 1]]"
            )
        return self.operators.Select(tuple(index) if isinstance(index, list) else index)(self)

    if TYPE_CHECKING:
        __iter__ = None  # its length is known only after the compile

        def __bool__(self) -> NoReturn: ...

    def to(self, unit: str) -> "Signal":
        """Convert to another unit of the same dimension: `angle.to("deg")`."""
        return self.operators.Convert(unit)(self)


@cache
def _outputs_type(names: tuple[str, ...]) -> Any:
    return namedtuple("Outputs", names, rename=True)  # pyright: ignore[reportUntypedNamedTuple] of unknown length


def Outputs(names: Iterable[str], signals: Iterable[Signal]) -> Any:
    """Return a named tuple of signals: `phase, walking = block(...)` and `block(...).phase` both work."""
    return _outputs_type(tuple(names))(*signals)

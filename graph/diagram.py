"""Diagrams: blocks, their paths and their wires. The compiler checks them."""

from __future__ import annotations

import math
import numbers
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np
from msgspec import Struct

from cext.user_text import repr_of
from graph import hints
from graph.diagnostics import Diagnostic, DiagramError, Location, caller
from graph.names import check_name, count, snake_case, suggestion
from graph.narrowing import is_tuple
from graph.signal import Signal
from graph.solvers import ATOL, DEFAULT, RTOL, SOLVERS

MAXIMUM_RATE = 1e9  # Hz; deadlines are whole ns

scope_in_context: ContextVar[Scope | None] = ContextVar("tickwork_scope", default=None)
_strays: ContextVar[list[Any] | None] = ContextVar("tickwork_strays", default=None)


class Wire(Struct, frozen=True):
    """A connection from a signal or a constant to an input."""

    source: Any  # a Signal, or a number or array
    block: Any
    port: str | None  # None in a variadic block
    where: Location | None


class Scope(Struct, frozen=True):
    """The diagram and subsystem to which new blocks belong, with its rate divisor and its conditions."""

    diagram: Diagram
    prefix: str = ""
    every: int = 1
    conditions: tuple[Signal, ...] = ()

    def adopt(self, block: Any, name: str | None) -> None:
        """Add a block to the diagram."""
        block.every *= self.every
        block.conditions = self.conditions
        self.diagram.add(block, name, self.prefix)


@contextmanager
def no_block_outside(file: str) -> Generator[None]:
    """Raise DiagramError at the end for each block that a line of `file` has made outside every diagram.

    One of which only step() is called computes, and is permitted; in Python it must have an output.
    """
    made: list[Any] = []
    token = _strays.set(made)
    try:
        yield
    finally:
        _strays.reset(token)
    problems = [
        Diagnostic(
            "TW011",
            "it was created outside a diagram and has no effect",
            path=block.path,
            where=block.location,
            hint="indent this line so that it is inside `with Diagram(...)`",
        )
        for block in made
        if block.location and block.location.file == file and not block.computes_alone
    ]
    if problems:
        raise DiagramError(problems)


def note_stray(block: Any) -> None:
    """Note a block that is made outside every diagram."""
    made = _strays.get()
    if made is not None:
        made.append(block)


def current_scope() -> Scope | None:
    """Return the scope of the enclosing `with Diagram(...)` or `with subsystem(...)`, or None."""
    return scope_in_context.get()


class Diagram:
    """A block diagram that runs at `rate` Hz. Blocks made inside `with Diagram(...)` belong to it.

        with Diagram("knee", rate=200) as diagram:
            ...

    diagram["left/knee"] is the block at that path; iteration yields all blocks.

    solver : method that integrates the continuous states of a plant: "rk45" with error control, or "euler", "heun",
        "rk4" or "dopri5" with one step per tick
    rtol, atol : tolerance of a state's error in a step of "rk45", relative to the state and in its unit: their sum

    Raises DiagramError for a name that is not allowed, a rate outside 0 to 1e9 Hz, an unknown solver, and tolerances
    that are not above 0.
    """

    def __init__(self, name: str, rate: float, solver: str = DEFAULT, rtol: float = RTOL, atol: float = ATOL) -> None:
        self.name = name
        self.rate = rate
        self.solver = solver
        self.tolerances = rtol, atol
        self._blocks: dict[str, Any] = {}
        self.wires: list[Wire] = []
        self.duplicates: list[tuple[str, Any]] = []  # (path, block) where the name was taken; the compiler reports them
        self._numbers: dict[str, int] = {}  # {path: number appended to the newest block of that name}
        self._tokens: list[Any] = []
        self.not_entered: list[subsystem] = []  # subsystems that no `with` has opened
        self.caps: dict[str, Any] = {}  # Caps by path of an actuator, above every limit of the diagram

    # A run and the compiler read these: what they cannot be is refused where it is assigned

    @property
    def name(self) -> str:
        """Name of the diagram, and of the files of its recordings."""
        return self._name

    @name.setter
    def name(self, name: str) -> None:
        """Set the name. Raises DiagramError."""
        check_name(name, caller())
        self._name = name

    @property
    def rate(self) -> float:
        """Rate in Hz."""
        return self._rate

    @rate.setter
    def rate(self, rate: Any) -> None:
        """Set the rate. Raises DiagramError."""
        if rate is True or not is_real(rate) or not 0 < rate <= MAXIMUM_RATE:
            got = repr_of(rate, 40)
            message = f"the rate must be a number above 0 Hz and at most {MAXIMUM_RATE:g} Hz, got {got}"
            raise DiagramError(Diagnostic("TW010", message, path=self.name, where=caller()))
        self._rate: Any = rate

    @property
    def blocks(self) -> dict[str, Any]:
        """The blocks by their paths."""
        return self._blocks

    @property
    def solver(self) -> str:
        """Method that integrates continuous states."""
        return self._solver

    @solver.setter
    def solver(self, solver: Any) -> None:
        """Set the method. Raises DiagramError."""
        if not (isinstance(solver, str) and solver in SOLVERS):
            message = f"the solver must be one of {', '.join(SOLVERS)}, got {repr_of(solver)}"
            raise DiagramError(Diagnostic("TW010", message, path=self.name, where=caller()))
        self._solver = solver

    @property
    def tolerances(self) -> tuple[float, float]:
        """Relative and absolute tolerance of "rk45"."""
        return self._tolerances

    @tolerances.setter
    def tolerances(self, tolerances: Any) -> None:
        """Set the tolerances. Raises DiagramError."""
        try:
            rtol, atol = map(float, tolerances)
        except (ValueError, TypeError, OverflowError):
            rtol = atol = math.nan
        if not (1e-14 <= rtol < 1.0 and 0.0 < atol < math.inf):
            got = " and ".join(map(repr_of, tolerances)) if is_tuple(tolerances) else repr_of(tolerances)
            message = f"rtol must be in [1e-14, 1) and atol above 0, got {got}"
            raise DiagramError(Diagnostic("TW010", message, path=self.name, where=caller()))
        self._tolerances = rtol, atol

    def __enter__(self) -> Diagram:
        self._tokens.append(scope_in_context.set(Scope(self)))
        return self

    def __exit__(self, *exception: object) -> None:
        scope_in_context.reset(self._tokens.pop())

    def __getitem__(self, path: str) -> Any:
        """Return the block at a path. Raises KeyError if there is none."""
        try:
            return self.blocks[path]
        except KeyError:
            block, dot, port = str(path).rpartition(".")
            output = f"an output is diagram[{block!r}].{port}" if dot and block in self.blocks else ""
            hint = output or suggestion(path, self.blocks)
            raise KeyError(f"{self.name} has no block {path!r}" + (f": {hint}" if hint else "")) from None

    def __iter__(self) -> Iterator[Any]:
        return iter(self.blocks.values())

    def __len__(self) -> int:
        return len(self.blocks)

    def add(self, block: Any, name: str | None, prefix: str) -> None:
        """Add a block and set its path: prefix + name, or the name of its class, with a number if that is taken."""
        if name is not None:
            check_name(name, block.location)
        wanted = prefix + (name or snake_case(type(block).__name__))
        path, number = wanted, self._numbers.get(wanted, 1)
        while path in self.blocks:
            number += 1
            path = f"{wanted}_{number}"
        self._numbers[wanted] = number
        if name is not None and path != wanted:
            self.duplicates.append((wanted, block))
        block.diagram, block.path = self, path
        block.dt = block.every / self.rate
        self.blocks[path] = block

    def discard(self, block: Any) -> None:
        """Remove a block that could not be made, so that a program that handles the error can compile the rest."""
        del self.blocks[block.path]
        self.duplicates = [(path, other) for path, other in self.duplicates if other is not block]

    def wire(self, source: Any, block: Any, port: str | None, where: Location | None) -> None:
        """Connect a signal, a number or an array to an input. Raises DiagramError for anything else."""
        if isinstance(source, Signal):
            if source.block.diagram is not self:
                raise DiagramError(
                    Diagnostic(
                        "TW011",
                        f"the signal {source.path} comes from a block that is not in this diagram",
                        path=block.path,
                        port=port or "",
                        where=where,
                        hint="create both blocks inside the same `with Diagram(...)`",
                    )
                )
        elif is_tuple(source) and source and all(isinstance(item, Signal) for item in source):
            raise DiagramError(
                Diagnostic(
                    "TW012",
                    f"expected one signal, got {len(source)} ({', '.join(item.port for item in source)})",
                    path=block.path,
                    port=port or "",
                    where=where,
                    hint="choose one by name, as in block(...).position",
                )
            )
        else:
            if not is_number(source) or block.variadic:
                raise DiagramError(
                    Diagnostic(
                        "TW012",
                        f"{repr_of(source)} is neither a signal nor a number",
                        path=block.path,
                        port=port or "",
                        where=where,
                        hint=hints.for_source(source, block.variadic),
                    )
                )
        self.wires.append(Wire(source, block, port, where))

    def __repr__(self) -> str:
        return f"<Diagram {self.name}: {count(self.blocks, 'block')} at {self.rate:g} Hz>"


class subsystem:
    """A part of a diagram: blocks made in `with subsystem("left"): ...` have paths such as "left/knee". May be nested.

    every : its blocks run at every n-th tick and hold their outputs in between
    enabled : scalar signal; its blocks run while it is true (above 0.5), and hold their outputs and states otherwise.
        The time for which they are disabled is not part of their dt, and those that are disabled during arming do not
        start in steady state

    Raises DiagramError for a wrong argument and outside a diagram.
    """

    def __init__(self, name: str, *, every: int = 1, enabled: Signal | None = None) -> None:
        scope = scope_in_context.get()
        where = caller()
        check_name(name, where)
        if scope is None:
            raise DiagramError(
                Diagnostic(
                    "TW011",
                    f"subsystem({name!r}) is outside a diagram",
                    where=where,
                    hint="open it inside `with Diagram(...)`",
                )
            )
        if not is_count(every):
            raise DiagramError(
                Diagnostic(
                    "TW014",
                    f"every must be a whole number of ticks, 1 or more, got {repr_of(every)}",
                    path=str(name),
                    where=where,
                )
            )
        if not may_be_scalar(enabled):
            raise DiagramError(
                Diagnostic(
                    "TW012", f"enabled must be a scalar signal, got {repr_of(enabled)}", path=str(name), where=where
                )
            )
        conditions = scope.conditions + ((enabled,) if enabled is not None else ())
        self.name, self.where = name, where
        self.scope = Scope(scope.diagram, f"{scope.prefix}{name}/", scope.every * every, conditions)
        scope.diagram.not_entered.append(self)

    def __enter__(self) -> subsystem:
        if self in self.scope.diagram.not_entered:
            self.scope.diagram.not_entered.remove(self)
        self.token = scope_in_context.set(self.scope)
        return self

    def __exit__(self, *exception: object) -> None:
        scope_in_context.reset(self.token)


def is_real(value: Any) -> bool:
    """Return whether a value is a real number."""
    return isinstance(value, numbers.Real)


def is_count(every: object) -> bool:
    """Return whether a value is a number of ticks, 1 or more."""
    return not isinstance(every, bool) and isinstance(every, numbers.Integral) and 1 <= int(every) < 2**31


def may_be_scalar(enabled: object) -> bool:
    """Return whether a value is None or a signal that is not declared as an array."""
    return enabled is None or isinstance(enabled, Signal) and enabled.declaration.shape in ((), ...)


def is_number(value: Any) -> bool:
    """Return whether a value can be wired as a constant: a number, or an array of numbers."""
    try:
        array = np.asarray(value)
        return array.dtype.kind in "fiub" and array.size > 0
    except (ValueError, TypeError):  # rows of unequal length, signals
        return False

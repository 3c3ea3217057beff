"""Diagrams: which blocks there are, what they are called, and how they are wired. What is wrong with them is the
compiler's to say.
"""

import numbers
from contextvars import ContextVar
from dataclasses import dataclass

import numpy as np

from graph.diagnostics import Diagnostic, DiagramError, Location, caller
from graph.names import check_name, snake_case, suggestion
from graph.signal import Signal

MAXIMUM_RATE = 1e9  # Hz; deadlines are whole ns

_scope = ContextVar("tickwork_scope", default=None)


@dataclass(frozen=True)
class Wire:
    source: object  # a Signal, or a number or array
    block: object
    port: str | None  # None: a place of its own in a variadic block
    where: Location


@dataclass(frozen=True)
class Scope:
    """Where new blocks go: a diagram, a path of subsystems in it, and what these say of rate and condition."""

    diagram: "Diagram"
    prefix: str = ""
    every: int = 1
    conditions: tuple = ()

    def adopt(self, block, name):
        block.every *= self.every
        block.conditions = self.conditions
        self.diagram.add(block, name, self.prefix)


def current_scope():
    return _scope.get()


class Diagram:
    """A block diagram that runs at `rate` Hz. Blocks made inside `with Diagram(...)` belong to it.

        with Diagram("knee", rate=200) as diagram:
            ...

    diagram["left/knee"] is the block at that path; iterating gives all blocks.
    """

    def __init__(self, name, rate):
        check_name(name, caller())
        if not isinstance(rate, numbers.Real) or not 0 < rate <= MAXIMUM_RATE:
            digits = repr(rate) if len(repr(rate)) <= 40 else f"{repr(rate)[:20]}..."
            raise DiagramError(
                Diagnostic(
                    "TW010",
                    f"the rate must be a number above 0 Hz and at most {MAXIMUM_RATE:g} Hz, got {digits}",
                    path=name,
                    where=caller(),
                )
            )
        self.name, self.rate = name, rate
        self.blocks = {}
        self.wires = []
        self.duplicates = []  # blocks whose name was taken, for the compiler to report
        self._numbers = {}  # path: the last number that was added to it, to tell blocks of one kind apart
        self._tokens = []

    def __enter__(self):
        self._tokens.append(_scope.set(Scope(self)))
        return self

    def __exit__(self, *exception):
        _scope.reset(self._tokens.pop())

    def __getitem__(self, path):
        try:
            return self.blocks[path]
        except KeyError:
            hint = suggestion(path, self.blocks)
            raise KeyError(f"{self.name} has no block {path!r}" + (f": {hint}" if hint else "")) from None

    def __iter__(self):
        return iter(self.blocks.values())

    def __len__(self):
        return len(self.blocks)

    def add(self, block, name, prefix):
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

    def wire(self, source, block, port, where):
        if isinstance(source, Signal):
            if source.block.diagram is not self:
                raise DiagramError(
                    Diagnostic(
                        "TW011",
                        f"the signal {source.path} comes from a block that is not in this diagram",
                        path=block.path,
                        port=port or "",
                        where=where,
                        hint="make both blocks inside the same `with Diagram(...)`",
                    )
                )
        elif isinstance(source, tuple) and source and all(isinstance(item, Signal) for item in source):
            raise DiagramError(
                Diagnostic(
                    "TW012",
                    f"got {len(source)} signals ({', '.join(item.port for item in source)}) where one is wanted",
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
                        f"{source!r} is neither a signal nor a number",
                        path=block.path,
                        port=port or "",
                        where=where,
                        hint="wire a block's output, as in knee.position, or what a call returned",
                    )
                )
        self.wires.append(Wire(source, block, port, where))

    def __repr__(self):
        return f"<Diagram {self.name}: {len(self.blocks)} blocks at {self.rate:g} Hz>"


class subsystem:
    """Blocks made inside get paths below `name`: `with subsystem("left"): ...` makes "left/knee". May be nested.

    every : its blocks run at every n-th tick, and hold their outputs in between
    enabled : a signal; its blocks run while it is true, and hold their outputs while it is false
    """

    def __init__(self, name, *, every=1, enabled=None):
        scope = _scope.get()
        where = caller()
        check_name(name, where)
        if scope is None:
            raise DiagramError(
                Diagnostic(
                    "TW011",
                    f"subsystem({name!r}) stands outside a diagram",
                    where=where,
                    hint="open it inside `with Diagram(...)`",
                )
            )
        if not is_count(every):
            raise DiagramError(
                Diagnostic(
                    "TW014",
                    f"every must be a whole number of ticks, 1 or more, got {every!r}",
                    path=str(name),
                    where=where,
                )
            )
        if enabled is not None and (not isinstance(enabled, Signal) or enabled.declaration.shape not in ((), ...)):
            raise DiagramError(
                Diagnostic("TW012", f"enabled must be a scalar signal, got {enabled!r}", path=str(name), where=where)
            )
        conditions = scope.conditions + ((enabled,) if enabled is not None else ())
        self.scope = Scope(scope.diagram, f"{scope.prefix}{name}/", scope.every * every, conditions)

    def __enter__(self):
        self.token = _scope.set(self.scope)
        return self

    def __exit__(self, *exception):
        _scope.reset(self.token)


def is_count(every):
    """Whether a block can run in every so many ticks."""
    return isinstance(every, numbers.Integral) and not isinstance(every, bool) and 1 <= every < 2**31


def is_number(value):
    """Whether a value can be wired as a constant: a number, or an array of numbers."""
    try:
        array = np.asarray(value)
        return array.dtype.kind in "fiub" and array.size > 0
    except ValueError:  # rows of unequal length
        return False

"""Checks of a block's class when it is defined: reserved names, the signatures of its methods, and shared state."""

from __future__ import annotations

import inspect
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from graph import hints

CLOCK = {"t": 0, "tick": 1, "dt": 2}  # arguments that every step may take, and their slots in the arena
STEPS = ("step", "update", "settle")  # methods that take inputs
MUTABLE = {list: "[]", dict: "{}", set: "set()", bytearray: "bytearray()", deque: "deque()", np.ndarray: "np.zeros(3)"}


def check_class(kind: type[Any], declared: Iterable[str], reserved: Iterable[str]) -> None:
    """Raise TypeError for a mistake in the class of a block.

    kind : class, whose inputs, outputs and parameters have been collected
    declared : names of its declarations
    reserved : names that a declaration must not override
    """
    taken = next((name for name in declared if name in reserved), None)
    if taken is not None:
        raise TypeError(
            f"{kind.__name__}: {taken!r} is reserved and cannot name a port or parameter: choose another name than "
            f"{', '.join(sorted(reserved))}"
        )
    unknown = next((name for name in kind.positional or () if name not in kind.parameters), None)
    if unknown is not None:
        raise TypeError(f"{kind.__name__}.positional names {unknown!r}, which is not a parameter of the class")
    code = getattr(inspect.unwrap(kind.__init__), "__code__", None) if "__init__" in vars(kind) else None
    if code is not None and "__init__" not in code.co_names:
        raise TypeError(
            f"{kind.__name__}.__init__ does not call super().__init__(), which makes the block: call it first, or "
            "omit __init__: declare parameters with Param, and set state in reset(self)"
        )
    for method in ("reset", "configure"):
        function = vars(kind).get(method)
        if inspect.isfunction(function) and not inspect.signature(function).parameters:
            raise TypeError(f"{kind.__name__}.{method} takes no `self`: define {method}(self)")
    if not kind.variadic:
        for method in STEPS:
            if method in vars(kind):
                check_step(kind, method, vars(kind)[method])
    if any(method in vars(kind) for method in STEPS):
        check_attributes(kind, reserved)


def check_step(kind: type[Any], method: str, function: Callable[..., Any]) -> None:
    """Raise TypeError for a step, an update or a settle that cannot be called with the inputs. method : its name"""
    if inspect.isgeneratorfunction(function):
        raise TypeError(f"{kind.__name__}.{method} is a generator: end it with `return` instead of `yield`")
    if inspect.iscoroutinefunction(function):
        raise TypeError(f"{kind.__name__}.{method} is a coroutine: define it without `async`")
    names, takes_all = arguments_of(function)
    first = next(iter(inspect.signature(function).parameters), "")
    if first in kind.inputs or first in CLOCK:
        raise TypeError(f"{kind.__name__}.{method} takes no `self`: define {method}(self, {first}, ...)")
    unknown = [] if takes_all else [name for name in names if name not in kind.inputs and name not in CLOCK]
    if unknown:
        raise TypeError(
            f"{kind.__name__}.{method} takes {unknown[0]!r}, which is neither an input "
            f"({', '.join(kind.inputs) or 'none'}) "
            f"nor one of {', '.join(CLOCK)}{hints.for_argument(kind, unknown[0])}"
        )


def check_attributes(kind: type[Any], reserved: Iterable[str]) -> None:
    """Raise TypeError for a list or another mutable value in the class, which its blocks would share as state.

    Names in upper case are constants.
    """
    own = {"_own", *reserved}
    for name, value in vars(kind).items():
        if type(value) in MUTABLE and not name.isupper() and not name.startswith("__") and name not in own:
            raise TypeError(
                f"{kind.__name__}.{name} is one {type(value).__name__} for all blocks of the class: if it is state, "
                f"set it in reset(self), as in self.{name} = {MUTABLE[type(value)]}; if it is constant, write "
                "its name in upper case"
            )


def arguments_of(function: Callable[..., Any]) -> tuple[list[str], bool]:
    """Return (names of the positional arguments after self, whether it takes `*arguments`).

    Raises TypeError for a required keyword-only argument: inputs are passed by position.
    """
    kinds = inspect.Parameter
    parameters = list(inspect.signature(function).parameters.values())
    named = next((p.name for p in parameters if p.kind is kinds.KEYWORD_ONLY and p.default is kinds.empty), None)
    if named is not None:
        raise TypeError(f"{function.__qualname__} takes {named!r} by name only, but inputs are passed by position")
    names = [p.name for p in parameters if p.kind in (kinds.POSITIONAL_ONLY, kinds.POSITIONAL_OR_KEYWORD)]
    return names[1:], any(p.kind is kinds.VAR_POSITIONAL for p in parameters)

"""Checks of a block's class when it is defined: reserved names, the signatures of its methods, and shared state."""

from __future__ import annotations

import inspect
import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from cext.user_text import repr_of
from graph import hints
from graph.declarations import Input, LiveBounds, Memory, Output, Param
from graph.narrowing import is_table, is_tuple
from graph.signal import Signal

CLOCK = {"t": 0, "tick": 1, "dt": 2}  # arguments that every step may take, and their slots in the arena
STEPS = ("step", "update", "settle")  # methods that take inputs
MUTABLE = {list: "[]", dict: "{}", set: "set()", bytearray: "bytearray()", deque: "deque()", np.ndarray: "np.zeros(3)"}


def is_names(value: Any) -> bool:
    """Return whether a value is a collection of names."""
    iterates = hasattr(value, "__iter__") and getattr(value, "ndim", 1) != 0  # an array without a dimension does not
    collects = iterates and hasattr(value, "__len__") and type(value) is not str
    return collects and all(isinstance(name, str) for name in value)


def is_size(value: object) -> bool:
    """Return whether a value is a finite number of 0 or more, or a property."""
    return isinstance(value, property) or isinstance(value, (int, float)) and 0.0 <= value < math.inf


def declares(kind: type[Any]) -> tuple[Callable[[Any], bool], str]:
    """Return the test of a dict of what is of one type, and its words."""
    return lambda value: is_table(value) and all(isinstance(each, kind) for each in value.values()), (
        f"a dict of {kind.__name__} by name"
    )


ATTRIBUTES: dict[str, tuple[Callable[[Any], bool], str]] = {  # of a block: (whether a value is valid, what is)
    "inputs": declares(Input),
    "outputs": declares(Output),
    "parameters": declares(Param),
    "memory": declares(Memory),
    "conditions": (lambda value: is_tuple(value) and all(isinstance(each, Signal) for each in value), "Signals"),
    "feedthrough": (lambda value: value is None or is_names(value), "a tuple of names of inputs, or None"),
    "positional": (lambda value: value is None or is_names(value), "a tuple of names of parameters, or None"),
    "free_units": (is_names, "a tuple of names of inputs"),
    "smooth": (is_names, "a tuple of names of inputs"),
    "held_within": (is_table, "a dict of pairs by name"),
    "live_bounds": declares(LiveBounds),
    "set_from": (is_table, "a dict by name of a parameter"),
    "winds_up": (is_table, "a dict of names of inputs, by name of an output"),
    "output_slew": (lambda value: value is None or is_size(value), "a number of 0 or more, or None"),
    "allowance": (is_size, "a time of 0 s or more"),
}
HOOKS: dict[str, tuple[Any, ...]] = {  # {method that a class may define: its arguments after self}
    "reset": (),
    "configure": (),
    "prepare": ("dt",),
    "instability": (),
    "fault_text": ("status",),
    "run_summary": (),
    "files_of": ("name",),
}
WITH_INPUTS = (*STEPS, "output_range", "start_range", "output_units")


def wrong_attributes(given: Mapping[str, Any]) -> list[str]:
    """Return a sentence for each attribute of a block or its class that cannot be valid. given : attributes by name"""
    wrong: list[str] = []
    for name, (is_valid, words) in ATTRIBUTES.items():
        if name in given and not is_valid(given[name]):
            wrong.append(f"{name} must be {words}, got {repr_of(given[name])}")
    for name in (*WITH_INPUTS, *HOOKS):
        if name in given and not callable(given[name]) and not hasattr(given[name], "__get__"):
            wrong.append(f"{name} must be a method, got {repr_of(given[name])}")
    return wrong


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
    for wrong in wrong_attributes(vars(kind)):
        raise TypeError(f"{kind.__name__}.{wrong}")
    unknown = next((name for name in kind.positional or () if name not in kind.parameters), None)
    if unknown is not None:
        raise TypeError(f"{kind.__name__}.positional names {unknown!r}, which is not a parameter of the class")
    code = getattr(inspect.unwrap(kind.__init__), "__code__", None) if "__init__" in vars(kind) else None
    if code is not None and "__init__" not in code.co_names:
        raise TypeError(
            f"{kind.__name__}.__init__ does not call super().__init__(), which makes the block: call it first, or "
            "omit __init__: declare parameters with Param, and set state in reset(self)"
        )
    if kind.__hash__ is None:
        raise TypeError(f"{kind.__name__} defines equality, but each block is equal to itself only: remove __eq__")
    if kind.continuous and not hasattr(kind, "derivative_kernel"):
        raise TypeError(f"{kind.__name__} has continuous states: derive it from Continuous (of blocks.continuous)")
    for method, arguments in HOOKS.items():
        if inspect.isfunction(function := vars(kind).get(method)):
            check_hook(kind, function, f"{method}({', '.join(('self', *arguments))})", len(arguments))
    if not kind.variadic:
        for method in STEPS:
            if method in vars(kind):
                check_step(kind, method, vars(kind)[method])
    if any(method in vars(kind) for method in STEPS):
        check_attributes(kind, reserved)


def check_hook(kind: type[Any], function: Callable[..., Any], form: str, count: int) -> None:
    """Raise TypeError for a method that cannot be called. form, count : its call, and the number of its arguments"""
    signature = inspect.signature(function)
    name = form.partition("(")[0]
    if not signature.parameters:
        raise TypeError(f"{kind.__name__}.{name} takes no `self`: define {form}")
    try:
        signature.bind(None, *[None] * count)
    except TypeError as error:
        raise TypeError(f"{kind.__name__}.{name} cannot be called ({error}): define {form}") from None


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

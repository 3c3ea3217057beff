"""Types of the arguments of the functions of `runtime`, checked before the work begins."""

from __future__ import annotations

import math
import numbers
import os
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from runtime.host.errors import BadInput


def is_path(value: Any) -> bool:
    """Return whether a value is None or can be the path of a file."""
    return (
        value is None or isinstance(value, os.PathLike) or isinstance(value, str) and value != "" and "\0" not in value
    )


def is_number(value: Any) -> bool:
    """Return whether a value is None or a finite number."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return value is None
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond a float
        return False


def is_whole(value: Any) -> bool:
    """Return whether a value is None or a whole number of at most 64 bits."""
    counts = isinstance(value, numbers.Integral) and value is not True and value is not False
    return value is None or counts and abs(int(value)) < 2**63


def is_set(is_valid: Callable[[Any], bool]) -> Callable[[Any], bool]:
    """Return a test that also rejects None."""
    return lambda value: value is not None and is_valid(value)


def is_iterable(value: Any) -> bool:
    """Return whether a value can be iterated: no text, and no array without a dimension."""
    return hasattr(value, "__iter__") and not isinstance(value, (str, bytes)) and getattr(value, "ndim", 1) != 0


def are_names(value: Any) -> bool:
    """Return whether a value is a collection of texts."""
    return is_iterable(value) and hasattr(value, "__len__") and all(isinstance(name, str) for name in value)


def is_table(value: Any) -> bool:
    """Return whether a value is None or a dict with names as keys."""
    return value is None or hasattr(value, "items") and all(isinstance(name, str) for name in value)


FILE = is_path, "the path of a file"
TABLE = is_table, 'a dict by name, as in {"gain": [0.5, 1.0]}'
NAMES = are_names, 'a list of names, as in ["knee.position"]'
EXPECTED: dict[str, tuple[Callable[[Any], bool], str]] = {  # {argument, or FUNCTION.argument: (test, what is valid)}
    "rig": FILE,
    "subject": FILE,
    "output": FILE,
    "settings": (lambda value: value is None or is_iterable(value), 'a dict, as in {"left/impedance.stiffness": 40}'),
    "plant_signals": (
        lambda value: isinstance(value, (str, Iterator)) or are_names(value),
        'names of signals, as in "walker.speed, walker.left_knee_angle"',
    ),
    "duration": (is_number, "a finite number above 0, in s"),
    "at": (
        lambda value: is_set(is_number)(value) or isinstance(value, float) or hasattr(value, "inputs"),
        "a time in s, or a result of trim",
    ),
    "loop_timeout": (is_set(is_number), "a finite number above 0, in s"),
    "samples": (is_set(is_whole), "a whole number"),
    "sample_seed": (is_set(is_whole), "a whole number"),
    "generations": (is_set(is_whole), "a whole number"),
    "population": (is_set(is_whole), "a whole number"),
    "workers": (is_whole, "a whole number of processes"),
    "seeds": (is_iterable, "a list of whole numbers"),
    "grid": TABLE,
    "sample": (
        lambda value: is_table(value) and all(map(is_set(is_table), dict[str, Any](value or ()).values())),
        'a dict of distributions, as in {"gain": {"uniform": [0.5, 1.0]}}',
    ),
    "over": (is_set(is_table), 'a table of settings, as in {"gain": [1, 5]}'),
    "cost": (lambda value: isinstance(value, str), "the name of an objective"),
    "optimiser": (lambda value: isinstance(value, str), "the name of an optimiser"),
    "dask": (lambda value: value is None or isinstance(value, str), "the address of a Dask scheduler"),
    "linearise.inputs": NAMES,
    "linearise.outputs": NAMES,
    "set.changes": (is_set(is_table), 'a dict, as in {"profile.scale": 0.5}'),
}


def check_arguments(function: str, given: Mapping[str, Any]) -> None:
    """Raise BadInput for an argument that cannot be valid. function : its name; given : arguments by name"""
    for name, value in given.items():
        expected = EXPECTED.get(f"{function}.{name}") or EXPECTED.get(name)
        if expected is not None and not expected[0](value):
            raise BadInput(f"{name}={f'{value!r}':.300}: expected {expected[1]}")

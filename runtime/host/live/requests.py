"""Conversion of NAME=VALUE to changes of live parameters."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from graph import Param
from runtime.host.errors import BadInput
from runtime.host.live import patterns

if TYPE_CHECKING:
    from runtime.host.live.table import Parameter, Table


def changes_of(run_table: Table, name: str, text: str) -> list[tuple[Parameter, float]]:
    """Return [(Parameter, value)] of the parameters that a name or pattern matches.

    Raises BadInput if none matches or one cannot take the value.
    """
    return [
        (parameter, value_of(parameter, name, text)) for parameter in parameters_of(run_table, name, f"{name}={text}")
    ]


def parameters_of(run_table: Table, name: str, shown: str, otherwise: str = "") -> list[Parameter]:
    """Return the live parameters that a name or pattern matches, or else another one. Raises BadInput without one.

    shown : request for the message; otherwise : pattern to be tried after `name`
    """
    known = {parameter.path: parameter for parameter in run_table.parameters}
    paths = patterns.matching(name, known) or patterns.matching(otherwise, known)
    if not paths:
        hint = patterns.hint(name, known) or "the live parameters are " + (", ".join(known) or "none")
        raise BadInput(f"{shown}: {run_table.name} has no live parameter {name!r}; {hint}")
    return [known[path] for path in paths]


def as_text(value: Any) -> str:
    """Return a value as text for `set` and the command line; a text or a path as it is."""
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value)
    value = value.item() if hasattr(value, "item") else value
    return repr(value).lower() if isinstance(value, bool) else repr(value)


def value_of(parameter: Parameter, name: str, text: str) -> float:
    """Convert a text to a value of a parameter. Raises BadInput."""
    types = {"float": float, "int": int, "bool": bool}
    bounds: dict[str, Any] = (
        {}
        if parameter.dtype == "bool"
        else {"min": parameter.plain(parameter.low), "max": parameter.plain(parameter.high)}
    )
    try:
        return float(
            Param(parameter.plain(parameter.built), parameter.unit, dtype=types[parameter.dtype], **bounds).parse(text)
        )
    except ValueError as error:
        which = "" if parameter.path == name else f"{parameter.path} "
        raise BadInput(f"{name}={text}: {which}{error}") from None

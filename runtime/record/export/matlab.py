"""MATLAB export: `trial.left.knee.position` is a column, `trial.time` is in s, `trial.units` has the units.

Names that are illegal in MATLAB are replaced by unique legal ones; `trial.paths` has the originals. Vectors are (ticks,
elements).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any

from runtime.host.errors import BadInput
from runtime.host.optional_dependencies import need
from runtime.host.unique_name import unique
from runtime.record.analysis.trial import Trial
from runtime.record.storage.ascii_units import ascii_name

EXTENSIONS = {"mat": "mat"}
VARIABLE = "trial"
OWN = ("time", "tick", "units", "paths", "fields", "rate")
NAME_LENGTH_LIMIT = 63  # characters
KEYWORDS = frozenset(
    "break case catch classdef continue else elseif end for function global if otherwise parfor persistent return "
    "spmd switch try while".split()
)
VARIABLE_SIZE_LIMIT = 2**31 - 1  # bytes


def check(trial: Trial, kind: str) -> None:
    """Raise MissingExtra without SciPy, and BadInput for a recording above the size limit. kind : not used"""
    need("scipy.io", "a MATLAB file")
    size = 8 * len(trial) * len(trial.signals)
    if size > VARIABLE_SIZE_LIMIT:
        raise BadInput(
            f"{trial.path} has {size} bytes of samples, more than the 2 GiB of a .mat file: "
            "convert it to Parquet, which MATLAB reads"
        )


def write(trial: Trial, path: str, progress: Callable[[float], None]) -> None:
    """Write the file.

    path : path of the file, which is overwritten
    progress : not used: the file is written at once
    """
    values, units = Struct(OWN), Struct(OWN)
    paths, fields = Struct(OWN), Struct()
    for name, value in trial.fields.items():
        fields.put([name], value)
    for name, samples in trial.read(trial.names).items():
        samples = samples if trial.every(name) == 1 else trial.column(name)
        for tree, leaf in ((values, samples), (units, ascii_name(trial.unit(name))), (paths, name)):
            tree.put(re.split(r"[/.]", name), leaf)
    made = {
        **values.content,
        "time": trial.time,
        "tick": trial.tick,
        "rate": trial.about["rate"],
        "units": units.content,
        "paths": paths.content,
        "fields": fields.content,
    }
    need("scipy.io", "a MATLAB file").savemat(
        path, {VARIABLE: fill_empty(made)}, long_field_names=True, oned_as="column"
    )


class Struct:
    """Nested dicts with legal names. taken : names that are not available at the outermost level"""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self.content: dict[str, Any] = {}
        self.taken = set(taken)
        self.names, self.inside = {}, {}  # {(name, is a leaf): legal name}, {legal name: Struct}

    def put(self, names: list[str], leaf: Any) -> None:
        """Add a leaf. names : names from the outermost level to the leaf"""
        first, *rest = names
        key = first, not rest
        name = self.names.get(key)
        if name is None or not rest:
            name = self.names[key] = legal(first, self.taken)
            self.taken.add(name)
        if not rest:
            self.content[name] = leaf
            return
        inner = self.inside.get(name)
        if inner is None:
            inner = self.inside[name] = Struct()
            self.content[name] = inner.content
        inner.put(rest, leaf)


def legal(name: str, taken: set[str]) -> str:
    """Return a similar name that MATLAB accepts and that is not taken."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", name)[:NAME_LENGTH_LIMIT]
    if not name or not name[0].isalpha() or name in KEYWORDS:
        name = f"x{name}"
    return unique(name, taken.__contains__, NAME_LENGTH_LIMIT)


def fill_empty(content: dict[str, Any]) -> dict[str, Any]:
    """Replace structs without fields, which cannot be written, by an empty value."""
    return {name: (fill_empty(value) or []) if isinstance(value, dict) else value for name, value in content.items()}

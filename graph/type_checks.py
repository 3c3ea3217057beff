"""Checks of a compile: both ends of a wire have the same dtype, shape and unit."""

from __future__ import annotations

import numpy as np

from graph import hints, units
from graph.compilation import Compilation
from graph.inference import infer_shapes, infer_units
from graph.signal import Signal

NARROW_TO_WIDE = ("bool", "int", "float")  # each holds the ones before it


def check_dtypes(compilation: Compilation) -> None:
    """Check the dtype of each wire: bool converts to int and int to float, but not the reverse.

    A signal with the unit "any" may have any dtype.
    """
    for (block, name), source in compilation.wired_inputs():
        wanted = block.inputs[name].dtype
        if isinstance(source, Signal):
            declared = source.declaration
            fits = NARROW_TO_WIDE.index(declared.dtype) <= NARROW_TO_WIDE.index(wanted) or declared.unit == units.ANY
            got = f"{declared.dtype}{compilation.origin(source)}"
        else:
            fits = wanted == "float" or np.all(
                np.isin(source, (0, 1)) if wanted == "bool" else np.isfinite(source) & (source == np.rint(source))
            )
            got = f"{source}"
        if not fits:
            compilation.report(
                "TW008",
                f"expected {wanted}, got {got}",
                block,
                name,
                compilation.where(block, name),
                'compare it with a threshold, as in Compare(">")(signal, 0.5)'
                if wanted == "bool"
                else "insert a Round",
            )


def check_shapes(compilation: Compilation) -> None:
    """Infer the shape of each port, and report connections between different shapes."""
    compilation.shapes = infer_shapes(compilation.blocks, compilation.sources)
    for (block, name), source in compilation.wired_inputs():
        wanted = compilation.shapes[block, name]
        got = compilation.shapes[source.block, source.port] if isinstance(source, Signal) else source.shape
        scalar_constant = not isinstance(source, Signal) and got == ()
        if wanted != got and not scalar_constant:
            compilation.report(
                "TW003",
                f"expected shape {wanted}, got {got}{compilation.origin(source)}",
                block,
                name,
                compilation.where(block, name),
            )


def check_units(compilation: Compilation) -> None:
    """Infer the unit of each port, and report connections between different units."""
    compilation.units, shared = infer_units(compilation.blocks, compilation.sources, compilation.attempt)
    compilation.shared_units = shared
    for (block, name), source in compilation.wired_inputs():
        unit = block.inputs[name].unit
        if unit == units.ANY:
            unit = units.ANY if name in block.free_units else shared.get(block, units.ANY)
        got = compilation.units[source.block, source.port] if isinstance(source, Signal) else units.ANY
        if units.ANY not in (unit, got) and unit != got:
            compilation.report(
                "TW002",
                f"expected {unit}, got {got}{compilation.origin(source)}",
                block,
                name,
                compilation.where(block, name),
                unit_hint(compilation, got, unit)
                or hints.for_factor(source, got, unit)
                or hints.for_output(source, unit, compilation.units),
            )


def unit_hint(compilation: Compilation, got: str, wanted: str) -> str:
    """Return how to convert one unit to another explicitly; "" if that is impossible."""
    try:
        units.conversion(got, wanted)
    except ValueError:
        return ""
    return f"units are not converted implicitly: connect signal.to({wanted!r})"

"""Checks of a compile: names, wires, and what computes a block."""

from __future__ import annotations

import numpy as np

from graph import hints
from graph.block import Block, Sink
from graph.compilation import Compilation
from graph.device import Device
from graph.diagnostics import DiagramError
from graph.names import check_name
from graph.signal import Signal
from graph.upstream import computes


def check_names(compilation: Compilation) -> None:
    """Report names that are used twice, subsystems that were not entered, and invalid names of buses."""
    for part in compilation.diagram.not_entered:
        compilation.report(
            "TW019",
            f"subsystem({part.name!r}) contains no blocks, since no `with` enters it",
            where=part.where,
            hint=f"write `with subsystem({part.name!r}):`, and indent its blocks",
        )
    for wanted, block in compilation.diagram.duplicates:
        first = compilation.diagram[wanted]
        compilation.report(
            "TW009",
            f"the name {wanted!r} is already used by the block made at {first.location}",
            where=block.location,
            hint="choose a different `name=`",
        )
    for block in compilation.blocks:
        if isinstance(block, Device) and block.bus not in ("", block.path):
            try:
                # a line has the path of its device
                for part in block.bus.split("/") if block.medium == "stream" else [block.bus]:
                    check_name(part, block.location)
            except DiagramError as error:
                [wrong] = error.diagnostics
                compilation.report("TW010", f"its bus: {wrong.message}", block, "", block.location, wrong.hint)


def check_wires(compilation: Compilation) -> None:
    """Find the source of each input; report inputs that are connected twice, or not at all."""
    for wire in compilation.diagram.wires:
        if wire.block.variadic:
            label = wire.port or wire.source.path
            compilation.taps.setdefault(wire.block, []).append((label, wire.source))
            continue
        key = (wire.block, wire.port or "")
        if key in compilation.sources:
            compilation.report(
                "TW004",
                f"is already wired at {compilation.wires[key].where}",
                wire.block,
                wire.port,
                wire.where,
                f"make another {type(wire.block).__name__} for the other signal, or combine the two with a Sum or a "
                "Switch",
            )
            continue
        compilation.sources[key] = (
            wire.source if isinstance(wire.source, Signal) else np.asarray(wire.source, dtype=float)
        )
        compilation.wires[key] = wire
    for block in compilation.blocks:
        for name, port in block.inputs.items():
            if isinstance(block, Sink) and isinstance(signal := compilation.sources.get((block, name)), Signal):
                compilation.taps.setdefault(block, []).append((name, signal))
            if (block, name) in compilation.sources:
                continue
            if port.default is None:
                compilation.report(
                    "TW001",
                    f"the input is not connected and has no default [{port.unit}]",
                    block,
                    name,
                    hint=hints.for_assignment(block)
                    or hints.for_attribute(block)
                    or f"wire it, as in {block.path.split('/')[-1]}({name}=...)",
                )
            compilation.sources[block, name] = np.asarray(0.0 if port.default is None else port.default, dtype=float)


def is_marked(block: Block) -> bool:
    """Return whether a block has Python code to compile."""
    python = block.is_python or block.continuous and block.has_python_update
    return block.jit and python and not block.hold_exceptions


def compile_marked(compilation: Compilation) -> None:
    """Compile the Python blocks with `jit = True` to kernels, if Numba is installed."""
    marked = [block for block in compilation.blocks if is_marked(block)]
    if not marked:
        return
    from graph import jit

    for block in marked:
        if not jit.available():
            compilation.report(
                "TW023",
                "runs in Python because Numba is not installed",
                block,
                hint="pip install 'tickwork[jit]'",
                severity="warning",
            )
            continue
        try:
            jit.compile_block(block)
        except jit.CannotCompile as error:
            compilation.report("TW017", str(error), block, hint="use numbers only, or remove `jit = True`")


def check_steps(compilation: Compilation) -> None:
    """Report blocks without a step or a kernel."""
    for block in compilation.blocks:
        works = computes(block) or block.update_kernel is not None or block.has_python_update and not block.outputs
        if not works and not isinstance(block, (Device, Sink)):
            compilation.report(
                "TW015",
                f"{type(block).__name__} has neither a step nor a kernel",
                block,
                hint=f"define step(self, {', '.join(block.inputs)})" if block.inputs else "define step(self)",
            )


def check_use(compilation: Compilation) -> None:
    """Warn of blocks whose outputs are not connected, unless a sink records everything."""
    used = {wire.source.block for wire in compilation.diagram.wires if isinstance(wire.source, Signal)}
    used |= {condition.block for block in compilation.blocks for condition in block.conditions}
    if any(isinstance(block, Sink) and block not in compilation.taps for block in compilation.blocks):
        return
    for block in compilation.blocks:
        if block.outputs and block not in used and not isinstance(block, Device):
            compilation.report("TW020", "its outputs are not connected or recorded", block, severity="warning")

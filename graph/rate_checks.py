"""Checks of a compile: rates and conditions of subsystems."""

from __future__ import annotations

from typing import TYPE_CHECKING

from graph.block import Sink
from graph.compilation import Compilation
from graph.device import Actuator, Device
from graph.rules import held_bounds_of
from graph.signal import Signal

if TYPE_CHECKING:
    import numpy as np

    from graph.block import Block


def check_always(compilation: Compilation, block: Block) -> None:
    """Check that a block with `always` and its sources run in every tick."""
    if block.every != 1:
        compilation.report(
            "TW018",
            f"runs every {block.every} ticks, but must run in every tick",
            block,
            hint="move it out of the slow subsystem",
        )
    if block.conditions:
        compilation.report(
            "TW018",
            f"does not run while {names_of(block.conditions)} is false",
            block,
            hint="move it out of the subsystem",
        )
    for name in block.inputs:
        source = compilation.sources[block, name]
        if isinstance(source, Signal) and source.block.conditions:
            compilation.report(
                "TW018",
                f"{source.path} keeps its last value while {names_of(source.block.conditions)} is false",
                block,
                name,
                compilation.where(block, name),
                f"move {source.block.path} out of the subsystem",
            )


def check_rates(compilation: Compilation) -> None:
    """Report what the rates and conditions of subsystems do not permit, and find held signals."""
    for block in compilation.blocks:
        if block.every != 1 and (isinstance(block, Device) or isinstance(block, Sink) and not block.accepts_every):
            compilation.report(
                "TW014",
                f"runs every {block.every} ticks, but a "
                f"{'device' if isinstance(block, Device) else 'viewer'} must run in every tick",
                block,
                hint="move it out of the slow subsystem; blocks that use its outputs may remain there",
            )
        if block.always:
            check_always(compilation, block)
        for name in block.inputs:
            source = compilation.sources[block, name]
            if not isinstance(source, Signal) or isinstance(block, (Device, Sink)) or source.block.every == block.every:
                continue
            slow, fast = max(source.block.every, block.every), min(source.block.every, block.every)
            if slow % fast and not (block.resamples or source.block.resamples):
                compilation.report(
                    "TW014",
                    f"runs at every {block.every} ticks, and {source.path} at every "
                    f"{source.block.every}: neither divides the other",
                    block,
                    name,
                    compilation.where(block, name),
                    f"insert a Hold(every={block.every}), which samples the signal",
                )
            else:
                compilation.holds.append((source.path, source.block.every, f"{block.path}.{name}", block.every))
    for block in compilation.blocks:
        if isinstance(block, Actuator):
            for name in block.inputs:
                source = held_source(compilation, compilation.sources[block, name])
                if source is not None and not block.conditions:
                    conditions = names_of(source.block.conditions)
                    late = late_parameters(compilation, source)
                    compilation.report(
                        "TW021",
                        f"{source.path} keeps its last value while {conditions} is false"
                        + (f"; live changes of {', '.join(late)} take effect when it is true again" if late else ""),
                        block,
                        name,
                        compilation.where(block, name),
                        "connect a Switch after the subsystem that selects 0 while it is disabled",
                        "warning",
                    )


def held_source(compilation: Compilation, source: np.ndarray | Signal | None) -> Signal | None:
    """Return the output of a conditional block that alone determines a source, such as that before a limiter."""
    seen = set()
    while isinstance(source, Signal) and source not in seen and not isinstance(source.block, Device):
        if source.block.conditions:
            return source
        seen.add(source)
        inputs = (compilation.sources[source.block, name] for name in source.block.inputs)
        signals = {each for each in inputs if isinstance(each, Signal)}
        source = signals.pop() if len(signals) == 1 else None
    return None


def late_parameters(compilation: Compilation, source: Signal) -> list[str]:
    """Return the live parameters behind a held signal that do not bound it while its block does not run."""
    bounds = held_bounds_of(source.block, source.block.held_within).get(source.port, ())
    at_once = {f"{source.block.path}.{name}" for side in bounds for name, _ in side.terms}
    found, waiting = {source.block}, [source.block]
    while waiting:
        block = waiting.pop()
        sources = (compilation.sources[block, name] for name in block.inputs)
        before = {each.block for each in sources if isinstance(each, Signal) and each.block.conditions}
        waiting += before - found
        found |= before
    names = (f"{block.path}.{name}" for block in found for name in block.parameters if block.live(name))
    return sorted(name for name in names if name not in at_once)


def names_of(conditions: tuple[Signal, ...]) -> str:
    """Return the paths of conditions, joined by "and"."""
    return " and ".join(signal.path for signal in conditions)

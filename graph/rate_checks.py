"""Checks of a compile: rates and conditions of subsystems."""

from __future__ import annotations

from typing import TYPE_CHECKING

from graph.block import Sink
from graph.compilation import Compilation
from graph.device import Actuator, Device
from graph.signal import Signal

if TYPE_CHECKING:
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
    """Report what the rates and conditions of subsystems do not permit, and find signals held between rates."""
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
        if block.continuous and any(isinstance(device, Actuator) for device in compilation.devices):
            compilation.report(
                "TW038",
                "has continuous states, and this diagram commands actuators",
                block,
                hint="move it to the plant, the diagram that `plant(robot)` returns, or use a discrete block",
            )
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


def names_of(conditions: tuple[Signal, ...]) -> str:
    """Return the paths of conditions, joined by "and"."""
    return " and ".join(signal.path for signal in conditions)

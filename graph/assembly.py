"""Last stage of a compile: allocate arena slots to the checked and sorted blocks and build the schedule."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec.structs import replace

from cext.rules import LiveRule
from graph.arena_layout import Layout, kernel_table, place_memory, place_parameters, size_of
from graph.block import Sink
from graph.class_checks import CLOCK
from graph.device import Device
from graph.device_assembly import DeviceAssembly
from graph.diagnostics import Diagnostic, DiagramError
from graph.interval import EVERYTHING
from graph.kernel_items import CHECKED, check_kernels
from graph.rules import held_bounds_of
from graph.schedule import Column, HeldBound, LiveParameter, Schedule, SignalPlace, SinkColumns, Step
from graph.signal import Signal
from graph.upstream import computes, upstream

if TYPE_CHECKING:
    from cext.kernel import Kernel
    from graph.arena_layout import KernelTable
    from graph.block import Block
    from graph.compilation import Compilation
    from graph.declarations import Output


def assemble(compilation: Compilation) -> Schedule:
    """Return the Schedule of a Compilation without errors."""
    return Assembly(compilation).schedule()


class Assembly:
    """Arena layout and steps of one compile. compilation : a Compilation without errors"""

    def __init__(self, compilation: Compilation) -> None:
        self.compilation = compilation
        self.blocks = compilation.blocks
        self.layout = Layout()
        # In the order of the tick, for locality of memory accesses.
        self.in_order = [block for block in self.blocks if not computes(block)] + compilation.order
        self.native = [block for block in self.in_order if not block.is_python and not isinstance(block, Sink)]
        self.places = self.place_outputs(block for block in self.in_order if not block.conditions)
        self.constants = {
            (block, name): self.layout.place(np.broadcast_to(source, compilation.shapes[block, name]))
            for block in self.in_order
            if not isinstance(block, Sink)
            for name in block.inputs
            if not isinstance(source := compilation.sources[block, name], Signal)
        }
        for block in self.native:
            if not CHECKED.isdisjoint(vars(block)):  # else the check of its class holds for it
                try:
                    check_kernels(block)
                except TypeError as error:
                    raise DiagramError(Diagnostic("TW010", str(error), block.path, where=block.location)) from None
        parameters = {block: place_parameters(block, self.layout) for block in self.native}
        self.held_start = len(self.layout)
        self.places |= self.place_outputs(block for block in self.in_order if block.conditions)
        self.memory_start = len(self.layout)
        self.memory = memory = {block: place_memory(block, self.layout) for block in self.native}
        self.parameters = {
            f"{block.path}.{name}": slot for block in self.native for name, slot in parameters[block].items()
        }
        self.items = {  # {native block: {name: (slot, length)}}
            block: {name: (self.input_slot(block, name), self.size(block, name)) for name in block.inputs}
            | {name: (self.places[Signal(block, name)].slot, self.size(block, name)) for name in block.outputs}
            | {name: (slot, 1) for name, slot in parameters[block].items()}
            | memory[block]
            for block in self.native
        }

    def place_outputs(self, blocks: Iterable[Block]) -> dict[Signal, SignalPlace]:
        """Reserve the slots of all outputs of blocks."""
        return {
            Signal(block, name): self.place_signal(block, name, port)
            for block in blocks
            for name, port in block.outputs.items()
        }

    def place_signal(self, block: Block, name: str, port: Output) -> SignalPlace:
        """Reserve the slots of an output in the arena, and return its place."""
        shape = self.compilation.shapes[block, name]
        slot = self.layout.reserve(size_of(shape))
        return SignalPlace(
            f"{block.path}.{name}", slot, shape, port.dtype, self.compilation.units[block, name], port.circle
        )

    def size(self, block: Block, name: str) -> int:
        """Return the number of slots of a port. name : name of the port"""
        return size_of(self.compilation.shapes[block, name])

    def input_slot(self, block: Block, name: str) -> int:
        """Return the first slot that an input reads: of the signal that is connected to it, or of its constant."""
        source = self.compilation.sources[block, name]
        return self.places[source].slot if isinstance(source, Signal) else self.constants[block, name]

    # Steps

    def native_step(self, block: Block, kernel: Kernel) -> Step:
        """Return the step that calls a kernel of a block."""
        return Step(block.path, block.every, self.conditions(block), kernel=kernel, table=self.table(block, kernel))

    def table(self, block: Block, kernel: Kernel) -> KernelTable:
        """Return the table with the slots of the items that a kernel names."""
        return kernel_table(block, kernel, self.items[block])

    def python_step(
        self, block: Block, method: Callable[..., Any], names: Sequence[str], outputs: dict[str, Output]
    ) -> Step:
        """Return the step that calls a Python method of a block.

        method : bound method
        names : names of the method's arguments
        outputs : outputs that the method returns, in order
        """
        # CPython 3.11 and 3.12 read attributes slowly from a dict that shares its keys with those of other instances,
        # once vars() has made it: a step would take half as long again.
        block.__dict__ = dict(vars(block))
        return Step(
            block.path,
            block.every,
            self.conditions(block),
            function=method,
            inputs=tuple(self.argument(block, name) for name in names),
            outputs=tuple(self.result(block, name, port) for name, port in outputs.items()),
            hold=block.hold_exceptions,
        )

    def conditions(self, block: Block) -> tuple[int, ...]:
        """Return the slots of the signals that must be true for a block to run."""
        return tuple(self.places[condition].slot for condition in block.conditions)

    def argument(self, block: Block, name: str) -> tuple[str, int, str, tuple[int, ...]]:
        """Return (name, slot, dtype, shape) of an argument of a Python method: an input, `t`, `dt` or `tick`."""
        if name in CLOCK and name not in block.inputs:
            return name, CLOCK[name], "int" if name == "tick" else "float", ()
        return name, self.input_slot(block, name), block.inputs[name].dtype, self.compilation.shapes[block, name]

    def result(self, block: Block, name: str, port: Output) -> tuple[str, int, str, tuple[int, ...], float, float]:
        """Return (name, slot, dtype, shape, low, high) of an output that a Python method returns."""
        declared = port.range or EVERYTHING
        return (
            name,
            self.places[Signal(block, name)].slot,
            port.dtype,
            self.compilation.shapes[block, name],
            declared.low,
            declared.high,
        )

    def output_step(self, block: Block) -> Step:
        """Return the step that computes the outputs of a block."""
        if block.is_python:
            step = self.python_step(block, block.step, block.step_inputs(), block.outputs)
        else:
            step = self.native_step(block, block.kernel)
        return replace(step, allowance=block.allowance) if block.allowance else step

    def settle_step(self, block: Block) -> Step | None:
        """Return the step that sets the steady state of the present inputs, or None."""
        if block.settle_kernel is not None:
            return self.native_step(block, block.settle_kernel)
        if block.is_python and hasattr(block, "settle"):
            return self.python_step(block, block.settle, block.arguments_of("settle"), {})
        return None

    def update_steps(self) -> list[Step]:
        """Return the steps of the update phase, those with the same rate and conditions together.

        The integration of continuous states comes last: the others read the signals of the tick.
        """
        steps = [
            self.native_step(block, block.update_kernel) for block in self.blocks if block.update_kernel is not None
        ]
        steps += [
            self.python_step(block, block.update, block.update_inputs(), {})
            for block in self.blocks
            if block.has_python_update and not block.continuous
        ]
        steps.sort(key=lambda step: (step.every, step.conditions, step.kernel is None))
        if any(block.continuous for block in self.blocks):
            from graph.continuous import integration

            steps += integration(self)
        return steps

    # Schedule

    def schedule(self) -> Schedule:
        """Return the Schedule."""
        compilation = self.compilation
        output = [self.output_step(block) for block in compilation.order]
        settle = {block: step for block in compilation.order if (step := self.settle_step(block)) is not None}
        seen = upstream(settle, compilation.sources)  # no other step runs before its first tick
        look = [
            step
            for block, step in zip(compilation.order, output)
            if block in seen
            for step in (settle.get(block), step)
            if step is not None
        ]
        buses = sorted({block.bus for block in self.blocks if isinstance(block, Device)})
        columns, recorded, sinks = self.recorded()
        live = self.live_parameters()
        arena = self.layout.arena()
        devices = sorted(
            (DeviceAssembly(self, block).steps(buses) for block in self.blocks if isinstance(block, Device)),
            key=lambda d: d.bus,
        )
        for watch in (device.watch for device in devices if device.watch is not None and device.watch.law_limit >= 0):
            arena[watch.law_limit] = watch.full
        return Schedule(
            name=compilation.diagram.name,
            rate=compilation.diagram.rate,
            arena=arena,
            held_start=self.held_start,
            memory_start=self.memory_start,
            look=look,
            settle=list(settle.values()),
            output=output,
            update=self.update_steps(),
            devices=devices,
            buses=buses,
            media=[
                next(block.medium for block in self.blocks if isinstance(block, Device) and block.bus == bus)
                for bus in buses
            ],
            signals={place.path: place for place in self.places.values()},
            columns=columns,
            recorded=recorded,
            sinks=sinks,
            python_blocks=[block for block in self.blocks if block.is_python or block.has_python_update],
            inputs={
                block.path: {
                    name: self.items[block][name][0] if block in self.items else self.input_slot(block, name)
                    for name in block.inputs
                    if compilation.shapes[block, name] == ()
                }
                for block in self.blocks
                if not isinstance(block, Sink)
            },
            parameters=self.parameters,
            items={block.path: items for block, items in self.items.items()},
            live=live,
            live_rules=self.live_rules(live),
            held_bounds=self.held_bounds(live),
            proofs=compilation.proofs,
            torque_bounds=compilation.torque_bounds,
            caveats=compilation.caveats,
            holds=compilation.holds,
            loads=compilation.loads,
            warnings=[diagnostic for diagnostic in compilation.diagnostics if diagnostic.severity == "warning"],
        )

    def live_parameters(self) -> list[LiveParameter]:
        """Return a LiveParameter for each parameter that may change while running."""
        parameters: list[LiveParameter] = []
        # the switches of drives last, after the parameters that an operator changes more often
        for block in sorted(self.blocks, key=lambda block: isinstance(block, Device)):
            for name, param in block.parameters.items():
                bounds = block.live(name)
                if bounds is None or isinstance(block, Sink):
                    continue
                path = f"{block.path}.{name}"
                parameters.append(
                    LiveParameter(
                        path,
                        self.parameters.get(path, -1),
                        block if block.is_python or block.has_python_update else None,
                        name,
                        param.dtype.__name__,
                        param.unit,
                        param.description,
                        float(getattr(block, name)),
                        float(bounds.min),
                        float(bounds.max),
                        float(bounds.slew),
                    )
                )
        return parameters

    def live_rules(self, live: Sequence[LiveParameter]) -> list[LiveRule]:
        """Return a LiveRule for each rule between live parameters. live : parameters in the order of their indices"""
        rules: list[LiveRule] = []
        for block, own in self.live_indices(live):
            for rule in block.applying_rules():
                folded = rule.folded(own, block.__getattribute__)
                if folded.keys and math.isfinite(folded.left.constant + folded.right.constant):
                    rules.append(LiveRule(block.path, folded))
        return rules

    def held_bounds(self, live: Sequence[LiveParameter]) -> list[HeldBound]:
        """Return a HeldBound for each output and memory that live parameters bound while its block does not run."""
        bounds: list[HeldBound] = []
        for block, own in self.live_indices(live):
            if not (block.conditions or block.every != 1 or block.hold_exceptions):
                continue
            for name, sides in held_bounds_of(block, block.held_within).items():
                low, high = (side.folded(own, block.__getattribute__) for side in sides)
                if not low.terms and not high.terms or name in block.memory and block not in self.memory:
                    continue
                slot, size = (
                    self.memory[block][name]
                    if name in block.memory
                    else (self.places[Signal(block, name)].slot, self.size(block, name))
                )
                bounds.append(HeldBound(slot, size, low, high))
        return bounds

    def live_indices(self, live: Sequence[LiveParameter]) -> Iterator[tuple[Block, dict[str, int]]]:
        """Yield each block with live parameters, and their indices by name. live : parameters in their order"""
        index = {parameter.path: place for place, parameter in enumerate(live)}
        for block in self.blocks:
            own = {name: index[path] for name in block.parameters if (path := f"{block.path}.{name}") in index}
            if own:
                yield block, own

    def recorded(self) -> tuple[np.ndarray, list[Column], list[SinkColumns]]:
        """Return (slots of all recorded numbers, Column of each, SinkColumns of each sink)."""
        slots: list[int] = []
        recorded: list[Column] = []
        sinks: list[SinkColumns] = []
        index_of: dict[int, int] = {}
        everything = [
            (place.path, signal) for signal, place in sorted(self.places.items(), key=lambda item: item[1].path)
        ]
        for block in self.blocks:
            if not isinstance(block, Sink):
                continue
            columns: list[Column] = []
            for label, signal in self.compilation.taps.get(block) or everything:
                place = self.places[signal]
                for offset in range(place.size):
                    slot = place.slot + offset
                    where = "".join(f"[{i}]" for i in np.unravel_index(offset, place.shape)) if place.shape else ""
                    if slot not in index_of:
                        index_of[slot] = len(slots)
                        slots.append(slot)
                        recorded.append(
                            Column(index_of[slot], place.path + where, place.dtype, place.unit, place.circle)
                        )
                    columns.append(Column(index_of[slot], label + where, place.dtype, place.unit, place.circle))
            sinks.append(SinkColumns(block, tuple(columns)))
        return np.array(slots, dtype=np.int32), recorded, sinks

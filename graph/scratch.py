"""Execution of one native block on an arena of its own, for `block.step(...)` outside a run."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from cext.schedule.kernel_table import call_kernel
from graph.arena_layout import Layout, kernel_table, place_memory, place_parameters, size_of
from graph.kernel_items import check_kernels

if TYPE_CHECKING:
    from cext.kernel import Kernel
    from graph.arena_layout import KernelTable

TYPES = {"float": float, "int": int, "bool": bool}  # of a scalar output, by the dtype of its port

NEEDS_PERIOD = (
    "{} needs a sampling period: make it inside `with Diagram(..., rate=...)`, or set its dt, in s, before the first "
    "step"
)


class Scratch:
    """Arena and kernel tables of one block, for single steps outside a tick."""

    def __init__(self, block: Any) -> None:
        if block.kernel is None and block.update_kernel is None:
            raise TypeError(f"{block.path} cannot be stepped: {type(block).__name__} has neither a step nor a kernel")
        self.block = block
        self.arena: Any = None  # made at the first step, when shapes are known

    def build(self, inputs: dict[str, Any]) -> None:
        """Reserve the arena of the block. inputs : {name: value}, which decide the free shape

        Raises TypeError if the block needs a sampling period and has none.
        """
        block = self.block
        given = (np.shape(inputs[n]) for n, p in block.inputs.items() if p.shape is ...)
        free = next((shape for shape in given if shape), ())
        self.shapes = {n: free if p.shape is ... else p.shape for n, p in (block.inputs | block.outputs).items()}
        block.width = size_of(free)
        try:
            block.prepare(block.dt)
        except TypeError:
            if block.dt is not None:
                raise
            raise TypeError(NEEDS_PERIOD.format(block.path)) from None
        check_kernels(block)
        layout = Layout()
        sizes = {n: size_of(shape) for n, shape in self.shapes.items()}
        self.slots_of = {n: layout.reserve(sizes[n]) for n in self.shapes}
        self.parameters = place_parameters(block, layout)
        self.memory_start = len(layout)
        memory = place_memory(block, layout)
        self.items = {name: (slot, sizes[name]) for name, slot in self.slots_of.items()}
        self.items |= {name: (slot, 1) for name, slot in self.parameters.items()} | memory
        self.tables: dict[Kernel, KernelTable] = {}
        self.arena = layout.arena()
        self.memory = self.arena[self.memory_start :].copy()
        self.arena[6] = 1.0
        self.tick = 0
        period = 1.0 if block.dt is None else block.dt  # without one, no result depends on it: see `call`
        self.arena[2:4] = period
        self.rate = 1.0 / period

    def restart(self) -> None:
        """Reset the memory as at the start of a run, without a call of `prepare`."""
        if self.arena is not None:
            self.arena[self.memory_start :] = self.memory
            self.tick = 0

    def load(self, values: tuple[float, ...], named: dict[str, float], needed: Iterable[str]) -> None:
        """Write the inputs to the arena. needed : names of the inputs that the kernel reads"""
        block = self.block
        names = list(block.inputs)
        if len(values) > len(names) or set(named) - set(names):
            raise TypeError(f"{type(block).__name__} takes {', '.join(names) or 'no inputs'}")
        inputs = {n: p.default for n, p in block.inputs.items()}
        inputs.update(zip(names, values))
        inputs.update(named)
        missing = [n for n, value in inputs.items() if value is None and n in needed]
        if missing:
            raise TypeError(f"{type(block).__name__} takes {', '.join(names)}: {missing[0]} has no value")
        if self.arena is None:
            self.build(inputs)
        arena: Any = self.arena
        for name, value in inputs.items():
            if value is None:
                continue
            slot = self.slots_of[name]
            if isinstance(value, (float, int)) and not self.shapes[name]:
                arena[slot] = value
            else:
                arena[slot : slot + size_of(self.shapes[name])] = np.ravel(value)
        for name, slot in self.parameters.items():
            value = getattr(block, name)
            arena[slot] = np.nan if value is None else value

    def table(self, kernel: Kernel) -> KernelTable:
        """Return the KernelTable of a kernel of the block."""
        if kernel not in self.tables:
            self.tables[kernel] = kernel_table(self.block, kernel, self.items)
        return self.tables[kernel]

    def call(self, kernel: Kernel) -> None:
        """Call a kernel of the block on its arena.

        Raises ArithmeticError at a status other than 0, and TypeError if the result depends on the sampling period and
        the block has none: the results of two periods are compared.
        """
        other: Any = None
        if self.block.dt is None:
            before = self.arena.copy()
            self.arena[[0, 2, 3]] *= 2.0
            call_kernel(kernel, self.arena, self.table(kernel))
            other, self.arena[:] = self.arena[4:].copy(), before
        status = call_kernel(kernel, self.arena, self.table(kernel))
        if status != 0:
            raise ArithmeticError(f"the kernel of {self.block.path} returned status {status}")
        if self.block.dt is None and not np.array_equal(other, self.arena[4:], equal_nan=True):
            raise TypeError(NEEDS_PERIOD.format(self.block.path))

    def step(self, values: tuple[Any, ...], named: dict[str, Any]) -> Any:
        self.load(values, named, self.block.step_inputs())
        self.arena[0], self.arena[1] = self.tick / self.rate, self.tick
        if self.block.kernel is not None:
            self.call(self.block.kernel)
        self.tick += 1
        results: list[Any] = []
        for name, port in self.block.outputs.items():
            slot, shape = self.slots_of[name], self.shapes[name]
            if shape:
                results.append(self.arena[slot : slot + size_of(shape)].reshape(shape).copy())
            else:
                value = float(self.arena[slot])
                results.append(TYPES[port.dtype](value) if math.isfinite(value) else value)
        return results[0] if len(results) == 1 else tuple(results)

    def update(self, values: tuple[Any, ...], named: dict[str, Any]) -> None:
        self.load(values, named, self.block.inputs)
        if self.block.update_kernel is not None:
            self.call(self.block.update_kernel)

"""Where things lie in the arena: the clock first, then signals and parameters, then the memory of blocks."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

CLOCK_SLOTS = 8


class KernelTable(NamedTuple):
    """What a kernel is told of its block: how many inputs, outputs, parameters and memories, where each begins, how
    long it is.
    """

    counts: tuple = (0, 0, 0, 0)
    slots: tuple = ()
    sizes: tuple = ()


class Layout:
    """Hands out slots of one arena and remembers what they hold at the start."""

    def __init__(self):
        self.values = [0.0] * CLOCK_SLOTS

    def place(self, values):
        """Slot of a run of doubles."""
        slot = len(self.values)
        self.values.extend(np.ravel(np.asarray(values, dtype=float)).tolist())
        return slot

    def __len__(self):
        return len(self.values)

    def arena(self):
        return np.array(self.values, dtype=np.float64)


def place_parameters(block, layout):
    """{name: slot} of a block's parameters that a kernel may be told of; NaN stands for one that has no value."""
    slots = {}
    for name, param in block.parameters.items():
        if param.placed:
            value = getattr(block, name)
            slots[name] = layout.place(float("nan") if value is None else value)
    return slots


def place_memory(block, layout):
    """{name: (slot, length)} of a block's memory: what `prepare` has set, else what is declared."""
    places = {}
    for name, memory in block.memory.items():
        value = vars(block).get(name)
        values = np.ravel(np.asarray(memory.initial if value is None else value, dtype=float))
        places[name] = layout.place(values), len(values)
    return places


def kernel_table(inputs, outputs, parameters, memory):
    """The KernelTable of a block. inputs, outputs, memory : lists of (slot, length); parameters : list of slots."""
    items = [*inputs, *outputs, *((slot, 1) for slot in parameters), *memory]
    counts = len(inputs), len(outputs), len(parameters), len(memory)
    return KernelTable(counts, tuple(slot for slot, _ in items), tuple(length for _, length in items))


def size_of(shape: Sequence[int]) -> int:
    """Return the number of elements of an array of this shape."""
    return math.prod(shape)

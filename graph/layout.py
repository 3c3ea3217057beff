"""Where things lie in the arena: the clock first, then what each block needs, in the order of its declaration."""

from typing import NamedTuple

import numpy as np

CLOCK_SLOTS = 8


class KernelTable(NamedTuple):
    """What a kernel is told of its block: how many inputs, outputs, parameters and memories, where each begins, how long it is."""

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

    def arena(self):
        return np.array(self.values, dtype=np.float64)


def memory_values(block, name):
    """What a block's memory holds at reset: what `prepare` has set, else what is declared."""
    value = block.__dict__.get(name)
    return np.atleast_1d(np.asarray(block.memory[name].initial if value is None else value, dtype=float))



def kernel_tables(block, layout, input_slots, output_slots, input_sizes, output_sizes):
    """The KernelTable of a native block: inputs, outputs, parameters, memory. Places the last two in the layout."""
    slots = list(input_slots) + list(output_slots)
    sizes = list(input_sizes) + list(output_sizes)
    for name, param in block.parameters.items():
        if param.numeric:
            value = getattr(block, name)
            slots.append(layout.place([float("nan") if value is None else value]))
            sizes.append(1)
    for name in block.memory:
        values = memory_values(block, name)
        slots.append(layout.place(values))
        sizes.append(len(values))
    parameters = sum(param.numeric for param in block.parameters.values())
    return KernelTable((len(input_slots), len(output_slots), parameters, len(block.memory)), tuple(slots), tuple(sizes))

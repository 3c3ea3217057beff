"""Layout of the arena: the clock, then signals and parameters, then the memory of blocks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from graph.kernel_items import rest_of

if TYPE_CHECKING:
    from cext.kernel import Kernel

CLOCK_SLOTS = 8


class KernelTable(NamedTuple):
    """The two tables that a kernel is called with: the position of each of its items, and its number of doubles."""

    slots: tuple = ()
    sizes: tuple = ()


class Layout:
    """Allocator of the slots of one arena, with their initial values."""

    def __init__(self) -> None:
        self.values = [0.0] * CLOCK_SLOTS

    def place(self, values: float | np.ndarray) -> int:
        """Allocate consecutive slots for values. Returns the first."""
        slot = len(self.values)
        self.values.extend(np.ravel(np.asarray(values, dtype=float)).tolist())
        return slot

    def __len__(self):
        return len(self.values)

    def arena(self) -> np.ndarray:
        """Return the arena as an array of float64 with the initial values."""
        return np.array(self.values, dtype=np.float64)


def place_parameters(block: Any, layout: Layout) -> dict[str, int]:
    """Allocate the numeric parameters of a block, NaN for None. Returns {name: slot}."""
    slots = {}
    for name, param in block.parameters.items():
        if param.placed:
            value = getattr(block, name)
            slots[name] = layout.place(float("nan") if value is None else value)
    return slots


def place_memory(block: Any, layout: Layout) -> dict[str, tuple[int, int]]:
    """Allocate the memory of a block, set by `prepare` or declared. Returns {name: (slot, length)}."""
    places = {}
    for name, memory in block.memory.items():
        value = vars(block).get(name)
        values = np.ravel(np.asarray(memory.initial if value is None else value, dtype=float))
        places[name] = layout.place(values), len(values)
    return places


def size_of(shape: Sequence[int]) -> int:
    """Return the number of elements of an array of this shape."""
    return math.prod(shape)


def kernel_table(block: Any, kernel: Kernel, places: dict[str, tuple[int, int]]) -> KernelTable:
    """The KernelTable of one kernel of a block. places : {name: (slot, length)} of all that a kernel may name

    Raises TypeError if an item has another length than the kernel states, as memory that `prepare` has set.
    """
    slots, sizes = [], []
    rests = {item: [places[name] for name in rest_of(block, kernel, item.name)] for item in kernel.items if item.rest}
    first = len(kernel.items) + len(rests)
    for item in kernel.items:
        if item.rest:
            count = len(rests[item])
            slots += [count, first]
            sizes += [count, first]
            first += count
            continue
        slot, length = places[item.name]
        if item.size not in (None, length):
            raise TypeError(
                f"{block.path}: a kernel of {type(block).__name__} takes {item.size} numbers of {item.name!r}, and it "
                f"has {length}. Set memory of {item.size} numbers in prepare()"
            )
        slots.append(slot)
        sizes.append(length)
    for rest in rests.values():
        slots += [slot for slot, _ in rest]
        sizes += [length for _, length in rest]
    return KernelTable(tuple(slots), tuple(sizes))

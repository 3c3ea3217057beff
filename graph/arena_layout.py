"""Layout of the arena: the clock, then signals and parameters, then the memory of blocks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from graph.kernel_items import rest_of

if TYPE_CHECKING:
    from cext.kernel import Kernel
    from graph.declarations import Numbers

CLOCK_SLOTS = 8


class KernelTable(NamedTuple):
    """The two tables that a kernel is called with: the position of each of its items, and its number of doubles."""

    slots: tuple[int, ...] = ()
    sizes: tuple[int, ...] = ()


class Layout:
    """Allocator of the slots of one arena, with their initial values."""

    def __init__(self) -> None:
        self.values = [0.0] * CLOCK_SLOTS

    def place(self, values: Numbers) -> int:
        """Allocate consecutive slots for values. Returns the first."""
        slot = len(self.values)
        if isinstance(values, (float, int)):
            self.values.append(float(values))
            return slot
        self.values.extend(np.ravel(np.asarray(values, dtype=float)).tolist())
        return slot

    def reserve(self, count: int) -> int:
        """Allocate consecutive slots with the value 0. Returns the first."""
        slot = len(self.values)
        self.values.extend([0.0] * count)
        return slot

    def __len__(self):
        return len(self.values)

    def arena(self) -> np.ndarray:
        """Return the arena as an array of float64 with the initial values."""
        return np.array(self.values, dtype=np.float64)


def place_parameters(block: Any, layout: Layout) -> dict[str, int]:
    """Allocate the numeric parameters of a block, NaN for None. Returns {name: slot}."""
    slots: dict[str, int] = {}
    for name, param in block.parameters.items():
        if param.placed:
            value = getattr(block, name)
            slots[name] = layout.place(float("nan") if value is None else value)
    return slots


def place_memory(block: Any, layout: Layout) -> dict[str, tuple[int, int]]:
    """Allocate the memory of a block, set by `prepare` or declared. Returns {name: (slot, length)}."""
    places: dict[str, tuple[int, int]] = {}
    attributes: dict[str, Any] = block.__dict__
    for name, memory in block.memory.items():
        value = attributes.get(name)
        first = layout.place(memory.initial if value is None else value)
        places[name] = first, len(layout) - first
    return places


def size_of(shape: Sequence[int]) -> int:
    """Return the number of elements of an array of this shape."""
    return math.prod(shape)


def kernel_table(block: Any, kernel: Kernel, places: dict[str, tuple[int, int]]) -> KernelTable:
    """The KernelTable of one kernel of a block. places : {name: (slot, length)} of all that a kernel may name

    Raises TypeError if an item has another length than the kernel states, as memory that `prepare` has set.
    """
    slots: list[int] = []
    sizes: list[int] = []
    rests: list[tuple[int, int]] = []
    first = len(kernel.items) + sum(item.rest for item in kernel.items)
    for name, size, is_rest in kernel.items:
        if is_rest:
            rest = [places[each] for each in rest_of(block, kernel, name)]
            slots += [len(rest), first]
            sizes += [len(rest), first]
            first += len(rest)
            rests += rest
            continue
        slot, length = places[name]
        if size != length and size is not None:
            raise TypeError(
                f"{block.path}: a kernel of {type(block).__name__} requires {size} numbers in {name!r}, got {length}. "
                f"Set memory of {size} numbers in prepare()"
            )
        slots.append(slot)
        sizes.append(length)
    for slot, length in rests:
        slots.append(slot)
        sizes.append(length)
    return KernelTable(tuple(slots), tuple(sizes))

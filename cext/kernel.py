"""Kernels and the items that they name.

A kernel is a C function, `int kernel(double *arena, const int32_t *slots, const int32_t *sizes)`. Beside its code it
names, once, the items of a block that it works on; for each, `slots` has the position in the arena and `sizes` the
number of doubles. In Cython a struct names them, and `items` reads the names from the struct, so that code and list
cannot disagree. Both tables are of that struct:

    cdef struct Exponential:
        int32_t u, y, time_constant, state

    EXPONENTIAL = items((<Exponential *>ITEMS)[0], "u[...] y[...] state[...]")

    cdef int exponential_kernel(double *arena, const Exponential *at, const Exponential *sizes) noexcept nogil:
        cdef double share = arena[DT] / (arena[at.time_constant] + arena[DT])
        ...

    exponential = export(<kernel_t>exponential_kernel, EXPONENTIAL)

A function pointer from elsewhere is wrapped with the list: `Kernel(pointer, "u[...] y[...] time_constant state[...]")`.

The list:

    gain            one number: an input, output, parameter or memory of that name
    limits[7]       so many numbers
    u[...]          any number of them; the kernel reads it from `sizes`
    *inputs         all inputs that the list does not name, in two places of each table: their number, and the index in
                    the table from which on it has the position (or size) of each. `*outputs` has the same
                    form

In a struct the last of these is a field `Rest inputs` or `Rest outputs`. A struct may contain another one, for what
several kernels share. The schedule builds the two tables of each kernel from the names, so the order in which a block
declares its items, and what else it declares, make no difference. `graph.kernel_items` checks a class against its
kernels.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

ITEM = re.compile(r"(\*?)(\w+)(?:\[(\d+|\.\.\.)\])?")
REST = {"count", "first"}  # fields of cext.abi.Rest


class Item(NamedTuple):
    """One item of a kernel. size : number of doubles, None for any; rest : it is *inputs or *outputs"""

    name: str
    size: int | None = 1
    rest: bool = False

    def __str__(self):
        length = "" if self.size == 1 else f"[{self.size or '...'}]"
        return "*" * self.rest + self.name + length * (not self.rest)


class Kernel:
    """A native function of the kernel ABI and the names of its items.

    function : PyCapsule named by its C signature, ctypes function pointer, or Numba cfunc
    items : str, as in "u[...] y[...] gain *inputs"
    owner : object that the function uses, kept as long as the kernel
    """

    __slots__ = ("function", "items", "owner")

    def __init__(self, function: Any, items: Any, owner: Any = None) -> None:
        self.function, self.owner = function, owner
        self.items = tuple(parse_item(word) for word in items.split()) if isinstance(items, str) else tuple(items)
        names = [item.name for item in self.items]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"the kernel lists item {twice!r} twice: list each item once")

    @property
    def names(self) -> list[str]:
        """Names of the items, in their order; without *inputs and *outputs."""
        return [item.name for item in self.items if not item.rest]

    def renamed(self, **names: Any) -> Kernel:
        """The same kernel for a block that calls items otherwise: `encode.renamed(command="velocity_command")`."""
        unknown = next((name for name in names if name not in self.names), None)
        if unknown is not None:
            raise ValueError(f"the kernel has no item {unknown!r}; its items are {', '.join(self.names)}")
        return Kernel(self.function, [item._replace(name=names.get(item.name, item.name)) for item in self.items])

    def owned(self, owner: Any) -> Kernel:
        """The same kernel for one block, which keeps an object that the block's memory points to."""
        return Kernel(self.function, self.items, owner)

    def __repr__(self):
        return f"<Kernel {' '.join(map(str, self.items))}>"


def of_struct(fields: dict[str, Any], sizes: str) -> tuple[Item, ...]:
    """The Items of a C struct, given as the dict that Cython makes of one.

    sizes : str, the items that are not one number, as in "u[...] limits[7]"
    """
    stated = {item.name: item for item in map(parse_item, sizes.split())}
    items = tuple(stated.pop(item.name, item) for item in named(fields))
    if stated:
        raise ValueError(f"sizes are given for items that the struct does not have: {', '.join(stated)}")
    return items


def named(fields: dict[str, Any]) -> Iterator[Item]:
    """The Items of a struct, those of the structs in it included."""
    for name, value in fields.items():
        if not isinstance(value, dict):
            yield Item(name)
        elif set(value) == REST:
            yield parse_item("*" + name)
        else:
            yield from named(value)


def parse_item(word: str) -> Item:
    """The Item of a word such as "limits[7]". ValueError"""
    match = ITEM.fullmatch(word)
    if match is None or match[1] and (match[2] not in ("inputs", "outputs") or match[3]):
        raise ValueError(f"invalid kernel item {word!r}: write a name, name[3], name[...], *inputs or *outputs")
    size = 1 if match[3] is None else None if match[3] == "..." else int(match[3])
    return Item(match[2], size, bool(match[1]))

"""Check of a block class against its kernels: a kernel names its items, and the class declares each of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from cext.kernel import Kernel

if TYPE_CHECKING:
    from types import EllipsisType

    from cext.kernel import Item

STEPS = ("kernel", "update_kernel", "settle_kernel")
KERNELS = (*STEPS, "decode", "encode")
CHECKED = {"inputs", "outputs", "parameters", "memory", *KERNELS}  # attributes that `check_kernels` reads


def check_kernels(block: Any) -> None:
    """Raise TypeError if a block, or a block class, does not declare an item of its kernels as the kernel takes it.

    A class that is marked `abstract` may leave items to its subclasses.
    """
    kind = block if isinstance(block, type) else type(block)
    incomplete = isinstance(block, type) and vars(kind).get("abstract", False)
    for attribute in KERNELS:
        kernel = getattr(block, attribute, None)
        if kernel is None:
            continue
        if not isinstance(kernel, Kernel):
            raise TypeError(
                f"{kind.__name__}.{attribute} is {kernel!r}, which does not name its items: wrap it with their names "
                f'in the order of its slots, {attribute} = Kernel(function, "u[...] y[...] gain")'
            )
        for item in kernel.items:
            problem = None if item.rest else problem_of(block, kind, item, incomplete)
            if problem is not None:
                reason, remedy = problem
                raise TypeError(
                    f"{kind.__name__}.{attribute} needs {str(item)!r}, and {reason}: {remedy}, "
                    f"or give the class a {attribute} that does not need it"
                )


def problem_of(block: Any, kind: type, item: Item, incomplete: bool) -> tuple[str, str] | None:
    """Return the problem with the declaration of an item and its remedy, or None."""
    name = item.name
    ports = block.inputs | block.outputs
    if name in ports:
        if not getattr(ports[name], "kernel", True):
            return f"the output {name!r} is declared with kernel=False", "leave that out"
        shape = ports[name].shape
        if not fits(shape, item.size):
            size = "one number" if item.size == 1 else f"{item.size} numbers"
            shown = "..." if shape is ... else shape
            return f"{name!r} is declared with shape={shown}", f"declare a port of {size}"
    elif name in block.parameters:
        if not block.parameters[name].placed:
            reason = f"the parameter {name!r} is not a number in the arena"
            return reason, "declare a number, without kernel=False"
        if item.size != 1:
            return f"the parameter {name!r} is one number", "declare an input, an output or memory"
    elif name not in block.memory and not incomplete:
        return f"{kind.__name__} does not declare {name!r}", "declare it as an input, an output, a parameter or memory"
    return None


def fits(shape: Sequence[int] | EllipsisType, size: int | None) -> bool:
    """Return whether a port has the number of elements that a kernel takes. size : None for any"""
    return size is None or shape is not ... and math.prod(shape) == size


def rest_of(block: Any, kernel: Kernel, kind: str) -> list[str]:
    """Return the "inputs" or "outputs" of a block that a kernel does not name, in the order of declaration."""
    ports = [name for name, port in getattr(block, kind).items() if getattr(port, "kernel", True)]
    return [name for name in ports if name not in kernel.names]


def replace_kernels(kind: type) -> None:
    """Drop the kernels that a block class inherits and a step in Python replaces."""
    for name in STEPS:
        if name not in vars(kind):
            setattr(kind, name, None)

"""Guard on inherited kernels: a kernel finds its items by position, so a subclass must not change them."""

STEPS = ("kernel", "update_kernel", "settle_kernel")
KERNELS = (*STEPS, "decode", "encode")
CURES = {
    "parameter": "declare it with kernel=False and fixed=True, ",
    "output": "declare it with kernel=False, ",
    "input": "",
    "memory": "",
}


def items_of(kind):
    """[(what, name, shape)] of everything that the kernels of a block class find by position, in their order."""
    return [
        *(("input", name, port.shape) for name, port in kind.inputs.items()),
        *(("output", name, port.shape) for name, port in kind.outputs.items() if port.kernel),
        *(("parameter", name, ()) for name, param in kind.parameters.items() if param.placed),
        *(("memory", name, ...) for name in kind.memory),
    ]


def check_inherited_kernels(kind):
    """Raise TypeError if a block class inherits a kernel and changes the items that the kernel counts.

    A class that is marked `abstract` is made to be extended: its kernels find their items by the counts in front of the
    slots.
    """
    for name in KERNELS:
        kernel = getattr(kind, name, None)
        if kernel is None or name in vars(kind):
            continue
        base = next((base for base in kind.__mro__[1:] if is_fixed(base) and getattr(base, name) is kernel), None)
        if base is not None and items_of(kind) != items_of(base):
            raise TypeError(difference(kind, base, name))


def is_fixed(base):
    """Whether it is a block class with items of its own, and neither a mixin nor made to be extended."""
    return "_own" in vars(base) and not vars(base).get("abstract")


def difference(kind, base, kernel):
    """The message for the first item that differs."""
    before, after = items_of(base), items_of(kind)
    kinds_before, kinds_after = ({(what, name) for what, name, _ in items} for items in (before, after))
    added = next((item for item in after if item[:2] not in kinds_before), None)
    removed = next((item for item in before if item[:2] not in kinds_after), None)
    if added is not None:
        change, cure = f"adds the {added[0]} {added[1]!r} to {base.__name__}", CURES[added[0]]
    elif removed is not None:
        change, cure = f"removes the {removed[0]} {removed[1]!r} of {base.__name__}", f"keep the {removed[0]}, "
    else:
        what, name, _ = next(mine for mine, theirs in zip(after, before) if mine != theirs)
        moved = [item[:2] for item in after] != [item[:2] for item in before]
        change = f"changes the {'place' if moved else 'shape'} of the {what} {name!r} of {base.__name__}"
        cure = f"keep the {'order' if moved else 'shape'}, "
    return (
        f"{kind.__name__} {change}, whose {kernel} finds its items by position: {cure}give the class a {kernel} "
        "of its own, "
        "or wrap the block in a subsystem"
    )


def replace_kernels(kind):
    """Drop the kernels that a block class inherits and a step in Python replaces."""
    for name in STEPS:
        if name not in vars(kind):
            setattr(kind, name, None)

"""What the wires tell of ports declared `...` and "any": one shape and one unit a block, found along the wires.

What has been found of a port never changes again, so the work grows with the number of wires, and a loop comes to rest.
"""

from collections import deque

from graph import units
from graph.block import Block
from graph.signal import Signal


def spread(blocks, sources, visit):
    """Visit every block, and again what follows one that has become known. visit(block) says whether its outputs
    have.
    """
    followers = {}
    for (block, _), source in sources.items():
        if isinstance(source, Signal):
            followers.setdefault(source.block, []).append(block)
    waiting, queued = deque(blocks), set(blocks)
    while waiting:
        block = waiting.popleft()
        queued.discard(block)
        if visit(block):
            for follower in followers.get(block, ()):
                if follower not in queued:
                    queued.add(follower)
                    waiting.append(follower)


def infer_shapes(blocks, sources):
    """Shape by (block, port name). The shape of a block's `...` ports is that of the first such input that is no
    scalar, () if all are.

    A scalar into an input that declares `broadcast` stays one.
    """
    free = {}

    def shape_of(source):
        if not isinstance(source, Signal):
            return source.shape  # a number fits any shape
        shape = source.declaration.shape
        return free.get(source.block) if shape is ... else shape

    def visit(block):
        if block in free:
            return False
        found = [shape_of(sources[block, name]) for name, port in block.inputs.items() if port.shape is ...]
        shape = next(filter(None, found), () if patient is False and () in found else None)
        if shape is None:
            return False
        free[block] = shape
        return True

    for patient in (True, False):  # first where a vector decides; then scalars, which any vector overrules
        spread(blocks, sources, visit)

    def shape_at(block, name, port):
        if port.shape is not ...:
            return port.shape
        shape = free.get(block, ())
        return () if shape and getattr(port, "broadcast", False) and shape_of(sources[block, name]) == () else shape

    return {
        (block, name): shape_at(block, name, port)
        for block in blocks
        for name, port in (block.inputs | block.outputs).items()
    }


def infer_units(blocks, sources, attempt):
    """(unit by (block, port name), the one unit of each block's "any" ports). What nothing decides stays "any".

    attempt(block, hook, **units) calls a hook of the block's author; None if it failed, and it has been told.
    """
    known = {(block, name): port.unit for block in blocks for name, port in (block.inputs | block.outputs).items()}
    shared = {}

    def unit_of(block, name):
        source = sources[block, name]
        if block.inputs[name].unit != units.ANY or not isinstance(source, Signal):
            return block.inputs[name].unit
        return known[source.block, source.port]

    def visit(block):
        of_inputs = {name: unit_of(block, name) for name in block.inputs}
        if block not in shared:
            found = (
                of_inputs[name]
                for name, port in block.inputs.items()
                if port.unit == units.ANY and name not in block.free_units
            )
            unit = next((unit for unit in found if unit != units.ANY), None)
            if unit is not None:
                shared[block] = unit
        own = (
            attempt(block, lambda: stated_units(block, of_inputs)) or {}
            if type(block).output_units is not Block.output_units
            else {}
        )
        changed = False
        for name, port in block.outputs.items():
            if known[block, name] == units.ANY:
                known[block, name] = own[name] if name in own else shared.get(block, units.ANY)
                changed = changed or known[block, name] != units.ANY
        return changed

    spread(blocks, sources, visit)
    for block in blocks:
        for name in block.inputs:
            known[block, name] = unit_of(block, name)
    return known, shared


def stated_units(block, of_inputs):
    """What a block says of its outputs' units, canonical. ValueError if one is no unit."""
    return {name: units.canonical(unit) for name, unit in (block.output_units(**of_inputs) or {}).items()}

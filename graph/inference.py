"""Inference of shapes declared `...` and units declared "any": one shape and one unit for each block.

An inferred property never changes again, so the work is proportional to the number of wires and loops terminate.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from graph import units
from graph.block import Block
from graph.signal import Signal

if TYPE_CHECKING:
    import numpy as np

    from graph.declarations import Port
    from graph.upstream import Sources


def spread(blocks: Sequence[Block], sources: Sources, visit: Callable[[Block], bool]) -> None:
    """Visit every block, and again the followers of a block whose outputs have changed.

    visit : called with a block; returns whether a property of its outputs was inferred
    """
    followers: dict[Block, list[Block]] = {}
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


def infer_shapes(blocks: Sequence[Block], sources: Sources) -> dict[tuple[Block, str], tuple[int, ...]]:
    """Return {(block, port name): shape}.

    The ports declared `...` of a block have the shape of the first such input that is not a scalar, or () if all are
    scalars. A scalar at an input with `broadcast` remains a scalar.
    """
    free: dict[Block, tuple[int, ...]] = {}

    def shape_of(source: np.ndarray | Signal) -> tuple[int, ...] | None:
        if not isinstance(source, Signal):
            return source.shape  # a number has shape () and fits any shape
        shape = source.declaration.shape
        return free.get(source.block) if shape is ... else shape

    def visit(block: Block, allow_scalar: bool) -> bool:
        if block in free:
            return False
        shapes = [shape_of(sources[block, name]) for name, port in block.inputs.items() if port.shape is ...]
        shape = next(filter(None, shapes), () if allow_scalar and () in shapes else None)
        if shape is None:
            return False
        free[block] = shape
        return True

    has_arrays = any(shape_of(source) for source in sources.values())
    # an array at any input determines the shape; scalars only without one
    for allow_scalar in (False, True) if has_arrays else (True,):
        spread(blocks, sources, partial(visit, allow_scalar=allow_scalar))

    def shape_at(block: Block, name: str, port: Port) -> tuple[int, ...]:
        if port.shape is not ...:
            return port.shape
        shape = free.get(block, ())
        return () if shape and getattr(port, "broadcast", False) and shape_of(sources[block, name]) == () else shape

    return {
        (block, name): shape_at(block, name, port)
        for block in blocks
        for name, port in (block.inputs | block.outputs).items()
    }


def infer_units(
    blocks: Sequence[Block], sources: Sources, attempt: Callable[..., Any]
) -> tuple[dict[tuple[Block, str], str], dict[Block, str]]:
    """Return ({(block, port name): unit}, {block: unit of its ports declared "any"}).

    A port without an inferred unit keeps "any".

    attempt : called as attempt(block, hook); calls the hook of a block, reports its errors and then returns None
    """
    known = {(block, name): port.unit for block in blocks for name, port in (block.inputs | block.outputs).items()}
    shared: dict[Block, str] = {}

    def unit_of(block: Block, name: str) -> str:
        source = sources[block, name]
        if block.inputs[name].unit != units.ANY or not isinstance(source, Signal):
            return block.inputs[name].unit
        return known[source.block, source.port]

    def visit(block: Block) -> bool:
        of_inputs = {name: unit_of(block, name) for name in block.inputs}
        if block not in shared:
            candidates = (
                of_inputs[name]
                for name, port in block.inputs.items()
                if port.unit == units.ANY and name not in block.free_units
            )
            unit = next((unit for unit in candidates if unit != units.ANY), None)
            if unit is not None:
                shared[block] = unit
        own: dict[str, str] = (
            attempt(block, canonical_units, attempt(block, block.output_units, **of_inputs) or {}) or {}
            if type(block).output_units is not Block.output_units
            else {}
        )
        changed = False
        for name in block.outputs:
            if known[block, name] == units.ANY:
                known[block, name] = own[name] if name in own else shared.get(block, units.ANY)
                changed = changed or known[block, name] != units.ANY
        return changed

    spread(blocks, sources, visit)
    for block in blocks:
        for name in block.inputs:
            known[block, name] = unit_of(block, name)
    return known, shared


def canonical_units(stated: dict[str, str]) -> dict[str, str]:
    """Return the `output_units` of a block in canonical spelling. Raises ValueError for an invalid unit."""
    return {name: units.canonical(unit) for name, unit in stated.items()}

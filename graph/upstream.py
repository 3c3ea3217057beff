"""Blocks that compute, and the blocks behind others."""

from __future__ import annotations

from typing import TYPE_CHECKING

from graph.signal import Signal

if TYPE_CHECKING:
    import numpy as np

    from graph.block import Block
    from graph.schedule import Step


def computes(block: Block) -> bool:
    """Return whether a block has a step in the output phase."""
    return block.is_python or block.kernel is not None


def upstream(blocks: dict[Block, Step], sources: dict[tuple[Block, str], np.ndarray | Signal]) -> set[Block]:
    """Return the blocks and all upstream of them, with or without direct feedthrough, as a set."""
    reached, waiting = set(blocks), list(blocks)
    while waiting:
        block = waiting.pop()
        for source in (*(sources.get((block, name)) for name in block.inputs), *block.conditions):
            if isinstance(source, Signal) and source.block not in reached:
                reached.add(source.block)
                waiting.append(source.block)
    return reached

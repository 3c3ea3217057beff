"""Blocks that compute, and the blocks before and behind others."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, TypeAlias

from graph.signal import Signal

if TYPE_CHECKING:
    import numpy as np

    from graph.block import Block

Sources: TypeAlias = "dict[tuple[Block, str], np.ndarray | Signal]"
"""{(block, input name): Signal or constant array}"""


def computes(block: Block) -> bool:
    """Return whether a block has a step in the output phase."""
    return block.is_python or block.kernel is not None


def upstream(blocks: Iterable[Block], sources: Mapping[tuple[Block, str], np.ndarray | Signal]) -> set[Block]:
    """Return the blocks and all upstream of them, with or without direct feedthrough, as a set."""
    reached, waiting = set(blocks), list(blocks)
    while waiting:
        block = waiting.pop()
        for source in (*(sources.get((block, name)) for name in block.inputs), *block.conditions):
            if isinstance(source, Signal) and source.block not in reached:
                reached.add(source.block)
                waiting.append(source.block)
    return reached


def followers_of(sources: Sources) -> dict[Signal, list[tuple[Block, str]]]:
    """Return {Signal: [(block, input)]} with the inputs to which each signal is connected."""
    followers: dict[Signal, list[tuple[Block, str]]] = {}
    for (block, name), source in sources.items():
        if isinstance(source, Signal):
            followers.setdefault(source, []).append((block, name))
    return followers

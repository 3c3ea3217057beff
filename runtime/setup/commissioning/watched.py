"""Live display of sensors: a tool passes frames to their blocks' decoders, without a run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cext.schedule.kernel_table import feed
from graph import Device, compile
from graph.arena_layout import KernelTable
from runtime.setup.commissioning.streaming import column

if TYPE_CHECKING:
    from graph.diagram import Diagram

FRAME = 64  # bytes


@dataclass(frozen=True)
class Fed:
    """A block, the arena slots of its outputs, and the names of the outputs to show."""

    block: Device
    table: KernelTable
    items: dict[str, tuple[int, int]]  # {name: (slot, length)}
    channels: tuple[str, ...]


class WatchedBlocks:
    """Sensors for `runtime.setup.commissioning.streaming.stream`. An answer is {path of a port: its values}.

    diagram : Diagram of the blocks; their inputs stay constant
    channels : function of a block that returns the names of the outputs to show
    shown : names of the outputs in the line on the terminal if there are many, None for all

    Raises DiagramError if the diagram does not compile.
    """

    shown = None

    def __init__(self, diagram: Diagram, channels: Callable[[Any], Iterable[str]]) -> None:
        schedule = compile(diagram)
        self.arena = schedule.arena.copy()
        self.fed = []
        for steps in schedule.devices:
            block = diagram[steps.name]
            self.fed.append(Fed(block, steps.decode_table, schedule.items[steps.name], tuple(channels(block))))

    def feed(self, fed: Fed, data: bytes, when: int, identifier: int) -> dict[int, int]:
        """Pass a frame to a block's decoder.

        data : bytes of the frame
        when : ns, time of its arrival
        identifier : identifier of the frame, with the flags of cext.abi

        Returns {value returned by the decoder (cext.abi): count}.
        """
        return feed(fed.block.decode, self.arena, fed.table, data, FRAME, when, identifier)

    def values_of(self, fed: Fed, name: str) -> list[float]:
        """Return the values of an output as a list."""
        slot, length = fed.items[name]
        return self.arena[slot : slot + length].tolist()

    def answer(self) -> dict[str, list[float]]:
        """Return {path of a port: its values} of every port that is shown."""
        return {f"{fed.block.path}.{name}": self.values_of(fed, name) for fed in self.fed for name in fed.channels}

    def columns(self, name: str) -> list[dict[str, str]]:
        """Return the columns of `row`, one per element of a port. name : unused; the blocks have their own"""
        columns = []
        for fed in self.fed:
            for channel in fed.channels:
                port = fed.block.outputs[channel]
                places = [f"[{index}]" for index in range(port.shape[0])] if port.shape else [""]
                columns += [column(f"{fed.block.path}.{channel}{place}", port.unit) for place in places]
        return columns

    def row(self, answer: Mapping[str, Iterable[float]]) -> list[float]:
        """Return the values of the columns."""
        return [value for values in answer.values() for value in values]

    def line(self, answer: Mapping[str, Iterable[float]]) -> str:
        """Return an answer as a line for the terminal."""
        parts = []
        for fed in self.fed:
            parts += [fed.block.path] * (len(self.fed) > 1)
            for channel in fed.channels:
                if self.shown is None or channel in self.shown or len(fed.channels) <= len(self.shown):
                    values = " ".join(f"{value:8.3f}" for value in answer[f"{fed.block.path}.{channel}"])
                    parts.append(f"{channel} {values} {fed.block.outputs[channel].unit}")
        return "  ".join(parts)

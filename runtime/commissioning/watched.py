"""Sensors that are watched live: blocks whose decode is fed by a tool, without a run around them, and what is shown of
their outputs.
"""

from dataclasses import dataclass

from cext.schedule.kernel_table import feed
from graph import Device, compile
from runtime.commissioning.streaming import column

FRAME = 64  # bytes


@dataclass(frozen=True)
class Fed:
    """A block, where its outputs lie, and which of them are shown."""

    block: Device
    table: object
    items: dict  # {name: (slot, length)}
    channels: tuple


class WatchedBlocks:
    """What `runtime.commissioning.streaming.stream` wants of what it shows: an answer is {path of a port: its values}.

    diagram : of the blocks, whose inputs stay as they are; channels(block) : names of the outputs that are shown.
        DiagramError
    shown : names of the outputs in the line on the terminal, where there are many; None for all
    """

    shown = None

    def __init__(self, diagram, channels):
        schedule = compile(diagram)
        self.arena = schedule.arena.copy()
        self.fed = []
        for steps in schedule.devices:
            block = diagram[steps.name]
            self.fed.append(Fed(block, steps.decode_table, schedule.items[steps.name], tuple(channels(block))))

    def feed(self, fed, data, when, identifier):
        """Offer a frame to a block. Return {value that its decode returned (cext.abi): how often}."""
        return feed(fed.block.decode, self.arena, fed.table, data, FRAME, when, identifier)

    def told(self, fed, name):
        """Values of an output."""
        slot, length = fed.items[name]
        return self.arena[slot : slot + length].tolist()

    def answer(self):
        return {f"{fed.block.path}.{name}": self.told(fed, name) for fed in self.fed for name in fed.channels}

    def columns(self, name):
        found = []
        for fed in self.fed:
            for channel in fed.channels:
                port = fed.block.outputs[channel]
                places = [f"[{index}]" for index in range(port.shape[0])] if port.shape else [""]
                found += [column(f"{fed.block.path}.{channel}{place}", port.unit) for place in places]
        return found

    def row(self, answer):
        return [value for values in answer.values() for value in values]

    def line(self, answer):
        words = []
        for fed in self.fed:
            words += [fed.block.path] * (len(self.fed) > 1)
            for channel in fed.channels:
                if self.shown is None or channel in self.shown or len(fed.channels) <= len(self.shown):
                    values = " ".join(f"{value:8.3f}" for value in answer[f"{fed.block.path}.{channel}"])
                    words.append(f"{channel} {values} {fed.block.outputs[channel].unit}")
        return "  ".join(words)

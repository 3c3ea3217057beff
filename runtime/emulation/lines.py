"""Pseudo-terminals as the serial lines of a plant, in place of the ports of real sensors."""

from __future__ import annotations

import os
import tty
from pathlib import Path
from typing import TYPE_CHECKING

from cext.lines.streams import Streams
from graph import StreamDevice

if TYPE_CHECKING:
    from graph.schedule import Schedule

SERIAL = ("serial", "dialogue")  # kinds of line that a pseudo-terminal can replace


def on_terminals(robot, schedule: Schedule):
    """Return the names of the plant's buses that are serial lines. robot : Diagram; schedule : of the plant"""
    serial = {block.bus for block in robot if isinstance(block, StreamDevice) and block.line in SERIAL}
    return [name for name in schedule.buses if name in serial]


class PtyLines:
    """Pseudo-terminals of lines.

    names : of the lines
    folder : of links to the terminals, with the same names at every start, or None

    paths : {name: path for the robot}
    """

    def __init__(self, names, folder=None) -> None:
        self.streams, self.lines, self.paths, self.kept, self.links = Streams(), {}, {}, [], []
        for name in names:
            master, slave = os.openpty()
            tty.setraw(slave)
            self.kept.append(slave)  # keeps the terminal from hanging up
            self.paths[name] = os.ttyname(slave)
            self.lines[name] = self.streams.add(master, name)
            os.close(master)
            if folder is not None:
                self.link(Path(folder) / f"tty{name.replace('/', '_')}", name)
        self.streams.start()

    def link(self, link, name: str) -> None:
        fresh = link.with_name(f".{link.name}.{os.getpid()}")
        fresh.symlink_to(self.paths[name])
        fresh.replace(link)  # a killed emulator may have left one
        self.paths[name] = str(link)
        self.links.append(link)

    def end(self, name: str):
        """Return the BusEnd of a line."""
        return self.lines[name].end

    def close(self) -> None:
        self.streams.end()
        for line in self.lines.values():
            line.close()
        for link in self.links:
            link.unlink(missing_ok=True)
        for descriptor in self.kept:
            os.close(descriptor)
        self.kept, self.links = [], []

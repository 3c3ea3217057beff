"""Lines of a plant, in place of those of real devices: pseudo-terminals, network senders, sockets of GPIO lines."""

from __future__ import annotations

import os
import tty
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from cext.lines.streams import Streams
from graph import StreamDevice
from runtime.robot.emulation.gpio_server import GpioServer
from runtime.robot.emulation.network_senders import NetworkSender
from runtime.robot.emulation.priority import PRIORITY

if TYPE_CHECKING:
    from cext.bus.memory_bus import BusEnd
    from graph import Diagram
    from graph.schedule import Schedule

TERMINALS = ("serial", "dialogue", "evdev")  # kinds of line that a pseudo-terminal can replace
NETWORK = "net"  # kind of line that a sender can replace
GPIO = "gpio"  # kind of line that a socket can replace


def lines_of(robot: Diagram, schedule: Schedule, *kinds: str) -> dict[str, StreamDevice]:
    """Return {name: StreamDevice of `robot`} of those buses of the plant that are lines of these kinds.

    schedule : schedule of the plant
    """
    devices = {block.bus: block for block in robot if isinstance(block, StreamDevice) and block.line in kinds}
    return {name: devices[name] for name in schedule.buses if name in devices}


class EmulatedLines:
    """Pseudo-terminals, network senders and GPIO servers of lines.

    names : names of the lines with a terminal
    folder : folder of links to the terminals, with the same names at every start, or None
    senders : {name: NetworkSender} of the network lines, which `close` ends
    servers : {name: GpioServer} of the GPIO lines, which `close` ends

    paths : {name: path of the terminal, for the robot}
    """

    def __init__(
        self,
        names: Iterable[str],
        folder: Path | None = None,
        senders: dict[str, NetworkSender] | None = None,
        servers: dict[str, GpioServer] | None = None,
    ) -> None:
        self.streams, self.lines, self.paths = Streams(), {}, {}
        self.kept, self.links = [], []
        self.senders: dict[str, NetworkSender] = senders or {}
        self.servers: dict[str, GpioServer] = servers or {}
        for name in names:
            master, slave = os.openpty()
            tty.setraw(slave)
            self.kept.append(slave)  # keeps the terminal from hanging up
            self.paths[name] = os.ttyname(slave)
            self.lines[name] = self.streams.add(master, name)
            os.close(master)
            if folder is not None:
                self.link(Path(folder) / f"tty{name.replace('/', '_')}", name)
        for name, sender in self.senders.items():
            self.lines[name] = self.streams.add(sender.source.fileno(), name)
        self.streams.start(PRIORITY)

    def link(self, link: Path, name: str) -> None:
        """Make a link to the terminal of a line, or replace the one of an emulator that was killed."""
        fresh = link.with_name(f".{link.name}.{os.getpid()}")
        fresh.symlink_to(self.paths[name])
        fresh.replace(link)  # a killed emulator may have left one
        self.paths[name] = str(link)
        self.links.append(link)

    def end(self, name: str) -> BusEnd:
        """Return the BusEnd of a line."""
        return self.servers[name].end if name in self.servers else self.lines[name].end

    def place(self, name: str) -> str:
        """Return where the run finds a line, as text."""
        device = self.senders.get(name) or self.servers.get(name)
        return f"terminal {self.paths[name]}" if device is None else device.description

    def close(self) -> None:
        """Close the terminals, and remove the links."""
        self.streams.end()
        for line in self.lines.values():
            line.close()
        for device in (*self.senders.values(), *self.servers.values()):
            device.close()
        for link in self.links:
            link.unlink(missing_ok=True)
        for descriptor in self.kept:
            os.close(descriptor)
        self.kept, self.links = [], []

"""Server of packets on a socket of this machine, which a run opens in place of a device file."""

from __future__ import annotations

import os
import select
import socket
import threading
from abc import ABC, abstractmethod
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from cext.ring.rings import Line, Lines
from runtime.host.errors import BadInput
from runtime.robot.emulation.priority import take_priority

if TYPE_CHECKING:
    from collections.abc import Callable

    from cext.bus.memory_bus import BusEnd


class SocketServer(threading.Thread, ABC):
    """Thread between the emulators of a plant and the runs that connect to a socket.

    path : path of the socket

    lines : frames to and from the emulators
    clients : connected runs
    Raises BadInput if the socket cannot be made.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(daemon=True)
        self.path = path
        self.clients: list[socket.socket] = []
        self.bell, self.leave = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC), os.eventfd(0, os.EFD_CLOEXEC)
        self.lines = Lines(1)
        self.line = Line(self.lines, 0, self.bell)
        self.listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            path.unlink(missing_ok=True)  # of an emulator that was killed
            self.listener.bind(str(path))
        except OSError as error:
            raise BadInput(f"{path}: {error.strerror}. Choose a folder that you may write, such as /tmp") from None
        self.listener.listen()
        self.start()

    @property
    def end(self) -> BusEnd:
        """BusEnd of the plant."""
        return self.line.end

    @property
    def trouble(self) -> str | int | None:
        """Reason for a failure of the plant's end."""
        return self.line.trouble

    @abstractmethod
    def take(self) -> None:
        """Process the frames of the emulators, which are in `lines`."""

    @abstractmethod
    def serve(self, client: socket.socket) -> None:
        """Process one packet of a client. Raises OSError if the client has disconnected."""

    def welcome(self, client: socket.socket) -> None:
        """Process a new client. Raises OSError if it is not accepted."""

    def run(self) -> None:
        """Serve until `close`."""
        take_priority()
        while True:
            ready, _, _ = select.select([self.leave, self.bell, self.listener, *self.clients], [], [])
            if self.leave in ready:
                break
            with suppress(BlockingIOError):
                os.eventfd_read(self.bell)
            self.take()
            for client in [client for client in self.clients if client in ready]:
                self.attempt(self.serve, client)
            if self.listener in ready:
                client, _ = self.listener.accept()
                self.clients.append(client)
                self.attempt(self.welcome, client)
        for client in self.clients:
            client.close()

    def attempt(self, action: Callable[[socket.socket], None], client: socket.socket) -> None:
        """Call action(client); disconnect the client if that raises OSError."""
        try:
            action(client)
        except OSError:
            self.clients.remove(client)
            client.close()

    def close(self) -> None:
        """End the thread and remove the socket."""
        os.eventfd_write(self.leave, 1)
        self.join()
        self.listener.close()
        self.path.unlink(missing_ok=True)
        os.close(self.bell)
        os.close(self.leave)

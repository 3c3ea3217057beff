"""Lock that gives each bus a single controller, ends with its holder, and identifies the holder's process.

It is a socket in Linux's abstract namespace that listens and never replies, so no file can be left behind. The guardian
inherits it, so that a bus is released only after its actuators are stopped.
"""

from __future__ import annotations

import errno
import os
import pwd
import socket
import struct
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from cext.safety.thresholds import BUS_LOCK_RELEASE_LIMIT

if TYPE_CHECKING:
    from collections.abc import Iterable

NAME_BYTES = 80  # limit; the system allows 107
CREDENTIALS = struct.Struct("iII")  # struct ucred: pid, uid, gid


class BusTaken(Exception):
    """A bus that another process controls.

    pid : ID of the process, 0 if unknown
    user : ID of its account, None if unknown
    owner : process and account as text
    """

    def __init__(self, pid: int, user: int | None = None) -> None:
        self.pid, self.user, self.owner = pid, user, in_words(pid, user)
        super().__init__(f"controlled by {self.owner}")


class BusLock:
    """Exclusive right to command a bus, from construction until `close`. Raises BusTaken.

    interface, channel : names of python-can
    """

    def __init__(self, interface: str, channel: str) -> None:
        name = name_of(interface, channel)
        deadline = time.monotonic() + BUS_LOCK_RELEASE_LIMIT * 1e-9
        while True:
            self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                self.socket.bind(name)
                self.socket.listen(socket.SOMAXCONN)
                return
            except OSError as error:
                self.socket.close()
                if error.errno != errno.EADDRINUSE:
                    raise
            owner = _holder(name)
            if owner is not None and (_is_alive(owner[0]) or time.monotonic() > deadline):
                raise BusTaken(*owner)
            time.sleep(0.01)

    def fileno(self) -> int:
        """Return the descriptor of the lock, which a child process can inherit."""
        return self.socket.fileno()

    def close(self) -> None:
        """Release the bus, unless another process has inherited the lock."""
        self.socket.close()


class Visitors:
    """Processes that have connected to the locks of buses since the last look: each wants to take one.

    descriptors : of the locks
    """

    def __init__(self, descriptors: Iterable[int]) -> None:
        self.sockets = [socket.socket(fileno=os.dup(descriptor)) for descriptor in descriptors]

    def came(self) -> bool:
        """Return whether one has connected, and dismiss all of them."""
        came = False
        for lock in self.sockets:
            with suppress(BlockingIOError):
                lock.setblocking(False)
                while True:
                    lock.accept()[0].close()
                    came = True
        return came

    def close(self) -> None:
        """Close the descriptors of this object; the locks remain."""
        for lock in self.sockets:
            lock.close()


def name_of(interface: str, channel: str) -> bytes:
    """Return the name of a bus in the abstract socket namespace; the same for all links to one port."""
    channel = os.path.realpath(channel) if os.path.exists(channel) else channel  # links to one port are one bus
    name = f"tickwork/bus/{interface}/{channel}".encode()
    if len(name) > NAME_BYTES:
        import hashlib  # 4 MB

        name = name[: NAME_BYTES - 33] + b"/" + hashlib.sha256(name).hexdigest()[:32].encode()
    return b"\0" + name


def _holder(name: bytes) -> tuple[int, int | None] | None:
    """Return (process ID, account ID) of the holder of a name; 0 and None for unknown ones. None without a holder."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as visitor:
        visitor.setblocking(False)
        try:
            visitor.connect(name)
        except ConnectionRefusedError:
            return None
        except OSError:
            return 0, None
        return CREDENTIALS.unpack(visitor.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, CREDENTIALS.size))[:2]


def _is_alive(pid: int) -> bool:
    """Return whether a process exists; True for an unknown one, 0."""
    return pid == 0 or os.path.exists(f"/proc/{pid}")


def in_words(pid: int, user: int | None) -> str:
    """Return a process as text: 'process 123 (python -m runtime ...) of user ada'. pid : 0 if unknown"""
    of = "" if user is None else f" of user {_account_name(user)}"
    if pid == 0:
        return "another process" + of
    try:
        with open(f"/proc/{pid}/cmdline", "rb") as file:
            words = " ".join(file.read().decode(errors="replace").replace("\0", " ").split())
    except OSError:
        return f"process {pid}{of}, which has ended; its guardian has not"
    return f"process {pid}" + (f" ({words})" if words else "") + of


def _account_name(user: int) -> str:
    """Return the name of an account, or its number if it has none, as in a container."""
    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return str(user)

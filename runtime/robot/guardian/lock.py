"""Lock that gives each bus a single controller, ends with its holder, and identifies the holder's process.

It is a socket in Linux's abstract namespace that listens and never replies, so no file can be left behind. The guardian
inherits it, so that a bus is released only after its actuators are stopped.
"""

from __future__ import annotations

import errno
import os
import pwd
import socket
import time
from typing import TYPE_CHECKING

from cext.safety.thresholds import BUS_LOCK_RELEASE_LIMIT, STOP_ORPHANED
from runtime.robot.guardian.handover import Offer, peer_of

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

NAME_BYTES = 80  # limit; the system allows 107


class BusTaken(Exception):
    """A bus that another process controls.

    pid : ID of the process, 0 if unknown
    user : ID of its account, None if unknown
    drives : names of those whose safe stop the process continues after the end of its run

    owner : process and account as text; remedy : what the operator can do
    """

    def __init__(self, pid: int, user: int | None = None, drives: Sequence[str] = ()) -> None:
        self.pid, self.user, self.owner = pid, user, in_words(pid, user)
        self.remedy = "end that process first: a bus has one controller"
        if drives:
            self.owner += f", whose run has ended and whose stop of {', '.join(drives)} continues"
            self.remedy = (
                "a run whose diagram has these drives takes the bus over; otherwise end that stop with Ctrl-C, or, "
                f"where the control process has died, wait {STOP_ORPHANED} s"
            )
        super().__init__(f"controlled by {self.owner}")


class BusLock:
    """Exclusive right to command a bus, from construction until `close`. Raises BusTaken.

    interface, channel : names of python-can
    identifiers : identifiers with flag bits of the stop frames of a run, which takes the bus over from a safe stop that
        continues if it has all of its drives; None for another process

    name : name of the lock; handover : connection to the process of that stop, or None
    """

    def __init__(self, interface: str, channel: str, identifiers: Collection[int] | None = None) -> None:
        self.name = name = name_of(interface, channel)
        self.handover: socket.socket | None = None
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
            offer = _offer_of(name)
            if offer is not None:
                if identifiers is not None and offer.identifiers <= set(identifiers):
                    self.socket, self.handover = offer.accept()
                    return
                owner = _holder(name) or peer_of(offer.link)
                offer.decline()
                raise BusTaken(*owner, offer.drives)
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
        if self.handover is not None:
            self.handover.close()


def _offer_of(name: bytes) -> Offer | None:
    """Return the offer of a process whose safe stop continues, None if there is none."""
    try:
        return Offer(name)
    except OSError:
        return None


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
        return peer_of(visitor)


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

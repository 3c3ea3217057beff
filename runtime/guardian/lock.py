"""One controller for each bus: a lock that ends with whoever holds it, kill -9 included, and names its process.

It is a socket in Linux's abstract namespace that listens and never answers: there is no file that could be left behind.
The guardian inherits it, so that a bus is not free before its actuators are stopped.
"""

import errno
import hashlib
import os
import pwd
import socket
import struct
import time

from cext.safety.thresholds import BUS_LOCK_RELEASE_LIMIT

NAME_BYTES = 80  # at most; the system takes 107
CREDENTIALS = struct.Struct("iII")  # struct ucred: pid, uid, gid


class BusTaken(Exception):
    """Another process controls the bus.

    pid : its number, 0 if the system does not tell
    user : number of the account that it runs under, None if the system does not tell
    owner : the process and its account in words
    """

    def __init__(self, pid, user=None):
        self.pid, self.user, self.owner = pid, user, in_words(pid, user)
        super().__init__(f"controlled by {self.owner}")


class BusLock:
    """The right to command what is on a bus, from now until `close`. BusTaken.

    interface, channel : as python-can names them
    """

    def __init__(self, interface, channel):
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
            found = holder(name)
            if found is not None and (alive(found[0]) or time.monotonic() > deadline):
                raise BusTaken(*found)
            time.sleep(0.01)

    def fileno(self):
        return self.socket.fileno()

    def close(self):
        self.socket.close()


def name_of(interface, channel):
    channel = os.path.realpath(channel) if os.path.exists(channel) else channel  # two links to one port are one bus
    name = f"tickwork/bus/{interface}/{channel}".encode()
    if len(name) > NAME_BYTES:
        name = name[: NAME_BYTES - 33] + b"/" + hashlib.sha256(name).hexdigest()[:32].encode()
    return b"\0" + name


def holder(name):
    """(process, account) that listens at a name, as numbers; 0 and None if the system does not tell. None if there is
    none by now.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as visitor:
        visitor.setblocking(False)
        try:
            visitor.connect(name)
        except ConnectionRefusedError:
            return None
        except OSError:
            return 0, None
        return CREDENTIALS.unpack(visitor.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, CREDENTIALS.size))[:2]


def alive(pid):
    return pid == 0 or os.path.exists(f"/proc/{pid}")


def in_words(pid, user):
    of = "" if user is None else f" of user {account(user)}"
    if pid == 0:
        return "another process" + of
    try:
        with open(f"/proc/{pid}/cmdline", "rb") as file:
            words = " ".join(file.read().decode(errors="replace").replace("\0", " ").split())
    except OSError:
        return f"process {pid}{of}, which has ended; its guardian has not"
    return f"process {pid}" + (f" ({words})" if words else "") + of


def account(user):
    """The name of an account, or its number where it has none, as in a container."""
    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return str(user)

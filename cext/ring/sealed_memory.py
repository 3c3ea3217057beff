"""Memory files that processes share."""

import fcntl
import os


def empty_memory(name: str) -> int:
    """Return the file descriptor of a new memory file without a size."""
    return os.memfd_create(name, os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)


def seal(fd: int, size: int) -> None:
    """Give an empty memory file its size, which no process can change afterwards: that would end the others.

    size : bytes
    """
    os.ftruncate(fd, size)
    fcntl.fcntl(fd, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL)


def sealed_memory(name: str, size: int) -> int:
    """Return the file descriptor of a new memory file of `size` bytes, as `seal` leaves it."""
    fd = empty_memory(name)
    seal(fd, size)
    return fd

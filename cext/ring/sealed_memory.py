"""Memory files that processes share."""

import fcntl
import os


def sealed_memory(name: str, size: int) -> int:
    """Return the file descriptor of a new memory file, whose size no process can change: that would end the others.

    size : bytes
    """
    fd = os.memfd_create(name, os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    os.ftruncate(fd, size)
    fcntl.fcntl(fd, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL)
    return fd

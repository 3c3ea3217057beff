"""File descriptors that a run depends on, although any code of its process can close or replace them, or use up all.

A library that detaches itself from its terminal closes every descriptor; one that leaks them leaves none to open.
"""

from __future__ import annotations

import os
import resource
from contextlib import suppress

SPARE, SPARE_PER_INTERFACE = 4, 8  # pyserial opens five for a port
SPARE_LIMIT = 256  # descriptors that a raised limit allows


def identity(number: int) -> tuple[int, int] | None:
    """Return (device, inode) of the file behind a descriptor; None if it is closed."""
    try:
        status = os.fstat(number)
    except OSError:
        return None
    return status.st_dev, status.st_ino


def close(number: int, file: tuple[int, int] | None) -> None:
    """Close a descriptor if it still has a file: a block may have closed it, or given its number to another file.

    file : result of `identity` when it was opened
    """
    if file is not None and identity(number) == file:
        os.close(number)


class Descriptors:
    """Descriptors by their purpose, each with the file that it had when it was kept."""

    def __init__(self) -> None:
        self._files: dict[str, tuple[int, tuple[int, int] | None]] = {}

    def keep(self, purpose: str, number: int) -> None:
        """Remember the file behind a descriptor. purpose : a noun phrase"""
        self._files[purpose] = number, identity(number)

    def replaced_purposes(self) -> list[str]:
        """Return the purposes of those that were closed, or replaced by another file."""
        return [purpose for purpose, (number, file) in self._files.items() if identity(number) != file]


class SpareDescriptors:
    """Descriptors that are held until they are needed, so that interfaces can be opened when no other is free.

    interfaces : number of them
    """

    def __init__(self, interfaces: int) -> None:
        count = SPARE + SPARE_PER_INTERFACE * interfaces
        self._numbers = [os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC) for _ in range(count)]
        self._file = identity(self._numbers[0])

    def release(self) -> None:
        """Close them, and raise the limit of descriptors as far as permitted: it may have been lowered."""
        hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
        for limit in (hard, max(hard, SPARE_LIMIT)):
            with suppress(OSError, ValueError):  # not permitted
                resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))
        self.close()

    def close(self) -> None:
        """Close those that are still held."""
        while self._numbers:
            close(self._numbers.pop(), self._file)

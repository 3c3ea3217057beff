"""Files of a recording: never overwritten, always ending with a complete piece, and readable by their owner alone.

A recording contains data of a subject. If its folder has the setgid bit and is readable by its group, the group can
also read the recording.
"""

import errno
import fcntl
import os
import stat
from collections.abc import Sequence
from contextlib import suppress
from itertools import accumulate, count
from pathlib import Path
from typing import Any

SIDECAR = ".json"
INCOMPLETE, DELETED = "incomplete", "deleted while it was written"  # remarks on a file
STOPPED_EARLY = "the recorder stopped before the end"  # end of a run whose recorder died first
# bytes: while the kernel copies more, a loop of ordinary priority that is due on that processor waits
AT_ONCE = 16 << 10


def is_shared(folder: str) -> bool:
    """Return whether the group of a folder may read the recordings in it."""
    mode = os.stat(folder).st_mode
    return bool(mode & stat.S_ISGID and mode & stat.S_IRGRP)


def mode_in(folder: str) -> int:
    """Return the permissions of a new file in a folder, before the umask."""
    return 0o640 if is_shared(folder or ".") else 0o600


def private(path: str, flags: int) -> int:
    """Open a file with the permissions of a recording and return its descriptor. An opener for `open`"""
    return os.open(path, flags, mode_in(os.path.dirname(path)))


def make_folder(path: str | os.PathLike[str]) -> list[str]:
    """Create a folder and its parents for their owner, and for the group of a shared folder.

    Returns the created folders, outermost first. Raises FileExistsError if the path is not a folder.
    """
    made: list[str] = []
    above = os.path.abspath(path)
    while not os.path.lexists(above):
        made.insert(0, above)
        above = os.path.dirname(above)
    mode = 0o750 if made and is_shared(above) else 0o700
    for folder in made:
        with suppress(FileExistsError):  # created by another process
            os.mkdir(folder, mode)
    os.makedirs(path, exist_ok=True)
    return made


def create(stem: Any, ending: str, overwrite: bool = False) -> tuple[str, int]:
    """Create a file `stem` + `ending`, with a number in between if that exists. Returns (path, file descriptor).

    overwrite : whether an existing file is opened instead, whose content the caller replaces. Raises OSError for one
        that another recorder is writing
    """
    mode = mode_in(os.path.dirname(stem))
    if overwrite:
        path = f"{stem}{ending}"
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, mode)
        if not claim(descriptor):
            os.close(descriptor)
            raise OSError(errno.EBUSY, "another recorder is writing this file", path)
        return path, descriptor
    for number in count(1):
        path = f"{stem}{ending}" if number == 1 else f"{stem}-{number}{ending}"
        try:
            return path, os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
        except FileExistsError:
            pass
    raise AssertionError


def reserve(folder: str, stem: str) -> tuple[str, str, int]:
    """Reserve an unused stem in a folder by creating its sidecar. Returns (stem, path of the sidecar, descriptor)."""
    number = 0
    while True:
        number += 1
        free = stem if number == 1 else f"{stem}-{number}"
        if any(name.startswith(free + ".") for name in os.listdir(folder)):
            continue
        path = os.path.join(folder, free + SIDECAR)
        try:
            return free, path, os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode_in(folder))
        except FileExistsError:
            pass


def claim(descriptor: int) -> bool:
    """Lock a file while it is open here or in a forked process. Returns False if it is locked by another `open`."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        pass
    return True


class WholeFile:
    """File that is written in complete pieces, which are lines or records, and stay in memory until `flush`.

    A flush passes the pieces to the kernel, where they outlive this process.

    durable : whether `close` waits for the disk
    """

    def __init__(self, path: str, descriptor: int, durable: bool = True) -> None:
        self.path = path
        self.descriptor: Any = descriptor
        self.durable = durable
        self.pieces: list[bytes] = []
        self.size = 0  # bytes of complete pieces in the file
        self.waiting = 0  # bytes in memory

    def write(self, piece: bytes | str) -> int:
        """Add a piece and return its size in bytes."""
        if isinstance(piece, str):
            piece = piece.encode()
        self.pieces.append(piece)
        self.waiting += len(piece)
        return len(piece)

    def take_back(self, piece: bytes) -> None:
        """Remove the last piece, which may have been flushed. Raises OSError."""
        if self.pieces:
            self.waiting -= len(self.pieces.pop())
        else:
            self.size -= len(piece)
            os.ftruncate(self.descriptor, self.size)
            os.lseek(self.descriptor, self.size, os.SEEK_SET)

    def tell(self) -> int:
        """Return the position of the end of the last piece, in bytes."""
        return self.size + self.waiting

    def flush(self) -> None:
        """Write all pieces. Raises OSError, after removing an incomplete piece from the file."""
        pieces, self.pieces, self.waiting = self.pieces, [], 0
        data = memoryview(b"".join(pieces))
        written = 0
        try:
            while written < len(data):
                written += os.write(self.descriptor, data[written : written + AT_ONCE])
        except OSError:
            whole = accumulate(map(len, pieces))
            self.size += max((end for end in whole if end <= written), default=0)
            os.ftruncate(self.descriptor, self.size)  # a full disk cuts in the middle of a piece
            raise
        self.size += written

    def let_go(self) -> None:
        """Close the file without writing: another process has written it."""
        if self.descriptor is not None:
            os.close(self.descriptor)
            self.descriptor = None

    def close(self) -> None:
        """Flush and close, and wait for the disk if `durable`. Does nothing if it is closed."""
        if self.descriptor is None:
            return
        descriptor = self.descriptor
        try:
            self.flush()
            if self.durable:
                os.fsync(descriptor)
        finally:
            self.descriptor = None
            os.close(descriptor)


def short_names(paths: Sequence[Path]) -> list[str]:
    """Return unique names of files, without their common folders and ending."""
    names = [path.stem for path in paths]
    if len(set(names)) == len(names):
        return names
    folders = [os.path.abspath(path.parent) for path in paths]
    above = os.path.commonpath(folders)
    return [os.path.join(os.path.relpath(folder, above), name) for folder, name in zip(folders, names)]

"""Files that are replaced as a whole: written beside, then renamed."""

import errno
import os
import stat
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from typing import BinaryIO

NAME_LIMIT = 100  # characters of the name of the file in that of the new one


@contextmanager
def replacement(
    path: str | os.PathLike[str],
    opener: Callable[[str, int], int] | None = None,
    durable: bool = True,
    part: str | None = None,
) -> Generator[BinaryIO]:
    """Open a new file for bytes, which replaces the file of this name when the block ends without an exception.

    Until then, and if the process is killed or the disk is full, the old file stays. Its owner and permissions
    also stay, and a symbolic link remains one. What is not a regular file, such as a pipe, is written directly.

    opener : function of a path and flags that opens a new file, as in `open`
    durable : whether to wait for the disk
    part : path of the new file until then; by default an unused one beside

    Raises OSError.
    """
    real = os.path.realpath(path)
    status = os.stat(real) if os.path.exists(real) else None
    if status is not None and not stat.S_ISREG(status.st_mode):
        with open(real, "wb") as file:
            yield file
        return
    if status is not None and not os.access(real, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    folder, name = os.path.split(real)
    part = part or os.path.join(folder, f".{name[:NAME_LIMIT]}.{os.getpid()}-{time.monotonic_ns()}.part")
    try:
        with open(part, "xb", opener=opener) as file:
            yield file
            file.flush()
            if durable:
                os.fsync(file.fileno())
        if status is not None:
            if (status.st_uid, status.st_gid) != (os.geteuid(), os.getegid()):
                with suppress(PermissionError):  # only root may give a file away
                    os.chown(part, status.st_uid, status.st_gid)
            os.chmod(part, status.st_mode & 0o7777)
        os.replace(part, real)
    except BaseException:
        with suppress(OSError):
            os.unlink(part)
        raise


def write(path: str | os.PathLike[str], data: bytes | str) -> None:
    """Replace a file as `replaced` does. data : bytes, or text for UTF-8. Raises OSError"""
    with replacement(path) as file:
        file.write(data.encode() if isinstance(data, str) else data)

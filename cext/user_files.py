"""Files of users that are read as a whole: diagrams, rigs, calibrations and others that are written by hand."""

from __future__ import annotations

import errno
import os
import stat

SMALL_FILE_LIMIT = 16 << 20  # bytes of a diagram, a rig, a calibration or another file that is written by hand


def read_small(path: str | os.PathLike[str], limit: int = SMALL_FILE_LIMIT) -> bytes:
    """Return the content of a file. limit : bytes

    Raises OSError: also for a larger file, and for a named pipe, whose writer may never come.
    """
    name = os.fspath(path)
    if stat.S_ISFIFO(os.stat(name).st_mode) and not name.startswith(("/dev/", "/proc/")):  # but for `<(command)`
        raise OSError(errno.EINVAL, "is a pipe, not a file", name)
    with open(name, "rb") as file:
        content = b"" if os.fstat(file.fileno()).st_size > limit else file.read(limit + 1)
        if len(content) > limit or not content and os.fstat(file.fileno()).st_size:
            raise OSError(errno.EFBIG, f"is larger than {limit >> 20} MB", name)
    return content

"""Files that a block reads: found beside the diagram, or in the working folder."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import TYPE_CHECKING

from cext.user_text import repr_of

if TYPE_CHECKING:
    from graph.diagnostics import Location


def path_beside(location: Location | None, file: str) -> Path:
    """Return the absolute path of a file that is named relative to the folder of a diagram, or to the working folder.

    location : of the block, or None

    Raises ValueError if there is no such file, and OSError where the system refuses the name.
    """
    if not file or "\0" in file:
        raise ValueError(f"expected the path of a file, got {repr_of(file)}")
    folder = Path(location.file).parent if location else Path()
    paths = [folder / file, Path(file)]
    for path in paths:
        if path.is_file():
            return path.absolute()
    if any(path.is_dir() for path in paths):
        raise ValueError(f"{file} is a folder: name a file in it")
    if any(path.exists() for path in paths):
        raise ValueError(f"{file} is not a file: it is a pipe or a device. Save its content as a file")
    if Path(file).is_absolute():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), file)
    raise ValueError(
        f"there is no {file} in {folder} or in the working folder: copy it there, or write its absolute path"
    )

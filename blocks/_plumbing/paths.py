"""Paths of files that a block reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from graph import Param


def file_param(what: str) -> Param[str]:
    """Return the declaration of a file that a block needs. what : such as "ONNX file" """
    place = "absolute, or relative to the folder of the diagram or the working folder"
    return Param("", "1", f"path of the {what}: {place}", required=True, dtype=str, file=True)


def path_beside(location: Any, file: str) -> Path:
    """Return the path of a file that is named relative to the folder of a diagram, or to the working folder.

    location : Location of the block, or None. Raises ValueError if there is no such file.
    """
    folder = Path(location.file).parent if location else Path()
    for path in (folder / file, Path(file)):
        if path.is_file():
            return path.absolute()
    raise ValueError(
        f"file: there is no {file} in {folder} or in the working folder: copy it there, or write its absolute path"
    )

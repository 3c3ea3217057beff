"""Parameters that are paths of files."""

from __future__ import annotations

from graph import Param


def file_param(what: str) -> Param[str]:
    """Return the declaration of a file that a block needs. what : such as "ONNX file" """
    place = "absolute, or relative to the folder of the diagram or the working folder"
    return Param("", "1", f"path of the {what}: {place}", required=True, dtype=str, file=True)

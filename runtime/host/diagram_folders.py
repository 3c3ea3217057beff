"""Folders of diagram files on the path of modules."""

from __future__ import annotations

import os
import sys
from pathlib import Path

HOME = os.path.realpath(Path(__file__).parents[2])


class DiagramFolder(str):
    """Entry of sys.path that is the folder of a diagram file."""


def import_from(folder: str) -> None:
    """Let a diagram file import modules of its folder, which shadow no library.

    The folder comes after the libraries, but before the folders of other diagram files and the working folder. A module
    of these that was imported, and of which this folder has its own, is imported again.

    folder : real path
    """
    others = [entry for entry in sys.path if entry != folder and _comes_after(entry)]
    if not others and folder in sys.path:
        return
    rest = [entry for entry in sys.path if entry not in others and not isinstance(entry, DiagramFolder)]
    sys.path[:] = [*rest, *([] if folder in rest else [DiagramFolder(folder)]), *others]
    behind = {os.path.realpath(entry) for entry in others}
    for name in [name for name in _modules_of(folder) & sys.modules.keys() if _folder_of(sys.modules[name]) in behind]:
        for each in [each for each in sys.modules if each == name or each.startswith(f"{name}.")]:
            del sys.modules[each]


def _modules_of(folder: str) -> set[str]:
    """Return the names of what may be a module or a package in a folder; none if it cannot be read."""
    try:
        return {name.removesuffix(".py") for name in os.listdir(folder)}
    except OSError:
        return set()


def _comes_after(entry: str) -> bool:
    """Return whether an entry is of another diagram file, or the working folder, unless that is Tickwork's own."""
    try:
        return isinstance(entry, DiagramFolder) or os.path.realpath(entry) == os.getcwd() != HOME
    except OSError:  # the folder was deleted
        return False


def _folder_of(module: object) -> str | None:
    """Return the folder in which a module or a package is; None for one without a file."""
    file = getattr(module, "__file__", None)
    if not isinstance(file, str):
        return None
    folder = os.path.dirname(os.path.realpath(file))
    return os.path.dirname(folder) if os.path.basename(file) == "__init__.py" else folder

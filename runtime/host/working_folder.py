"""Removal of the working folder from the head of the path, where `python -m` inserts it.

A `signal.py` there would shadow Python's own module. This file must parse on Python 3.6 or newer, and import nothing
that the working folder could shadow.
"""

import os
import sys


def move_back() -> "str | None":
    """Move the working folder from the head of the path to its end, so that its files shadow no library.

    Returns the folder, or None if it was not at the head. A diagram's own modules are still found at the end. The
    folder of Tickwork itself moves only behind Python's own modules.
    """
    try:
        folder = os.getcwd()
    except OSError:  # the folder was deleted
        return None
    if getattr(sys.flags, "safe_path", False) or not sys.path or sys.path[0] not in ("", folder):
        return None
    del sys.path[0]
    home = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    if os.path.realpath(folder) == os.path.realpath(home):
        sites = [
            place
            for place, entry in enumerate(sys.path)
            if os.path.basename(entry) in ("site-packages", "dist-packages")
        ]
        sys.path.insert(min(sites, default=len(sys.path)), folder)
    else:
        sys.path.append(folder)
    return folder


def namesake(folder: str, modules: "list[str]") -> "str | None":
    """Return the path of a file or package in a folder with the name of one of these modules; None for none."""
    for module in modules:
        for name in (module + ".py", os.path.join(module, "__init__.py")):
            path = os.path.join(folder, name)
            if os.path.exists(path):
                return path
    return None

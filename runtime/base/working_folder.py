"""The working folder, which `python -m` puts first on the path: there a `signal.py` would take the place of Python's
own module.

This file must be readable for any Python 3.6 or newer, and import nothing that the working folder could hide.
"""

import os
import sys


def move_back():
    """Take the working folder from the head of the path, so that its files hide no library. Returns it; None where it
    was not there.

    It goes to the end, where a diagram's own modules are still found. The folder of Tickwork itself goes behind
    Python's own modules only.
    """
    try:
        folder = os.getcwd()
    except OSError:  # it has been deleted
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


def namesake(folder, modules):
    """A file or package in a folder that bears the name of one of these top-level modules, its path; None if there is
    none.
    """
    for module in modules:
        for name in (module + ".py", os.path.join(module, "__init__.py")):
            path = os.path.join(folder, name)
            if os.path.exists(path):
                return path
    return None

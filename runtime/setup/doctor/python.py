"""Checks of the Python interpreter and the folder of recordings."""

from __future__ import annotations

import os
import platform
import sys
import sysconfig
from typing import TYPE_CHECKING

from runtime.host.machine.finding import BAD, OK, WORSE, Finding

if TYPE_CHECKING:
    from runtime.host.machine.finding import Wants
    from runtime.host.machine.probe import Machine

FREE_SPACE_WORSE, FREE_SPACE_BAD = 2 << 30, 100 << 20  # bytes: an hour of 60 signals at 1000 Hz is 2 GB of CSV


def python(machine: Machine, wants: Wants) -> Finding:
    """Return the finding on the interpreter: version, and whether it is a debug build."""
    version = f"{platform.python_implementation()} {platform.python_version()}"
    kind = ", free-threaded" if sysconfig.get_config_var("Py_GIL_DISABLED") else ""
    if sysconfig.get_config_var("Py_DEBUG") or hasattr(sys, "gettotalrefcount"):
        return Finding(
            "Python",
            WORSE,
            f"{version}, a debug build",
            "Python blocks take several times as long",
            "use a release build",
        )
    return Finding("Python", OK, f"{version}{kind}, {64 if sys.maxsize > 2**32 else 32} bits")


def _recordings(machine: Machine, wants: Wants) -> Finding:
    folder = os.path.abspath(os.path.expanduser(wants.folder))
    there = folder
    while not os.path.exists(there):
        there = os.path.dirname(there)
    if not os.path.isdir(there) or not os.access(there, os.W_OK | os.X_OK):
        return Finding(
            "recordings",
            BAD,
            f"cannot write to {there}",
            "a run that records does not start",
            "use another folder: --record DIR",
        )
    space = os.statvfs(there)
    free = space.f_bavail * space.f_frsize
    verdict = OK if free >= FREE_SPACE_WORSE else WORSE if free >= FREE_SPACE_BAD else BAD
    return Finding(
        "recordings",
        verdict,
        f"{free / 2**30:.1f} GiB free in {there}",
        "a recording ends when the disk is full",
        "" if verdict == OK else "free some space, or use another folder: --record DIR",
    )


CHECKS = (python, _recordings)

"""A control group for the guardian alone, outside of the group of its run.

systemd stops a unit, and systemd-oomd frees memory, by killing every process of one control group and of those below
it. `enter` moves the calling process out of the group in which the run was started, as far up the hierarchy (version 2)
as the system permits: root may use all of it, and a process below user@UID.service that part. Elsewhere the guardian
stays where it is.

An empty group is left behind only where both the guardian and the run are killed; the next guardian removes it.
"""

import os
from contextlib import suppress
from pathlib import Path

from runtime.base.system import read

PREFIX = "tickwork-guardian-"


def enter():
    """Move this process into a group of its own. Returns (its folder, the folder of the group it came from), or
    None.
    """
    top, before = hierarchy(), group_of("self")
    if top is None or before is None:
        return None
    came_from = top / before
    for parent in [*reversed(came_from.parents)][len(top.parents) :] or [top]:
        remove_stale(parent)
        own = parent / f"{PREFIX}{os.getpid()}"
        with suppress(OSError):
            own.mkdir()
            if move_here(own):
                return own, came_from
            own.rmdir()
    return None


def leave(own, came_from):
    """Move this process back, and remove its own group. Where the group it came from has gone, another process has to
    remove it.
    """
    if move_here(came_from):
        remove(own)


def remove(group):
    """Remove an empty group."""
    with suppress(OSError):
        os.rmdir(group)


def remove_stale(parent):
    """Remove the empty groups of guardians that have ended."""
    with suppress(OSError):
        for group in parent.glob(f"{PREFIX}*"):
            if not os.path.exists(f"/proc/{group.name.removeprefix(PREFIX)}"):
                remove(group)


def hierarchy():
    """Folder of the control groups of version 2, None where there are none."""
    for line in read("/proc/self/mounts").splitlines():
        _, folder, kind, *_ = line.split()
        if kind == "cgroup2":
            return Path(folder)
    return None


def group_of(process):
    """Path of a process's group in the hierarchy, without a slash in front; None where it is outside of what this
    process may see.
    """
    for line in read(f"/proc/{process}/cgroup").splitlines():
        number, _, path = line.split(":", 2)
        if number == "0" and ".." not in path.split("/"):
            return path.strip("/")
    return None


def move_here(group):
    """Move this process into a group, with all its threads. Returns whether the system permits it."""
    try:
        procs = os.open(group / "cgroup.procs", os.O_WRONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        return os.write(procs, b"0") == 1
    except OSError:
        return False
    finally:
        os.close(procs)

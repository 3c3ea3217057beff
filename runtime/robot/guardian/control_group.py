"""Control group for the guardian alone, outside the group of its run.

systemd stops a unit, and systemd-oomd frees memory, by killing every process of a control group and its descendants.
`enter` moves the calling process out of the group in which the run was started, as far up the hierarchy (version 2) as
permitted: root may use all of it, a process below user@UID.service that part. Elsewhere the guardian does not move.

An empty group remains only if both the guardian and the run are killed; the next guardian removes it.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from runtime.host.system import read

PREFIX = "tickwork-guardian-"


def enter() -> tuple[Path, Path] | None:
    """Move this process into a new group. Returns (folder of the group, folder of the previous group), or None."""
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


def leave(own: Path, came_from: Path) -> None:
    """Move this process back, and remove its group. If the previous group is gone, a later guardian removes it."""
    if move_here(came_from):
        remove(own)


def remove(group: str | Path) -> None:
    """Remove an empty group."""
    with suppress(OSError):
        os.rmdir(group)


def remove_stale(parent: Path) -> None:
    """Remove the empty groups of guardians that have ended."""
    with suppress(OSError):
        for group in parent.glob(f"{PREFIX}*"):
            if not os.path.exists(f"/proc/{group.name.removeprefix(PREFIX)}"):
                remove(group)


def hierarchy() -> Path | None:
    """Return the folder of the control groups of version 2, None if there is none."""
    for line in read("/proc/self/mounts").splitlines():
        _, folder, kind, *_ = line.split()
        if kind == "cgroup2":
            return Path(folder)
    return None


def group_of(process: int | str) -> str | None:
    """Return the path of a process's group in the hierarchy, without a leading slash; None if it is outside.

    process : its ID, or "self"
    """
    for line in read(f"/proc/{process}/cgroup").splitlines():
        number, _, path = line.split(":", 2)
        if number == "0" and ".." not in path.split("/"):
            return path.strip("/")
    return None


def move_here(group: Path) -> bool:
    """Move this process with all its threads into a group. Returns whether this is permitted."""
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

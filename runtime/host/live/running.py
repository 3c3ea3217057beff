"""Runs on this machine: processes that have created a shared state, found by its file descriptor."""

from __future__ import annotations

import os
from pathlib import Path

from cext.memory.shared_state import SharedState

MEMORY = "/memfd:tickwork"


def shared_state_of(pid: int) -> SharedState | None:
    """Return the shared state that a process has created, None if it has none. Raises PermissionError."""
    try:
        entries = list(Path("/proc", str(pid), "fd").iterdir())
    except (FileNotFoundError, ProcessLookupError):
        return None
    for entry in entries:
        try:
            if not os.readlink(entry).startswith(MEMORY):
                continue
            descriptor = os.open(entry, os.O_RDWR)
        except (FileNotFoundError, ProcessLookupError):
            continue
        try:
            shared = SharedState(fd=descriptor)
        except ValueError:  # not initialized yet, or of another version
            continue
        finally:
            os.close(descriptor)
        if shared.control == pid:  # the recorder has also mapped it
            return shared
    return None


def runs() -> dict[int, SharedState]:
    """Return {process ID: shared state} of every run that this user may access.

    `emulate` also has a shared state, but no table of live parameters.
    """
    states: dict[int, SharedState] = {}
    for name in os.listdir("/proc"):
        if name.isdigit():
            try:
                shared = shared_state_of(int(name))
            except PermissionError:
                continue
            if shared is not None and shared.live and not shared.closed:
                states[int(name)] = shared
    return states

"""The runs on this machine: processes that have made a shared page, found by the descriptor they hold."""

import os
from pathlib import Path

from cext.safety.shared_state import SharedState

MEMORY = "/memfd:tickwork"


def page_of(pid):
    """The shared page that a process has made, None while it has none. PermissionError where it may not be looked
    at.
    """
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
            page = SharedState(fd=descriptor)
        except ValueError:  # still being made, or another version's
            continue
        finally:
            os.close(descriptor)
        if page.control == pid:  # the recorder has it too
            return page
    return None


def runs():
    """{pid: SharedState} of every run that this user may look at."""
    found = {}
    for name in os.listdir("/proc"):
        if name.isdigit():
            try:
                page = page_of(int(name))
            except PermissionError:
                continue
            if page is not None and not page.closed:
                found[int(name)] = page
    return found

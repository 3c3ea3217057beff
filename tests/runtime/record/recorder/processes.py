"""Processes of a recorder that are not children of the tests."""

import os
import select
import time
from pathlib import Path


def writers(session, name="tickwork-record"):
    """Process numbers of the writers of a run, or of what starts them (tickwork-parts): all are of one session."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if (
                entry.name.isdigit()
                and (entry / "comm").read_text() == f"{name}\n"
                and os.getsid(int(entry.name)) == session
            ):
                alive = (entry / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
                found += [int(entry.name)] * alive
        except OSError:  # it has just ended
            pass
    return found


def all_ended(session):
    """Return whether no writer and no parent of writers is left in a session."""
    deadline = time.monotonic() + 2.0  # from closing its last file to its end a process takes a moment
    while (left := writers(session) + writers(session, "tickwork-parts")) and time.monotonic() < deadline:
        time.sleep(0.001)
    return not left


def ends_by_itself(pid, timeout=20.0):
    """Return whether a process ends within a time in s."""
    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    try:
        return bool(poll.poll(timeout * 1e3))
    finally:
        os.close(descriptor)

"""Mark by which the processes that user code has started are recognized, and end with the command.

The mark is a number in the soft limit RLIMIT_LOCKS, which Linux does not enforce (since 2.4.25). Every process inherits
it through fork and exec, whatever it does with its environment, its descriptors, its session and its parent. A process
that sets the limit leaves the run: `prlimit --locks=unlimited COMMAND`.

This file must parse on Python 3.6 or newer.
"""

import os
import resource
import signal
from contextlib import suppress

RLIMIT_LOCKS = 10  # linux/resource.h; the module `resource` lacks it
PROCESS_SHIFT = 32  # bits; the ID of the process that has set the mark is above them, random bits are below
ROUND_LIMIT = 100  # rounds of `end_marked`: a marked process may start another in each


def set_mark() -> None:
    """Mark this process and every process that it starts afterwards.

    Does nothing where the system lacks the limit or has restricted it.
    """
    mark = os.getpid() << PROCESS_SHIFT | int.from_bytes(os.urandom(PROCESS_SHIFT // 8), "little")
    with suppress(OSError, ValueError):
        resource.setrlimit(RLIMIT_LOCKS, (mark, resource.getrlimit(RLIMIT_LOCKS)[1]))


def own_mark(process: "int | None" = None) -> "int | None":
    """Return the mark that this process bears if `process` has set it; by default this process. None for any other."""
    with suppress(OSError, ValueError):
        mark = resource.getrlimit(RLIMIT_LOCKS)[0]
        if mark >> PROCESS_SHIFT == (os.getpid() if process is None else process):
            return mark
    return None


def remove_mark() -> None:
    """Remove the mark from this process and those that it starts from now on."""
    with suppress(OSError, ValueError):
        hard = resource.getrlimit(RLIMIT_LOCKS)[1]
        resource.setrlimit(RLIMIT_LOCKS, (hard, hard))


def end_marked(mark: "int | None") -> None:
    """Kill every process with a mark, except this one. Does nothing for None.

    Processes of other users, and those whose limits this user may not read, are not killed.
    """
    if mark is None:
        return
    killed = {os.getpid()}
    for _ in range(ROUND_LIMIT):
        with suppress(OSError):  # no file descriptor is left
            present = {int(name) for name in os.listdir("/proc") if name.isdigit()}
            marked = {process for process in present - killed if bears(process, mark)}
            for process in marked:
                kill(process, mark)
            killed |= marked
            if marked:
                continue
        return


def bears(process: int, mark: int) -> bool:
    """Return whether a process bears a mark."""
    with suppress(OSError, ValueError):  # it has ended, or belongs to another user
        return resource.prlimit(process, RLIMIT_LOCKS)[0] == mark
    return False


def kill(process: int, mark: int) -> None:
    """Kill a process if it still bears the mark, and never another that has got its number."""
    with suppress(OSError):
        handle = os.pidfd_open(process)
        try:
            if bears(process, mark):
                signal.pidfd_send_signal(handle, signal.SIGKILL)
        finally:
            os.close(handle)

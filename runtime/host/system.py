"""Properties of this process and its processors that Linux reports."""

from __future__ import annotations

import ctypes
import os
import pwd
import resource
import signal
from collections.abc import Callable
from contextlib import suppress

PR_SET_PDEATHSIG = 1  # linux/prctl.h
CAP_IPC_LOCK, CAP_SYS_NICE = 14, 23  # linux/capability.h


def end_with_parent() -> None:
    """Let the kernel kill this process when the thread that started it ends: for `preexec_fn` of subprocess."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)


def processor_wait() -> float:
    """Return the time in s for which this thread was ready to run and had no processor.

    0.0 if the kernel does not count it.
    """
    fields = read("/proc/thread-self/schedstat").split()
    return int(fields[1]) * 1e-9 if len(fields) > 1 else 0.0


def maps(pid: int, descriptor: int) -> bool:
    """Return whether a process has mapped the file of a descriptor of this process.

    After an exec, the process keeps its number, but not the mapping.
    """
    inode = str(os.fstat(descriptor).st_ino)
    with suppress(OSError):  # it has ended, or runs as another user
        with open(f"/proc/{pid}/maps") as file:
            return any(line.split()[4:5] == [inode] for line in file)
    return False


def name_process(name: str) -> None:
    """Set the name of this process, as `ps` shows it."""
    with open("/proc/self/comm", "w") as file:
        file.write(name)


def user() -> str:
    """Return the name of this process's account, or # and its number if it has none, as in a container."""
    try:
        return pwd.getpwuid(os.getuid()).pw_name
    except KeyError:
        return f"#{os.getuid()}"


def capable(capability: int) -> bool:
    """Return whether this process has an effective capability. capability : number in linux/capability.h"""
    for line in read("/proc/self/status").splitlines():
        if line.startswith("CapEff:"):
            return bool(int(line.split()[1], 16) >> capability & 1)
    return False


def address_space() -> int:
    """Return the bytes of address space of this process."""
    return int(read("/proc/self/statm").split()[0]) * resource.getpagesize()


def stack_limit() -> int:
    """Return the size limit of the main thread's stack in bytes; 8 MiB if it is unlimited."""
    soft = resource.getrlimit(resource.RLIMIT_STACK)[0]
    return 8 << 20 if soft == resource.RLIM_INFINITY else soft


def isolated_processors() -> set[int]:
    """Return the numbers of the isolated processors (isolcpus=)."""
    return processors(read("/sys/devices/system/cpu/isolated"))


def processors(text: str) -> set[int]:
    """Return the numbers in the kernel's list format: {0, 2, 3} for "0,2-3"."""
    numbers: set[int] = set()
    for part in text.strip().split(","):
        first, _, last = part.partition("-")
        if first.isdigit():
            numbers |= set(range(int(first), int(last or first) + 1))
    return numbers


def exhausted_group(text_of: Callable[[str], str] | None = None) -> str | None:
    """Return the file that denies the control group of this session any real-time budget; None if none is found.

    text_of : function that reads a file of the machine, "" for an unreadable one; of this machine by default
    """
    text_of = text_of or read
    for line in text_of("/proc/self/cgroup").splitlines():
        _, controllers, path = line.split(":", 2)
        if "cpu" in controllers.split(","):
            for mount in ("cpu", "cpu,cpuacct"):
                file = f"/sys/fs/cgroup/{mount}{path.rstrip('/')}/cpu.rt_runtime_us"
                if text_of(file).strip() == "0":
                    return file
    return None


def read(path: str) -> str:
    """Return the content of a small text file, "" for an unreadable one."""
    with suppress(OSError), open(path) as file:
        return file.read()
    return ""

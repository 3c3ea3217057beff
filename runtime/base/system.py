"""What Linux says of this process and of the processors it has."""

import os
import pwd
import resource
from contextlib import suppress

CAP_IPC_LOCK, CAP_SYS_NICE = 14, 23  # linux/capability.h


def user():
    try:
        return pwd.getpwuid(os.getuid()).pw_name
    except KeyError:
        return f"#{os.getuid()}"


def capable(capability):
    """Whether this process has a capability in effect, by its number in linux/capability.h."""
    for line in read("/proc/self/status").splitlines():
        if line.startswith("CapEff:"):
            return bool(int(line.split()[1], 16) >> capability & 1)
    return False


def memory_sizes():
    """(bytes of address space of this process, bytes that are available on the machine)"""
    size = int(read("/proc/self/statm").split()[0]) * resource.getpagesize()
    free = [
        int(line.split()[1]) << 10 for line in read("/proc/meminfo").splitlines() if line.startswith("MemAvailable:")
    ]
    return size, free[0] if free else 2 * size


def stack_limit():
    soft = resource.getrlimit(resource.RLIMIT_STACK)[0]
    return 8 << 20 if soft == resource.RLIM_INFINITY else soft


def isolated_processors():
    """Numbers of the processors that the kernel keeps for who asks (isolcpus=)."""
    return processors(read("/sys/devices/system/cpu/isolated"))


def processors(text):
    """{0, 2, 3} of the kernel's "0,2-3"."""
    found = set()
    for part in text.strip().split(","):
        first, _, last = part.partition("-")
        if first.isdigit():
            found |= set(range(int(first), int(last or first) + 1))
    return found


def exhausted_group(text_of=None):
    """The file that denies this session's control group any real-time, or None where none does or it cannot be told.

    text_of : reads a file of the machine, "" where it cannot; this machine's by default
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


def read(path):
    """A small text file, or "" where it cannot be read."""
    with suppress(OSError), open(path) as file:
        return file.read()
    return ""

"""Memory that a loop uses, brought in before its first tick, so that no tick waits for a page.

Memory is locked page by page as it is used. Most of a process is never used by its loop: the library of linear algebra
alone has 90 MB of code and buffers.
"""

import re
from collections.abc import Iterator
from typing import NamedTuple

from cext.clock import realtime as native

MAPPING = re.compile(r"([0-9a-f]+)-([0-9a-f]+) (....) \S+ \S+ \S+ *(.*)")
# files whose code and data a tick can use: our modules, the interpreter, the C library, NumPy's core
LOOP_FILES = re.compile(
    r"/cext/|/(lib)?python3[^/]*$|/(libc|libm|libpthread|ld-linux)[^/]*$|_multiarray_umath|\[heap\]"
)
USED_SHARE = 0.5  # resident share from which an anonymous mapping counts as used


class Mapping(NamedTuple):
    """Mapping of a process: addresses, permissions such as "r-xp", name, resident bytes."""

    begin: int
    end: int
    permissions: str
    name: str
    resident: int

    @property
    def is_used(self) -> bool:
        """Whether a loop uses it."""
        if not self.permissions.startswith("r") or self.permissions.endswith("s"):
            return False
        if self.name:
            return LOOP_FILES.search(self.name) is not None
        return self.resident >= USED_SHARE * (self.end - self.begin)


def mappings(text: str) -> Iterator[Mapping]:
    """Yield the mappings of a process. text : content of /proc/PID/smaps"""
    match, resident = None, 0
    for line in [*text.splitlines(), ""]:
        head = MAPPING.fullmatch(line)
        if match is not None and (head or not line):
            yield Mapping(int(match[1], 16), int(match[2], 16), match[3], match[4], resident)
        match = head or match
        if line.startswith("Rss:"):
            resident = int(line.split()[1]) << 10


def prefault() -> None:
    """Bring in the memory that a loop of this process uses: the code, the heap and the data of its modules."""
    try:
        with open("/proc/self/smaps") as file:
            text = file.read()
    except OSError:  # /proc is not mounted
        return
    for mapping in mappings(text):
        if mapping.is_used:
            native.prefault(mapping.begin, mapping.end, "w" in mapping.permissions)

"""Allocation of a processor to the loop, so that two loops on one machine use different ones.

A loop reserves its processor with a name in Linux's abstract socket namespace, as for a bus
(runtime.robot.guardian.lock): the reservation ends with the process.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Sequence

from runtime.host.descriptors import close, identity
from runtime.host.system import read


class Processor:
    """Processor of a loop from construction until `close`.

    It is the first one that no other loop uses; if all are in use, the first, shared.

    numbers : numbers of the processors, at least one, in order of preference

    number : number of the allocated processor
    shared : whether another loop uses it
    """

    def __init__(self, numbers: Sequence[int]) -> None:
        for number in numbers:
            self._name = socket.socket(socket.AF_UNIX)
            try:
                self._name.bind(f"\0tickwork/processor/{number}")
            except OSError:
                self._name.close()
            else:
                self.number, self.shared, self._file = number, False, identity(self._name.fileno())
                return
        self.number, self.shared, self._file = numbers[0], True, None

    def close(self) -> None:
        """Release the processor."""
        close(self._name.detach(), self._file)


def fastest_first(numbers: set[int], text_of: Callable[[str], str] = read) -> list[int]:
    """Return processors in order of preference: the last of the fastest first, since the first serves interrupts.

    text_of : function that reads a file of the machine, "" for an unreadable one
    """

    def speed(number: int) -> int:
        return int(text_of(f"/sys/devices/system/cpu/cpu{number}/cpufreq/cpuinfo_max_freq").strip() or 0)  # kHz

    return sorted(numbers, key=lambda number: (speed(number), number), reverse=True)

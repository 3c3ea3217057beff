"""A processor for the loop: which one it takes, so that two loops of one machine do not take the same.

A loop that has one holds a name in Linux's abstract namespace of sockets, as a bus has (runtime.guardian.lock): it ends
with its holder.
"""

import socket

from runtime.base.system import read


class Processor:
    """The first of these that no other loop has, from now until `close`; where every one is taken, the first, together
    with another.

    numbers : of processors, the best first; one at least

    number : of the one it is
    """

    def __init__(self, numbers):
        for number in numbers:
            self._name = socket.socket(socket.AF_UNIX)
            try:
                self._name.bind(f"\0tickwork/processor/{number}")
            except OSError:
                self._name.close()
            else:
                self.number = number
                return
        self.number = numbers[0]

    def close(self):
        self._name.close()


def fastest_first(numbers, text_of=read):
    """Processors with the best for a loop first: of the fastest the last, as it is the first that answers interrupts
    where nothing else is set.

    text_of : reads a file of the machine, "" where it cannot
    """

    def speed(number):
        return int(text_of(f"/sys/devices/system/cpu/cpu{number}/cpufreq/cpuinfo_max_freq").strip() or 0)  # kHz

    return sorted(numbers, key=lambda number: (speed(number), number), reverse=True)

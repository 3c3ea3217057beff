"""Processes that notice when this machine stands still: one for each processor, above the priorities of all others.

Each wakes every PERIOD and notes where it is late. Nothing on the machine itself delays it.

Without permission for real-time priority nothing is noticed.
"""

import os
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PERIOD = 0.004  # s
SHORTEST = 0.01  # s that count
PRIORITY = 98
FILE = "STANDSTILLS"  # variable of the environment: file that the processes write
NOTE = struct.Struct("dd")  # begin and end, in s of the monotonic clock
DELIVERY = 0.02  # s for a note to be written


def watch(file, processor):
    """Write each standstill of a processor to a file, until the parent has ended."""
    os.sched_setaffinity(0, {processor})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    notes, parent, before = os.open(file, os.O_WRONLY | os.O_APPEND), os.getppid(), time.monotonic()
    print("ready", flush=True)
    while os.getppid() == parent:
        time.sleep(PERIOD)
        now = time.monotonic()
        if now - before > PERIOD + SHORTEST:
            os.write(notes, NOTE.pack(before, now))
        before = now


class Watching:
    """The processes, until `end`. The environment has their file."""

    def __init__(self):
        descriptor, os.environ[FILE] = tempfile.mkstemp(prefix="standstills-")
        os.close(descriptor)
        words = [sys.executable, "-S", __file__, os.environ[FILE]]
        how = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        self.processes = [subprocess.Popen([*words, str(each)], **how) for each in sorted(os.sched_getaffinity(0))]
        for process in self.processes:
            process.stdout.readline()

    def end(self):
        for process in self.processes:
            process.kill()
            process.communicate()
        os.unlink(os.environ.pop(FILE))


def standstills(since=0.0):
    """s of each standstill that ended after some time of the monotonic clock."""
    time.sleep(DELIVERY)
    notes = NOTE.iter_unpack(Path(os.environ[FILE]).read_bytes())
    return [end - begin for begin, end in notes if end > since]


if __name__ == "__main__":
    watch(sys.argv[1], int(sys.argv[2]))

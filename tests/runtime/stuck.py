"""Where the processes of a run are that does not end: for the report of a test whose patience is over."""

import faulthandler
import os
import signal
import time
from contextlib import suppress
from pathlib import Path

import psutil

SHOW_STACK = signal.SIGRTMIN + 3
WAIT = 0.5  # s for all threads to have written their stacks


def show_stack_on_signal():
    """Let this process and those that it forks write the stacks of their threads to standard error at SHOW_STACK."""
    faulthandler.register(SHOW_STACK, file=2, all_threads=True, chain=False)


def family(process):
    """A run and all its processes."""
    parent = psutil.Process(process.pid)
    return [parent, *parent.children(recursive=True)]


def ask_for_stacks(run):
    """Have each process of a run write its stacks, if it can. Returns what the kernel says of their threads."""
    lines, processes = [], []
    with suppress(psutil.Error):  # it has ended, and another process holds its output
        processes = [process.pid for process in family(run)]
    for process in processes:
        with suppress(OSError):
            folder = Path(f"/proc/{process}")
            status = dict(line.split(":\t", 1) for line in (folder / "status").read_text().splitlines())
            signals = ("SigPnd", "ShdPnd", "SigBlk", "SigIgn", "SigCgt")
            lines.append(f"{process} {', '.join(f'{name} {status[name]}' for name in signals)}")
            if int(status["SigCgt"], 16) >> (SHOW_STACK - 1) & 1:
                os.kill(process, SHOW_STACK)
        lines += threads(process)
    time.sleep(WAIT)
    return "\n".join(lines)


def threads(process):
    """A line for each thread of a process: name, state, policy, priority, where it waits, system call."""
    lines = []
    with suppress(OSError):
        for thread in sorted(Path(f"/proc/{process}/task").iterdir()):
            fields = (thread / "stat").read_text().rpartition(")")[2].split()
            name, at, call = ((thread / part).read_text().strip() for part in ("comm", "wchan", "syscall"))
            state, processor, priority, policy = fields[0], fields[36], fields[37], fields[38]
            where = f"processor {processor}, policy {policy}, priority {priority}, waits in {at}, call {call}"
            lines.append(f"{process} {thread.name} {name}: {state}, {where}")
    return lines

"""Real-time priority of the threads of an emulator: a busy machine must not delay what a robot's hardware sends."""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

from cext.clock.realtime import stop_watching
from runtime.host.machine.realtime import limit_spinning, restore_scheduler

PRIORITY = 20  # of SCHED_FIFO, below a run's and below interrupt threads


def take_priority() -> None:
    """Give the calling thread real-time priority, if that is permitted."""
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))


@contextmanager
def priority_of_loop() -> Iterator[None]:
    """Context manager of that priority for a loop that loses it if it does not sleep, as a plant that is too slow."""
    with ExitStack() as guard:
        limit_spinning(guard, stop_watching)
        guard.callback(restore_scheduler, os.sched_getscheduler(0), os.sched_getparam(0))
        take_priority()
        yield

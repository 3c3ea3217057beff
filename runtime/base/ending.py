"""How a process of Tickwork ends: the signals that end a command, and the exit itself."""

import atexit
import gc
import io
import os
import signal
import threading
from contextlib import suppress

ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1)
FLUSH_LIMIT = 1.0  # s for the files that user code has left open


class Interrupted(KeyboardInterrupt):
    """A signal that ends the command. number : of the signal"""

    def __init__(self, number):
        super().__init__(number)
        self.number = number


def raise_on_signals():
    """Let the ending signals raise Interrupted in this process, so that `finally` and `with` are carried out. SIGINT
    keeps its handler, and so does a signal that is ignored or handled already.
    """

    def interrupt(number, frame):
        raise Interrupted(number)

    for number in ENDING_SIGNALS:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, interrupt)


def ignore_signals():
    """Ignore the ending signals in a process that ends with its parent."""
    for number in ENDING_SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def uninterrupted(outcome):
    """Return a cext.schedule.executor.Outcome; raise Interrupted if a signal has ended its run."""
    if outcome.signal:
        raise Interrupted(outcome.signal)
    return outcome


def leave(code):
    """End the process with an exit code, without the interpreter's own ending.

    That one takes 50 ms to take every object apart, and waits for the threads of user code for ever. Exit handlers are
    called, and the files that user code has left open are written. A signal meanwhile ends the process at once.
    """

    def leave_now(number=0, frame=None):
        os._exit(code)

    for number in ENDING_SIGNALS:
        signal.signal(number, leave_now)
    with suppress(Exception):
        atexit._run_exitfuncs()
    timer = threading.Timer(FLUSH_LIMIT, leave_now)  # a thread that hangs in a write holds the lock of its file
    timer.daemon = True
    with suppress(RuntimeError):  # the system grants no more threads
        timer.start()
    flush_files()
    leave_now()


def flush_files():
    """Write what is in the buffers of every open file."""
    gc.unfreeze()  # the collector does not list what a run has frozen
    for kind in (io.TextIOWrapper, io.BufferedWriter, io.BufferedRandom):
        for file in gc.get_objects():
            if type(file) is kind:
                with suppress(Exception):
                    file.flush()

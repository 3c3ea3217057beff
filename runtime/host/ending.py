"""How a process of Tickwork ends: the signals that end a command, and the exit itself.

    imports of the command      leave_on_signals    a signal ends the process at once; nothing is armed yet
    the command                 raise_on_signals    a signal raises Interrupted
    Executor.run                cext.clock.signals  a signal ends the run

Library code may swallow the exception or replace it by another. It is raised again every RETRY_PERIOD until it is
handled, and `as_interrupt` replaces what surfaces instead.

This file must parse on Python 3.6 or newer.
"""

import atexit
import gc
import io
import os
import signal
import sys
import threading
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from runtime.host.run_mark import end_marked, own_mark

if TYPE_CHECKING:
    from collections.abc import Callable, Generator
    from typing import NoReturn

    from cext.schedule.outcome import Outcome

ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1)
CHILD_EXIT_LIMIT = 0.03  # s for the exit handlers to end the processes that user code has started
FLUSH_LIMIT = 1.0  # s for the files that user code has left open
RETRY_PERIOD = 0.03  # s after which a swallowed Interrupted is raised again


class Interrupted(BaseException):
    """A signal that ends the command. number : number of the signal

    It is not a KeyboardInterrupt, after which `subprocess` waits 250 ms for a child.
    """

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def leave_on_signals() -> None:
    """Let the ending signals end this process at once. One that is ignored or handled already keeps its handler."""
    for number in ENDING_SIGNALS:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _leave)


def raise_on_signals() -> None:
    """Raise Interrupted at a signal of `leave_on_signals` from now on, so that `finally` and `with` are carried out."""
    for number in ENDING_SIGNALS:
        if signal.getsignal(number) is _leave:
            signal.signal(number, _interrupt)
            sys.unraisablehook = _unraisable


def _leave(number: int, frame: object) -> None:
    with suppress(OSError):
        os.write(2, f"tickwork: {stopped_by(number)}\n".encode())
    os._exit(128 + number)


def stopped_by(number: int) -> str:
    """Return the message of a command that a signal has ended. number : number of the signal"""
    name = "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
    return f"stopped by {name}; nothing is armed"


_raised = None  # the last Interrupted, until it is handled


def _interrupt(number: int, frame: object) -> None:
    global _raised
    _raised = Interrupted(number)
    signal.signal(signal.SIGALRM, _retry)
    signal.setitimer(signal.ITIMER_REAL, RETRY_PERIOD, RETRY_PERIOD)
    raise _raised


def _retry(number: int, frame: object) -> None:
    """Raise the last Interrupted again, unless an `except`, `finally` or `with` is being carried out for it."""
    error = sys.exc_info()[1]
    while error is not None and not isinstance(error, Interrupted):
        error = error.__context__
    if error is None:
        raise_if_interrupted()


def _unraisable(entry: "sys.UnraisableHookArgs") -> None:
    if _raised is None and entry.exc_type is not KeyboardInterrupt:  # of the watchdog, which has noted that it hung
        sys.__unraisablehook__(entry)


def raise_if_interrupted() -> None:
    """Raise Interrupted if a signal has arrived and is not handled yet."""
    if _raised is not None:
        raise Interrupted(_raised.number)


def forget_interrupt() -> None:
    """Continue after an Interrupted, which is not raised again."""
    global _raised
    if _raised is not None:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    _raised = None


@contextmanager
def as_interrupt() -> "Generator[None]":
    """Raise Interrupted at the end of a `with` block if an unhandled signal has arrived in it.

    It replaces any other exception.
    """
    try:
        yield
    finally:
        raise_if_interrupted()


def ignore_signals() -> None:
    """Ignore the ending signals in a process that ends with its parent."""
    for number in ENDING_SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def raise_if_ended_by_signal(outcome: "Outcome") -> "Outcome":
    """Return the outcome of a run; raise Interrupted if a signal has ended it."""
    if outcome.signal:
        raise Interrupted(outcome.signal)
    return outcome


def leave(code: int) -> "NoReturn":
    """End the process with an exit code, without the interpreter's own ending.

    The interpreter's ending takes 50 ms to free all objects, and waits indefinitely for threads of user code. Exit
    handlers are called, files that user code has left open are flushed, and the processes that it has started are
    killed. A signal meanwhile ends the process.
    """
    mark = own_mark()

    def leave_now(number: int = 0, frame: object = None) -> "NoReturn":
        end_marked(mark)
        os._exit(code)

    for number in ENDING_SIGNALS:
        signal.signal(number, leave_now)
    after(CHILD_EXIT_LIMIT, lambda: end_marked(mark))  # the handler of multiprocessing waits for its processes
    with suppress(Exception):
        atexit._run_exitfuncs()  # pyright: ignore[reportPrivateUsage] there is no other way to call them
    after(FLUSH_LIMIT, leave_now)  # a thread that hangs in a write holds the lock of its file
    with suppress(Exception):  # a block has limited the memory of the process
        flush_files()
    leave_now()


def after(seconds: float, function: "Callable[[], object]") -> None:
    """Call a function in another thread, unless the process has ended before."""
    with suppress(RuntimeError):  # the system grants no more threads, or user code has removed sys.excepthook
        timer = threading.Timer(seconds, function)
        timer.daemon = True
        timer.start()


def flush_files() -> None:
    """Write what is in the buffers of every open file."""
    gc.unfreeze()  # the collector does not list frozen objects
    kinds = (io.TextIOWrapper, io.BufferedWriter, io.BufferedRandom)
    for file in sorted(
        (file for file in gc.get_objects() if type(file) in kinds), key=lambda file: kinds.index(type(file))
    ):
        with suppress(Exception):
            file.flush()

"""Text of exceptions that user code raised. Their `__str__` and `__repr__` are user code, too: they may raise, or never
return.
"""

import ctypes
import threading
import time
import traceback

TEXT_LIMIT = 0.02  # s for the text of one exception


def text_of(error, limit=TEXT_LIMIT):
    """Return str(error); of one whose text cannot be formed, why not.

    limit : s after which the text is given up
    """
    return bounded(lambda: str(error), limit)


def name_and_text(error, limit=TEXT_LIMIT):
    """Return 'ValueError: no such gain': the name of an exception, and what it says if it says anything."""
    text = text_of(error, limit)
    return type(error).__name__ + (f": {text}" if text else "")


def last_lines(error):
    """Return the lines with which Python ends a traceback: name and text, and the notes that were added."""
    text = bounded(
        lambda: "".join(traceback.format_exception_only(type(error), error)),
        TEXT_LIMIT,
        prefix=f"{type(error).__name__}: ",
    )
    return text.rstrip().split("\n")


def within(seconds):
    """Return a function that returns how much of `seconds` is left, 1 ms at least: a limit that several texts share."""
    deadline = time.monotonic() + seconds
    return lambda: max(deadline - time.monotonic(), 0.001)


def bounded(form, limit, prefix=""):
    """Return what `form` returns, as text; where it raises or takes longer than `limit` s, `prefix` and the reason.

    A thread calls it, which is asked to end after that: one that computes for ever would take the interpreter's time.
    One that does not end stays behind as a daemon thread, and ends with the process.
    """
    found = []

    def call():
        try:
            found.append(str.__str__(form()))  # a plain str, also of a subclass with methods of its own
        except BaseException as error:
            found.append(f"{prefix}(no text: it raised {type(error).__name__})")

    thread = threading.Thread(target=call, daemon=True)
    try:
        thread.start()
    except RuntimeError:  # the system grants no more threads
        return f"{prefix}(no text)"
    thread.join(limit)
    if not found:
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident or 0), ctypes.py_object(SystemExit))
    return found[0] if found else f"{prefix}(no text within {limit * 1e3:.0f} ms)"

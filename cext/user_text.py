"""Text of objects of user code, such as exceptions and values of parameters.

Their `__str__` and `__repr__` are user code, too: they may raise, or never return.
"""

from __future__ import annotations

import ctypes
import threading
import time
import traceback
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


TEXT_LIMIT = 0.02  # s for one text
REPR_LENGTH_LIMIT = 300  # characters of a value in a message


def text_of(value: object, limit: float = TEXT_LIMIT) -> str:
    """Return str(value), or in parentheses the reason why it has none.

    limit : s
    """
    return bound_text(lambda: str(value), limit)


def repr_of(value: object, length: int = REPR_LENGTH_LIMIT) -> str:
    """Return repr(value), or in parentheses the reason why it has none.

    length : characters after which the text is cut, and ends in its full length
    """
    text = bound_text(lambda: repr(value), TEXT_LIMIT)
    return text if len(text) <= length else f"{text[:length]}... ({len(text)} characters)"


def name_and_text(error: BaseException, limit: float = TEXT_LIMIT) -> str:
    """Return 'ValueError: no such gain': the name of an exception, and its text if there is any."""
    text = text_of(error, limit)
    return type(error).__name__ + (f": {text}" if text else "")


def last_lines(error: BaseException) -> list[str]:
    """Return the lines with which Python ends a traceback: name and text, and the notes that were added."""
    text = bound_text(
        lambda: "".join(traceback.format_exception_only(type(error), error)),
        TEXT_LIMIT,
        prefix=f"{type(error).__name__}: ",
    )
    return text.rstrip().split("\n")


def within(seconds: float) -> Callable[[], float]:
    """Return a function that returns the rest of `seconds`, at least 1 ms: a limit that several texts share."""
    deadline = time.monotonic() + seconds
    return lambda: max(deadline - time.monotonic(), 0.001)


def bound_text(form: Callable[[], str], limit: float, prefix: str = "") -> str:
    """Return the text that `form` returns; where it raises or takes longer than `limit` s, `prefix` and the reason.

    A thread calls it, and receives a SystemExit at the limit, since an endless computation would take the interpreter's
    time. If it does not end, it remains as a daemon thread until the process ends.
    """
    texts = []

    def call():
        try:
            texts.append(str.__str__(form()))  # a plain str, also of a subclass with methods of its own
        except BaseException as error:
            texts.append(f"{prefix}(no text: it raised {type(error).__name__})")

    try:
        thread = threading.Thread(target=call, daemon=True)
        thread.start()
    except RuntimeError:  # the system grants no more threads, or user code has removed sys.excepthook
        return f"{prefix}(no text)"
    thread.join(limit)
    if not texts:
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident or 0), ctypes.py_object(SystemExit))
    return texts[0] if texts else f"{prefix}(no text within {limit * 1e3:.0f} ms)"

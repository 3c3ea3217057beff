"""Ctrl-C during a call of Tickwork in a script or notebook: one line instead of a traceback.

The call raises KeyboardInterrupt, which the program may catch. This module must not import anything that a file of the
working folder could shadow.
"""

import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import ParamSpec, TypeVar

    Arguments = ParamSpec("Arguments")  # on a line of its own: type checkers do not read an assignment of two
    Result = TypeVar("Result")


def interruptible(function: "Callable[Arguments, Result]") -> "Callable[Arguments, Result]":
    """Return a function whose uncaught KeyboardInterrupt is shown as one line."""

    def call(*arguments, **named):
        try:
            return function(*arguments, **named)
        except KeyboardInterrupt as interrupt:
            show_as_line(interrupt)
            raise

    for name in ("__module__", "__name__", "__qualname__", "__doc__", "__annotations__"):
        setattr(call, name, getattr(function, name))
    call.__wrapped__ = function  # whose signature help() shows
    return call


def show_as_line(interrupt: KeyboardInterrupt, result: str = "") -> None:
    """Let Python and IPython show a KeyboardInterrupt that is not caught as one line.

    result : what has ended, and where its recording is; by default the text of the exception
    """
    if result:
        interrupt.args = (result,)
    interrupt._render_traceback_ = _Line(interrupt)  # pyright: ignore[reportAttributeAccessIssue]  # for IPython
    if not isinstance(sys.excepthook, _Hook):
        sys.excepthook = _Hook(sys.excepthook)


class _Line:
    """Function that returns the lines of an exception for IPython."""

    def __init__(self, interrupt):
        self.text = f"tickwork: stopped by Ctrl-C{f': {interrupt}' * bool(str(interrupt))}"

    def __call__(self):
        return [self.text]


class _Hook:
    """Function for sys.excepthook that shows the marked exceptions. before : shows all others"""

    def __init__(self, before):
        self.before = before

    def __call__(self, kind, error, trace):
        line = getattr(error, "_render_traceback_", None)
        if isinstance(line, _Line):
            print(line.text, file=sys.stderr)
        else:
            self.before(kind, error, trace)

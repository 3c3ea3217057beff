"""Ctrl-C during a call of Tickwork in a script or notebook: one line instead of a traceback.

The call raises KeyboardInterrupt, which the program may catch, but not while it imports a library: an import that is
interrupted leaves half a module, with which the next call fails. This module must not import anything that a file of
the working folder could shadow: built-in modules alone.
"""

import _thread
import sys
import time

TYPE_CHECKING = False
if TYPE_CHECKING:
    import signal as _signal
    from collections.abc import Callable
    from types import FrameType, TracebackType
    from typing import ParamSpec, TypeVar

    Arguments = ParamSpec("Arguments")  # on a line of its own: type checkers do not read an assignment of two
    Result = TypeVar("Result")
else:
    import _signal

ROOT = __file__.removesuffix("runtime/host/interrupts.py")
LIBRARIES = (
    "<frozen ",
    f"{sys.prefix}/",
    f"{sys.base_prefix}/",
    *(f"{ROOT}{package}/" for package in ("blocks", "cext", "graph", "runtime")),
)
RETRY_PERIOD = 0.01  # s


def interruptible(function: "Callable[Arguments, Result]") -> "Callable[Arguments, Result]":
    """Return a function whose uncaught KeyboardInterrupt is shown as one line."""

    def call(*arguments: "Arguments.args", **named: "Arguments.kwargs") -> "Result":
        try:
            delays = _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler and _handle(
                interrupt_between_imports
            )
            try:
                return function(*arguments, **named)
            finally:
                if delays:
                    _handle(_signal.default_int_handler)
        except KeyboardInterrupt as interrupt:
            show_as_line(interrupt)
            raise

    for name in ("__module__", "__name__", "__qualname__", "__doc__", "__annotations__"):
        setattr(call, name, getattr(function, name))
    vars(call)["__wrapped__"] = function  # whose signature help() shows
    return call


def _handle(handler: "Callable[..., None]") -> bool:
    """Set the handler of SIGINT. Returns False outside the main thread, which alone receives signals."""
    try:
        _signal.signal(_signal.SIGINT, handler)
    except ValueError:
        return False
    return True


def interrupt_between_imports(number: int, frame: "FrameType | None") -> None:
    """Raise KeyboardInterrupt, or send the signal once more after RETRY_PERIOD while a library is being imported."""
    if not imports_library(frame):
        raise KeyboardInterrupt
    _thread.start_new_thread(_interrupt_later, (_thread.get_ident(), number))


def _interrupt_later(thread: int, number: int) -> None:
    """Send a signal to the main thread: the flag of a loop is not for handlers in other threads."""
    time.sleep(RETRY_PERIOD)
    _signal.pthread_kill(thread, number)


def imports_library(frame: "FrameType | None") -> bool:
    """Return whether a frame belongs to the import of a library; a module of the user's can be interrupted."""
    while frame is not None and _of_library(frame.f_code.co_filename):
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            return True
        frame = frame.f_back
    return False


def _of_library(path: str) -> bool:
    return path.startswith(LIBRARIES) or "-packages/" in path


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

    def __init__(self, interrupt: KeyboardInterrupt) -> None:
        self.text = f"tickwork: stopped by Ctrl-C{f': {interrupt}' * bool(str(interrupt))}"

    def __call__(self) -> "list[str]":
        return [self.text]


class _Hook:
    """Function for sys.excepthook that shows the marked exceptions. before : shows all others"""

    def __init__(self, before: "Callable[..., object]") -> None:
        self.before = before

    def __call__(self, kind: "type[BaseException]", error: BaseException, trace: "TracebackType | None") -> None:
        line = getattr(error, "_render_traceback_", None)
        if isinstance(line, _Line):
            print(line.text, file=sys.stderr)
        else:
            self.before(kind, error, trace)

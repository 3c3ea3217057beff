"""Command-line output: results on standard output, errors on standard error.

A failure to write never ends a run. If a result is lost on a full disk, its command fails (`exit_code`); a closed pipe
(`| head -1`) and a closed terminal change nothing.
"""

from __future__ import annotations

import errno
import os
import re
import select
import shutil
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from runtime.host.errors import BAD_INPUT, OK

if TYPE_CHECKING:
    from collections.abc import Iterable
    from typing import TextIO

ERASE = "\r\x1b[J"  # to the start of the line, and what follows it
LOST = "has_lost_text"  # attribute of a stream to which a result could not be written


PIPE_PART = 4096  # bytes that a pipe accepts at once if it is writable


def program() -> str:
    """Return the shell command that starts this program again, with or without an active environment."""
    script = os.path.abspath(sys.argv[0])
    if os.path.basename(script) == "tickwork":
        return "tickwork" if on_path("tickwork", script) else relative(script)
    name = next((name for name in ("python", "python3") if on_path(name, sys.executable)), None)
    return f"{name or relative(sys.executable)} -m runtime"


def short_program() -> str:
    """Return the name of this program in help texts: without the path of the interpreter."""
    return "tickwork" if program().endswith("tickwork") else "python -m runtime"


def on_path(name: str, file: str) -> bool:
    """Return whether the shell finds `file` under this name.

    Compares folders, since the executables of different environments are links to the same file.
    """
    path = shutil.which(name)
    return path is not None and os.path.realpath(os.path.dirname(path)) == os.path.realpath(os.path.dirname(file))


# Replacements for characters that the encoding of a terminal or file lacks.
IN_ASCII = str.maketrans(
    {
        "µ": "u",
        "·": "*",
        "−": "-",
        "°": " deg",
        "²": "^2",
        "³": "^3",
        "±": "+-",
        "×": "x",
        "τ": "tau",
        "σ": "sigma",
        "Δ": "delta",
        "θ": "theta",
        "ω": "omega",
        "…": "...",
        "–": "-",
        "→": "->",
        "≤": "<=",
        "≥": ">=",
        "━": "#",
        "╌": ".",
        "│": "|",
        "─": "-",
        "“": '"',
        "”": '"',
        "’": "'",
    }
)


# Control characters and bidirectional overrides that a terminal would execute, except line ends and tabs; the first
# group matches the styles of Console.
CONTROL = re.compile("(\x1b\\[(?:0|1|2|31|32|33)m)|[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def harmless(text: str, coloured: bool) -> str:
    """Return a text with its control characters escaped, as in \\x1b.

    Names, notes and events of a recording may contain any characters.

    coloured : keep the styles of Console
    """
    return CONTROL.sub(
        lambda match: match[0] if match[1] and coloured else match[0].encode("unicode_escape").decode(), text
    )


def one_line(text: str, coloured: bool = False) -> str:
    """Return a text of a recording as `harmless` does, with ends of lines and tabs also escaped.

    Otherwise they could show a line that Tickwork has not written.
    """
    return harmless(text, coloured).replace("\n", "\\n").replace("\t", "\\t")


class StopMessages:
    """Lines on standard error of a process that stops actuators. They never delay it.

    A line is dropped if standard error is closed, and waits while a stopped terminal or a full pipe accepts none.
    """

    def __init__(self) -> None:
        self._waiting = b""

    def write(self, words: str) -> None:
        """Write one line, on a terminal in place of the status line that the recorder has drawn.

        words : text with names of devices and interfaces, which may contain any characters
        """
        with suppress(Exception):  # the code of a diagram may have closed or replaced it
            erase = ERASE if sys.stderr.isatty() and os.environ.get("TERM", "") not in ("", "dumb") else ""
            line = f"{erase}{one_line(words)}\n"
            self._waiting += line.encode(sys.stderr.encoding or "utf-8", "backslashreplace")
        self.flush()

    def flush(self) -> None:
        """Write what is accepted now."""
        try:
            while self._waiting and is_writable(sys.stderr.fileno()):
                self._waiting = self._waiting[os.write(sys.stderr.fileno(), self._waiting[:PIPE_PART]) :]
        except Exception:
            self._waiting = b""


def is_writable(descriptor: int) -> bool:
    """Return whether a file accepts PIPE_PART bytes at once, or an error. descriptor : file descriptor"""
    poll = select.poll()
    poll.register(descriptor, select.POLLOUT)
    return bool(poll.poll(0))


def print_lines(lines: Iterable[object]) -> None:
    """Write lines to standard output. A failure to write is reported on standard error."""
    write(lines, sys.stdout)


def print_to_stderr(lines: Iterable[str]) -> None:
    """Write lines to standard error, with paths relative to the working folder. Ignores a failure to write."""
    write([relative(line) for line in lines], sys.stderr)


def reopen_streams() -> None:
    """Open standard output and standard error again where the code of a diagram has closed their files."""
    for name, number in (("stdout", 1), ("stderr", 2)):
        stream = getattr(sys, name)
        if stream is not None and getattr(stream, "closed", False):
            setattr(sys, name, open(number, "w", encoding="utf-8", errors="backslashreplace", closefd=False))


def write(lines: Iterable[object], stream: TextIO | None) -> None:
    """Write lines to a stream, with control characters escaped and missing characters replaced.

    stream : None for one that is closed: nothing is written

    Redirects the stream to /dev/null at the first failure, and reports one other than a closed pipe on standard error.
    """
    if stream is None:
        return
    try:
        text = harmless("".join(f"{line}\n" for line in lines), stream.isatty())
        stream.write(readable(text, stream.encoding or "utf-8"))
        stream.flush()
    except BrokenPipeError:
        _discard(stream)
    except OSError as error:
        _discard(stream)
        if stream is not sys.stderr:
            print_to_stderr([f"tickwork: cannot write to standard output: {error.strerror}"])
            setattr(stream, LOST, error.errno != errno.EBADF)  # closed by a block, as a terminal can be


def exit_code(code: int) -> int:
    """Return the exit code of a command: that of an unusable file if standard output has lost its result."""
    return BAD_INPUT if code == OK and getattr(sys.stdout, LOST, False) else code


def readable(text: str, encoding: str) -> str:
    """Return a text with replacements for the characters that an encoding lacks."""
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        text = text.translate({code: word for code, word in IN_ASCII.items() if not _is_encodable(chr(code), encoding)})
    return text.encode(encoding, "replace").decode(encoding)


def _is_encodable(character: str, encoding: str) -> bool:
    """Return whether an encoding has a character."""
    try:
        character.encode(encoding)
    except UnicodeEncodeError:
        return False
    return True


def _discard(stream: TextIO) -> None:
    """Redirect a stream to /dev/null, so that flushing its buffer at exit raises no error."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def relative(text: str) -> str:
    """Return a text whose paths below the working folder are relative to it."""
    try:
        here = os.getcwd().rstrip("/") + "/"
    except OSError:  # the folder was removed
        return text
    return re.sub(rf"(?<![\w./~-]){re.escape(here)}(?=[^/\s])", "", text) if here != "/" else text

"""Processes beside a measurement, which are killed at its end."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from runtime.host.system import end_with_parent

ROOT = Path(__file__).parents[3]


@contextmanager
def emulation(
    module: str, *arguments: str, what: str, remedy: str = "", descriptors: Sequence[int] = ()
) -> Iterator[None]:
    """Context manager of a process that emulates devices. Raises OSError if it does not start.

    module : prints a line when its devices are ready
    what, remedy : text of the message, such as "drives" and ". Check that ..."
    descriptors : file descriptors that the process inherits under the same numbers
    """
    process = subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        cwd=ROOT,
        pass_fds=descriptors,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=end_with_parent,
    )
    assert process.stdout is not None
    try:
        if process.stdout.readline() != "ready\n":
            raise OSError(f"the emulated {what} did not start{remedy}")
        yield
    finally:
        process.kill()
        process.wait()
        process.stdout.close()

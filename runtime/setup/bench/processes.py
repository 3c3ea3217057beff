"""Processes beside a measurement, which are killed at its end."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from runtime.host.system import end_with_parent

ROOT = Path(__file__).parents[3]
START_TIMEOUT = 10.0  # s until a run commands torque
WAITS = """
import os, sys
import blocks.families, can, runtime.cli.run, runtime.robot.rig, runtime.session.session
import runtime.robot.loading.simulation
from runtime.__main__ import main
print("ready", flush=True)
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
sys.stdin.read()
main()
"""


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


@contextmanager
def run_on_rig(robot: Path, rig: Path, *words: str) -> Iterator[subprocess.Popen[str]]:
    """Context manager of a run on a rig, armed without confirmation, which waits for the end of its standard input.

    It prints a line once it has imported what a run imports, and then waits for that end.

    robot, rig : paths of their files
    words : further options
    """
    process = subprocess.Popen(
        [sys.executable, "-c", WAITS, str(robot), "--rig", str(rig), "--yes", "--no-record", *words],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        preexec_fn=end_with_parent,
    )
    with process:
        try:
            yield process
        finally:
            process.kill()

"""Time from the start of a process to its first tick, and its memory then: of the command line, in a new process."""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from runtime.host.console.progress import rounds
from runtime.host.errors import BadInput
from runtime.host.live.running import shared_state_of
from runtime.host.system import end_with_parent
from runtime.setup.bench.measure import Times

IMPORTS = "numpy, can, networkx"
BARE = {"Python alone": "pass", f"import {IMPORTS}": f"import {IMPORTS}"}
TIMEOUT = 60.0  # s
T = TypeVar("T")

# The peak of this program alone: the figure of wait4 includes the parent's memory before exec.
PRINT_MEMORY = "print(next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM:')))"


def measure(file: Path, repeats: int) -> dict[str, tuple[Times, Times]]:
    """Start bare imports and a run of a diagram file in turn.

    Returns {name: (Times in ms, Times of resident memory in MB)}. Raises BadInput if a start fails.
    """
    samples = {what: ([], []) for what in (*BARE, "run")}
    for _ in rounds("starting", repeats):
        for what, (times, memory) in samples.items():
            seconds, kilobytes = first_tick(file) if what == "run" else bare(BARE[what])
            times.append(seconds * 1e3)
            memory.append(kilobytes / 1024)
    return {what: (Times(times), Times(memory)) for what, (times, memory) in samples.items()}


def bare(program: str) -> tuple[float, int]:
    """Run a short program in a new Python process. Returns (duration in s, peak resident memory in kB)."""
    began = time.monotonic()
    child = subprocess.run([sys.executable, "-c", f"{program}\n{PRINT_MEMORY}"], stdout=subprocess.PIPE, text=True)
    took = time.monotonic() - began
    if child.returncode != 0:
        raise BadInput(f"`{sys.executable} -c {program!r}` fails: exit code {child.returncode}")
    return took, int(child.stdout)


def first_tick(file: Path) -> tuple[float, int]:
    """Start a run. Returns (s from start to first tick, resident memory in kB right after it)."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.time_ns()
        child = subprocess.Popen(
            [sys.executable, "-m", "runtime", str(file), "--duration", "0.5", "--record", folder],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            cwd=Path(__file__).parents[2],
            preexec_fn=end_with_parent,
        )
        try:
            shared = wait_for(child, lambda: shared_state_of(child.pid))
            wait_for(child, lambda: shared.statistics()["ticks"] > 0)
            seconds, kilobytes = (shared.wall + shared.first_tick - began) * 1e-9, resident(child.pid)
        except BaseException:
            child.kill()
            raise
        finally:
            child.communicate(timeout=TIMEOUT)
    return seconds, kilobytes


def wait_for(child: subprocess.Popen[bytes], look: Callable[[], T | None]) -> T:
    """Return the first true result of `look`. Raises BadInput if the process ends before or TIMEOUT passes."""
    deadline = time.monotonic() + TIMEOUT
    while child.poll() is None and time.monotonic() < deadline:
        result = look()
        if result:
            return result
        time.sleep(0.001)
    assert child.stderr is not None
    message = child.stderr.read().decode().strip() if child.poll() is not None else f"no output within {TIMEOUT:g} s"
    raise BadInput(f"the run did not reach its first tick: {message}")


def resident(pid: int) -> int:
    """Return the resident memory of a process in kB."""
    status = Path("/proc", str(pid), "status").read_text()
    return int(next(line.split()[1] for line in status.splitlines() if line.startswith("VmRSS:")))

"""Compile the short C programs that the benchmarks compare with."""

import ctypes
import os
import shlex
import shutil
import subprocess
import sysconfig
import tempfile
from collections.abc import Callable
from pathlib import Path

FLAGS = ("-O2", "-ffp-contract=off", "-fno-math-errno", "-falign-loops=32")  # as in setup.py

# A clock for loops at a fixed rate.
C_GRID = """
#include <errno.h>
#include <time.h>

/* Point k of a grid lies k periods, in ns, after the first point, which lies one period after the grid was made. */
struct grid { long long first, period; };

static long long nanoseconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000000000LL + now.tv_nsec;
}

static struct grid grid_from_now(long long period)
{
    struct grid grid = {nanoseconds() + period, period};
    return grid;
}

/* Sleeps until point k. Returns how late the process woke, in ns; -1 if a signal has ended the sleep. */
static long long wait_for_point(const struct grid *grid, long k)
{
    long long point = grid->first + k * grid->period;
    struct timespec next = {point / 1000000000LL, point % 1000000000LL};
    if (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, 0) == EINTR)
        return -1;
    return nanoseconds() - point;
}
"""


class NoCompiler(Exception):
    """The C compiler is missing, or it fails."""


def build(text: str) -> Callable[..., float]:
    """Compile C source and load its function `run`.

    text : C source that defines `double run(long, long, double *, double *)`

    Returns the function, through ctypes. Raises NoCompiler.
    """
    candidates = (os.environ.get("CC"), sysconfig.get_config_var("CC"), "cc", "gcc", "clang")
    compiler = next((command for command in candidates if command and shutil.which(shlex.split(command)[0])), None)
    if compiler is None:
        raise NoCompiler("this machine has no C compiler. Install gcc")
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder, "program.c"), Path(folder, "program.so")
        source.write_text(text)
        done = subprocess.run(
            [*shlex.split(compiler), *FLAGS, "-shared", "-fPIC", "-o", str(library), str(source), "-lm"],
            capture_output=True,
            text=True,
        )
        if done.returncode != 0:
            raise NoCompiler(f"{compiler} fails: {(done.stderr.strip().splitlines() or [done.returncode])[-1]}")
        run = ctypes.CDLL(str(library)).run  # stays mapped without its file
    run.restype = ctypes.c_double
    run.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_double)]
    return run

"""A native block that spins: it holds the tick for a given time, and no signal interrupts it."""

import shutil
import subprocess

import pytest

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")

SOURCE = """
#include <time.h>

/* u: s; y: u */
int spin(double *arena, const int *slots, const int *sizes)
{
    struct timespec now;
    double end;
    clock_gettime(CLOCK_MONOTONIC, &now);
    end = now.tv_sec + 1e-9 * now.tv_nsec + arena[slots[0]];
    while (now.tv_sec + 1e-9 * now.tv_nsec < end)
        clock_gettime(CLOCK_MONOTONIC, &now);
    arena[slots[1]] = arena[slots[0]];
    return 0;
}
"""

BLOCK = '''
from graph import Kernel


class Spin(Block):
    """Spins for u."""

    u = Input("s")
    y = Output("s")
    kernel = Kernel(ctypes.CDLL("{library}").spin, "u y")
'''


def compiled(folder):
    """The library with the kernel. Returns its path."""
    (folder / "spin.c").write_text(SOURCE)
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", folder / "spin.so", folder / "spin.c"], check=True)
    return folder / "spin.so"

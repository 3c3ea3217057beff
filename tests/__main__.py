"""Run all tests but the long ones: `python -m tests`.

The tests marked `timing` run one after another. The others run at the same time, on all processors, at the lowest
priority: they take the processor time that the first do not use, and do not delay them.
"""

import os
import subprocess
import sys
import tempfile

LOWEST_PRIORITY = 19


def pytest(*options, **how):
    return subprocess.Popen([sys.executable, "-m", "pytest", *options], **how)


def main():
    """Run both. Returns the larger exit code."""
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # collecting the tests without bytecode takes four times as long
    with tempfile.TemporaryFile("w+") as log:
        timing = pytest("-m", "timing and not soak", stdout=log, stderr=subprocess.STDOUT)
        os.nice(LOWEST_PRIORITY)
        others = pytest("-n", "auto", "--dist", "worksteal", "-m", "not timing and not soak")
        codes = others.wait(), timing.wait()
        log.seek(0)
        print("\nTests that keep time:\n", log.read(), sep="\n")
    return max(codes)


if __name__ == "__main__":
    sys.exit(main())

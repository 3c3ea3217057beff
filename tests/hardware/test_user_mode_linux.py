"""Runs the tests of real SocketCAN and I2C under User Mode Linux, on a machine that has none itself."""

import os
import shutil
import subprocess
import sys

import pytest

from tests.hardware.test_i2c import CHIPS
from tests.hardware.vcan import REQUIRED, there
from tests.shared import shared
from tests.test_packaging import ROOT


@pytest.mark.parametrize("file", [
    "test_i2c.py", *(pytest.param(file, marks=pytest.mark.soak) for file in ("test_i2c_run.py", "test_i2c_combined.py"))])
def test_real_i2c_under_user_mode_linux(file):
    under_user_mode_linux(file, VMRUN_CHIPS=",".join(f"{address:#04x}" for address in CHIPS))


@pytest.mark.skipif(there, reason="this machine has vcan0 itself")
@pytest.mark.parametrize("file", [
    "test_socketcan.py",
    *(pytest.param(file, marks=pytest.mark.soak) for file in ("test_knee_exo.py", "test_guardian.py", "test_tools.py", "test_emulate.py"))])
def test_real_socketcan_under_user_mode_linux(file):
    under_user_mode_linux(file)


def under_user_mode_linux(file, **environment):
    """One start for a whole file. What fails in there is in the output."""
    script = shared("linux-can-i2c/vmrun.sh")
    if os.geteuid() != 0 or shutil.which("linux.uml") is None:
        pytest.skip("needs root and User Mode Linux: apt-get install --no-install-recommends user-mode-linux kmod iproute2")
    options = "-p no:cacheprovider -p no:hypothesispytest --color=no --tb=short -m ''"
    command = f"{sys.executable} -m pytest {options} {os.path.relpath(os.path.dirname(__file__), ROOT)}/{file}"
    process = subprocess.run(
        ["sh", script, command], cwd=ROOT, env={**os.environ, REQUIRED: "1", **environment}, stdin=subprocess.DEVNULL, capture_output=True, text=True,
        timeout=120)
    assert process.returncode == 0, process.stdout[-8000:]
    assert " passed" in process.stdout and "skipped" not in process.stdout

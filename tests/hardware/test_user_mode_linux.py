"""Runs the tests of real SocketCAN and I2C under User Mode Linux, on a machine that has none itself."""

import os
import subprocess
import sys

import pytest

from tests.hardware.test_i2c import CHIPS
from tests.hardware.vcan import REQUIRED, there
from tests.shared import shared
from tests.test_packaging import ROOT

ADDRESSES = ",".join(f"{address:#04x}" for address in CHIPS)
CANNOT_RUN = 77  # exit status of vmrun.sh where User Mode Linux cannot run


@pytest.mark.soak
def test_real_i2c_and_socketcan_under_user_mode_linux():
    """In one start; a machine that has vcan0 runs the tests of SocketCAN itself."""
    under_user_mode_linux("test_i2c.py", *[] if there else ["test_socketcan.py"], VMRUN_CHIPS=ADDRESSES)


@pytest.mark.soak
@pytest.mark.parametrize("file", ["test_i2c_run.py", "test_i2c_combined.py", "test_spi.py"])
def test_i2c_and_spi_of_runs_under_user_mode_linux(file):
    under_user_mode_linux(file, VMRUN_CHIPS=ADDRESSES)


@pytest.mark.soak
@pytest.mark.skipif(there, reason="this machine has vcan0 itself")
@pytest.mark.parametrize("file", [f"test_{name}.py" for name in "knee_exo guardian bus_off tools emulate".split()])
def test_socketcan_of_runs_under_user_mode_linux(file):
    under_user_mode_linux(file)


def test_a_machine_without_user_mode_linux_skips_and_prints_why(tmp_path):
    script = tmp_path / "vmrun.sh"
    script.write_text("echo 'vmrun.sh: cannot run here: linux.uml is missing' >&2\nexit 77\n")
    with pytest.raises(pytest.skip.Exception, match="cannot run here: linux.uml is missing"):
        run_in(script, "test_i2c.py")


def test_any_other_failure_of_user_mode_linux_fails(tmp_path):
    script = tmp_path / "vmrun.sh"
    script.write_text("echo Aborted\nexit 134\n")
    with pytest.raises(AssertionError, match="Aborted"):
        run_in(script, "test_i2c.py")


def under_user_mode_linux(*files, **environment):
    run_in(shared("linux-can-i2c/vmrun.sh"), *files, **environment)


def run_in(script, *files, **environment):
    """Run whole files of tests in one start of User Mode Linux; its output is in the failure. Skip where the script
    exits with 77.
    """
    folder = os.path.relpath(os.path.dirname(__file__), ROOT)
    options = "-p no:cacheprovider -p no:hypothesispytest --color=no --tb=short -m ''"
    command = f"{sys.executable} -m pytest {options} {' '.join(f'{folder}/{file}' for file in files)}"
    process = subprocess.run(
        ["sh", script, command],
        cwd=ROOT,
        env={**os.environ, REQUIRED: "1", **environment},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,
    )
    if process.returncode == CANNOT_RUN:
        pytest.skip(process.stderr.strip())
    assert process.returncode == 0, process.stdout[-8000:] + process.stderr[-2000:]
    assert " passed" in process.stdout and "skipped" not in process.stdout

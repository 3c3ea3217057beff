"""A test that fails while the machine stands still is made again; any other has failed."""

import os
import subprocess
import sys

import pytest

from tests.checkout import ROOT
from tests.soaking import soaked
from tests.standstill import FILE

# A processor stands still for the process that watches it while that one is suspended.
FAILS_ONCE = """
import os
import time
from pathlib import Path

import psutil
import pytest

made, FILE = [], os.environ["STANDSTILLS"]
processes = [each for each in psutil.process_iter(["cmdline"]) if FILE in (each.info["cmdline"] or ())]


@pytest.fixture(scope="module", autouse=True)
def fresh():
    yield made[:]


@pytest.fixture
def folder(tmp_path):
    yield tmp_path


def test_it(folder, fresh):
    assert fresh == made, "a fixture of the module is made again as well"
    made.append(1)
    (folder / "file").touch(exist_ok=False)
    for process in processes if {still} else ():
        process.suspend()
    time.sleep(0.05)
    for process in processes if {still} else ():
        process.resume()
    assert len(made) > {failures}, "it has failed"


def test_another(fresh):
    pass
"""


@pytest.mark.parametrize("words", soaked([[], ["-n", "1"]], but=[0]), ids=["alone", "workers"])
@pytest.mark.parametrize(
    "still, failures, code, made",
    soaked([(True, 1, 0, 1), (True, 2, 0, 2), (True, 3, 1, 2), (False, 1, 1, 0)], but=[0, 3]),
)
def test_a_failure_while_the_machine_stands_still_is_no_failure(tmp_path, still, failures, code, made, words):
    if not can_watch():
        pytest.skip("needs permission for real-time priority")
    (tmp_path / "conftest.py").write_text((ROOT / "tests" / "conftest.py").read_text())
    (tmp_path / "test_it.py").write_text(FAILS_ONCE.format(still=still, failures=failures))
    environment = {name: value for name, value in os.environ.items() if name != FILE and "XDIST" not in name}
    process = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words, "."],
        cwd=tmp_path,
        env={**environment, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert process.returncode == code, process.stdout
    assert process.stdout.count("test_it while a processor stood still for ") == made
    assert ("standstills in the session" in process.stdout) == bool(made)


def can_watch():
    try:
        policy = os.sched_getscheduler(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, policy, os.sched_param(0))
    except PermissionError:
        return False
    return True

"""The machine stalls during a simulation in real time: emulated drives do not time out, and the ticks are counted."""

import os
import re
import signal
import time

import numpy as np
import pytest

import runtime
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, compile
from tests.runtime.runs import Files, knee, started
from tests.runtime.terminals import patient
from tests.soaking import soaked

STALL = 0.4  # s, four times the timeout of a drive
LAW = "if tick >= 40: open('running', 'w').close()\n        return 2.0 * math.sin(5.0 * t)"


@pytest.mark.paced
@pytest.mark.parametrize("duration", soaked(["1.0", "0.5"], but=[1]), ids=["in the middle of a run", "at its end"])
def test_a_simulation_survives_a_stall_and_every_grid_point_is_a_row_or_missed(tmp_path, duration):
    process = started(knee(tmp_path, LAW), "--duration", duration, cwd=tmp_path)
    patient((tmp_path / "running").exists)
    os.kill(process.pid, signal.SIGSTOP)
    time.sleep(STALL)
    os.kill(process.pid, signal.SIGCONT)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 0, out + err
    files = Files(tmp_path / "recordings")
    assert files.sidecar["ticks"] + files.sidecar["missed"] == 200 * float(duration)
    [stood] = re.findall(r"simulated time stood still for (\d+) grid points while the computer stalled", out)
    assert int(stood) >= 200 * STALL - 1
    trial = runtime.load(files.one(".mcap"))
    assert trial.tick[-1] > 200 * float(duration) - 12, "the run has its whole duration in simulated time"
    assert np.diff(trial.tick).max() < 20 and trial["knee.age"].max() < 0.1, "no drive seemed silent"


@pytest.mark.paced
@pytest.mark.parametrize("after", soaked([0.05 * step for step in range(1, 9)], but=[4]))
def test_a_stall_while_a_simulation_starts_is_no_fault(tmp_path, after):
    process = started(knee(tmp_path), "--duration", "0.5", cwd=tmp_path)
    time.sleep(after)
    os.kill(process.pid, signal.SIGSTOP)
    time.sleep(STALL)
    os.kill(process.pid, signal.SIGCONT)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 0, out + err


def test_only_a_plant_waits_for_a_stalled_host():
    with Diagram("robot", rate=200) as robot:
        pass
    with pytest.raises(ValueError, match="only a plant can wait for it"):
        Executor(Program(compile(robot), []), 200.0, waits=True)

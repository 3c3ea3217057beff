"""A robot of sensors alone on its rig: real processes, from the pre-flight table to the replay."""

import json
import os
import re
import signal
import time

import pytest

from cext.safety.thresholds import NOTHING_TO_STOP
from runtime.host.errors import FAULT, OK
from tests.runtime.robot.guardian.bus import guardian_of
from tests.runtime.robot.rig.test_microstrain import Sensors
from tests.runtime.runs import finished, started, write
from tests.soaking import soaked

pytestmark = pytest.mark.paced

ROBOT = """
import os
import signal
import time

from blocks.imus import MicroStrain
from blocks.recorders import CsvRecorder
from graph import Block, Diagram, Output


class Law(Block):
    done = Output("1")

    def step(self, tick):
        if tick == 200:  # its guardian has been found by then
            {law}
        return 1.0


with Diagram("walker", rate=200) as diagram:
    MicroStrain(name="shank", rate=500.0, timeout=0.5)
    MicroStrain(name="thigh", rate=200.0, timeout=0.5)
    Law(name="law")
    CsvRecorder()
"""
GUARDIAN = """

def guardian():
    import psutil

    return next(each.pid for each in psutil.Process().children() if each.name() == "tickwork-guard")
"""
RIG = """
[device.shank]
serial = "133931"

[device.thigh]
serial = "133932"
"""


def await_rows(run, folder):
    """Until a run in that folder has written rows."""
    deadline = time.monotonic() + 15.0
    # a header is there before it is armed
    while not any(file.read_bytes().count(b"\n") > 1 for file in folder.glob("recordings/*.csv")):
        if run.poll() is not None or time.monotonic() > deadline:
            pytest.fail(f"it did not begin: {run.communicate(timeout=1)}")
        time.sleep(0.02)


@pytest.fixture
def robot(tmp_path, monkeypatch):
    monkeypatch.setenv("TICKWORK_PORTS", str(tmp_path / "tty*"))
    write(tmp_path, ROBOT.format(law="pass"), "robot.py")
    write(tmp_path, RIG, "lab.toml")
    sensors = Sensors(tmp_path, "133931", "133932=3DM-CV7-AHRS")
    yield sensors
    sensors.process.kill()
    sensors.process.wait()
    sensors.process.stdout.close()


def test_run_with_sensors_arms_records_and_replays_bit_for_bit(robot):
    run = finished("robot.py", "--rig", "lab.toml", "--yes", "--duration", "0.5", "--record", "out", cwd=robot.folder)
    assert run.returncode == OK, run.stderr
    assert "bus shank  serial " in run.stderr + run.stdout and "2 devices, no problems" in run.stderr + run.stdout
    assert not list((robot.folder / "out").glob("*.can.log"))
    [recording] = (robot.folder / "out").glob("*.mcap")
    again = finished("replay", str(recording), cwd=robot.folder)
    assert again.returncode == OK and "are the same, bit for bit" in again.stdout, again.stdout + again.stderr
    [sidecar] = (robot.folder / "out").glob("*.json")
    [buses] = [event for event in json.loads(sidecar.read_text())["events"] if event["event"] == "buses"]
    assert buses["shank"]["bytes"] > 10_000 and buses["shank"]["losses"] == 0


@pytest.mark.hazard("H12d")
def test_an_unplugged_cable_ends_the_run_and_is_named(robot):
    run = started("robot.py", "--rig", "lab.toml", "--yes", "--duration", "20", cwd=robot.folder)
    await_rows(run, robot.folder)
    robot.unplug()
    out, err = run.communicate(timeout=20)
    assert run.returncode == FAULT
    assert (
        "no reply for longer than its timeout (0.5 s); " in err
        and "tty13393" in err
        and "disconnected 1 time and still missing" in err
    )


@pytest.mark.hazard("H4d")
@pytest.mark.parametrize("whole", soaked([False, True], but=[1]), ids=["the loop alone", "with its guardian"])
def test_a_run_without_actuators_ends_after_a_pause(robot, whole):
    run = started("robot.py", "--rig", "lab.toml", "--yes", "--duration", "20", cwd=robot.folder)
    await_rows(run, robot.folder)
    paused = [run.pid, *([guardian_of(run).pid] if whole else ())]
    for number in (signal.SIGSTOP, signal.SIGCONT):
        for pid in paused:
            os.kill(pid, number)
        time.sleep(NOTHING_TO_STOP * 1.2e-9)
    out, err = run.communicate(timeout=10)
    assert run.returncode == FAULT, out + err
    assert ("every process of the run was paused" if whole else "loop has stalled") in out + err
    assert "drives" not in err, "it has none"


def test_the_guardian_of_a_run_without_actuators_ends_with_it(robot):
    run = started("robot.py", "--rig", "lab.toml", "--yes", "--duration", "20", cwd=robot.folder)
    await_rows(run, robot.folder)
    guardian = guardian_of(run)
    run.kill()
    guardian.wait(5)
    assert "died after tick" in run.communicate(timeout=10)[1]


@pytest.mark.parametrize(
    "law, code, said",
    soaked(
        [
            ("raise ValueError('x')", 3, "ValueError: x"),
            ("time.sleep(100)", 3, "law hangs"),
            ("while True: pass", 3, "law hangs"),
            ("time.sleep(0.6)", 3, "law hangs"),
            ("time.sleep(0.25)", 0, " missed; 0 records dropped"),
            ("os._exit(5)", 5, "died"),
            ("os.kill(os.getpid(), signal.SIGSEGV)", -11, "died of SIGSEGV in law"),
            ("os.closerange(3, 1024)", 3, "file descriptors of the run were closed or replaced"),
            ("return float('nan')", 0, ""),
            ("signal.raise_signal(signal.SIGINT)", 130, "stopped by SIGINT"),
            ("signal.raise_signal(signal.SIGTERM)", 143, "stopped by SIGTERM"),
            ("signal.raise_signal(signal.SIGHUP)", 129, "stopped by SIGHUP"),
            ("os.kill(guardian(), signal.SIGKILL)", 3, "guardian"),
            ("os.kill(guardian(), signal.SIGSTOP)", 3, "guardian"),
            ("pid = guardian(); os.kill(pid, signal.SIGSTOP); time.sleep(0.3); os.kill(pid, signal.SIGCONT)", 0, ""),
        ],
        but=[4, 6, 12],
    ),
)
def test_a_run_without_actuators_ends_whatever_happens(robot, law, code, said):
    write(robot.folder, ROBOT.format(law=law) + GUARDIAN, "robot.py")
    run = started("robot.py", "--rig", "lab.toml", "--yes", "--duration", "4", cwd=robot.folder)
    await_rows(run, robot.folder)
    guardian = guardian_of(run)
    out, err = run.communicate(timeout=10)
    assert run.returncode == code, out + err
    assert said in out + err and "Traceback" not in err
    assert not re.search("motor|actuators? (run|stay)", err), "it has none"
    guardian.wait(5)

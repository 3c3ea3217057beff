"""runtime.run in real time and on a rig: the command in a process of its own, called from a script."""

import os
import re
import signal
import sys
import threading
import time
from dataclasses import fields
from pathlib import Path

import numpy as np
import psutil
import pytest

import runtime
from graph import Diagram
from runtime.host.errors import BadInput
from runtime.host.live.running import shared_state_of
from runtime.record.storage.format import Frame
from runtime.session import own_process
from runtime.session.request import Request, RunOptions
from tests.runtime.robot.guardian.bus import PATIENT, ROBOT, Bus
from tests.runtime.runs import DISABLE, FORKING, NOTHING, environment, knee, open_files, server, write
from tests.runtime.terminals import patient

paced = pytest.mark.paced
INTERRUPTED = """
import runtime
runtime.run("robot.py", rig="lab.toml", yes=True)
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(own_process, "subprocess", FORKING)
    return tmp_path


@pytest.fixture
def bus(folder):
    write(folder, ROBOT.format(law="pass", torque=2.0, more="", blocks="", drive=PATIENT))
    with Bus(folder, number=11) as bus:
        yield bus


def sent(trial, can_id=1):
    """Data in hex digits of the frames that a run has sent to a drive; the bus may lose some on the way to a test."""
    frames = [Frame.unpack(item.payload) for item in trial.frames if item.sent]
    return [frame.data.hex().upper() for frame in frames if frame.id == can_id]


def test_options_are_those_of_the_command():
    named = {"file", "settings", "rig", "duration", "subject", "rate", "seed", "fast", "no_record", "report"}
    assert RunOptions.__annotations__.keys() | named == {f.name for f in fields(Request) if f.metadata}
    options = {"rig": Path("lab.toml"), "duration": 2.0, "yes": True, "rearm": False, "seed": None, "spin": "50us"}
    options |= {"trial": {"subject": "S03", "notes": "new shoes"}, "poses": {"left/knee": 0.5}}
    settings = [("gain", np.float64(0.5)), ("on", True), ("angle", "60 deg")]
    assert own_process.words(settings, options) == [
        *("--rig=lab.toml", "--duration=2.0", "--yes", "--spin=50us", "--trial", "subject=S03", "notes=new shoes"),
        *("--pose=left/knee=0.5", "--set=gain=0.5", "--set=on=true", "--set=angle=60 deg"),
    ]


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"fast": False, "yess": True}, "no option yess; did you mean 'yes'"),
        ({"fast": False, "no_record": True}, "no option no_record"),
        ({"fast": False, "diagram": lambda: Diagram("d", rate=100)}, "%%writefile"),
        ({"fast": False, "plant": lambda robot: None}, "the plant of its diagram file"),
        ({"yes": True}, "yes: only a run in real time has options"),
        ({"seeds": 7}, "no option seeds; did you mean 'seed'"),
        ({"seed": "7"}, "seed='7': expected a whole number"),
        ({"plant": "wearer.py"}, "plant='wearer.py': expected a Diagram, or a function plant.robot."),
        ({"duration": None}, "needs a duration"),
    ],
)
def test_arguments_that_do_not_fit_raise_bad_input_without_a_process(arguments, message):
    with pytest.raises(BadInput, match=message):
        runtime.run(**{"diagram": "robot.py", "duration": 1.0} | arguments)


@paced
def test_a_run_in_real_time_returns_the_trial_of_its_recording(folder, capsys):
    server()
    before, children = open_files(), psutil.Process().children()
    trial = runtime.run(knee(folder), 0.5, fast=False, trial={"subject": "S03"}, settings={"knee.timeout": 0.2})
    assert trial.complete and trial.fault is None and trial.fields == {"subject": "S03"}
    assert 90 <= trial.tick[-1] <= 99 and trial.about["metadata"]["settings"] == {"knee.timeout": "0.2"}
    assert [trial.path] == list(Path("recordings").glob("*_S03_*.mcap"))
    printed = capsys.readouterr().out
    assert printed.startswith("knee: 0.5 s at 200 Hz, simulated\n") and "try next" not in printed
    assert not open_files() - before and psutil.Process().children() == children


@paced
def test_an_error_before_the_run_is_raised_and_not_printed(folder, capsys):
    robot = knee(folder)
    with pytest.raises(BadInput, match="^setting knee.timeot=0.2: knee has no parameter 'timeot'"):
        runtime.run(robot, 1, fast=False, settings={"knee.timeot": 0.2})
    with pytest.raises(BadInput, match=r"robot.py:\d+: error TW007 .*\n.*\n1 error; nothing was armed"):
        runtime.run(robot, 1, fast=False, settings={"torque_limiter.limit": 30.0})
    assert capsys.readouterr() == ("", "") and not Path("recordings").exists()


@paced
def test_a_fault_ends_the_trial_and_is_printed(folder, capsys):
    trial = runtime.run(knee(folder, "return 1.0 / (20 - min(tick, 20))"), 5, fast=False)
    assert trial.fault["status"] == "exception" and trial.tick[-1] < 20  # a tick may be skipped
    assert re.search(r"FAULT at law, tick [2-9]\d", capsys.readouterr().out)


# On a rig


@paced
def test_a_rig_is_armed_after_the_answer_to_input(bus, monkeypatch, capsys):
    asked = []

    def answer(prompt):
        bus.listen(0.05)
        asked.append((prompt, capsys.readouterr().out, {frame.data for frame in bus.commands(1, asking=True)}))
        return ""

    monkeypatch.setattr("builtins.input", answer)
    trial = runtime.run("robot.py", 0.3, rig="lab.toml")
    [(prompt, table, commands)] = asked
    assert (
        commands == {DISABLE}
        and prompt == "Enter arms the robot, q ends the run: "
        and "2 devices, no problems" in table
    )
    assert trial.fault is None and 50 <= trial.tick[-1] <= 59 and trial["left/knee.torque_sent"][-1] > 1.0
    assert {"event": "confirm", "tick": -1, "by": f"set {os.getpid()}"} in trial.events
    assert sent(trial)[-2:] == [NOTHING, DISABLE]


@pytest.mark.soak
@paced
def test_without_a_confirmation_nothing_is_armed(bus, monkeypatch):
    def nothing(prompt):
        raise EOFError("no frontend")

    monkeypatch.setattr("builtins.input", nothing)
    with pytest.raises(BadInput, match=r"cannot ask .*\(no frontend\).* nothing was armed.*yes=True"):
        runtime.run("robot.py", 5, rig="lab.toml")
    monkeypatch.setattr("builtins.input", lambda prompt: "q")
    trial = runtime.run("robot.py", 5, rig="lab.toml")
    assert len(trial) == 0 and trial.end["ended"] == "stopped by the space bar"
    bus.listen()
    assert {frame.data for frame in bus.commands(1)} == {NOTHING, DISABLE}, "no motor was enabled"


@paced
def test_ctrl_c_stops_the_robot_safely_and_raises_keyboard_interrupt(bus):
    def interrupt():
        bus.await_torque()
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt, match="its recording is recordings/robot_") as stopped:
        runtime.run("robot.py", rig="lab.toml", yes=True)
    thread.join()
    trial = runtime.load(str(stopped.value).rpartition(" ")[2])
    assert sent(trial)[-2:] == [NOTHING, DISABLE]
    assert trial.complete and trial.end["ended"] == "stopped by SIGINT" and trial.fault is None


@paced
def test_the_robot_is_stopped_when_the_process_that_called_is_killed(bus, folder):
    with FORKING.Popen([sys.executable, "-c", INTERRUPTED], cwd=folder, env=environment()) as caller:
        bus.await_torque()
        [run] = [child for child in psutil.Process(caller.pid).children() if shared_state_of(child.pid) is not None]
        caller.kill()
    run.wait(10)
    [recording] = Path("recordings").glob("*.mcap")
    trial = patient(lambda: (found := runtime.load(recording)).complete and found)
    assert trial.end["ended"] == "stopped by SIGHUP" and sent(trial)[-2:] == [NOTHING, DISABLE]


@paced
@pytest.mark.parametrize("stream", [None, open(os.devnull, "w")])
def test_a_closed_output_does_not_end_a_run(folder, monkeypatch, stream):
    if stream is not None:
        stream.close()
    monkeypatch.setattr(sys, "stdout", stream)
    assert len(runtime.run(knee(folder), 0.1, fast=False)) > 0


@paced
def test_an_interrupt_at_the_table_ends_the_run_before_it_is_armed(bus, monkeypatch):
    def interrupted(prompt):
        raise KeyboardInterrupt

    monkeypatch.setattr("builtins.input", interrupted)
    before, children = open_files(), psutil.Process().children()
    with pytest.raises(KeyboardInterrupt, match="its recording is"):
        runtime.run("robot.py", rig="lab.toml")
    bus.listen()
    assert {frame.data for frame in bus.commands(1)} == {NOTHING, DISABLE}, "no motor was enabled"
    assert not open_files() - before and psutil.Process().children() == children


@paced
def test_a_process_that_does_not_end_is_killed_at_the_third_interrupt(folder, monkeypatch):
    robot = write(
        folder,
        "import signal, time\nfor number in (1, 2, 15): signal.signal(number, signal.SIG_IGN)\n"
        "open('begun', 'w').close()\ntime.sleep(60)\n",
    )

    def strike():
        patient(lambda: Path("begun").exists())
        for _ in range(3):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.1)

    threading.Thread(target=strike).start()
    with pytest.raises(KeyboardInterrupt):
        runtime.run(robot, 1, fast=False)

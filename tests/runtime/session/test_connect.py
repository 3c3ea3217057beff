"""runtime.connect: a program's own loop between the ticks of a run, on a rig and in simulation."""

import json
import math
import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

import runtime
from runtime.host.errors import BadInput, RunFault
from runtime.host.live.running import shared_state_of
from runtime.session import own_process
from runtime.session.connected import ConnectedRobot
from tests.runtime.robot.guardian.bus import Bus
from tests.runtime.runs import DISABLE, FORKING, NOTHING, environment, write
from tests.runtime.session.test_own_process import sent
from tests.runtime.terminals import patient
from tests.soaking import soaked

paced = pytest.mark.paced

ROBOT = """
import math

from blocks.actuators import CubeMars
from blocks.recorders import CsvRecorder
from blocks.sources import Constant
from graph import Diagram, Live


def build():
    with Diagram("robot", rate=200) as diagram:
        for number, side in enumerate(("left", "right"), 1):
            knee = CubeMars(
                "AK10-9-V2.0", bus="legs", can_id=number, name=f"{side}_knee", range=(-12.5, 12.5), wake_shift=0.0,
                timeout=1.0)
            torque = Constant(Live(0.0, min=-5.0, max=5.0, slew=math.inf), unit="N·m", name=f"{side}_torque")
            knee(torque_command=torque())
        CsvRecorder()
    return diagram
"""
PROGRAM = """
import os, runtime, time
with runtime.connect("robot.py", rig="lab.toml", yes=True, loop_timeout=1.0) as robot:
    for tick in robot:
        robot.set({"left_torque.value": 2.0, "right_torque.value": 2.0})
        %s
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(own_process, "subprocess", FORKING)
    write(tmp_path, ROBOT)
    return tmp_path


@pytest.fixture
def bus(folder):
    with Bus(folder, number=12) as bus:
        yield bus


def spring(robot):
    """A loop of two virtual springs, as a program writes it. Returns the ticks that it has seen."""
    ticks = []
    for tick in robot:
        ticks.append(tick)
        for side in ("left", "right"):
            torque = -20.0 * (robot[f"{side}_knee.position"] - 0.1)
            robot.set({f"{side}_torque.value": max(-5.0, min(5.0, torque))})
    return ticks


def test_same_loop_runs_in_virtual_time():
    with runtime.connect("robot.py", duration=1.0) as robot:
        ticks = spring(robot)
    trial = robot.trial
    assert ticks == list(range(200)) and robot.state == "safe"
    position = trial["left_knee.position"]
    command = np.clip(-20.0 * (position[:-1] - 0.1), -5.0, 5.0)
    np.testing.assert_allclose(trial["left_torque.y"][1:], command, atol=1e-12)
    assert position.max() > 0.1


@pytest.mark.parametrize("fast", [True, pytest.param(False, marks=paced)])
def test_tick_time_and_missed_ticks_of_the_loop_are_those_of_real_time(fast):
    with runtime.connect("robot.py", fast=fast, duration=0.1) as robot:
        for tick in robot:
            assert robot.tick == tick and robot.time == tick / robot.rate and robot.missed >= 0
    public = {name for name in dir(ConnectedRobot) if not name.startswith("_")}
    assert public | {"missed"} <= set(dir(robot))
    missed = 0
    if not fast:  # a busy machine may miss one
        [sidecar] = Path("recordings").glob("*.json")
        missed = json.loads(sidecar.read_text())["missed"]
    assert len(robot.trial.tick) + missed == 20


def test_break_ends_the_simulation_and_marks_are_in_the_trial():
    with runtime.connect("robot.py") as robot:
        for tick in robot:
            if tick == 5:
                robot.mark()
            if tick == 9:
                break
        assert robot.state == "safe"
    assert len(robot.trial) == 10
    assert [(event["number"], event["tick"]) for event in robot.trial.events if event["event"] == "mark"] == [(1, 6)]


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"yes": True}, "yes: only a run in real time has options"),
        ({"fast": False, "loop_timeout": 0.0}, "loop_timeout=0.0: expected a finite number of seconds above 0"),
        ({"fast": False, "loop_timeout": math.inf}, "loop_timeout=inf: expected a finite number"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(arguments, message):
    with pytest.raises(BadInput, match=message):
        runtime.connect("robot.py", **arguments)


@paced
def test_loop_commands_a_robot_on_a_rig_and_its_end_is_the_safe_stop(bus, monkeypatch, capsys):
    monkeypatch.setattr("builtins.input", lambda prompt: "")
    with runtime.connect("robot.py", rig="lab.toml", loop_timeout=1.0) as robot:
        ticks, begun = [], []  # of the steps: the loop may miss ticks
        for tick in robot:
            ticks.append(tick)
            robot.set({"left_torque.value": 2.0, "right_torque.value": "-2"})
            if tick >= 100 and not begun:
                begun.append("taken out")
                robot.mark()
                robot["right_knee.disabled"] = True
            elif tick >= 200 and begun == ["taken out"]:
                begun.append("armed again")
                assert robot["right_knee.active"] is False and robot["left_knee.torque"] == pytest.approx(2.0, abs=0.1)
                robot["right_knee.disabled"] = False
            elif tick > 300 and len(begun) == 2 and robot["right_knee.active"]:
                break
    trial = robot.trial
    assert trial.complete and trial.fault is None
    assert ticks == sorted(set(ticks)) and len(ticks) + robot.missed == ticks[-1] - ticks[0] + 1
    assert trial["left_knee.torque_sent"][200] == pytest.approx(2.0, abs=0.1)
    assert [event["event"] for event in trial.events if event["event"] in ("confirm", "mark")] == ["confirm", "mark"]
    assert sent(trial)[-2:] == [NOTHING, DISABLE] and sent(trial, 2)[-2:] == [NOTHING, DISABLE]
    assert f"stopped by process {os.getpid()}" in capsys.readouterr().out


@paced
def test_exception_in_the_loop_stops_the_robot_and_is_raised(bus):
    with pytest.raises(ZeroDivisionError):
        with runtime.connect("robot.py", rig="lab.toml", yes=True, loop_timeout=1.0) as robot:
            for tick in robot:
                robot.set({"left_torque.value": 2.0 / (50 - tick)} if tick < 50 else {"left_torque.value": 1 / 0})
    assert sent(robot.trial)[-2:] == [NOTHING, DISABLE] and robot.trial.fault is None


@paced
def test_pass_that_takes_too_long_is_a_fault_of_the_run(bus):
    with runtime.connect("robot.py", rig="lab.toml", yes=True, loop_timeout=0.15) as robot:
        with pytest.raises(RunFault, match="a pass of the connected program's loop took longer than its loop_timeout"):
            for tick in robot:
                robot.set({"left_torque.value": 2.0})
                if tick > 100:
                    time.sleep(1.0)
    fault = robot.trial.fault
    assert fault["status"] == "program silent" and fault["tick"] < 100 + 100
    assert sent(robot.trial)[-2:] == [NOTHING, DISABLE]


@paced
def test_fault_of_a_drive_ends_the_loop_with_its_report(bus):
    with runtime.connect("robot.py", rig="lab.toml", yes=True, loop_timeout=1.0, stop_for=0.5) as robot:
        with pytest.raises(RunFault, match="no reply for longer than its timeout"):
            for tick in robot:
                if tick >= 50:  # a busy machine may skip tick 50
                    bus.drives.kill()
    assert robot.trial.fault["status"] == "silent" and robot.state == "safe"


@paced
@pytest.mark.parametrize(
    "end", soaked(["tick > 100 and os.kill(os.getpid(), 9)", "tick > 100 and os._exit(0)"], but=[0])
)
def test_robot_is_stopped_when_the_program_dies(bus, folder, end):
    with FORKING.Popen([sys.executable, "-c", PROGRAM % end], cwd=folder, env=environment()) as program:
        bus.await_torque()
        [run] = [child for child in psutil.Process(program.pid).children() if shared_state_of(child.pid) is not None]
        program.wait(10)
    run.wait(10)
    [recording] = Path("recordings").glob("*.mcap")
    trial = patient(lambda: (found := runtime.load(recording)).complete and found)
    assert trial.end["ended"] == "stopped by SIGHUP" and sent(trial)[-2:] == [NOTHING, DISABLE]


@paced
def test_program_that_is_suspended_stops_the_robot(bus, folder):
    with FORKING.Popen([sys.executable, "-c", PROGRAM % "pass"], cwd=folder, env=environment()) as program:
        bus.await_torque()
        [run] = [child for child in psutil.Process(program.pid).children() if shared_state_of(child.pid) is not None]
        os.kill(program.pid, signal.SIGSTOP)
        assert patient(lambda: run.status() == psutil.STATUS_ZOMBIE or not run.is_running())
        os.kill(program.pid, signal.SIGCONT)
        program.wait(10)
    [recording] = Path("recordings").glob("*.mcap")
    trial = runtime.load(recording)
    assert trial.fault["status"] == "program silent" and sent(trial)[-2:] == [NOTHING, DISABLE]


@paced
def test_ctrl_c_in_the_loop_stops_the_robot_and_raises_keyboard_interrupt(bus):
    with pytest.raises(KeyboardInterrupt):
        with runtime.connect("robot.py", rig="lab.toml", yes=True, loop_timeout=1.0) as robot:
            for tick in robot:
                if tick >= 50:  # the loop may miss ticks
                    os.kill(os.getpid(), signal.SIGINT)
    assert robot.trial.complete and robot.trial.fault is None and sent(robot.trial)[-2:] == [NOTHING, DISABLE]


@paced
def test_parameter_out_of_bounds_and_unknown_name_are_reported_with_names(folder):
    with runtime.connect("robot.py", fast=False, duration=5.0) as robot:
        with pytest.raises(BadInput, match="left_torque.value=6.0: must be at most 5"):
            robot.set({"left_torque.value": 6.0})
        with pytest.raises(KeyError, match="did you mean 'left_knee.position'"):
            robot["left_knee.positon"]
        robot.close()
        with pytest.raises(BadInput, match="the run has ended"):
            robot.mark()

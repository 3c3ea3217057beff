"""The programs beside the example scripts of Epically Powerful: complete, with the laws and gains of the scripts."""

import json
import math
import re
import subprocess
import sys

import numpy as np
import pytest

import runtime
from blocks.models import Limb
from blocks.sources import Sine
from graph import Diagram, stack
from tests.checkout import ROOT
from tests.docs.fences import fences
from tests.docs.reference_package import STORED
from tests.runtime.runs import environment
from tests.soaking import soaked

PATH = ROOT / "docs" / "coming_from" / "epically_powerful_examples.md"
PROGRAMS = {fence.file: fence.text for fence in fences(PATH) if fence.file}
FADED_IN = 100  # ticks
ROW = re.compile(r"^\| ([^|]*) \| (\d+) \| [^|]* \| ([^|]*) \| (\d*) ?\|$", re.MULTILINE)


def pushed(robot):
    """Return a plant: limbs that are pushed, at the drives, and a sensor that turns about its x axis."""
    with Diagram("pushed", rate=5 * robot.rate) as plant:
        push = Sine(amplitude=0.5, frequency=0.7, unit="N·m")()
        for name in (name for name in ("motor", "actuator_1", "actuator_2") if name in robot.blocks):
            drive, limb = robot[name].emulator(), Limb(inertia=0.05, damping=0.1, stiffness=0.0, reflex=0.0)
            limb(torque=drive.torque + push)
            drive(position=limb.position, velocity=limb.velocity)
        if "imu" in robot.blocks:
            robot["imu"].emulator()(gyro=stack(Sine(amplitude=8.0, frequency=0.5, unit="rad/s")(), 0.0, 0.0))
    return plant


@pytest.fixture
def run(tmp_path):
    """Return a function that runs a program of the page, on pushed limbs, and returns its Trial."""

    def trial(file, duration=4.0, **settings):
        (tmp_path / file).write_text(PROGRAMS[file])
        names = {"__name__": "program"}
        exec(compile(PROGRAMS[file], file, "exec"), names)
        found = runtime.run(names["build"], duration, settings=settings, plant=pushed)
        assert found.fault is None
        return found

    return trial


def slope(values, rate=200.0):
    return np.diff(values, prepend=values[0]) * rate


def test_the_table_has_every_script_with_its_lines_and_each_program_with_its_own():
    scripts, own = {}, {}
    for names, lines, program, own_lines in ROW.findall(PATH.read_text()):
        scripts |= {name: int(lines) for name in re.findall(r"`([^`]*)`", names)}
        if own_lines:
            own[re.match(r"\[(.*?)\]", program)[1]] = int(own_lines)
    assert scripts == json.loads(STORED.read_text())["examples"]
    assert own == {file: len(text.splitlines()) for file, text in PROGRAMS.items()}


@pytest.mark.soak
@pytest.mark.parametrize("file", soaked(list(PROGRAMS), but=[0]))
def test_a_program_runs_from_the_command_line_with_another_drive(file, tmp_path):
    (tmp_path / file).write_text(PROGRAMS[file])
    command = [sys.executable, file, "--fast", "--duration", "1", "--set", "model=RS02", "--no-record"]
    done = subprocess.run(command, cwd=tmp_path, env=environment(), capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert "confirmed by" in done.stdout


def test_actuators_at_zero_torque_are_displayed(run):
    trial = run("display.py")
    assert np.ptp(trial["actuator_1.position"]) > 0.1
    assert trial["actuator_2.torque_sent"] == pytest.approx(0.0, abs=0.005)  # zero lies between two codes


def test_the_position_follows_the_sine_with_the_gains_of_the_script(run):
    for file in ("position.py", "position_plotjuggler.py"):
        trial = run(file, duration=8.0)
        error = math.pi / 2 * np.sin(trial.time) - trial["motor.position"]
        law = 5.0 * error + 0.25 * slope(error)
        assert trial["motor.torque_sent"][FADED_IN:] == pytest.approx(law[FADED_IN:], abs=0.05)
        assert np.ptp(trial["motor.position"]) == pytest.approx(math.pi, rel=0.3)


def test_the_impedance_holds_the_actuator_with_the_gains_of_the_script(run):
    trial = run("impedance.py")
    law = -2.0 * trial["motor.position"] - 0.1 * trial["motor.velocity"]
    assert np.ptp(law) > 0.2
    assert trial["motor.torque_sent"][FADED_IN:] == pytest.approx(law[FADED_IN:], abs=0.02)


def test_the_torque_follows_the_angular_rate_with_the_gains_of_the_script(run):
    trial = run("imu_to_actuator.py")
    rate = trial["imu.gyro[0]"]
    law = 0.25 * rate + 0.01 * slope(rate)
    assert np.ptp(law) > 2.0
    assert trial["motor.torque_sent"][FADED_IN:] == pytest.approx(law[FADED_IN:], abs=0.02)

"""Examples and constants in docstrings that the site shows: the code runs, and numbers are those of the code."""

import inspect
import os
import re
import shutil
import sys

import pytest

import runtime
from blocks.actuators import CubeMars, CubeMarsV3
from blocks.actuators.cubemars import frames, models_v3
from blocks.controllers import GravityCompensation, joint
from blocks.imus import OpenImu
from blocks.limiters import TorqueLimiter
from blocks.sinks import PlotJuggler
from blocks.sources import Pulse
from blocks.states import StateMachine
from blocks.thermal import COPPER, RISE, ThermalModel
from blocks.wearer import Cuff, Walker
from graph import Diagram, subsystem
from runtime.experiments.optimisation.result import OptimisationResult
from runtime.experiments.studies.result import StudyResult
from runtime.host.errors import BadInput
from runtime.record.analysis.trial import Trial
from tests.checkout import ROOT

SHORTER = {
    "duration=60": "duration=1",
    ", 60,": ", 0.1,",
    "duration=30": "duration=8",
    "10.0:": "0.5:",
    "run(17)": "run(1)",
}
KNEE = """
import math
from blocks.actuators import CubeMars
from blocks.sources import Constant
from graph import Diagram, Live, subsystem

with Diagram("robot", rate=200) as diagram:
    torque = Constant(Live(0.0, min=-9.0, max=9.0, slew=math.inf), unit="N·m", name="torque")
    with subsystem("left"):
        CubeMars("AK80-9", bus="leg", can_id=1, name="knee")(torque_command=torque())
"""
NUMBERS = [  # object, pattern in its docstring, values
    (PlotJuggler, r"port (\d+), JSON", (PlotJuggler.parameters["port"].default,)),
    (GravityCompensation, r"g = ([\d.]+) m/s²", (joint.GRAVITY,)),
    (OpenImu, r"a unit has (\d+) kbit/s", (OpenImu.parameters["bitrate"].default / 1e3,)),
    (CubeMarsV3, r"± ([\d.]+)° of a motor,\s+commands ± ([\d.]+) rad", (frames.DEGREES, models_v3.POSITION)),
    (ThermalModel, r"\(1 \+ ([\d.]+) \(T_w", (COPPER,)),
    (ThermalModel, r"to (\d+) K above ambient", (RISE,)),
    (
        TorqueLimiter,
        r"whole range in ([\d.]+) s: (\d+) limit",
        (2 / TorqueLimiter(limit=1.0).output_slew, TorqueLimiter(limit=1.0).output_slew),
    ),
    (CubeMars, r"Replies of (\d) or (\d) bytes", frames.REPLIES[1:]),
]


def example(thing):
    """Return the first indented block of a docstring, shortened."""
    text = inspect.cleandoc(thing.__doc__)
    block = re.search(r"^(?:    .*\n|\n(?=    ))+", text + "\n", re.MULTILINE)
    code = block[0] if block else text.split("\n\n")[1]
    for long, short in SHORTER.items():
        code = code.replace(long, short)
    return inspect.cleandoc("\n" + code)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with the diagrams of the clone and a module of objectives."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "costs", raising=False)  # of another test
    os.symlink(ROOT / "diagrams", tmp_path / "diagrams")
    (tmp_path / "robot.py").write_text(KNEE)
    (tmp_path / "costs.py").write_text("def effort(trial):\n    return float(abs(trial['left/knee.torque']).mean())\n")
    return tmp_path


def test_the_example_of_run(folder):
    *virtual, robot = example(runtime.run).splitlines()
    exec("\n".join(virtual), {"runtime": runtime})
    with pytest.raises(BadInput, match="lab.toml"):  # the file is missing; the arguments are accepted
        exec(robot, {"runtime": runtime})


def test_the_examples_of_loops(folder):
    for function in (runtime.simulate, runtime.connect):
        code = example(function).replace(', rig="lab.toml"', ", duration=0.5")
        exec(code, {"runtime": runtime})


def test_the_example_of_check(folder):
    code = example(runtime.check).replace(', rig="lab.toml"', "")
    names = {"runtime": runtime}
    exec(code, names)
    assert names["report"]["ok"]


@pytest.mark.soak
def test_the_example_of_a_study_and_of_its_result(folder):
    pytest.importorskip("pyarrow"), pytest.importorskip("pandas")
    names = {"runtime": runtime}
    exec(example(runtime.study), names)
    exec(example(StudyResult), names)


@pytest.mark.soak
def test_the_example_of_an_optimisation_and_of_its_result(folder):
    pytest.importorskip("cma")
    names = {"runtime": runtime}
    exec(example(runtime.optimise).replace("duration=20", "generations=1, duration=2"), names)
    exec(example(OptimisationResult), names)


def test_the_examples_of_a_trial_and_of_load(folder):
    for name in ("trials", "recordings"):
        runtime.run("diagrams/knee_exo.py", 0.2, fast=False, record=name)
    [recording] = folder.glob("trials/*.mcap")
    shutil.copy(recording, "trial.mcap")
    shutil.copy(next(folder.glob("recordings/*.mcap")), "recordings/knee_exo_2026-11-21_10-00-00.mcap")
    exec(example(runtime.load), {"load": runtime.load})
    exec(example(Trial), {"runtime": runtime})


def test_the_examples_of_blocks():
    with Diagram("robot", rate=200) as robot, subsystem("left"):
        knee = CubeMars("AK80-9", name="knee")
        foot = type("Foot", (), {"contact": Pulse(unit="1")()})
        exec(example(StateMachine), {"StateMachine": StateMachine, "knee": knee, "foot": foot})
    with Diagram("plant", rate=1000):
        drive, adult = robot["left/knee"].emulator(), Walker(1.2)
        exec(example(Cuff), {"Cuff": Cuff, "drive": drive, "adult": adult, "motion": adult})


@pytest.mark.parametrize("thing, pattern, values", NUMBERS)
def test_a_number_in_a_docstring_is_that_of_the_code(thing, pattern, values):
    found = re.search(pattern, inspect.cleandoc(thing.__doc__))
    assert [float(number) for number in found.groups()] == pytest.approx([float(value) for value in values])

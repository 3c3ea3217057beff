"""The fixtures of tests/runtime/conftest.py hold here; a study of a sine of 50 ticks, and objectives that can fail."""

import pytest

DIAGRAM = """\
from blocks.mathematics import Gain
from blocks.sources import GaussianNoise, Sine
from graph import Block, Diagram, Output


class Fails(Block):
    y = Output("1")

    def step(self):
        raise ValueError("sensor unplugged")


def build(gain=1.0, frequency=1.0, fails=False):
    if gain == 0.25:
        from runtime.host.errors import BadInput
        raise BadInput("gain 0.25 is not allowed")
    with Diagram("sine", rate=100) as diagram:
        Gain(gain, name="gain")(Sine(frequency=frequency, name="sine")())
        GaussianNoise(name="noise")()
        if fails:
            Gain(1.0)(Fails(name="broken")())
    return diagram
"""
COSTS = """\
import os, signal
from pathlib import Path


def _once(name):
    try:
        Path(name).touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def counted(trial):
    with open("count", "a") as file:
        file.write("x")
    return len(trial)


def raises_once(trial):
    if trial["gain.y"].max() > 2.5 and _once("raised"):
        return trial["no.such"]
    return 1.0


def dies_once(trial):
    if trial["gain.y"].max() > 2.5 and _once("died"):
        os.kill(os.getpid(), signal.SIGKILL)
    return 1.0


def dies(trial):
    os.kill(os.getpid(), signal.SIGKILL)
"""


KNEE = """\
from blocks.sources import Constant, Pulse
from blocks.wearer import Walker
from graph import Diagram


def build():
    with Diagram("knee", rate=200) as diagram:
        Constant(1.0, name="one")()
    return diagram


def plant(robot, torque=0.0):
    with Diagram("wearer", rate=1000) as wearer:
        Walker(name="walker")(left_knee_assistance=Pulse(low=torque, high=-torque, unit="N·m")())
    return wearer
"""
LIMB = """\
from blocks.sources import Constant
from graph import Diagram
from limb_of_test.lengths import LENGTH


def build():
    with Diagram("limb", rate=100) as diagram:
        Constant(LENGTH, name="length")()
    return diagram
"""


@pytest.fixture
def limb(folder):
    """Function that writes limb.py, which imports a length from a package.

    Lengths with the same number of digits may share bytecode.
    """

    def write(length):
        (folder / "limb.py").write_text(LIMB)
        (folder / "limb_of_test").mkdir(exist_ok=True)
        (folder / "limb_of_test" / "lengths.py").write_text("from .shank import SHANK\n\nLENGTH = SHANK\n")
        (folder / "limb_of_test" / "shank.py").write_text(f"SHANK = {length}\n")

    return write


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with sine.py and the objectives in costs_of_test.py."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "sine.py").write_text(DIAGRAM)
    (tmp_path / "costs_of_test.py").write_text(COSTS)
    return tmp_path

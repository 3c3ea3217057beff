"""Every Python sample of every page runs, and every rig file is read.

The samples of a page run in their order and share their names, in an empty folder with the folders of the clone beside
them: `diagrams/knee_exo.py` exists. A sample that needs hardware, a compiler, a second process or a terminal has the
word `notest` behind `python` on its fence; test_special_samples.py names the test that runs it.

A fragment may use names of a diagram that the page does not show: SETUP defines them.
"""

import ast
import os
import re
from contextlib import nullcontext

import pytest

from graph import Diagram
from runtime.robot.rig.file import read
from tests.checkout import ROOT
from tests.docs.block_pages import homes
from tests.docs.pages import NAMES

RIG = re.compile(r"^```toml\n(\[(?:bus\.|device\.|battery).*?)^```", re.DOTALL | re.MULTILINE)
SAMPLE = re.compile(r"^```python([^\n]*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
ELSEWHERE = ("docs/reference/errors.md", "docs/tutorial/", "docs/coming_from/")  # tests of their own run their samples
DIAGRAM = "from blocks.sources import Sine\nfrom graph import Diagram, stack, subsystem\n"
INSIDE = (  # samples of these pages are parts of a diagram
    "docs/explanation/wearer.md",
    "docs/reference/arming.md",
    "docs/reference/emergency_stop.md",
    "docs/reference/gait.md",
    "docs/reference/networks.md",
)
ROBOT = """
from blocks.actuators import CubeMars
from blocks.sensors import NAU7802
from blocks.wearer import Cuff, Walker

with Diagram("robot", 200) as robot, subsystem("left"):
    CubeMars("AK80-9", can_id=1, name="knee"), CubeMars("AK80-9", can_id=2, name="ankle"), NAU7802(name="cell")
drive = robot["left/ankle"].emulator()
motion = Walker(1.2)(left_ankle_assistance=drive.torque)
"""
STUDY = """
from pathlib import Path
from runtime.cli.main import main

page = Path("docs/how_to/studies.md").read_text()
Path("study.toml").write_text(page.split("```toml\\n")[1].split("```")[0].replace("duration = 30 ", "duration = 8 "))
assert main(["study", "study.toml"]) == 0
"""
LOOP = """
from pathlib import Path

Path("knee.py").write_text(Path("docs/how_to/own_loop.md").read_text().split("```python\\n")[1].split("```")[0])
"""
SETUP = {
    "docs/how_to/own_loop.md": LOOP,
    "docs/explanation/wearer.md": DIAGRAM + ROBOT,
    "docs/how_to/studies.md": STUDY,
    "docs/reference/gait.md": DIAGRAM + "left_thigh = right_thigh = Sine(unit='rad')(), Sine(unit='rad/s')()\n",
    "docs/reference/networks.md": DIAGRAM
    + "from blocks.limiters import Saturation\nfrom blocks.mathematics import Gain\n"
    + "angle, velocity, mass = Sine(unit='rad')(), Sine(unit='rad/s')(), 70.0\n",
}
OF_EVERY_BLOCK = ("name", "every", "hold_exceptions")
PAGES = [name for name in NAMES if SAMPLE.search((ROOT / name).read_text()) and not name.startswith(ELSEWHERE)]


@pytest.mark.parametrize("page", PAGES)
def test_samples_run(page, tmp_path, monkeypatch):
    for library in re.findall(r"^import (pandas)$", (ROOT / page).read_text(), re.MULTILINE):
        pytest.importorskip(library)
    monkeypatch.chdir(tmp_path)
    for folder, target in (("diagrams", "diagrams"), ("docs", "docs"), ("networks", "diagrams/networks")):
        os.symlink(ROOT / target, folder)
    names = {"__name__": "sample"}
    text = (ROOT / page).read_text()
    with Diagram("sample", 200) if page in INSIDE else nullcontext():
        exec(SETUP.get(page, ""), names)
        for sample in SAMPLE.finditer(text):
            if "notest" in sample[1].split():
                continue
            file = tmp_path / "sample.py"
            lines = text[: sample.start(2)].count("\n")
            file.write_text("\n" * lines + sample[2])  # a traceback has the lines of the page
            exec(compile(file.read_text(), str(file), "exec"), names)
    if {"robot", "plant"} <= names.keys():
        names["plant"](names["robot"])


@pytest.mark.parametrize("page", [name for name in NAMES if not name.endswith("CHANGELOG.md")])
def test_blocks_in_the_text_have_the_parameters_and_choices_that_it_shows(page):
    blocks = {kind.__name__: kind for kind in homes()}
    text = re.sub(r"^```.*?^```", "", (ROOT / page).read_text(), flags=re.DOTALL | re.MULTILINE)
    for code in re.findall(r"`([^`]+)`|^    (\S.*)", text, re.MULTILINE):
        try:
            tree = ast.parse("".join(code).strip(), mode="eval")
        except SyntaxError:
            continue
        for call in [node for node in ast.walk(tree) if isinstance(node, ast.Call)]:
            kind = blocks.get(getattr(call.func, "id", ""))
            for word in call.keywords if kind else ():
                assert word.arg in {*kind.parameters, *kind.inputs, *OF_EVERY_BLOCK}, ast.unparse(call)
                choices = kind.parameters[word.arg].choices if word.arg in kind.parameters else None
                assert not choices or ast.literal_eval(word.value) in choices, ast.unparse(call)


def test_rig_files_are_read(tmp_path):
    texts = [text for page in NAMES for text in RIG.findall((ROOT / page).read_text())]
    assert len(texts) > 10
    for number, text in enumerate(texts):
        path = tmp_path / f"{number}.toml"
        path.write_text(text)
        assert read(path).path == path

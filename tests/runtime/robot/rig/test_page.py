"""docs/reference/rigs.md: its rig fits the knee exoskeleton, and each of its error codes is provoked by a test.

The charge pump and the sender of docs/reference/emergency_stop.md work.
"""

import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from graph import compile
from runtime.host.console.styles import Console
from runtime.robot.loading.file import load
from runtime.robot.rig.errors import CODES
from runtime.robot.rig.file import read
from runtime.robot.rig.overrides import override
from runtime.session.check.battery import battery_lines
from runtime.session.check.report import check
from tests.runtime.runs import KNEE_EXO, ROOT

PAGE = (ROOT / "docs" / "reference" / "rigs.md").read_text()
EMERGENCY_STOP = (ROOT / "docs" / "reference" / "emergency_stop.md").read_text()


def test_the_rig_of_the_page_fits_the_knee_exoskeleton(tmp_path):
    path = tmp_path / "lab.toml"
    path.write_text(re.search(r"^```toml\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)[1])
    _, diagram = load(KNEE_EXO, (), read(path))
    knee = diagram["left/knee"]
    assert (knee.can_id, knee.invert, knee.offset) == (3, True, 0.12) and diagram["right/knee"].can_id == 2
    assert all(f"`{name}`" in PAGE for name in knee.hardware)


def test_the_battery_budget_of_the_page_is_that_of_check(tmp_path):
    samples = re.findall(r"^```toml\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    (tmp_path / "lab.toml").write_text(samples[0] + next(sample for sample in samples if "[battery]" in sample))
    _, *printed = battery_lines(check(KNEE_EXO, rig=tmp_path / "lab.toml")["battery"], Console(width=200))
    shown = re.search(r"^    battery  .*\n(?:    .+\n)+", PAGE, re.MULTILINE)[0].splitlines()
    numbers = re.compile(r"\d+(?:\.\d+)?")
    assert [numbers.sub("#", line[4:]) for line in shown] == [numbers.sub("#", line) for line in printed]
    for line, fresh in zip(shown, printed):  # the simulated wearer may change a little
        assert [*map(float, numbers.findall(line))] == pytest.approx([*map(float, numbers.findall(fresh))], rel=0.1)


def test_the_charge_pump_of_the_page_compiles_and_its_rig_fits_it(tmp_path):
    section = EMERGENCY_STOP.split("## A charge pump")[1].split("\n## ")[0]
    names = {}
    exec(re.search(r"^```python\n(.*?)^```", section, re.DOTALL | re.MULTILINE)[1], names)
    (tmp_path / "lab.toml").write_text(re.search(r"^```toml\n(.*?)^```", section, re.DOTALL | re.MULTILINE)[1])
    override(read(tmp_path / "lab.toml"), names["diagram"])
    pump = names["diagram"]["pump"]
    assert compile(names["diagram"]).devices and (
        pump.line,
        pump.opening()["pin"],
        pump.relay_time,
        pump.start_time,
    ) == ("gpio", "GPIO4", 0.1, 1.0)


def test_sender_of_the_page_reads_as_released_button():
    script = re.search(r"^```python notest\n(.*?)^```", EMERGENCY_STOP, re.DOTALL | re.MULTILINE)[1]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(10.0)
        sender = subprocess.Popen([sys.executable, "-c", script.replace("9871", str(receiver.getsockname()[1]))])
        heard = [receiver.recv(100) for _ in range(3)]
        sender.kill()
        sender.wait()
    assert heard == [bytes([0, 1, 0, 0, 2, 0, 0, 0, count, 0x5A, 0, 0, 0, 0, 0, 0]) for count in range(3)]


def test_every_code_has_its_row():
    assert dict(re.findall(r"^\| (TW\d+) \| ([^|]+?) \|", PAGE, re.MULTILINE)) == CODES


def test_every_code_is_raised_and_provoked():
    here = Path(__file__)
    raised = "".join(
        path.read_text()
        for room in ("rig", "emulation")
        for path in (ROOT / "runtime" / "robot" / room).glob("*.py")
        if path.name != "errors.py"
    )
    tests = [
        path
        for folder in (here.parent, here.parents[1] / "emulation", ROOT / "tests" / "hardware")
        for path in folder.glob("*.py")
        if path != here
    ]
    provoked = "".join(path.read_text() for path in tests)
    for text in (raised, provoked):
        assert {code for code in CODES if code in text} == set(CODES)

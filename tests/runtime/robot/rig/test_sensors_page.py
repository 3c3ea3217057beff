"""docs/reference/i2c.md: its diagram runs, its rig fits, its scan matches the command, and its options exist."""

import os
import re

import pytest

from cext.lines.i2c_memory import MemoryI2c
from graph import compile
from runtime.host.errors import OK
from runtime.robot.guardian.lock import BusLock
from runtime.robot.loading.file import load
from runtime.robot.rig.chips import Chips
from runtime.robot.rig.errors import CODES
from runtime.robot.rig.file import read
from runtime.setup.commissioning import chips
from tests.runtime.robot.rig.wires import Wires, add_mpu
from tests.runtime.runs import ROOT, write
from tests.runtime.test_documents import python_of, shown_after

PAGES = {
    name: (ROOT / "docs" / "reference" / f"{name}.md").read_text() for name in ("sensors", "imus", "i2c", "inputs")
}
PAGE = PAGES["i2c"]
LEG = next(code for code in python_of(PAGE) if "MPU9250(" in code)
RIG = next(text for text in re.findall(r"^```toml\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE) if "i2c" in text)


def test_the_diagram_of_the_page_runs(command_line):
    code, out, err = command_line(write(command_line.folder, LEG, "leg.py"), "--fast", "--duration", "0.5")
    assert (code, err) == (OK, "") and "100 of 100 done" in out


def test_the_rig_of_the_page_fits_its_diagram(tmp_path):
    (tmp_path / "calibration").mkdir()
    (tmp_path / "calibration" / "shank.toml").write_text("[gyroscope]\nbias = [0.1, 0.0, 0.0]\n")
    text = RIG.replace('"calibration/', f'"{tmp_path}/calibration/')
    _, diagram = load(write(tmp_path, LEG, "leg.py"), (), read(write(tmp_path, text, "lab.toml")))
    assert (diagram["thigh"].mux, diagram["thigh"].channel, diagram["shank"].gyro_bias) == (0x71, 3, (0.1, 0.0, 0.0))
    compile(diagram)


def test_the_page_shows_the_output_of_scan(command_line, monkeypatch):
    wires = MemoryI2c((0x70,))
    add_mpu(wires)
    wires.add(0x48, wide=True)
    wires.write(wires.add(0x69, 1 + 1), 0x75, b"\x71")
    monkeypatch.setattr("runtime.setup.commissioning.chips.open_adapter", lambda bus: (Chips(Wires(wires)), wires))
    # another session of the tests on this computer may look at the same bus
    monkeypatch.setattr(chips, "BusLock", lambda interface, channel: BusLock(interface, f"{channel} {os.getpid()}"))
    command = re.search(r"`python -m runtime (scan --interface i2c .*?)`", PAGE)[1].split()
    code, out, err = command_line(*command)
    assert (code, err) == (OK, "") and out.splitlines() == shown_after(PAGE, "lists the chips on the bus")


@pytest.mark.parametrize("command", ["calibrate", "scan"])
def test_help_lists_every_option_of_the_pages(command_line, command):
    with pytest.raises(SystemExit):
        command_line(command, "--help")
    told = command_line.capsys.readouterr().out
    lines = re.findall(rf"python -m runtime {command}(.*)", "".join(PAGES.values()))
    assert lines and all(option in told for line in lines for option in re.findall(r"--[\w-]+", line))


def test_error_codes_of_the_pages_exist():
    assert set(re.findall(r"TW\d{3}", "".join(PAGES.values()))) <= set(CODES)

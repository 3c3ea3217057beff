"""Battery budget of `check --rig`: the same numbers as from a recorded run of the robot."""

from types import SimpleNamespace

import numpy as np
import pytest

import runtime
from blocks.actuators import CubeMars
from graph import Actuator, Diagram, Input
from runtime.host.console.styles import Console
from runtime.robot.rig.battery import Battery, supply_current, windings
from runtime.robot.rig.errors import RigError
from runtime.session.check.battery import SETTLING_TIME, SIMULATED_TIME, battery_lines, budget, duration
from runtime.session.check.report import check
from runtime.session.check.text import text
from runtime.session.prepare import prepare
from runtime.session.request import Request
from tests.runtime.runs import KNEE_EXO, knee, write

RIG = """
[bus.legs]
interface = "socketcan"
channel = "can0"

[device."left/knee"]
range = [-0.1, 2.0]

[device."right/knee"]
range = [-0.1, 2.0]

[battery]
voltage = 24.0
capacity = 4.0
fuse = 8.0
load = 10.0
"""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("rig") / "lab.toml"
    path.write_text(RIG)
    return check(KNEE_EXO, rig=path)


def test_power_of_the_simulated_use_is_that_of_a_recorded_run(report):
    trial = runtime.run(KNEE_EXO, duration=SETTLING_TIME + SIMULATED_TIME)
    first = round(SETTLING_TIME * 200)
    power = [trial[f"{side}/knee.torque"] * trial[f"{side}/knee.velocity"] for side in ("left", "right")]
    used = report["battery"]["simulated"]
    assert used["mechanical"] == pytest.approx(sum(np.mean(np.maximum(each[first:], 0.0)) for each in power))
    assert used["mechanical"] > 1.0 and used["heat"] > 0.1
    assert used["power"] == pytest.approx(used["mechanical"] + used["heat"] + 10.0)
    assert used["time"] == pytest.approx(96.0 / used["power"])


def test_currents_are_those_of_the_proved_torque(report):
    budget = report["battery"]
    assert [drive["limit"] for drive in budget["drives"]] == [12.0, 12.0]
    current = sum(drive["supply_current"] for drive in budget["drives"]) + 10.0 / 24.0
    assert budget["peak"] == pytest.approx(current) and budget["least_time"] == pytest.approx(4.0 / current)


@pytest.mark.hazard("H10c")
def test_fuse_that_is_too_small_is_a_warning(report):
    assert report["ok"] and [problem["code"] for problem in report["warnings"]] == ["TW137", "TW137"]


def test_section_has_currents_and_times(report):
    lines = text(report, Console(width=200))
    begin = next(number for number, line in enumerate(lines) if line.startswith("battery"))
    assert lines[begin] == "battery  24 V, 4 A·h, 96 W·h, 8 A fuse for each drive"
    assert lines[begin + 1].startswith("  left/knee   at most 9.12 A from the battery, 10.5 A in the motor at 12 N·m (")
    assert lines[begin + 3] == "  peak       at most 18.7 A with every drive at its limit"
    time = duration(report["battery"]["simulated"]["time"])
    assert lines[begin + 4].startswith("  simulated  ") and lines[begin + 4].endswith(f"A charge lasts {time}")
    assert lines[begin + 5].startswith("  at least   13 min")
    assert [duration(hours) for hours in (0.2, 1.4, 1.5)] == ["12 min", "84 min", "1.5 h"]


def test_robot_without_a_plant_has_no_simulated_use(tmp_path):
    path = knee(tmp_path)
    (tmp_path / "lab.toml").write_text(
        '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\n[device.knee]\nrange = [-1.0, 2.0]\n'
        "[battery]\nvoltage = 24.0\ncapacity = 4.0\n"
    )
    budget = check(path, rig=tmp_path / "lab.toml")["battery"]
    assert budget["simulated"] is None and budget["least_time"] > 0.0


def test_drive_without_published_currents_is_listed_and_not_included():
    class Board(Actuator):
        """Drive of a laboratory."""

        torque_command = Input("N·m", "torque command", default=0.0)

    with Diagram("board", rate=200) as diagram:
        Board(name="board")
        CubeMars("AK80-9", name="knee")
    drives = windings(diagram)
    report = budget(Battery(24.0, 4.0, 24.0), drives, None, SimpleNamespace(given=False))
    assert report["peak"] == pytest.approx(supply_current(drives["knee"])) and report["least_time"] is None
    lines = battery_lines(report, Console(width=200))
    assert "  board  current not published: not included" in lines
    assert any("with every drive with a published current at its limit" in line for line in lines)


CYBERGEAR = """
from blocks.actuators import RobStride
from graph import Diagram

with Diagram("knee", rate=200) as diagram:
    RobStride("CyberGear", range=(-1.0, 2.0), name="knee")(torque_command=0.0)
"""


@pytest.mark.hazard("H14a")
def test_robot_whose_drive_the_battery_would_damage_is_rejected_by_check_and_run(tmp_path):
    path = write(tmp_path, CYBERGEAR)
    (tmp_path / "lab.toml").write_text(
        '[bus.can]\ninterface = "socketcan"\nchannel = "can0"\n[battery]\nvoltage = 48.0\ncapacity = 4.0\n'
    )
    for examined in (check, lambda file, rig: prepare(Request(file, rig=rig, yes=True))):
        with pytest.raises(RigError, match="TW137 .*of up to 48 V exceeds the supply range of knee, 16 to 28 V"):
            examined(path, rig=tmp_path / "lab.toml")


def test_without_a_battery_there_is_no_budget():
    assert check(KNEE_EXO)["battery"] is None

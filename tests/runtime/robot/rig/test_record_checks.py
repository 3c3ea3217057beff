"""Records of commissioning against the units that respond when a run with a subject file starts."""

import datetime
import json
import re

import pytest

import runtime
from runtime.host.errors import BadInput
from runtime.robot.rig.records import AGREES, BEFORE_TORQUE, OF_SENSORS, Record, StepRecord, write
from runtime.session.prepare import prepare
from runtime.session.request import Request
from tests.runtime.runs import finished, started
from tests.runtime.runs import write as write_file
from tests.runtime.setup.commissioning.nodes import Nodes, Private, channel
from tests.soaking import soaked

ROBOT = """
from blocks.actuators import CubeMars, RobStride
from blocks.actuators.cubemars import EmulatedCubeMars
from blocks.actuators.robstride import EmulatedRobStride
from blocks.imus import MicroStrain, OpenImu
from blocks.imus.openimu.emulator import EmulatedOpenImu
from graph import Diagram
from graph import Input, Output

with Diagram("legs", rate=200) as diagram:
    for name, block in (
        ("left", RobStride("RS02", "legs", 20, range=(-0.3, 0.3), name="left")),
        ("right", RobStride("RS02", "legs", 21, range=(-0.3, 0.3), name="right")),
        ("cyber", RobStride("CyberGear", "legs", 22, range=(-0.3, 0.3), name="cyber")),
        ("hip", CubeMars("AK80-9", "legs", 3, range=(-0.3, 0.3), name="hip")),
    ):
        block(torque_command=0.0)
    OpenImu("imus", 129, timeout=1.0, name="shank")
    MicroStrain(serial="133931", timeout=1.0, name="thigh")


def plant(robot):
    with Diagram("plant", rate=1000) as plant:
        for name, unit, firmware in (("left", "A", "0.2.3.32"), ("right", "B", "0.2.3.33"), ("cyber", "C", "")):
            robot[name].emulator(unique=unit * 16, firmware=firmware)(position=0.1, velocity=0.0)
        robot["hip"].emulator()(position=0.1, velocity=0.0)
        robot["thigh"].emulator()
        EmulatedOpenImu.of(robot["shank"])(accel=(0.0, 0.0, -9.81), gyro=(0.0, 0.0, 0.0))
    return plant
"""
SUBJECT = """
version = 1
id = "S03"
signed_by = "A. Investigator"
date = 2026-11-27
reason = "first session"

[joint."*"]
torque = 1.5
"""
IMU, VERSION = "6904E06600830000", "1.1.2.0.0"
AT = {"block": "RobStride", "model": "RS02"}
UNITS = {
    "left": AT | {"serial": "A" * 16, "firmware": "0.2.3.32.0", "settings": {"can_id": 20}},
    "right": AT | {"serial": "B" * 16, "firmware": "0.2.3.33.0", "settings": {"can_id": 21}},
    "cyber": AT | {"serial": "C" * 16, "model": "CyberGear", "settings": {"can_id": 22}},
    "shank": {
        "serial": IMU,
        "block": "OpenImu",
        "model": "300RI",
        "firmware": VERSION,
        "settings": {"address": 129, "timeout": 1.0},
    },
    "thigh": {
        "serial": "6253.133931",
        "block": "MicroStrain",
        "model": "",
        "firmware": "1.1.6",
        "settings": {"serial": "133931", "timeout": 1.0},
    },
    "hip": {"serial": "X 7", "block": "CubeMars", "model": "AK80-9", "settings": {"can_id": 3}},
}


@pytest.fixture(scope="module")
def legs(tmp_path_factory):
    """The folder of a robot whose drives respond, as the fixture `run` needs it."""
    folder = tmp_path_factory.mktemp("legs")
    write_file(folder, SUBJECT, "subject.toml")
    write_file(
        folder,
        f'[bus.legs]\ninterface = "udp_multicast"\nchannel = "{channel(77)}"\n[bus.imus]\n'
        f'interface = "udp_multicast"\nchannel = "{channel(78)}"\nbitrate = 250_000\n',
        "lab.toml",
    )
    robot = write_file(folder, ROBOT)
    plant = started("emulate", robot, "--rig", "lab.toml", "--lines", folder / "ports", cwd=folder)
    while "Ctrl-C ends it" not in (line := plant.stdout.readline()):
        assert line, plant.communicate()
    yield folder
    plant.kill()
    plant.communicate()


def run(folder, *words, **changed):
    """Run with records of UNITS, some of them changed, {path: fields}."""
    for old in folder.glob("lab.records/*"):
        old.unlink()
    for path in UNITS | changed:
        signed = {"name": "E. Person", "date": str(datetime.date.today())}
        steps = {name: StepRecord("2026-11-27 14:02", AGREES) for name in (*BEFORE_TORQUE, *OF_SENSORS)}
        fields = {"device": path, "signed": signed, "steps": steps} | UNITS.get(path, {}) | changed.get(path, {})
        write(folder / "lab.toml", Record(**fields))
    words = ("--rig", "lab.toml", "--subject", "subject.toml", "--yes", "--record", "out", "--duration", "0.2", *words)
    return finished("robot.py", *words, cwd=folder, TICKWORK_PORTS=str(folder / "ports" / "tty*"))


@pytest.mark.hazard("H1o")
@pytest.mark.parametrize(
    ("changed", "words"),
    soaked(
        [
            ({"left": {"firmware": "0.2.3.31.0"}}, "A.toml is of firmware 0.2.3.31.0, and the unit has 0.2.3.32.0"),
            ({"right": {"serial": "D" * 16}}, f"is of the unit {'D' * 16}, and the unit that responds is {'B' * 16}"),
            ({"left": {"serial": "B" * 16}, "right": {"serial": "A" * 16}}, "A.toml was measured at right"),
            ({"cyber": {"serial": "E" * 16}}, f"and the unit that responds is {'C' * 16}"),
            ({"shank": {"serial": "F" * 16}}, f"and the unit that responds is {IMU}"),
            ({"shank": {"firmware": "1.0.9.0.0"}}, f"is of firmware 1.0.9.0.0, and the unit has {VERSION}"),
            (
                {"shank": {"settings": {"address": 129, "timeout": 1.0, "orientation": "x"}}},
                "was measured with orientation",
            ),
            ({"shank": {"steps": {"rest": StepRecord("2026-11-27 14:02", AGREES)}}}, "has no bend"),
            (
                {"thigh": {"serial": "6253.133932"}},
                "is of the unit 6253.133932, and the unit that responds is 6253.133931",
            ),
            ({"left": {"steps": {}}}, "has no identity, bus, state, turn"),
        ],
        but=[0, 1, 4, 6, 8],
    ),
    ids=["firmware", "unit", "exchanged", "cybergear", "imu", "imu firmware", "axes", "bend", "serial line", "steps"],
)
def test_a_unit_other_than_the_recorded_one_does_not_arm(legs, changed, words):
    ended = run(legs, **changed)
    assert ended.returncode == 2 and words in ended.stderr and "commission" in ended.stderr, ended.stderr
    assert "TW140" in ended.stderr and all(f"--accept {path}.record" in ended.stderr for path in changed), ended.stderr


@pytest.mark.hazard("H1o")
def test_two_units_with_one_id_do_not_arm(legs):
    with Nodes(77, Private(20)):
        ended = run(legs)
    assert ended.returncode == 2 and re.search(r"cannot be compared: units \w+ and \w+ respond", ended.stderr), ended


@pytest.mark.hazard("H1o")
@pytest.mark.parametrize("call", [runtime.run, runtime.connect])
def test_python_asks_for_records_as_the_command_does(legs, call):
    for old in legs.glob("lab.records/*"):
        old.unlink()
    with pytest.raises(BadInput, match="left: subject S03 .* which is missing"):
        with call(legs / "robot.py", rig=legs / "lab.toml", subject=legs / "subject.toml", duration=1.0, yes=True):
            pass


def test_recorded_units_arm_and_the_table_states_what_was_not_compared(legs, monkeypatch):
    signed = {"name": "E. Person", "date": "2099-01-01"}  # the newest of this joint, but its unit is not mounted
    ended = run(legs, spare=UNITS["left"] | {"serial": "0" * 16, "device": "left", "signed": signed})
    assert ended.returncode == 0, ended.stderr
    for path, words in (
        ("left", "record AAAAAAAAAAAAAAAA of .*; serial number and firmware compared"),
        ("cyber", "record CCCCCCCCCCCCCCCC of .*; serial number compared, no firmware"),
        ("thigh", "record 6253.133931 of .*; serial number and firmware compared"),
        ("shank", "record .*; serial number and firmware compared"),
        ("hip", "record X 7 of .*; serial number and firmware not compared: its protocol reports neither"),
    ):
        assert re.search(f"{path}: {words}\n", ended.stderr), ended.stderr
    [about] = (json.loads(file.read_text()) for file in legs.glob("out/*.json"))
    assert about["metadata"]["rig"]["records"]["serials"]["left"] == "A" * 16
    ended = run(legs, "--accept", "left.record", left={"firmware": ""})
    assert ended.returncode == 0 and "accepted although it is of firmware unknown" in ended.stderr, ended.stderr
    words = {"rig": legs / "lab.toml", "subject": legs / "subject.toml", "accept": ("left.record",)}
    monkeypatch.setenv("TICKWORK_PORTS", str(legs / "ports" / "tty*"))
    schedule = prepare(Request(legs / "robot.py", yes=True, **words)).schedule  # arming again accepts these units alone
    for path, half in (("left", 0xAAAAAAAA), ("cyber", 0xCCCCCCCC)):
        first, length = schedule.items[path]["unique"]
        assert list(schedule.arena[first : first + length]) == [2.0, half, half]

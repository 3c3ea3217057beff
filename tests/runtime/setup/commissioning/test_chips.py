"""`scan` on I2C."""

import json
import os

import pytest

from cext.lines.i2c_memory import MemoryI2c
from runtime.host.errors import BAD_INPUT, CHECK_FAILED, OK
from runtime.robot.guardian.lock import BusLock
from runtime.robot.rig.chips import Chips
from runtime.robot.rig.file import read
from tests.runtime.robot.rig.wires import Wires, add_mpu

CHANNEL = f"/dev/i2c-{os.getpid()}"  # another worker of pytest takes another bus
WORDS = ("scan", "--interface", "i2c", "--channel", CHANNEL)


@pytest.fixture
def wires(monkeypatch):
    """The chips of the bus that the command opens."""
    wires = MemoryI2c((0x70,))
    monkeypatch.setattr("runtime.setup.commissioning.chips.open_adapter", lambda bus: (Chips(Wires(wires)), wires))
    return wires


def test_every_chip_is_listed_with_its_identification(wires, command_line):
    add_mpu(wires)
    wires.add(0x3C)
    add_mpu(wires, 0x69, 1 + 4, 0x73)
    code, out, err = command_line(*WORDS)
    assert (code, err) == (OK, "")
    assert out.splitlines() == [
        f"bus imus  i2c {CHANNEL}",
        "  0x0c        AK8963  (register 0x00 is 0x48)",
        "  0x3c        unknown chip",
        "  0x68        MPU-9250  (register 0x75 is 0x71)",
        "  0x70        TCA9548A multiplexer  (by its address)",
        "  0x70.4 0x69 MPU-9255  (register 0x75 is 0x73)",
    ]


def test_scan_writes_a_first_rig_file(wires, command_line):
    add_mpu(wires, 0x68, 1 + 4)
    wires.write(wires.add(0x2A), 0x1F, b"\x0f")
    code, _, err = command_line(*WORDS, "--write-rig", "new.toml")
    assert code == OK and "written" in err
    text = (command_line.folder / "new.toml").read_text()
    assert read(command_line.folder / "new.toml").buses["imus"].channel == CHANNEL
    assert (
        '# [device."mpu9250_70_4"]\n# address = 0x68\n# mux = 0x70\n# channel = 4\n' in text
        and '# [device."nau7802_2a"]' in text
    )
    rows = json.loads(command_line("scan", "--rig", "new.toml", "--json")[1])["buses"][0]["chips"]
    assert [(row["mux"], row["channel"], row["address"], row["name"]) for row in rows if row["block"]] == [
        (0, 0, 0x2A, "NAU7802"),
        (0x70, 4, 0x68, "MPU-9250"),
    ]


def test_silence_is_reported_with_its_likely_cause(monkeypatch, command_line):
    wires = MemoryI2c()
    monkeypatch.setattr("runtime.setup.commissioning.chips.open_adapter", lambda bus: (Chips(Wires(wires)), wires))
    code, out, _ = command_line(*WORDS)
    assert code == CHECK_FAILED and "! no chip responds: check the sensors' supply" in out


def test_a_bus_of_a_run_is_not_used(wires, command_line):
    lock = BusLock("i2c", CHANNEL)
    try:
        code, _, err = command_line(*WORDS)
    finally:
        lock.close()
    assert code == CHECK_FAILED and "TW106" in err and wires.exchanges == 0


def test_a_bus_that_does_not_exist_is_reported(command_line):
    code, _, err = command_line(*WORDS)
    assert code == CHECK_FAILED and "TW131" in err
    code, _, err = command_line("scan", "--interface", "i2c")
    assert code == BAD_INPUT and "add, for example, --channel /dev/i2c-1" in err


def test_drive_tools_reject_an_i2c_bus(command_line):
    code, _, err = command_line("configure", "3", "--interface", "i2c", "--channel", CHANNEL, "--read", "all")
    assert code == BAD_INPUT and "TW105" in err and "has no drives" in err

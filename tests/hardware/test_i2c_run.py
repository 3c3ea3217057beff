"""A whole run from the command line on the chips of i2c-stub: opened, set up, armed, recorded. Under User Mode
Linux.
"""

import re

import pytest

from tests.hardware.test_i2c import NODE, ROBOT, assert_read, converting, needs_stub, stub  # noqa: F401
from tests.runtime.runs import Files, finished, write

pytestmark = [needs_stub, pytest.mark.soak]
RIG = f'[bus.imus]\ninterface = "i2c"\nchannel = "{NODE}"\n'


def test_a_run_records_every_sensor(stub, converting, tmp_path):  # noqa: F811
    done = finished(
        write(tmp_path, ROBOT, "robot.py"),
        "--rig",
        write(tmp_path, RIG, "lab.toml"),
        "--yes",
        "--duration",
        "0.6",
        "--record",
        tmp_path / "out",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    files = Files(tmp_path / "out")
    assert_read({header.split(" [")[0]: column[-1] for header, column in files.table.items()})
    assert len(files.table["tick"]) + files.sidecar["missed"] == 30
    assert all(re.search(rf" {name} \d[\d.]* Hz\n", done.stdout) for name in ("handle", "insole", "shank", "thigh")), (
        done.stdout
    )


def test_a_wrong_address_ends_before_anything_is_armed(stub, tmp_path):  # noqa: F811
    done = finished(
        write(tmp_path, ROBOT, "robot.py"),
        "--rig",
        write(tmp_path, RIG + "[device.insole]\naddress = 0x49\n", "lab.toml"),
        "--yes",
        "--duration",
        "1",
        cwd=tmp_path,
    )
    assert done.returncode == 2 and "TW128" in done.stderr and "address 0x49: no reply" in done.stderr, done.stderr

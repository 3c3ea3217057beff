"""`configure --joint`: a joint is moved by hand, its rig file says how its motor sits, and the table before arming
compares with it.
"""

import errno
import os
import subprocess
import time

import pytest

from blocks.actuators import CubeMarsServo, CubeMarsV3
from graph import Diagram
from runtime.host.errors import BadInput
from runtime.record.report.preflight.table import marks, position_range
from runtime.robot.loading.file import compile_diagram, load
from runtime.robot.rig.file import RigBus, parse, read
from runtime.robot.rig.overrides import override
from runtime.robot.rig.tool_bus import ToolBus
from runtime.setup.commissioning import rig_edit
from runtime.setup.commissioning.configure.joint import Motor
from tests.runtime.runs import finished, knee, started, write
from tests.runtime.setup.commissioning.nodes import DISABLE, ENABLE, V3, Commander, Mit, Nodes, Servo

pytestmark = pytest.mark.paced

RIG = """# the lab's exo
[bus.legs]      # both knees
interface = "udp_multicast"
channel = "{channel}"

[device.knee]
can_id = 1      # the label says 1
offset = 0.5    # of last year

# that was all
"""


class Person:
    """Moves the joint, and presses Enter when it is asked to."""

    def __init__(self, folder, *words):
        self.process = started("configure", *words, cwd=folder, stdin=subprocess.PIPE, bufsize=1)

    def asked(self, word):
        while word not in (line := self.process.stdout.readline()):
            assert line, self.process.stderr.read()

    def enter(self):
        self.process.stdin.write("\n")

    def end(self):
        out, err = self.process.communicate(timeout=20)
        return self.process.returncode, out, err


def test_boards_in_extended_frames_are_queried_with_frames_that_keep_them_disabled():
    servo, board = Servo(4), V3(5)
    with Diagram("boards", rate=100) as robot:
        CubeMarsServo("AK60-6-V1.1", can_id=4, gear_ratio=2.0, name="hip")(current_command=0.0)
        CubeMarsV3("AK80-9-V3.0", can_id=5, name="knee")(torque_command=0.0)
    with Nodes(48, servo, board) as nodes, ToolBus(RigBus("can", "udp_multicast", nodes.channel)) as bus:
        assert Motor(bus, robot["hip"]).angle() == pytest.approx(1.5708 / 2.0, abs=1e-4)
        assert Motor(bus, robot["knee"]).angle() == pytest.approx(1.5708, abs=1e-4)
        bus.listen(0.05)
    told = {frame for node in nodes.nodes for frame in node.heard if frame[0] >> 8 != 0x29}
    assert told == {(1 << 8 | 4, True, bytes(4)), (15 << 8 | 5, True, b"")}  # no current; disable


def test_three_poses_give_offset_sign_and_range(tmp_path):
    drive = Mit(1, position=0.3)
    with Nodes(40, drive) as nodes:
        rig = write(tmp_path, RIG.format(channel=nodes.channel), "lab.toml")
        person = Person(tmp_path, "--joint", "knee", "--rig", rig, knee(tmp_path), "--yes")
        person.asked("1 of 3")
        person.enter()
        person.asked("2 of 3")
        drive.position = -0.7  # bending turns the motor down
        person.enter()
        person.asked("3 of 3")
        for drive.position in (0.4, -1.5):
            time.sleep(0.15)
        person.enter()
        code, out, err = person.end()
        assert (code, err) == (0, "")
        drive.position = -0.7
        run = finished("robot.py", "--rig", rig, "--yes", "--no-record", "--duration", "0.2", cwd=tmp_path)
        told = next(line for line in (run.stdout + run.stderr).splitlines() if line.startswith("  knee "))
        # the wire's steps are 0.4 mrad
        assert "  1.000 rad in [-0.1, 1.8]  " in told or "  0.999 rad in [-0.1, 1.8]  " in told
    drive.heard = drive.heard[: next(place for place, frame in enumerate(drive.heard) if frame[2] == ENABLE)]
    assert {data for _, extended, data in drive.heard if not extended} == {DISABLE}  # motor off, all the time
    found = read(rig)
    step = 25.0 / 65535
    assert found.devices["knee"]["invert"] is True and found.devices["knee"]["offset"] == pytest.approx(
        -0.3, abs=2 * step
    )
    assert (
        found.devices["knee"]["range"] == pytest.approx([-0.1, 1.8], abs=2e-3) and found.devices["knee"]["can_id"] == 1
    )
    text = rig.read_text()
    assert text.startswith("# the lab's exo\n[bus.legs]      # both knees\n") and text.endswith("\n\n# that was all\n")
    assert (
        "can_id = 1      # the label says 1\noffset = -0." in text
        and ("    # of last year\ninvert = true\nrange = [") in text
    )


@pytest.mark.soak
def test_a_joint_that_does_not_move_is_rejected_and_nothing_is_written(tmp_path):
    with Nodes(41, Mit(1, position=0.3)) as nodes:
        rig = write(tmp_path, RIG.format(channel=nodes.channel), "lab.toml")
        person = Person(tmp_path, "--joint", "knee", "--rig", rig, knee(tmp_path), "--yes")
        for number in ("1 of 3", "2 of 3"):
            person.asked(number)
            person.enter()
        code, _, err = person.end()
    assert (
        code == 2
        and "the sign needs at least 0.2 rad; nothing was written" in err
        and rig.read_text() == RIG.format(channel=nodes.channel)
    )


def test_a_joint_under_another_controller_is_not_measured(command_line):
    drive = Mit(1)
    with Nodes(42, drive, Commander(1)) as nodes:
        rig = write(command_line.folder, RIG.format(channel=nodes.channel), "lab.toml")
        code, _, err = command_line("configure", "--joint", "knee", "--rig", rig, knee(command_line.folder))
    assert (
        code == 2
        and "another controller commands id 1 on this bus" in err
        and DISABLE not in [data for _, _, data in drive.heard]
    )


def test_the_tables_before_arming_compare_with_the_range_of_the_rig(tmp_path):
    rig = parse("lab.toml", RIG.format(channel="239.1.1.1"))
    _, diagram = load(knee(tmp_path), ())
    rig.devices["knee"]["range"] = [-0.1, 1.8]
    override(rig, diagram)
    compile_diagram(tmp_path / "robot.py", diagram)
    block = diagram["knee"]
    assert position_range(block) == (-0.1, 1.8)
    row = {"position": 2.0, "low": -0.1, "high": 1.8, "temperature": 30.0, "fault": 0, "age": 0.0}
    assert marks(row, block) == {"position": "outside its range"} and marks(row | {"position": 0.5}, block) == {}


@pytest.mark.parametrize("value", ["[1.0, 0.5]", "[1.0]", "[0.0, nan]", "3.0"])
def test_an_invalid_range_is_rejected(command_line, value):
    rig = write(command_line.folder, RIG.format(channel="239.1.1.1"), "lab.toml")
    rig.write_text(rig.read_text().replace("can_id = 1", f"range = {value}\ncan_id = 1"))
    code, out, err = command_line("check", knee(command_line.folder), "--rig", rig)
    assert code and "range must be the lowest and the highest angle in rad" in out + err


@pytest.mark.parametrize(
    "text, device",
    [
        ('[device]\n"left/knee" = { can_id = 3 }\n', "left/knee"),
        ('[device."left/knee"]\nrange = [\n  0.0,\n  1.0,\n]\n', "left/knee"),
    ],
)
def test_a_rig_file_that_cannot_be_edited_safely_is_not_changed(text, device):
    with pytest.raises(
        BadInput,
        match="cannot be edited automatically. Nothing was written. Edit the file by hand: offset = 0.5, range = ",
    ):
        rig_edit.change_device("lab.toml", text, device, {"offset": 0.5, "range": [0.0, 2.0]})


def test_a_device_missing_in_the_rig_file_is_appended():
    after = rig_edit.change_device("lab.toml", "# hers\n", "left/knee", {"offset": 0.5, "invert": True})
    assert after == '# hers\n\n[device."left/knee"]\noffset = 0.5\ninvert = true\n'


def test_line_ends_and_owner_of_a_rig_file_stay(tmp_path):
    path = tmp_path / "lab.toml"
    path.write_bytes(b"# old\r\n")
    owner = (12345, 12345) if os.geteuid() == 0 else (os.geteuid(), os.getegid())
    os.chown(path, *owner)
    path.chmod(0o640)
    rig_edit.write(path, "# old\n", "# new\n# line\n")
    status = path.stat()
    assert path.read_bytes() == b"# new\r\n# line\r\n"
    assert (status.st_uid, status.st_gid, status.st_mode & 0o777) == (*owner, 0o640)


def test_a_file_that_cannot_be_replaced_leaves_no_other_file(tmp_path, monkeypatch):
    path = write(tmp_path, "# old\n", "lab.toml")

    def full(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(BadInput, match="cannot be written: No space left on device"):
        rig_edit.write(path, "# old\n", "# new\n")
    assert path.read_text() == "# old\n" and list(tmp_path.iterdir()) == [path]


def test_a_file_that_has_changed_is_not_overwritten(tmp_path):
    path = write(tmp_path, "# new\n", "lab.toml")
    with pytest.raises(BadInput, match="has changed since it was read"):
        rig_edit.write(path, "# old\n", "# mine\n")
    assert path.read_text() == "# new\n"

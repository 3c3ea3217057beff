"""`scan` over real udp_multicast: what it finds, what it sends, frame by frame, and what it never sends."""

import json
import math
import os
import socket
import time

import pytest

from blocks.actuators.queries import alternates
from runtime.host.errors import BAD_INPUT, CHECK_FAILED, OK
from runtime.robot.guardian.lock import BusLock
from runtime.robot.rig.file import read
from runtime.setup.commissioning.scan import foreign_drive_ids
from tests.runtime.setup.commissioning.nodes import (
    DISABLE,
    ENABLE,
    V3,
    Commander,
    Mit,
    Node,
    Nodes,
    OpenImu,
    Private,
    Servo,
    channel,
)

QUICK = ("--listen", "0.1")
GET_ID, STOP, READ = 0x0000FD00, 0x0400FD00, 0x1100FD00


def found(command_line, nodes, *more):
    """(exit code, the one bus's report)"""
    code, out, err = command_line("scan", *nodes.words, *QUICK, "--json", *more)
    [report] = json.loads(out)["buses"]
    return code, report


@pytest.mark.parametrize(
    "positions, two",
    [
        ([0.0, 1.5] * 4, True),
        ([0.0, 0.001, 1.5] * 6, True),  # one reports twice as often
        ([0.1 * k for k in range(20)], False),
        ([0.0] * 10 + [1.5] * 10, False),  # a jump
        ([0.3 * math.sin(k) for k in range(40)], False),
        ([0.0] * 20, False),
    ],
)
def test_reports_of_two_positions_are_those_of_two_drives(positions, two):
    assert alternates(positions) == two


def test_every_family_is_found_and_listed(command_line):
    with Nodes(
        1, Mit(3, position=0.5, error=5), Private(9), Mit(12, host=0xFD, temperature=28.4), OpenImu(), Servo(77), V3(78)
    ) as nodes:
        code, report = found(command_line, nodes)
    by_id = {drive["can_id"]: drive for drive in report["drives"]}
    assert code == OK and sorted(by_id) == [3, 9, 12, 77, 78]
    assert (
        by_id[3]["family"] == "CubeMars in MIT mode"
        and by_id[3]["temperature"] == 31.0
        and by_id[3]["fault"] == "encoder"
    )
    assert by_id[3]["position"] == pytest.approx(0.5, abs=4e-4) and by_id[3]["velocity"] is None
    assert (
        by_id[9]["family"] == "RobStride"
        and by_id[9]["firmware"] == "0.3.1.7.0"
        and by_id[9]["unique"] == "1122334455667788"
    )
    assert (by_id[9]["position"], by_id[9]["voltage"], by_id[9]["temperature"]) == (0.25, 47.5, 36.5)
    assert (
        by_id[12]["family"] == "RobStride in its MIT protocol"
        and by_id[12]["temperature"] == 28.4
        and by_id[12]["fault"] is None
    )
    assert (
        by_id[77]["family"] == "CubeMars in servo mode, or a V3.0 board"
        and "CubeMars needs MIT mode" in by_id[77]["notes"][0]
    )
    assert (
        by_id[78]["family"] == "CubeMars with a V3.0 board"
        and by_id[78]["fault"] == ""
        and by_id[78]["temperature"] == 33.0
    )
    assert by_id[77]["position"] == pytest.approx(1.5708, abs=1e-3) and by_id[77]["fault"] == "under-voltage"
    [node] = report["nodes"]
    assert (node["family"], node["address"], node["manufacturer"], node["function"], node["firmware"]) == (
        "OpenIMU",
        128,
        823,
        131,
        "1.1.2.0.0",
    )
    assert node["sends"]["acceleration"] == pytest.approx(100.0, rel=0.5)


def test_no_frame_of_scan_enables_a_drive(command_line):
    drive, private, witness = Mit(3), Private(9), Mit(200)
    with Nodes(2, drive, private, witness) as nodes:
        code, report = found(command_line, nodes, "--ids", "1-20")
    told = [(frame["id"], frame["extended"], bytes.fromhex(frame["data"])) for frame in report["sent"]]
    answers = [
        frame for frame in witness.heard if frame[2][:1] == b"\x03" or (frame[1] and frame[0] & 0xFF in (0xFD, 0xFE))
    ]
    heard = [frame for frame in witness.heard if frame not in answers]
    assert heard == told and code == OK
    standard = [frame for frame in heard if not frame[1]]
    assert standard == [(can_id, False, DISABLE) for can_id in range(1, 21)]
    extended = [frame for frame in heard if frame[1]]
    assert extended[0] == (0x18EAFFF9, True, bytes.fromhex("00EE00"))
    assert extended[1:21] == [(GET_ID | can_id, True, bytes(8)) for can_id in range(1, 21)]
    assert extended[26:] == [(0xF00 | can_id, True, b"") for can_id in range(1, 21)]
    assert extended[21:26] == [
        (STOP | 9, True, bytes(8)),
        (STOP | 9, True, bytes.fromhex("00C4000000000000")),
        (READ | 9, True, bytes.fromhex("1970000000000000")),
        (READ | 9, True, bytes.fromhex("1B70000000000000")),
        (READ | 9, True, bytes.fromhex("1C70000000000000")),
    ]
    assert ENABLE not in [data for _, _, data in heard] and not drive.enabled
    assert not {identifier >> 24 for identifier, extended, _ in heard if extended} - {0, 4, 17, 0x18}
    # for no drive
    assert {identifier & 0xFF for identifier, extended, _ in heard if extended and identifier >> 24 == 0x18} == {0xF9}


class Loose(Private):
    """A drive whose plug has no contact for 0.3 s from its first stop on."""

    since = None

    def hear(self, identifier, extended, data):
        if identifier >> 24 == 4 and self.since is None:
            self.since = time.monotonic()
        return [] if self.since and time.monotonic() - self.since < 0.3 else super().hear(identifier, extended, data)


def test_a_drive_that_misses_three_stops_is_asked_again(command_line):
    with Nodes(97, Loose(9)) as nodes:
        code, report = found(command_line, nodes, "--ids", "9")
    [drive] = report["drives"]
    assert code == OK and drive["temperature"] == 36.5 and not drive["remarks"]


class Odd(Mit):
    """Replies cut to `length` bytes, with `name` in byte 0."""

    def __init__(self, can_id, length=8, name=None):
        super().__init__(can_id)
        self.length, self.name = length, can_id if name is None else name

    def hear(self, *frame):
        return [
            (identifier, extended, bytes([self.name]) + data[1 : self.length])
            for identifier, extended, data in super().hear(*frame)
        ]


def test_scan_reports_the_reply_parameter_for_short_replies(command_line, tmp_path):
    rig = tmp_path / "lab.toml"
    with Nodes(12, Odd(3, 7), Odd(4, 6), Mit(5)) as nodes:
        code, out, _ = command_line("scan", *nodes.words, *QUICK, "--ids", "1-10", "--write-rig", str(rig))
    assert code == OK and out.count("faults not reported") == 2 and "id 3: replies of 7 bytes" in out
    assert "# can_id = 3\n# reply = 7\n" in rig.read_text() and "# can_id = 4\n# reply = 6\n" in rig.read_text()
    assert rig.read_text().count("reply =") == 2


def test_a_drive_that_replies_with_another_id_is_reported(command_line):
    with Nodes(13, Odd(3, name=6)) as nodes:
        code, out, _ = command_line("scan", *nodes.words, *QUICK, "--ids", "1-10")
    assert code == CHECK_FAILED and "! id 3: replies with id 6 in byte 0" in out and "commands" not in out


def test_two_drives_with_one_id_are_reported(command_line):
    with Nodes(
        3, Mit(3, position=0.5), Mit(3, position=-0.2), Private(9), Private(9, unique=5), V3(7), V3(7), V3(8)
    ) as nodes:
        code, out, _ = command_line("scan", *nodes.words, *QUICK, "--ids", "1-10")
    assert code == CHECK_FAILED
    assert "! id 7: 2 replies to one query: 2 drives have id 7" in out and "id 8: 2" not in out
    assert "! id 3: 2 replies to one query: 2 drives have id 3. Disconnect all but one" in out
    assert "! id 9: 2 replies to one query: 2 drives have id 9" in out


class Counter(Node):
    """A device of a laboratory that counts in byte 0."""

    period = 0.005

    def speak(self):
        self.count = getattr(self, "count", -1) + 1
        return [(0x123, False, bytes([self.count % 16]) + bytes(7))]


class Noise(Node):
    """Datagrams that are not frames, to the group of a bus."""

    def live(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            while self.alive:
                stranger.sendto(b"rubbish", (channel(17), 43113))
                time.sleep(0.01)


def test_frames_that_cannot_be_decoded_are_reported(command_line):
    with Nodes(17, Noise()) as nodes:
        code, report = found(command_line, nodes, "--ids", "1-5")
    assert code == CHECK_FAILED and len(report["remarks"]) == 1
    assert "frames could not be decoded: check the adapter" in report["remarks"][0]


def test_a_device_that_sends_unasked_is_not_a_drive(command_line):
    with Nodes(16, Mit(3), Mit(5, host=0xFD), Counter()) as nodes:
        code, report = found(command_line, nodes, "--ids", "1-20")
    assert [drive["can_id"] for drive in report["drives"]] == [3, 5] and report["remarks"] == []
    assert report["others"] == ["123"] and code == OK


@pytest.mark.parametrize(
    "identifier, extended", [(3, False), (0x01FFFF03, True), (0x0300FD03, True), (0x00000103, True), (0x00000803, True)]
)
def test_scan_sends_nothing_on_a_bus_of_another_controller(command_line, identifier, extended):
    drive = Mit(3)
    with Nodes(4, drive, Commander(identifier, extended)) as nodes:
        code, report = found(command_line, nodes)
    assert code == CHECK_FAILED and report["commanded"] == [3] and report["sent"] == []
    assert report["remarks"][0].startswith("another controller commands id 3 on this bus. Nothing was sent")
    assert {data for _, _, data in drive.heard} == {bytes.fromhex("7fff7ff000000900")}


def test_a_reply_to_get_id_is_not_a_command():
    """That of a RobStride with a small id, to another program's query, looks like a CubeMars command to id 254."""
    assert not foreign_drive_ids(
        [(can_id << 8 | 0xFE, True, bytes(range(8))) for can_id in range(1, 128)], range(1, 256)
    )


def test_two_imus_with_one_address_are_reported(command_line):
    with Nodes(9, OpenImu(128), OpenImu(128, serial=4712)) as nodes:
        code, out, _ = command_line("scan", *nodes.words, *QUICK, "--ids", "3")
    assert code == CHECK_FAILED and "! two nodes have address 128: " in out


def test_a_bus_controlled_by_another_process_is_not_used_and_its_process_is_named(command_line):
    drive = Mit(3)
    with Nodes(5, drive) as nodes:
        lock = BusLock("udp_multicast", nodes.channel)
        code, out, err = command_line("scan", *nodes.words, *QUICK)
        lock.close()
    message = f"[bus.can] {nodes.channel} is controlled by process {os.getpid()}"
    assert (code, out) == (CHECK_FAILED, "")
    assert f"error TW106 bus controlled by another process: {message}" in err
    assert drive.heard == []


def test_silence_is_reported_with_the_likely_remedy(command_line):
    with Nodes(6) as nodes:
        code, out, _ = command_line("scan", *nodes.words, *QUICK, "--ids", "1-3")
    assert (
        code == CHECK_FAILED
        and "! no device responds: check its supply" in out
        and ("an OpenIMU has 250 kbit/s as delivered") in out
    )
    assert "try --bitrate 250000" in out


def test_the_written_rig_file_is_valid_and_is_not_overwritten(command_line):
    with Nodes(7, Mit(3), Private(9)) as nodes:
        code, out, err = command_line("scan", *nodes.words, *QUICK, "--ids", "1-10", "--write-rig", "new.toml")
        assert code == OK and err == "written: new.toml\n"
        text = (command_line.folder / "new.toml").read_text()
        rig = read(command_line.folder / "new.toml")
        assert rig.buses["can"].channel == nodes.channel and rig.devices == {}
        assert '# [device."cubemars_3"]\n# can_id = 3\n' in text and '# [device."robstride_9"]\n# can_id = 9\n' in text
        heard = len(nodes.nodes[0].heard)
        assert "the file exists" in command_line.refused("scan", *nodes.words, "--write-rig", "new.toml")
        assert len(nodes.nodes[0].heard) == heard and (command_line.folder / "new.toml").read_text() == text
        assert command_line("scan", "--rig", "new.toml", *QUICK, "--ids", "3")[0] == OK


def test_every_frame_is_reported_on_request(command_line):
    with Nodes(8, Mit(3)) as nodes:
        out = command_line("scan", *nodes.words, *QUICK, "--ids", "3,4", "--verbose")[1]
        brief = command_line("scan", *nodes.words, *QUICK, "--ids", "3,4")[1]
    assert "    003#FFFFFFFFFFFFFFFD  disable of drives in MIT mode\n    004#FFFFFFFFFFFFFFFD" in out
    assert "  sent: disable of drives in MIT mode, 2 frames, 003#FFFFFFFFFFFFFFFD to 004#FFFFFFFFFFFFFFFD\n" in brief


@pytest.mark.parametrize(
    "words, said",
    [
        (["--ids", "0-3"], "--ids 0-3: expected ids from 1 to 255"),
        (["--ids", "3-"], "--ids 3-: expected"),
        (["--ids", "9-3"], "--ids 9-3: expected"),
        (["--interface", "slcan"], "--interface slcan needs a channel: add, for example, --channel /dev/ttyACM0"),
        (["--bus", "legs"], "--bus selects a bus of a rig file: add --rig RIG"),
        (["--interface", "slacn", "--channel", "x"], "python-can has no such interface"),
        (["--channel", "can0", "--rig", "lab.toml"], "exclude each other"),
    ],
)
def test_scan_rejects_invalid_options_with_reason(command_line, words, said):
    code, _, err = command_line("scan", *words)
    assert code == BAD_INPUT and said in err

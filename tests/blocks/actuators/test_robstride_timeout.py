"""The settings of a RobStride drive, its time-out among them: written at arming, read back, and no arming where the
drive returns another one or none.
"""

import struct

import pytest

from blocks.actuators import RobStride
from blocks.actuators.robstride import frames
from graph import Block, Diagram, Output
from tests.blocks.actuators import robstride_reference as reference
from tests.blocks.actuators.wire import Wired
from tests.cext.rigs import Rig

NOTED, TAKEN = 2, 1  # cext/abi.pxd
READ_REPLY = reference.identifier(17, 127, 0xFD)
FEEDBACK = reference.identifier(2, 2 << 14 | 127, 0xFD)  # mode 2: it runs


def read_reply(counts, index=0x7028, failed=0):
    return READ_REPLY | failed << 16, struct.pack("<HHI", index, 0, counts)


@pytest.mark.hazard("H8g")
def test_arming_writes_the_time_out_and_reads_it_back_before_it_enables():
    drive = RobStride("RS03", can_timeout=0.1)
    listed = drive.set_up_frames()
    assert [(identifier >> 24, data.hex()) for identifier, _, data in listed if data[:2] == b"\x28\x70"] == [
        (18, "28700000d0070000"),
        (17, "2870000000000000"),
    ]
    assert [identifier >> 24 for identifier, _, _ in listed] == [4, 18, 18, 18, 0, 17, 17, 17, 17, 17]
    assert [identifier >> 24 for identifier, _, _ in drive.enable_frames()] == [3]
    assert all(data[:2] != b"\x28\x70" for _, _, data in RobStride("CyberGear").set_up_frames())
    plain = RobStride("RS03", can_timeout=0.0)
    assert all(data[:2] != b"\x28\x70" for _, _, data in plain.read_frames()) and plain.ready == "read_back"


def test_a_drive_is_ready_once_it_has_returned_the_written_values():
    wired = Wired(RobStride, "RS03")
    limit = struct.unpack("<I", struct.pack("<f", 20.0))[0]
    for index, value in ((0x7029, 2000), (0x7028, 2000), (0x7005, 0xABCDEF00), (0x700B, limit)):
        assert wired["read_back"][0] == 0.0
        assert wired.hear(*read_reply(value, index=index)) == NOTED and wired["fault"] == 0
    assert wired["read_back"][0] == 1.0, "of the mode, one byte counts"


def test_a_torque_limit_that_the_firmware_has_converted_is_as_written():
    wired = Wired(RobStride, "RS03")
    for limit, differs in ((20.01, False), (19.99, False), (20.1, True)):
        wired["read_back"] = 0.0
        bits = struct.unpack("<I", struct.pack("<f", limit))[0]
        wired.hear(*read_reply(bits, index=0x700B))
        assert (wired["read_back"][2] > 0.0) == differs


@pytest.mark.parametrize("counts, failed", [(0, 0), (1999, 0), (20000, 0), (2000, 1)])
def test_another_time_out_is_a_fault_when_it_was_read_three_times(counts, failed):
    """Once may be a write that got lost: arming writes again."""
    wired = Wired(RobStride, "RS03")
    for _ in range(2):
        wired.hear(*read_reply(counts, failed=failed))
    assert wired["fault"] == 0 and wired["read_back"][0] == 0.0
    wired.hear(*read_reply(counts, failed=failed))
    fault = frames.DIFFERENT | (frames.UNREADABLE if failed else counts) << 8 | 1 << frames.PLACE
    assert wired["fault"] == fault
    assert wired.hear(FEEDBACK, bytes.fromhex("7fff7fff7fff012c")) == TAKEN and wired["fault"] == fault
    words = wired.block.fault_in_words(fault)
    read = "cannot be read back" if failed else f"reads {counts:g}"
    assert words.startswith(f"canTimeout (0x7028) {read}, 2000 was written; ") and "set can_timeout=0" in words


class Board(Block):
    """In the plant: a RobStride drive that answers every frame with its state, and reads with what was written; of its
    time-out with `counts`, None for not at all.
    """

    y = Output("1")

    def configure(self):
        self.counts, self.end, self.written, self.runs = 2000, None, {}, False

    def step(self, tick):
        for identifier, _extended, data, *_ in self.end.receive():
            kind, now = identifier >> 24 & 31, round(tick * self.dt * 1e9)
            index = struct.unpack("<H", data[:2])[0]
            self.runs = {3: True, 4: False}.get(kind, self.runs)
            if kind == 18:
                self.written[index] = data[4:]
            if kind == 17:
                value = self.written.get(index)  # none of mechPos and mechVel
                if index == 0x7028:
                    value = None if self.counts is None else struct.pack("<I", self.counts)
                if value is not None:
                    self.end.send(READ_REPLY & 0x1FFFFFFF, struct.pack("<HH", index, 0) + value, True, time=now)
            else:
                state = reference.identifier(2, (2 if self.runs else 0) << 14 | 127, 0xFD)
                self.end.send(state & 0x1FFFFFFF, bytes.fromhex("7fff7fff7fff012c"), True, time=now)
        return 0.0


def armed(counts, **parameters):
    with Diagram("robot", rate=200) as robot:
        knee = RobStride("RS03", name="knee", **parameters)
        knee(torque_command=0.5)
    with Diagram("plant", rate=200) as plant:
        board = Board(name="board")
    rig = Rig(robot, plant)
    board.counts, board.end = counts, rig.buses["can"].device
    outcome = rig.run(20, fade=0.0, arming_timeout=0.5)
    moved = [
        frame for frame in rig.frames if frame.sent and frame.id >> 24 & 31 == 1 and frame.id >> 8 & 0xFFFF != 0x7FFF
    ]
    return rig, knee, outcome, moved


def test_a_drive_that_returns_its_time_out_is_armed():
    _, _, outcome, moved = armed(2000)
    assert outcome.status == "ok" and len(moved) == 20


@pytest.mark.hazard("H8g")
def test_a_drive_with_another_time_out_is_never_commanded():
    _, _, outcome, moved = armed(0)
    assert (outcome.status, outcome.culprit) == ("device fault", "knee") and moved == []


def test_a_drive_that_does_not_return_its_time_out_is_not_armed():
    rig, knee, outcome, moved = armed(None)
    assert (outcome.status, outcome.unanswered) == ("no answer", ("knee",)) and moved == []
    assert rig.control.reports.unready == ["knee"]
    assert "not every read of its settings (type 17: canTimeout 0x7028, run_mode" in knee.unready_in_words()
    enabled = [frame for frame in rig.frames if frame.sent and frame.id >> 24 & 31 == 3]
    assert enabled == []


def test_without_a_time_out_the_other_settings_are_read():
    _, knee, outcome, moved = armed(None, can_timeout=0.0)
    assert outcome.status == "ok" and len(moved) == 20 and knee.own_timeout is None


def test_fault_mask_is_decoded_bit_by_bit():
    knee = RobStride("RS03")
    assert knee.fault_in_words(0) == ""
    assert knee.fault_in_words(1 | 256 << 3 | 256 << 30) == (
        "under-voltage (bit 0), over-voltage (bit 3 of the fault report), bit 30 of the fault report"
    )

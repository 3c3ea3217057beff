"""The time-out of a RobStride drive: written at arming, read back, and no arming where the drive returns another one or
none.
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
    listed = RobStride("RS03", can_timeout=0.1).enable_frames()
    assert [(identifier >> 24, data.hex()) for identifier, _, data in listed if data[:2] == b"\x28\x70"] == [
        (18, "28700000d0070000"),
        (17, "2870000000000000"),
    ]
    assert [identifier >> 24 for identifier, _, _ in listed] == [4, 18, 18, 18, 17, 3]
    assert all(data[:2] != b"\x28\x70" for _, _, data in RobStride("CyberGear").enable_frames())
    assert RobStride("CyberGear").ready is RobStride("RS03", can_timeout=0.0).ready is None


def test_a_drive_is_ready_once_it_has_returned_the_written_values():
    wired = Wired(RobStride, "RS03")
    assert wired.hear(*read_reply(2000, index=0x7029)) == NOTED and wired["timeout_read"][0] == 0.0
    assert wired.hear(*read_reply(2000)) == NOTED and wired["timeout_read"][0] == 1.0 and wired["fault"] == 0


@pytest.mark.parametrize("counts, failed", [(0, 0), (1999, 0), (20000, 0), (2000, 1)])
def test_another_time_out_is_a_fault_when_it_was_read_three_times(counts, failed):
    """Once may be a write that got lost: arming writes again."""
    wired = Wired(RobStride, "RS03")
    for _ in range(2):
        wired.hear(*read_reply(counts, failed=failed))
    assert wired["fault"] == 0 and wired["timeout_read"][0] == 0.0
    wired.hear(*read_reply(counts, failed=failed))
    assert wired["fault"] == frames.NO_TIMEOUT
    assert wired.hear(FEEDBACK, bytes.fromhex("7fff7fff7fff012c")) == TAKEN and wired["fault"] == frames.NO_TIMEOUT
    words = wired.block.fault_in_words(frames.NO_TIMEOUT)
    assert "time-out differs from the one written (bit 7)" in words and "set can_timeout=0" in words


class Board(Block):
    """In the plant: a RobStride drive that answers every frame as if it ran; reads of its time-out with `counts`, None
    for not at all.
    """

    y = Output("1")

    def configure(self):
        self.counts, self.end = 2000, None

    def step(self, tick):
        for identifier, extended, data, *_ in self.end.receive():
            kind, now = identifier >> 24 & 31, round(tick * self.dt * 1e9)
            if kind == 17 and self.counts is not None:
                self.end.send(READ_REPLY & 0x1FFFFFFF, struct.pack("<HHI", 0x7028, 0, self.counts), True, time=now)
            elif kind != 17:
                self.end.send(FEEDBACK & 0x1FFFFFFF, bytes.fromhex("7fff7fff7fff012c"), True, time=now)
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
    assert rig.control.reports.unready == ["knee"] and "not the read of its time-out" in knee.unready_in_words()


def test_without_a_time_out_nothing_is_read():
    _, knee, outcome, moved = armed(None, can_timeout=0.0)
    assert outcome.status == "ok" and len(moved) == 20 and knee.own_timeout is None


def test_fault_mask_is_decoded_bit_by_bit():
    knee = RobStride("RS03")
    assert knee.fault_in_words(0) == ""
    assert knee.fault_in_words(1 | 256 << 3 | 256 << 30) == (
        "under-voltage (bit 0), over-voltage (bit 3 of the fault report), bit 30 of the fault report"
    )

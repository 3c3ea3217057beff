"""Records of the ring, byte by byte."""

import pytest

from runtime.record.storage import messages
from runtime.record.storage.format import BUS_BYTE, Frame, row_struct

TIME = 1_000_000_007


def test_a_frame_is_read_from_its_bytes():
    payload = (
        TIME.to_bytes(8, "little")
        + (0x1FFF_FFFE | 0x8000_0000).to_bytes(4, "little")
        + bytes([3, 0, 2, 1])
        + b"abc".ljust(64, b"\0")
    )
    frame = Frame.unpack(payload)
    assert frame == Frame(TIME, 0x1FFF_FFFE, True, False, False, False, False, False, True, 2, b"abc")
    assert frame.pack() == payload and payload[BUS_BYTE] == frame.bus == 2 and len(payload) == 80


@pytest.mark.parametrize(
    "word, flags, named",
    [
        (0x4000_0001, 0, {"remote"}),
        (0x2000_0001, 0, {"error"}),
        (1, 1 | 4, {"rate_switch", "fd"}),
        (1, 2 | 4, {"error_state", "fd"}),
    ],
)
def test_flags_are_named(word, flags, named):
    payload = bytes(8) + word.to_bytes(4, "little") + bytes([8, flags, 0, 0]) + bytes(64)
    frame = Frame.unpack(payload)
    names = [name for name, kind in messages.FRAME if kind == messages.BOOL]
    assert {name for name in names if getattr(frame, name)} == named and frame.id == 1
    assert frame.truths == tuple(getattr(frame, name) for name in names) and frame.pack() == payload


def test_more_than_8_bytes_are_can_fd():
    assert Frame.unpack(bytes(8) + b"\1\0\0\0" + bytes([12, 0, 0, 0]) + bytes(64)).fd


def test_a_row_has_its_tick_and_its_lateness_before_the_signals():
    assert row_struct(3).size == 8 * 5

"""Rows, sent frames and events of the ring as arrays."""

import numpy as np
import pytest

from cext.memory.shared_state import RECORD_EVENT, SharedState
from cext.recording.ring_reader import take
from runtime.record.storage.format import FRAME

ROW, FRAMES, RECEIVED = 1, 2, 4


def frame(number, sent, length=8):
    return FRAME.pack(number, 0x101, length, 0, 0, sent, b"\xff" * 64)


def test_rows_and_sent_frames_are_arrays_in_order():
    shared = SharedState(1 << 14)
    for tick in range(3):
        shared.push(RECEIVED, bytes(8))
        shared.push(FRAMES, frame(10 * tick, sent=False))
        shared.push(FRAMES, frame(10 * tick + 1, sent=True, length=3))
        shared.push(ROW, np.array([tick, 0.5, 7.0, np.nan]).tobytes())
    shared.push(RECORD_EVENT, b'{"a":1}')
    rows, sent, before, others = take(shared, 2)
    np.testing.assert_array_equal(rows, [[tick, 0.5, 7.0, np.nan] for tick in range(3)])
    assert before.tolist() == [0, 1, 2] and others == [(RECORD_EVENT, b'{"a":1} ')]
    assert bytes(sent[1]) == FRAME.pack(11, 0x101, 3, 0, 0, True, b"\xff" * 3)  # no bytes beyond its length
    assert shared.empty and len(take(shared, 2)[0]) == 0


def test_a_wrapping_ring_is_read_correctly():
    shared = SharedState(1 << 12)
    for tick in range(1000):
        assert shared.push(ROW, np.array([float(tick), 0.0, 1.0]).tobytes())
        if tick % 7 == 6:
            rows = take(shared, 1)[0]
            assert rows[:, 0].tolist() == list(range(tick - 6, tick + 1))


def test_row_of_another_size_is_refused():
    shared = SharedState(1 << 12)
    shared.push(ROW, bytes(32))
    with pytest.raises(ValueError, match="a row has 32 bytes, not 40"):
        take(shared, 3)

"""The newest row of a run and the extremes of the rows before it, read beside the recorder."""

import math
import struct

from cext.bus.bits import frame_bits
from cext.memory.shared_state import RECORD_EVENT, RECORD_FRAME, RECORD_ROW, SharedState
from cext.recording.newest_row import NewestRow


def push(shared, tick, *values):
    return shared.push(RECORD_ROW, struct.pack(f"<{2 + len(values)}d", tick, 0.0, *values))


def test_extremes_are_those_of_every_row_since_the_look_before_in_the_order_of_time():
    shared = SharedState(1 << 16)
    newest = NewestRow(shared, 3)
    assert not newest.look() and newest.tick == -1
    for tick, values in enumerate(((1.0, 5.0, math.nan), (9.0, -4.0, 2.0), (-3.0, 6.0, math.nan), (2.0, 1.0, 7.0))):
        push(shared, tick, *values)
        shared.push(RECORD_EVENT, b"{}")
    assert newest.look() and newest.tick == 3 and list(newest.values) == [2.0, 1.0, 7.0]
    assert list(newest.first) == [9.0, -4.0, 2.0] and list(newest.second) == [-3.0, 6.0, 7.0]
    assert not newest.look()
    push(shared, 4, 0.5, math.nan, 1.0)
    assert newest.look() and newest.first[0] == newest.second[0] == 0.5 and math.isnan(newest.first[1])


def test_rows_that_the_recorder_has_taken_count_until_the_ring_has_moved_on():
    shared = SharedState(4096)
    newest = NewestRow(shared, 1)
    for tick in range(3):
        push(shared, tick, 10.0 * (tick == 1))
    shared.drain()
    assert newest.look() and (newest.first[0], newest.second[0]) == (0.0, 10.0)
    for tick in range(3, 200):  # twice the ring
        push(shared, tick, 20.0 * (tick == 4))
        shared.drain()
    assert not newest.look()  # the rows were taken and perhaps overwritten
    push(shared, 200, 1.0)
    assert newest.look() and newest.tick == 200 and newest.second[0] == 1.0


def test_frames_are_counted_for_each_bus_with_their_bits():
    shared = SharedState(1 << 16)
    newest = NewestRow(shared, 1, buses=(1.0, 0.0))
    for bus, sent, length in ((0, 0, 8), (0, 1, 8), (0, 1, 0), (1, 0, 8), (2, 0, 8), (0, 0, 255)):
        frame = struct.pack("<qIBBBB64s", 0, 1, length, 0, bus, sent, bytes(range(64)))
        shared.push(RECORD_FRAME, frame)
    assert not newest.look()  # no row
    bits = frame_bits(1, bytes(range(8)))[0]
    assert newest.traffic.tolist() == [[1, 2, 2 * bits + frame_bits(1, b"")[0]], [1, 0, 0]]

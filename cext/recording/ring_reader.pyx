# cython: freethreading_compatible=True
"""Reader of the ring inside the control process: rows and sent frames as arrays, without an object per record."""

import numpy as np

from libc.stdint cimport int64_t, uint8_t, uint64_t, uintptr_t
from libc.string cimport memcpy, memset

from cext.abi cimport FRAME_BYTES, Frame
from cext.atomics cimport load_u64, store_u64
from cext.memory.shared_state cimport (
    FRAME, PADDING, RECEIVED, ROW, Header, SharedLayout, SharedState, damaged, read_header, record_at,
)


def take(SharedState shared, int columns):
    """Take all records out of the ring.

    columns : number of recorded signals

    Returns (rows, sent, before, others):

    rows : float64 array (n, 2 + columns): tick, lateness in s, recorded signals
    sent : uint8 array (m, bytes of a struct Frame) of the sent frames; bytes beyond the length of a frame are 0
    before : int64 array (m,) of the number of these rows before each frame
    others : [(kind, payload in bytes)] of the events and changes
    """
    cdef SharedLayout *layout = shared.layout
    cdef uint64_t head = load_u64(&layout.head)
    cdef uint64_t place = shared.cursor
    cdef int64_t row_count = 0
    cdef int64_t sent_count = 0
    cdef Header header
    cdef char *payload
    cdef int length
    cdef Frame *frames_out
    cdef double *rows_out
    cdef int64_t *before_out
    while place != head:
        if not read_header(layout, place, head, &header):
            raise damaged(place)
        row_count += header.kind == ROW
        sent_count += header.kind == FRAME
        place += sizeof(Header) + header.bytes
    rows = np.empty((row_count, 2 + columns))
    sent = np.empty((sent_count, sizeof(Frame)), dtype=np.uint8)
    before = np.empty(sent_count, dtype=np.int64)
    rows_out, frames_out = <double *><uintptr_t>rows.ctypes.data, <Frame *><uintptr_t>sent.ctypes.data
    before_out = <int64_t *><uintptr_t>before.ctypes.data
    row_count = sent_count = 0
    others = []
    place = shared.cursor
    while place != head:
        if not read_header(layout, place, head, &header):
            raise damaged(place)
        payload = <char *>record_at(layout, place) + sizeof(Header)
        if header.kind == ROW:
            if header.bytes != 8 * <uint64_t>(2 + columns) or row_count == len(rows):
                raise ValueError("a row has %d bytes, not %d" % (header.bytes, 8 * (2 + columns)))
            memcpy(rows_out + row_count * (2 + columns), payload, header.bytes)
            row_count += 1
        elif header.kind == FRAME:
            if header.bytes != sizeof(Frame) or sent_count == len(sent):
                raise damaged(place)
            memcpy(&frames_out[sent_count], payload, sizeof(Frame))
            if frames_out[sent_count].sent != 0:
                length = min(frames_out[sent_count].length, <uint8_t>FRAME_BYTES)
                memset(frames_out[sent_count].data + length, 0, FRAME_BYTES - length)
                before_out[sent_count] = row_count
                sent_count += 1
        elif header.kind != PADDING and header.kind != RECEIVED:
            others.append((header.kind, payload[:header.bytes]))
        place += sizeof(Header) + header.bytes
    shared.cursor = place
    store_u64(&layout.tail, place)
    return rows, sent[:sent_count], before[:sent_count], others

# cython: freethreading_compatible=True
"""Newest row of a run, for a program beside it, with the extremes of the rows and the traffic of the buses before it. It
takes nothing out of the ring, and the run does not wait for it.

What was read of a record is valid if afterwards the ring's head is less than half of the ring past it: the head moves
with each record, and the space of a record is written again after a whole ring (a seqlock, with the head as its number).
"""

import numpy as np

from libc.stdint cimport int64_t, uint32_t, uint64_t
from libc.string cimport memcpy

from cpython.bytes cimport PyBytes_FromStringAndSize

from cext.abi cimport FRAME_BYTES, Frame
from cext.atomics cimport fence_acquire, load_u64
from cext.bus.bits cimport bits_of
from cext.memory.shared_state cimport FRAME, ROW, Header, SharedLayout, SharedState, own, read_header, record_at

cdef enum:
    ATTEMPTS = 8                # the head moves on while the rows are read


cdef class NewestRow:
    """Reader of the newest row.

    shared : SharedState of the run
    columns : number of its recorded signals
    buses : for each bus whose frames are counted, nominal bitrate / data bitrate of a CAN bus; 0: its bits are not

    values : float64 array (columns,) of the newest row that `look` has found
    first, second : float64 arrays (columns,), smallest and largest value of the rows since the `look` before, in the
        order of time; NaN is none of them
    traffic : float64 array (buses, 3): frames received, frames sent, and the bits of the nominal bitrate that both last
    keeps : whether `rows` is filled
    rows : rows since the `look` before, each as bytes: its tick, its lateness, and the signals
    """

    cdef SharedState shared
    cdef uint64_t cursor
    cdef uint32_t size          # bytes of a row
    cdef readonly object values, first, second, traffic
    cdef double[:] row, low, high
    cdef double[:] earlier, later  # of low and high
    cdef int64_t[:] low_at, high_at
    cdef double[:, :] counts   # of the traffic
    cdef double[:] ratios       # of each bus
    cdef readonly int64_t tick  # tick of that row; -1 before the first
    cdef public bint keeps
    cdef readonly list rows
    cdef double kept            # tick of the newest of them

    def __init__(self, SharedState shared, int columns, buses=()):
        self.shared, self.size, self.tick = shared, 8 * (2 + columns), -1
        row = np.full(2 + columns, np.nan)
        self.row, self.values = row, row[2:]
        self.first, self.second = np.full(columns, np.nan), np.full(columns, np.nan)
        self.earlier, self.later = self.first, self.second
        self.low, self.high = np.empty(columns), np.empty(columns)
        self.low_at, self.high_at = np.zeros(columns, np.int64), np.zeros(columns, np.int64)
        self.traffic = np.zeros((len(buses), 3))
        self.counts, self.ratios = self.traffic, np.array(buses, np.float64)
        self.rows, self.kept = [], -1.0
        self.cursor = load_u64(&shared.layout.tail)

    cdef bint intact(self, uint64_t place) noexcept:
        """Return whether what was read of a record is valid."""
        fence_acquire()
        return load_u64(&self.shared.layout.head) - place <= own(self.shared.layout).capacity // 2

    cdef void fold(self, int64_t number) noexcept:
        """Take the row into the extremes. number : of the row, 0 for the first one"""
        cdef Py_ssize_t index
        cdef double value
        for index in range(self.low.shape[0]):
            value = self.row[2 + index]
            if number == 0 or value < self.low[index] or self.low[index] != self.low[index]:
                self.low[index], self.low_at[index] = value, number
            if number == 0 or value > self.high[index] or self.high[index] != self.high[index]:
                self.high[index], self.high_at[index] = value, number

    cdef void count(self, const Frame *frame) noexcept:
        """Take a frame into the traffic."""
        if frame.bus < self.counts.shape[0] and frame.length <= FRAME_BYTES:
            self.counts[frame.bus, frame.sent != 0] += 1
            if self.ratios[frame.bus]:
                self.counts[frame.bus, 2] += bits_of(frame, self.ratios[frame.bus])

    def look(self) -> bool:
        """Read the newest row, and those before it. Returns whether it is newer than the one before."""
        cdef SharedLayout *layout = self.shared.layout
        cdef uint64_t head, place
        cdef int64_t count
        cdef Header header
        cdef Frame frame
        cdef Py_ssize_t index
        self.rows = []
        for _ in range(ATTEMPTS):
            if not self.intact(self.cursor):
                self.cursor = max(self.cursor, load_u64(&layout.tail))     # the rows between are lost to this reader
            place, count = self.cursor, 0
            head = load_u64(&layout.head)
            while place < head:
                if not read_header(layout, place, head, &header) or not self.intact(place):
                    break
                if header.kind == ROW and header.bytes == self.size:
                    memcpy(&self.row[0], <char *>record_at(layout, place) + sizeof(Header), self.size)
                    if not self.intact(place):
                        break
                    self.fold(count)
                    count += 1
                    if self.keeps and self.row[0] > self.kept:  # an attempt may read it again
                        self.rows.append(PyBytes_FromStringAndSize(<char *>&self.row[0], self.size))
                        self.kept = self.row[0]
                elif header.kind == FRAME and header.bytes == sizeof(Frame) and self.counts.shape[0]:
                    frame = (<Frame *>(<char *>record_at(layout, place) + sizeof(Header)))[0]
                    if not self.intact(place):
                        break
                    self.count(&frame)
                place += sizeof(Header) + header.bytes
            if place < head:
                self.cursor = load_u64(&layout.tail)
                continue
            self.cursor = place
            if count == 0:
                return False
            self.tick = <int64_t>self.row[0]
            for index in range(self.low.shape[0]):
                if self.low_at[index] <= self.high_at[index]:
                    self.earlier[index], self.later[index] = self.low[index], self.high[index]
                else:
                    self.earlier[index], self.later[index] = self.high[index], self.low[index]
            return True
        return False

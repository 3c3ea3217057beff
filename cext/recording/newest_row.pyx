# cython: freethreading_compatible=True
"""Newest row of a run, for a program beside it. It takes nothing out of the ring, and the run does not wait for it.

A record may be overwritten once the ring's tail, which the recorder moves, has passed it: what was read before the tail
is read is valid if the tail has not passed it (a seqlock, with the tail as its number).
"""

import numpy as np

from libc.stdint cimport int64_t, uint32_t, uint64_t, uintptr_t
from libc.string cimport memcpy

from cext.atomics cimport fence_acquire, load_u64
from cext.memory.shared_state cimport ROW, Header, SharedLayout, SharedState, read_header, record_at

cdef enum:
    ATTEMPTS = 8                # a recorder that keeps up frees records twice a second


cdef class NewestRow:
    """Reader of the newest row.

    shared : SharedState of the run
    columns : number of its recorded signals

    values : float64 array (columns,) of the newest row that `look` has found
    """

    cdef SharedState shared
    cdef uint64_t cursor
    cdef uint32_t size          # bytes of a row
    cdef readonly object values
    cdef double[:] row
    cdef readonly int64_t tick  # tick of that row; -1 before the first

    def __init__(self, SharedState shared, int columns):
        self.shared, self.size, self.tick = shared, 8 * (2 + columns), -1
        row = np.full(2 + columns, np.nan)
        self.row, self.values = row, row[2:]
        self.cursor = load_u64(&shared.layout.tail)

    def look(self) -> bool:
        """Read the newest row. Returns whether it is newer than the one before."""
        cdef SharedLayout *layout = self.shared.layout
        cdef uint64_t head, place, found
        cdef Header header
        cdef bint any, valid
        cdef int attempt
        for attempt in range(ATTEMPTS):
            place = max(self.cursor, load_u64(&layout.tail))
            head = load_u64(&layout.head)
            found, any = 0, False
            while place < head:
                valid = read_header(layout, place, head, &header)
                fence_acquire()
                if load_u64(&layout.tail) > place or not valid:
                    break                                          # overwritten, perhaps
                if header.kind == ROW and header.bytes == self.size:
                    found, any = place, True
                place += sizeof(Header) + header.bytes
            if place < head:
                self.cursor = load_u64(&layout.tail)
                continue
            self.cursor = place
            if not any:
                return False
            memcpy(&self.row[0], <char *>record_at(layout, found) + sizeof(Header), self.size)
            fence_acquire()
            if load_u64(&layout.tail) <= found:
                self.tick = <int64_t>self.row[0]
                return True
        return False

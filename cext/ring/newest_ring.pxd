"""A ring of frames between two threads in which the newest wins: one writes and never waits, one reads what it has kept.

A tick may stand still for longer than the ring lasts. Then the oldest frames are written over, the reader skips them and counts them, and the
first frame behind them is marked GAP. Nobody locks: the writer claims a place before it writes there, and the reader, after it has copied a
frame, looks whether the place has been claimed anew meanwhile (a seqlock a place; Boehm, "Can seqlocks get along with programming language
memory models?", 2012).
"""

from libc.stdint cimport uint64_t

from cext.abi cimport Frame
from cext.atomics cimport fence_acquire, fence_release, load_u64, store_u64

cdef enum:
    NEWEST = 1024               # frames of a ring, a power of two
    AHEAD = 128                 # kept free in front of a writer that has gone round, so that it does not catch up at once

cdef enum: # flags of a frame from a ring
    GAP = 1                     # frames before this one were lost
    START = 2                   # the first of what one read has brought: of a datagram, its beginning

cdef struct NewestRing:
    uint64_t claimed            # frames that the writer has begun;
    uint64_t head               # and finished
    uint64_t spare[6]           # keeps the two ends on cache lines of their own
    uint64_t tail               # frames that the reader has taken or skipped,
    uint64_t skipped            # and those of them that it never saw
    uint64_t more[6]
    Frame frames[NEWEST]


cdef inline void push(NewestRing *ring, const Frame *frame) noexcept nogil:
    cdef uint64_t head = ring.head
    store_u64(&ring.claimed, head + 1)
    fence_release()
    ring.frames[head % NEWEST] = frame[0]
    store_u64(&ring.head, head + 1)


cdef inline bint pull(NewestRing *ring, Frame *frame) noexcept nogil:
    """The oldest frame that is left; False if there is none."""
    cdef uint64_t head = load_u64(&ring.head)
    cdef uint64_t tail = ring.tail
    cdef bint gap = False
    cdef int rounds
    for rounds in range(8):                         # a writer that is faster than this is not to hold up a tick
        if head - tail > <uint64_t>NEWEST:
            ring.skipped += head - NEWEST + AHEAD - tail
            tail = head - NEWEST + AHEAD
            gap = True
        if tail == head:
            break
        frame[0] = ring.frames[tail % NEWEST]
        fence_acquire()
        if load_u64(&ring.claimed) - tail <= <uint64_t>NEWEST:
            ring.tail = tail + 1
            if gap:
                frame.flags |= GAP
            return True
        head = load_u64(&ring.claimed)              # what was copied is torn: nothing up to here is left
    ring.tail = tail
    return False


cdef inline void forget(NewestRing *ring) noexcept nogil:
    """Take everything that is there, unread."""
    ring.tail = load_u64(&ring.head)

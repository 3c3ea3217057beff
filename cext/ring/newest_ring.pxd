"""Ring of frames between two threads that keeps the newest: one thread writes without waiting, one reads.

If the reader stalls for longer than the ring lasts, the writer overwrites the oldest frames; the reader skips and
counts them, and marks the next frame with GAP. There are no locks: the writer claims a place before it writes, and the
reader checks after copying a frame whether the place was claimed again (a seqlock for each place; Boehm, "Can seqlocks
get along with programming language memory models?", 2012).
"""

from libc.stdint cimport uint64_t

from cext.abi cimport Frame
from cext.atomics cimport fence_acquire, fence_release, load_u64, store_u64

cdef extern from *:
    """
    #include <stddef.h>
    #include <stdint.h>
    /* A frame in the ring may be written while it is read: its words are atomic, so that a torn copy, which the reader
    discards, is not undefined behaviour. */
    typedef uint64_t __attribute__((may_alias)) tw_word;
    static inline void tw_copy_in(void *shared, const void *own, size_t size) {
        for (size_t i = 0; i < size / sizeof(tw_word); i++)
            __atomic_store_n((tw_word *)shared + i, ((const tw_word *)own)[i], __ATOMIC_RELAXED);
    }
    static inline void tw_copy_out(void *own, const void *shared, size_t size) {
        for (size_t i = 0; i < size / sizeof(tw_word); i++)
            ((tw_word *)own)[i] = __atomic_load_n((const tw_word *)shared + i, __ATOMIC_RELAXED);
    }
    """
    void copy_in "tw_copy_in"(void *shared, const void *own, size_t size) noexcept nogil
    void copy_out "tw_copy_out"(void *own, const void *shared, size_t size) noexcept nogil

cdef enum:
    NEWEST = 1024               # frames of a ring, a power of two
    # places kept free in front of the writer after a skip, so that it does not catch up at once
    AHEAD = 128

cdef enum: # flags of a frame from a ring
    GAP = 1                     # frames before this one were lost
    START = 2                   # first frame of a read, such as the start of a datagram

cdef struct NewestRing:
    uint64_t claimed            # frames begun by the writer
    uint64_t head               # frames finished by the writer
    uint64_t spare[6]           # keeps both ends on separate cache lines
    uint64_t tail               # frames taken or skipped by the reader
    uint64_t skipped            # frames skipped by the reader
    uint64_t more[6]
    Frame frames[NEWEST]


cdef inline void push(NewestRing *ring, const Frame *frame) noexcept nogil:
    cdef uint64_t head = ring.head
    store_u64(&ring.claimed, head + 1)
    fence_release()
    copy_in(&ring.frames[head % NEWEST], frame, sizeof(Frame))
    store_u64(&ring.head, head + 1)


cdef inline bint pull(NewestRing *ring, Frame *frame) noexcept nogil:
    """Take the oldest remaining frame; False if there is none."""
    cdef uint64_t head = load_u64(&ring.head)
    cdef uint64_t tail = ring.tail
    cdef bint gap = False
    cdef int rounds
    for rounds in range(8):                         # limit for a writer that is faster than the reader
        if head - tail > <uint64_t>NEWEST:
            ring.skipped += head - NEWEST + AHEAD - tail
            tail = head - NEWEST + AHEAD
            gap = True
        if tail == head:
            break
        copy_out(frame, &ring.frames[tail % NEWEST], sizeof(Frame))
        fence_acquire()
        if load_u64(&ring.claimed) - tail <= <uint64_t>NEWEST:
            ring.tail = tail + 1
            if gap:
                frame.flags |= GAP
            return True
        head = load_u64(&ring.claimed)              # the copy is torn: nothing before this remains
    ring.tail = tail
    return False


cdef inline void forget(NewestRing *ring) noexcept nogil:
    """Discard all frames."""
    ring.tail = load_u64(&ring.head)

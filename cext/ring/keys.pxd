"""Keys of the run's terminal: the control process reads them, and the recorder carries out their commands.

A stop does not pass through here: the reader of the terminal sets it at once.
"""

from libc.stdint cimport int32_t, int64_t, uint32_t, uint64_t

from cext.atomics cimport load_u64, store_u64

cdef enum:
    KEYS = 512                  # a power of two

cdef struct Key:
    int64_t since               # ns of CLOCK_MONOTONIC: the key was pressed after it
    int64_t read                # ns of CLOCK_MONOTONIC
    uint32_t question           # number of the newest question to the operator before the key was pressed
    uint32_t byte               # byte of the sequence that the terminal sends for the key

cdef struct KeyRing:
    uint64_t head               # bytes written, in total; owned by the control process
    uint64_t lost               # bytes that found a full ring
    int32_t listening           # whether the control process reads the terminal
    uint64_t spare[5]           # keeps both ends on separate cache lines
    uint64_t tail               # bytes taken, in total; owned by the recorder
    uint64_t more[7]
    Key keys[KEYS]

cdef inline void put_key(KeyRing *ring, const Key *key) noexcept nogil:
    cdef uint64_t head = ring.head
    if head - load_u64(&ring.tail) >= <uint64_t>KEYS:
        ring.lost += 1
        return
    ring.keys[head % KEYS] = key[0]
    store_u64(&ring.head, head + 1)

cdef inline bint get_key(KeyRing *ring, Key *key) noexcept nogil:
    cdef uint64_t tail = ring.tail
    if tail == load_u64(&ring.head):
        return False
    key[0] = ring.keys[tail % KEYS]
    store_u64(&ring.tail, tail + 1)
    return True

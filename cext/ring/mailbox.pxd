"""Mailbox in the shared state: requests of other processes to a run, which its loop takes at the start of a tick.

Any number of processes write, one loop reads, and none of them waits. The `state` of a letter has its step in the lower
half and the ID of the writing process in the upper half:

    FREE      not in use
    WRITING   owned by a writer
    POSTED    complete: the loop takes it, or its writer withdraws it
    READING   owned by the loop
    ANSWERED  with the result, for the writer to read and to free

A writer that dies leaves a letter in WRITING or ANSWERED: the next writer without a free letter frees it. An idle loop
reads only `posted`.
"""

from libc.stdint cimport int32_t, int64_t, uint32_t, uint64_t

from cext.atomics cimport load_u64

cdef enum:
    LETTERS = 32
    CHANGES = 16                # in one letter: they take effect in one tick, all or none

cdef enum: # step of a letter
    FREE = 0
    WRITING = 1
    POSTED = 2
    READING = 3
    ANSWERED = 4

cdef enum: # kind of a letter
    SET = 0
    MARK = 1
    STOP = 2
    CONFIRM = 3                 # arm a robot that is ready
    REARM = 4                   # arm again after a fault

cdef enum: # writer of a letter
    BY_SET = 0                  # `python -m runtime set`
    BY_KEYS = 1                 # the keys of the run's own terminal
    BY_REPLAY = 2               # a recording

cdef enum: # answers
    TAKEN = 0
    OUT_OF_BOUNDS = 1           # a value is outside its bounds, not finite, or of another type: nothing was changed
    UNKNOWN = 2                 # no such parameter or kind: nothing was changed
    OVER = 3                    # the run has ended
    NOT_NOW = 4                 # the run does not wait for it, or its condition is not met: nothing was done

cdef struct Letter:
    uint64_t state              # step | process << 32
    uint64_t number             # of posting, the order of processing
    int32_t kind
    int32_t origin
    int32_t count               # of changes
    int32_t answer
    int32_t[CHANGES] parameters
    double[CHANGES] values
    int64_t tick                # at the start of which it took effect
    int64_t mark                # number of the mark

cdef struct Mailbox:
    uint64_t posted             # incremented when a letter becomes POSTED
    uint64_t numbers
    Letter[LETTERS] letters

cdef struct Change:             # a change in effect, for the ring
    int64_t tick
    int32_t kind
    int32_t origin
    int32_t writer              # ID of its process
    int32_t parameter
    double value                # number of the mark, for a mark
    double before
    double slew                 # rate in units per second; infinite for a step

cdef inline uint64_t step_of(uint64_t state) noexcept nogil:
    return <uint32_t>state

cdef inline uint64_t writer_of(uint64_t state) noexcept nogil:
    return state >> 32

cdef inline uint64_t in_step(uint64_t state, uint64_t step) noexcept nogil:
    return state >> 32 << 32 | step

cdef inline Letter *oldest(Mailbox *mailbox, int32_t except_kind) noexcept nogil:
    """Return the waiting letter that was posted first, except those of `except_kind`; or NULL."""
    cdef int index
    cdef Letter *letter
    cdef Letter *found = NULL
    for index in range(LETTERS):
        letter = &mailbox.letters[index]
        if step_of(load_u64(&letter.state)) == POSTED and letter.kind != except_kind and (found == NULL
                or letter.number < found.number):
            found = letter
    return found

"""The mailbox in the shared page: what other processes ask of a run, for its loop to take at the start of a tick.

Any number of processes write, one loop reads, and nobody waits for anybody. A letter's `state` is its step in this round, with
the process that writes it in the upper half:

    FREE      nobody's
    WRITING   a writer's own
    POSTED    complete: the loop takes it, or its writer withdraws it
    READING   the loop's
    ANSWERED  with what became of it, for the writer to read and to free

A writer that has died leaves a letter in WRITING or ANSWERED: the next one that finds no other frees it. An idle loop looks at
`posted` and nothing else.
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
    CONFIRM = 3                 # arm, of a robot that is ready
    REARM = 4                   # arm again, after a fault

cdef enum: # who wrote it
    BY_SET = 0                  # `python -m runtime set`
    BY_KEYS = 1                 # the keys of the run's own terminal
    BY_REPLAY = 2               # nobody: a recording has it

cdef enum: # answers
    TAKEN = 0
    OUT_OF_BOUNDS = 1           # a value is outside its bounds, not finite, or not of its type: nothing was changed
    UNKNOWN = 2                 # there is no such parameter or kind: nothing was changed
    OVER = 3                    # the run has ended before
    NOT_NOW = 4                 # nothing waits for it, or what the run waits for is not there: nothing was done

cdef struct Letter:
    uint64_t state              # step | process << 32
    uint64_t number             # of posting: the order in which letters are taken
    int32_t kind
    int32_t origin
    int32_t count               # of changes
    int32_t answer
    int32_t[CHANGES] parameters
    double[CHANGES] values
    int64_t tick                # at whose start it took effect
    int64_t mark                # number of the mark

cdef struct Mailbox:
    uint64_t posted             # grows when a letter has become POSTED
    uint64_t numbers
    Letter[LETTERS] letters

cdef struct Change:             # what has taken effect, as the ring has it
    int64_t tick
    int32_t kind
    int32_t origin
    int32_t writer              # its process
    int32_t parameter
    double value                # of a mark, its number
    double before
    double slew                 # unit per second with which it goes there; infinite for at once

cdef inline uint64_t step_of(uint64_t state) noexcept nogil:
    return <uint32_t>state

cdef inline uint64_t writer_of(uint64_t state) noexcept nogil:
    return state >> 32

cdef inline uint64_t in_step(uint64_t state, uint64_t step) noexcept nogil:
    return state >> 32 << 32 | step

cdef inline Letter *oldest(Mailbox *mailbox, int32_t but) noexcept nogil:
    """The letter posted first of those that wait, those of the kind `but` left out; or NULL."""
    cdef int index
    cdef Letter *letter
    cdef Letter *found = NULL
    for index in range(LETTERS):
        letter = &mailbox.letters[index]
        if step_of(load_u64(&letter.state)) == POSTED and letter.kind != but and (found == NULL or letter.number < found.number):
            found = letter
    return found

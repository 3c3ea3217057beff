"""Mailbox in the shared state: requests of other processes to a run, which its loop takes at the start of a tick.

Any number of processes write, one loop reads, and none of them waits. A letter is used in these steps:

    FREE      not in use
    WRITING   owned by a writer
    POSTED    complete: the loop takes it, or its writer withdraws it
    READING   owned by the loop
    ANSWERED  with the result, for the writer to read and to free

Its `state` has the step in the lowest byte, then the number of its use, and in the upper half the ID of the writing
process. A letter changes hands only by a compare-and-swap of the whole word, so that one that was withdrawn and posted
again is not taken for the one before. The loop copies a letter after the swap and uses only the copy, since a defective
process may change the letter at any time.

A writer that dies leaves a letter in WRITING or ANSWERED: the next writer without a free letter frees it. An idle loop
reads only `posted`.

A stop and the confirmations of the operator are not letters: cext.ring.operator.
"""

from libc.stdint cimport int32_t, int64_t, uint64_t

from cext.atomics cimport load_u64, store_u64, swap

cdef enum:
    LETTERS = 32
    CHANGES = 16                # in one letter: they take effect in one tick, all or none

cdef enum: # step of a letter
    FREE = 0
    WRITING = 1
    POSTED = 2
    READING = 3
    ANSWERED = 4

cdef enum: # kind of a request; only the first two are letters
    SET = 0
    MARK = 1
    STOP = 2
    CONFIRM = 3                 # arm a robot that is ready
    REARM = 4                   # arm again after a fault

cdef enum: # origin of a request
    BY_SET = 0                  # `python -m runtime set`
    BY_KEYS = 1                 # the keys of the run's own terminal
    BY_REPLAY = 2               # a recording
    BY_PANEL = 3                # a page of the panel

cdef enum: # answers
    TAKEN = 0
    OUT_OF_BOUNDS = 1           # a value is outside its bounds, not finite, or of another type: nothing was changed
    UNKNOWN = 2                 # no such parameter or kind: nothing was changed
    OVER = 3                    # the run has ended
    AGAINST_RULE = 4            # the values break a rule between parameters: nothing was changed

cdef struct Letter:
    uint64_t state              # step | number of its use << 8 | process << 32
    uint64_t number             # number of the posting, the order of processing
    int32_t kind
    int32_t origin
    int32_t count               # number of changes
    int32_t answer
    int32_t[CHANGES] parameters
    double[CHANGES] values
    int64_t tick                # at the start of which it took effect
    int64_t mark                # number of the mark
    int32_t writer              # as in Change

cdef struct Mailbox:
    uint64_t posted             # incremented when a letter becomes POSTED
    uint64_t numbers
    Letter[LETTERS] letters

cdef struct Change:             # a request that has taken effect, for the ring
    int64_t tick
    int32_t kind
    int32_t origin
    int32_t writer              # ID of its process, or number of the page of a panel
    int32_t parameter
    double value                # number of the mark, for a mark
    double before
    double slew                 # rate in units per second; infinite for a step

cdef inline uint64_t step_of(uint64_t state) noexcept nogil:
    return state & 0xFF

cdef inline uint64_t writer_of(uint64_t state) noexcept nogil:
    return state >> 32

cdef inline uint64_t in_step(uint64_t state, uint64_t step) noexcept nogil:
    return state >> 8 << 8 | step

cdef inline uint64_t claimed(uint64_t state, uint64_t process) noexcept nogil:
    """Return the word of the next use of a letter, by a process that writes it. state : its word before"""
    cdef uint64_t use = ((state >> 8) + 1) % (1 << 24)
    return process << 32 | use << 8 | WRITING

cdef inline Letter *oldest(Mailbox *mailbox, uint64_t *state) noexcept nogil:
    """Return the posted letter with the lowest number and its word, or NULL."""
    cdef int index
    cdef uint64_t found_state
    cdef Letter *letter
    cdef Letter *found = NULL
    for index in range(LETTERS):
        letter = &mailbox.letters[index]
        found_state = load_u64(&letter.state)
        if step_of(found_state) == POSTED and (found == NULL or letter.number < found.number):
            found, state[0] = letter, found_state
    return found

cdef inline Letter *take_oldest(Mailbox *mailbox, Letter *copy) noexcept nogil:
    """Take the letter that was posted first, and copy it, with its word as it was posted. Returns NULL if none waits."""
    cdef Letter *letter
    cdef uint64_t state = 0
    cdef int rounds
    for rounds in range(LETTERS):           # a writer may withdraw the letter meanwhile
        letter = oldest(mailbox, &state)
        if letter == NULL:
            return NULL
        if swap(&letter.state, state, in_step(state, READING)):
            copy[0] = letter[0]
            copy.state = state
            return letter
    return NULL

cdef inline void answer(Letter *letter, const Letter *copy, int32_t verdict, int64_t tick, int64_t mark) noexcept nogil:
    """Answer a letter of `take_oldest`."""
    letter.answer, letter.tick, letter.mark = verdict, tick, mark
    store_u64(&letter.state, in_step(copy.state, ANSWERED))

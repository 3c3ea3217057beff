# cython: freethreading_compatible=True
"""Writer side of the mailbox. Values are not checked here but by the loop."""

import os

from libc.stdint cimport uint64_t

from cext.atomics cimport count_up, load_u64, store_u64, swap
from cext.ring.mailbox cimport (
    ANSWERED, BY_KEYS, BY_SET, CHANGES, CONFIRM, FREE, LETTERS, MARK, NOT_NOW, OUT_OF_BOUNDS, OVER, POSTED, REARM, SET,
    STOP, TAKEN, UNKNOWN,
    WRITING, Letter, Mailbox, step_of, writer_of,
)
from cext.safety.shared_state cimport SharedState

ORIGINS = {"set": BY_SET, "keys": BY_KEYS}
ANSWERS = {TAKEN: "taken", OUT_OF_BOUNDS: "out of bounds", UNKNOWN: "unknown", OVER: "over", NOT_NOW: "not now"}
CHANGE_LIMIT = CHANGES


cdef class Writer:
    """Writer to the mailbox of a run.

    page : cext.safety.shared_state.SharedState
    origin : "set" or "keys"

    `set` and the others return a ticket, or None while the mailbox is full. The letter of a ticket belongs to the
    writer until `answer` has returned its answer, or `withdraw` has taken it back.
    """

    cdef SharedState page
    cdef Mailbox *mailbox
    cdef int origin

    def __init__(self, SharedState page, str origin="set"):
        self.page, self.mailbox, self.origin = page, &page.layout.mailbox, ORIGINS[origin]

    def set(self, changes) -> int | None:
        """Set parameters.

        changes : at most CHANGE_LIMIT pairs (index of the parameter, value), which take effect in one tick, all or none
        """
        if len(changes) > CHANGES:
            raise ValueError("a request has at most %d changes, not %d" % (CHANGES, len(changes)))
        return self.post(SET, changes)

    def mark(self) -> int | None:
        """Set a mark in the recording."""
        return self.post(MARK, ())

    def stop(self) -> int | None:
        """Stop the run."""
        return self.post(STOP, ())

    def confirm(self) -> int | None:
        """Arm a robot that is ready."""
        return self.post(CONFIRM, ())

    def rearm(self) -> int | None:
        """Arm again after a fault."""
        return self.post(REARM, ())

    cdef object post(self, int kind, changes):
        cdef uint64_t mine = <uint64_t>os.getpid() << 32
        cdef int index = self.claim(mine | WRITING)
        cdef Letter *letter
        if index < 0:
            return None
        letter = &self.mailbox.letters[index]
        letter.kind, letter.origin, letter.count = kind, self.origin, len(changes)
        for position, (parameter, value) in enumerate(changes):
            letter.parameters[position], letter.values[position] = parameter, value
        letter.number = count_up(&self.mailbox.numbers)
        store_u64(&letter.state, mine | POSTED)
        count_up(&self.mailbox.posted)
        return index

    cdef int claim(self, uint64_t state):
        """Claim a letter and set its `state`. Returns its index; -1 if there is none."""
        cdef int index
        cdef uint64_t found
        cdef uint64_t *place
        for index in range(LETTERS):
            if swap(&self.mailbox.letters[index].state, FREE, state):
                return index
        for index in range(LETTERS):
            place = &self.mailbox.letters[index].state
            found = load_u64(place)
            if step_of(found) in (WRITING, ANSWERED) and not alive(writer_of(found)) and swap(place, found, state):
                return index
        return -1

    def answer(self, int ticket) -> tuple[str, int, int] | None:
        """Return None while the letter waits, else (one of ANSWERS, tick, number of the mark), which ends the
        ticket.
        """
        cdef Letter *letter = &self.mailbox.letters[ticket]
        if step_of(load_u64(&letter.state)) != ANSWERED:
            return None
        answer = ANSWERS[letter.answer], letter.tick, letter.mark
        store_u64(&letter.state, FREE)
        return answer

    def withdraw(self, int ticket) -> bool:
        """Take back a waiting letter, which ends the ticket. Returns False if the loop has taken it."""
        cdef Letter *letter = &self.mailbox.letters[ticket]
        cdef uint64_t mine = <uint64_t>os.getpid() << 32
        return swap(&letter.state, mine | POSTED, FREE)


cdef bint alive(uint64_t process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True

# cython: freethreading_compatible=True
"""Writer side of the mailbox, and of the requests of the operator. Values are not checked here but by the loop."""

import os
import time

from libc.stdint cimport int32_t, int64_t, uint64_t

from cext.atomics cimport count_up, load_u64, store_u64, swap
from cext.ring.mailbox cimport (
    AGAINST_RULE, ANSWERED, CHANGES, FREE, LETTERS, MARK, OUT_OF_BOUNDS, OVER, POSTED, SET, TAKEN, UNKNOWN, WRITING,
    Letter, Mailbox, claimed, in_step, step_of, writer_of,
)
from cext.ring.operator cimport ask_to_stop, consent_to
from cext.memory.shared_state cimport SharedState

from cext.memory.shared_state import ORIGINS

ANSWERS = {
    TAKEN: "taken", OUT_OF_BOUNDS: "out of bounds", UNKNOWN: "unknown", OVER: "over", AGAINST_RULE: "against a rule"}
CHANGE_LIMIT = CHANGES


cdef class Writer:
    """Writer to a run: changes and marks through its mailbox, and the requests of the operator beside it.

    shared : cext.memory.shared_state.SharedState
    origin : "set", "keys" or "panel"

    `set` and `mark` return a ticket, or None while the mailbox is full. The letter of a ticket belongs to the writer
    until `answer` has returned its answer, or `withdraw` has taken it back. `page` is the number of the page of a panel
    that has asked, for the recording.
    """

    cdef SharedState shared
    cdef Mailbox *mailbox
    cdef int origin
    cdef uint64_t[LETTERS] mine          # words of the letters of this writer, as it posted them

    def __init__(self, SharedState shared, str origin="set"):
        self.shared, self.mailbox, self.origin = shared, &shared.layout.mailbox, ORIGINS[origin]

    def stop(self, int32_t page=0) -> bool:
        """Stop the run. Waits for nothing, and cannot be withdrawn. Returns False if a stop was requested before."""
        return ask_to_stop(&self.shared.layout.operator, self.origin, page or os.getpid())

    def confirm(self, uint64_t question, pressed=None) -> None:
        """Confirm that a robot may be armed, or again after a fault.

        question : SharedState.question, as it was when the operator was asked
        pressed : ns of CLOCK_MONOTONIC, when the operator answered; None for now

        The loop ignores it if it has asked another question since, or if the answer is older than CONSENT_LIMIT.
        """
        consent_to(&self.shared.layout.operator, question, self.origin, os.getpid(),
            <int64_t>(time.monotonic_ns() if pressed is None else pressed))

    def set(self, changes, int32_t page=0) -> int | None:
        """Set parameters.

        changes : at most CHANGE_LIMIT pairs (index of the parameter, value), which take effect in one tick, all or none
        """
        if len(changes) > CHANGES:
            raise ValueError("a request has at most %d changes, not %d" % (CHANGES, len(changes)))
        return self.post(SET, changes, page)

    def mark(self, int32_t page=0) -> int | None:
        """Set a mark in the recording."""
        return self.post(MARK, (), page)

    cdef object post(self, int kind, changes, int32_t page):
        cdef int index = self.claim(os.getpid())
        cdef Letter *letter
        if index < 0:
            return None
        letter = &self.mailbox.letters[index]
        letter.kind, letter.origin, letter.count = kind, self.origin, len(changes)
        letter.writer = page or os.getpid()
        for position, (parameter, value) in enumerate(changes):
            letter.parameters[position], letter.values[position] = parameter, value
        letter.number = count_up(&self.mailbox.numbers)
        store_u64(&letter.state, self.mine[index])
        count_up(&self.mailbox.posted)
        return index

    cdef int claim(self, uint64_t process):
        """Claim a letter, and keep its word as it will be posted. Returns its index; -1 if there is none."""
        cdef int index
        cdef uint64_t found, ours
        cdef bint dead
        for dead in (False, True):
            for index in range(LETTERS):
                found = load_u64(&self.mailbox.letters[index].state)
                if step_of(found) != FREE and not (
                        dead and step_of(found) in (WRITING, ANSWERED) and not alive(writer_of(found))):
                    continue
                ours = claimed(found, process)
                if swap(&self.mailbox.letters[index].state, found, ours):
                    self.mine[index] = in_step(ours, POSTED)
                    return index
        return -1

    def answer(self, int ticket) -> tuple[str, int, int] | None:
        """Return None while the letter waits, else (one of ANSWERS, tick, number of the mark), which ends the
        ticket.
        """
        cdef Letter *letter = &self.mailbox.letters[ticket]
        cdef uint64_t answered = in_step(self.mine[ticket], ANSWERED)
        if load_u64(&letter.state) != answered:
            return None
        answer = ANSWERS.get(letter.answer, "unknown"), letter.tick, letter.mark
        swap(&letter.state, answered, in_step(answered, FREE))
        return answer

    def withdraw(self, int ticket) -> bool:
        """Take back a waiting letter, which ends the ticket. Returns False if the loop has taken it."""
        cdef uint64_t posted = self.mine[ticket]
        return swap(&self.mailbox.letters[ticket].state, posted, in_step(posted, FREE))


cdef bint alive(uint64_t process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True

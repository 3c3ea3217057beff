cimport cython
from libc.stdint cimport int64_t, uint32_t

from cext.abi cimport Frame
from cext.safety.reply_field cimport PATTERN_LIMIT, Field, Pattern

cdef enum Phase:
    SENDING                      # every round is sent
    WAITING                      # a round was sent, and its replies may take longer than a round
    LISTENING                    # nothing is sent, and nothing may be received

@cython.final
cdef class StopConfirmation:
    cdef Pattern replies[PATTERN_LIMIT]
    cdef Pattern unasked[PATTERN_LIMIT]
    cdef int reply_count, unasked_count
    cdef int length              # bytes of a reply, 0 for any
    cdef bint has_torque
    cdef Field torque
    cdef double rest             # largest torque or current at rest, in the unit of the field
    cdef bint has_enabled
    cdef Field enabled           # 0 for a drive that is not enabled
    cdef uint32_t disabled_mask, disabled       # bits of the identifier that report a disabled drive, and their values
    cdef int echo_at, echo       # byte that answers a disable, -1 for none, and its value
    cdef bint reports            # the number of replies says nothing

    cdef Phase phase
    cdef int64_t began           # ns, start of the stop; -1 before
    cdef int64_t transit         # ns that a reply may have been under way when the stop began
    cdef int64_t asked           # ns, newest round
    cdef int64_t window          # ns from a round to its last reply, if longer than a round; else 0
    cdef int64_t until           # ns, end of the present phase
    cdef int64_t listened        # ns, since when it listens
    cdef int64_t last            # ns, newest reply while it listens; -1: none
    cdef int64_t arrived         # ns, newest reply; before the first, the begin
    cdef int64_t gap             # ns, longest time without a reply that ended in the newest round
    cdef int rounds, wanted, seen, source
    cdef bint restless           # a reply since the newest round contradicts the rest
    cdef int rest_count          # consecutive replies at rest
    cdef int64_t rest_since      # ns, first of them
    cdef bint echoed, failed     # one of them answers a disable; the newest reports an error in place of the answer
    cdef readonly bint confirmed
    cdef readonly double newest  # newest torque or current; NaN before the first
    cdef readonly int received   # replies since the begin

    cdef int load(self, reply) except -1
    cdef bint is_at_rest(self, const Frame *frame) noexcept nogil
    cdef bint is_reply(self, const Frame *frame) noexcept nogil
    cdef bint note(self, const Frame *frame) noexcept nogil
    cdef void note_rest(self, const Frame *frame, int source) noexcept nogil
    cdef void judge_answers(self, int64_t now, int64_t round) noexcept nogil
    cpdef void begin(self, int64_t now, int64_t transit=*) noexcept nogil
    cpdef bint may_send(self) noexcept nogil
    cpdef void sent(self, int64_t now, int answers) noexcept nogil
    cpdef bint judge(self, int64_t now, int64_t round) noexcept nogil

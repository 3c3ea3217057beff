"""Requests of the operator that pass by every queue: a stop, and a confirmation.

    stop        0, or the origin and the process of the first request to end the run. Any process sets it at any time; the
                loop reads it in every tick and every round of arming
    question    number of the newest question to the operator: whether to arm a robot that is ready, or again after a fault
    consent     0, or the newest confirmation: the question that it answers, its origin, and when the key was pressed

The loop asks a new question each time it begins to wait, and after each confirmation, whether it arms or is refused.
Whoever shows the question also passes on its number; a confirmation counts only for the newest question, once, if it was
given after the question was asked and CONSENT_LIMIT ago at most. So a key that was pressed before a fault, and is
delivered after it, has no effect.
"""

from libc.stdint cimport int32_t, int64_t, uint64_t

from cext.atomics cimport load_u64, store_u64, swap

cdef enum:
    NO_CONSENT = -1
    QUESTIONS = 1 << 16         # numbers of questions in a consent

cdef struct Operator:
    uint64_t stop               # 1 + origin | process << 32
    uint64_t question
    uint64_t consent            # 1 + origin | question << 8 | ms of CLOCK_MONOTONIC << 24
    uint64_t process            # ID of the process of the newest confirmation, for the recording

cdef inline bint ask_to_stop(Operator *operator, int32_t origin, uint64_t process) noexcept nogil:
    """Request the end of the run. Returns False if it was requested before."""
    return swap(&operator.stop, 0, <uint64_t>(1 + origin) | process << 32)

cdef inline int32_t origin_of_stop(uint64_t stop) noexcept nogil:
    return <int32_t>(stop & 0xFF) - 1

cdef inline uint64_t process_of_stop(uint64_t stop) noexcept nogil:
    return stop >> 32

cdef inline void consent_to(
        Operator *operator, uint64_t question, int32_t origin, uint64_t process, int64_t pressed) noexcept nogil:
    """Answer a question. pressed : ns of CLOCK_MONOTONIC, when the key was pressed"""
    store_u64(&operator.process, process)
    store_u64(&operator.consent,
        <uint64_t>(1 + origin) | question % QUESTIONS << 8 | <uint64_t>(pressed // 1000000) << 24)

cdef inline int32_t take_consent(
        Operator *operator, uint64_t question, int64_t asked, int64_t now, int64_t limit) noexcept nogil:
    """Take the newest confirmation. Returns its origin; NO_CONSENT without one, or if it does not count.

    question : number of the question that it must answer
    asked : ns of CLOCK_MONOTONIC, when that was asked
    limit : ns, greatest age
    """
    cdef uint64_t consent = load_u64(&operator.consent)
    cdef int64_t pressed = <int64_t>(consent >> 24)
    if consent == 0 or not swap(&operator.consent, consent, 0):         # a newer one is taken in the next round
        return NO_CONSENT
    if (consent >> 8) % QUESTIONS != question % QUESTIONS:
        return NO_CONSENT
    if not asked // 1000000 <= pressed <= now // 1000000 or now // 1000000 - pressed > limit // 1000000:
        return NO_CONSENT
    return <int32_t>(consent & 0xFF) - 1

"""Two devices with one id, detected by their replies: more than there were questions.

Principle
    1. A device that only answers sends at most one reply to each frame. A reply without a question is a surplus.
    2. A question is outstanding for TWIN_LATE to twice that time: late replies are not a surplus, and lost ones hide a
       surplus no longer than that.
    3. Each question removes a quarter of a reply from the surplus: single repeated frames have no effect. A surplus of
       TWIN_REPLIES is two devices. From two replies on, arming is not complete.
"""

from libc.stdint cimport int64_t

from cext.safety.thresholds cimport TWIN_LATE, TWIN_REPLIES

cdef struct Twins:
    bint counted                 # whether the device only answers
    int64_t fresh, old           # outstanding questions, since `turned` and before
    int64_t turned               # ns
    double surplus               # replies without a question


cdef inline void forget_twins(Twins *twins, int64_t now, int64_t outstanding) noexcept nogil:
    """Begin to count. outstanding : questions that were not counted, and may still be answered"""
    twins.fresh, twins.old, twins.turned, twins.surplus = outstanding, 0, now, 0.0


cdef inline void note_questions(Twins *twins, int64_t count, int64_t now) noexcept nogil:
    """Note that frames were sent to the device. now : ns"""
    if now - twins.turned >= TWIN_LATE:
        twins.old, twins.fresh, twins.turned = twins.fresh, 0, now
    twins.fresh += count
    twins.surplus = max(twins.surplus - 0.25 * count, 0.0)


cdef inline bint note_answer(Twins *twins) noexcept nogil:
    """Note a reply. Returns whether two devices answer."""
    if twins.old > 0:
        twins.old -= 1
    elif twins.fresh > 0:
        twins.fresh -= 1
    else:
        twins.surplus += 1.0
    return twins.surplus >= TWIN_REPLIES

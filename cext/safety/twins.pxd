"""Two devices with one id, detected by their replies: more than there were questions.

Principle
    1. A device that only answers sends at most one reply to each frame. A reply without a question is a surplus. For a
       device that reports by itself, each `period` is a question, in which it owes one report.
    2. A question is outstanding for TWIN_LATE to twice that time: late replies are not a surplus, and lost ones hide a
       surplus no longer than that.
    3. Each question removes a quarter of a reply from the surplus: single repeated frames, and a clock that is fast by
       less than a quarter, have no effect. A surplus of TWIN_REPLIES is two devices. From two replies on, and before
       TWIN_PERIODS of the reports, arming is not complete; from one on for a drive that obeys without an enable.
    4. Frames from before `since` wait in a queue, and are not counted.
"""

from libc.stdint cimport int64_t

from cext.safety.thresholds cimport TWIN_LATE, TWIN_PERIODS, TWIN_REPLIES

cdef struct Twins:
    bint counted                 # whether its replies show a second device
    int64_t period               # ns between its reports; 0 if it only answers
    bint answers_disable         # whether a device that reports also answers the frames that disable it
    int64_t since, owed          # ns: start of the count, and end of the last period that was counted
    int64_t fresh, old           # outstanding questions, since `turned` and before
    int64_t turned               # ns
    double surplus               # replies without a question


cdef inline void forget_twins(Twins *twins, int64_t now, int64_t outstanding) noexcept nogil:
    """Begin to count. outstanding : questions that were not counted, and may still be answered"""
    twins.fresh, twins.old, twins.turned, twins.surplus = outstanding, 0, now, 0.0
    twins.since = twins.owed = now


cdef inline void note_questions(Twins *twins, int64_t count, int64_t now) noexcept nogil:
    """Note that frames were sent to the device. now : ns"""
    if now - twins.turned >= TWIN_LATE:
        twins.old, twins.fresh, twins.turned = twins.fresh, 0, now
    twins.fresh += count
    twins.surplus = max(twins.surplus - 0.25 * count, 0.0)


cdef inline void expect_reports(Twins *twins, int64_t now) noexcept nogil:
    """Note the reports that are due from a device that sends them by itself. now : ns"""
    cdef int64_t due = (now - twins.owed) // twins.period if twins.period > 0 else 0
    if due > 0:
        twins.owed += due * twins.period
        note_questions(twins, due, now)


cdef inline bint note_answer(Twins *twins, int64_t time) noexcept nogil:
    """Note a reply. Returns whether two devices answer. time : ns, of its arrival"""
    if time < twins.since:
        return False
    if twins.old > 0:
        twins.old -= 1
    elif twins.fresh > 0:
        twins.fresh -= 1
    else:
        twins.surplus += 1.0
    return twins.surplus >= TWIN_REPLIES


cdef inline bint may_be_two(const Twins *twins, bint enabled, int64_t now) noexcept nogil:
    """Return whether arming has to compare more replies.

    enabled : whether the device is enabled by frames, which it also answers
    now : ns
    """
    return twins.surplus >= (2.0 if enabled else 1.0) or now - twins.since < TWIN_PERIODS * twins.period

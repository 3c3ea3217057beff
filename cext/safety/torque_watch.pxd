"""Torque that a drive measures although none is commanded: before arming, while it is taken out, and in a run whose
command is zero.

Principle
    1. A torque counts if it exceeds UNCOMMANDED_TORQUE_LIMIT of the rated torque while the law, of this reply and of the
       previous one, is at most half of that. A drive that is late by a reply therefore does not count.
    2. It is a fault after UNCOMMANDED_TORQUE_TIME and UNCOMMANDED_TORQUE_REPLIES. A quarter of the time in which a reply
       does not count is subtracted, so that an alternating torque is also detected.
"""

from libc.math cimport fabs, fmax, fmin
from libc.stdint cimport int64_t

from cext.safety.thresholds cimport (
    UNCOMMANDED_TORQUE_LIMIT, UNCOMMANDED_TORQUE_REPLIES, UNCOMMANDED_TORQUE_TIME,
)

cdef enum:
    REPLY_INTERVAL_LIMIT = 50000000     # ns between two replies that counts

cdef struct Uncommanded:
    int64_t reply_time                  # ns, time of the newest checked reply; -1: none
    double wanted                       # N·m, the law at that reply
    double time                         # s
    int replies


cdef inline void forget_uncommanded(Uncommanded *u) noexcept nogil:
    u.reply_time = -1
    u.wanted = u.time = 0.0
    u.replies = 0


cdef inline bint is_uncommanded(
        Uncommanded *u, double wanted, double torque, double rated, int64_t reply_time) noexcept nogil:
    """Add a reply. Returns whether the torque is a fault. wanted, torque : N·m, sent and measured; rated : N·m"""
    cdef double limit = 1e-2 * UNCOMMANDED_TORQUE_LIMIT * rated
    cdef double elapsed
    cdef bint silent = fmax(fabs(wanted), fabs(u.wanted)) <= 0.5 * limit
    if reply_time == u.reply_time:
        return False
    elapsed = 0.0 if u.reply_time < 0 else 1e-9 * fmin(<double>(reply_time - u.reply_time), REPLY_INTERVAL_LIMIT)
    u.reply_time, u.wanted = reply_time, wanted
    if silent and fabs(torque) > limit:
        u.time += elapsed
        u.replies += 1
        return u.replies >= UNCOMMANDED_TORQUE_REPLIES and u.time >= 1e-9 * UNCOMMANDED_TORQUE_TIME - 1e-9
    u.time -= 0.25 * elapsed
    if u.time <= 0.0:
        u.time, u.replies = 0.0, 0
    return False

"""Ownership of the buses, the devices and the ring of the recording, which the loop and the watchdog use in turn.

One word names the owner. The loop releases it around steps alone: whatever touches a device, a bus or the ring, events
included, happens while the loop owns them. The watchdog takes it from a step that does not return, by a compare-and-swap,
and only then begins its stop. A compare-and-swap by the loop fails from then on: the loop touches none of them until it
has dismissed the watchdog.
"""

from libc.stdint cimport int64_t, uint64_t

from cext.atomics cimport store_u64, swap

cdef enum: # owner
    LOOP = 0                     # the thread of the ticks
    UNOWNED = 1                  # no owner: the loop runs a step that uses none of them
    WATCHDOG = 2                 # the watchdog: the step did not return

cdef struct Handover:
    uint64_t user
    # ns of CLOCK_MONOTONIC, start of the tick's work, later by the time of its steps with an allowance; 0 between ticks
    int64_t since
    int64_t allowed              # ns, allowance of the present step

cdef inline void release(Handover *handover) noexcept nogil:
    """Release what the loop owns, before a step. `handover` may be NULL, without a watchdog."""
    if handover != NULL:
        store_u64(&handover.user, UNOWNED)

cdef inline bint acquire(Handover *handover) noexcept nogil:
    """Acquire it again after a step. Returns False if the step took too long: the loop then returns HUNG at once."""
    return handover == NULL or swap(&handover.user, UNOWNED, LOOP)

cdef inline bint take_over(Handover *handover) noexcept nogil:
    """Take it from a step, for the watchdog. Returns whether it is the owner now."""
    return swap(&handover.user, UNOWNED, WATCHDOG)

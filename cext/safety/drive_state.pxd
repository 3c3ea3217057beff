"""State of one drive in a run: commanded, or taken out while the others go on.

    state       from                                        frames
    ACTIVE      arming                                      commands
    DAMPED      ACTIVE, if its safe stop begins by damping  damping, for the time of the safe stop
    OUT         ACTIVE or DAMPED                            zero torque until it has confirmed, and disable
    RETURNING   OUT, once `disabled` is false               enable and zero torque, as in arming

A drive leaves ACTIVE while its parameter `disabled` or its input `disable` is true. The input sets the parameter, so a
drive returns only after an operator has cleared the parameter. RETURNING ends in ACTIVE with commands that fade in, or,
after ARMING_LIMIT, in OUT with the parameter set again.
"""

from libc.stdint cimport int64_t

cdef enum:
    ACTIVE
    DAMPED
    OUT
    RETURNING

cdef struct DriveState:
    int state
    int disabled                # slot of the parameter; -1: the device cannot be taken out
    int disable                 # slot of the input
    int active                  # slot of the output
    int64_t since               # ns, time of the newest change
    int64_t sent                # ns, time of the newest disable
    bint silent                 # it has not replied for a time while out, and may have lost its power
    bint unconfirmed            # it is out, and has not confirmed that it is disabled
    bint reported               # that it has not was reported
    int64_t taken_out, returned # number of times


cdef inline void forget_state(DriveState *drive, const double *arena) noexcept nogil:
    """Return to the state before arming."""
    drive.state = ACTIVE if drive.disabled < 0 or not arena[drive.disabled] > 0.5 else OUT
    drive.since = drive.sent = 0
    drive.silent = drive.unconfirmed = drive.state == OUT
    drive.reported = False
    drive.taken_out = drive.returned = 0


cdef inline void enter(DriveState *drive, int state, int64_t now) noexcept nogil:
    drive.state, drive.since = state, now

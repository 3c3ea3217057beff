"""Zeroing of the drives of a schedule, in a tick and during arming. Its principle is in cext.safety.zeroing."""

from libc.stdint cimport int64_t

from cext.abi cimport OK, TICK, Frame
from cext.status cimport IMPLAUSIBLE
from cext.safety.drive_state cimport ACTIVE
from cext.safety.drive_watch cimport DriveWatch
from cext.safety.motion_watch cimport POSITION, blame
from cext.safety.zeroing cimport (
    ZERO_KEPT, ZERO_LOST, ZERO_SET, ZERO_UNKNOWN, Zeroing, begin_zero, judge_zero, may_be_zeroed, repeat_zero,
)
from cext.schedule.device_events cimport ZERO_NOT_SET, ZERO_REFUSED, ZEROED, DeviceEvents
from cext.schedule.device_table cimport Device, DeviceTable


cdef inline int end_zeroing(DeviceTable table, DriveWatch drives, DeviceEvents events, int number) noexcept nogil:
    """End the zeroing of a device, if it runs and a reply or the time decides it.

    Returns OK or a negated status.
    """
    cdef Device *device = &table.devices[number]
    cdef Zeroing *z = &device.zeroing
    cdef int result, place
    if not z.runs:
        return OK
    result = judge_zero(z, table.arena, table.now)
    if result == ZERO_UNKNOWN:
        for place in range(drives.count):
            if drives.drives[place].device == number:
                blame(&drives.drives[place].motion, IMPLAUSIBLE, POSITION, table.arena[z.position], -z.offset)
        return -IMPLAUSIBLE
    if result == ZERO_SET or result == ZERO_KEPT:
        z.runs = False
        device.fades_from = <int64_t>table.arena[TICK]
        z.set += result == ZERO_SET
        z.refused += result == ZERO_KEPT
        events.publish(number, ZEROED if result == ZERO_SET else ZERO_NOT_SET, <int64_t>table.arena[TICK])
    return OK


cdef inline int add_zero(DeviceTable table, DeviceEvents events, int number, Frame *frames, int count) noexcept nogil:
    """Add the frame that sets the zero of a device, if it is requested and permitted, or was lost.

    count : number of frames of the device. Returns the new number
    """
    cdef Device *device = &table.devices[number]
    cdef Zeroing *z = &device.zeroing
    cdef bint requested = z.request >= 0 and table.arena[z.request] > 0.5
    cdef bint rises = requested and not z.requested
    cdef bint permitted
    if z.position < 0:
        return count
    z.requested = requested
    permitted = not table.waiting and device.drive.state == ACTIVE and may_be_zeroed(z, table.now)
    if z.runs and permitted and judge_zero(z, table.arena, table.now) == ZERO_LOST:
        repeat_zero(z, table.now)
    elif not z.runs and rises and permitted:
        begin_zero(z, table.arena, table.now)
    else:
        if rises:
            z.refused += 1
            events.publish(number, ZERO_REFUSED, <int64_t>table.arena[TICK])
        return count
    frames[count] = device.set_zero.frames[0]
    return count + 1


cdef inline bint zero_while_arming(DeviceTable table, DeviceEvents events, int number) noexcept nogil:
    """Return whether the frame that sets the zero of a device is to be sent now: it was enabled, and is at rest."""
    cdef Device *device = &table.devices[number]
    cdef Zeroing *z = &device.zeroing
    cdef int result = ZERO_LOST
    if not z.due or not table.has_replied(device):
        return False
    if z.runs:
        result = judge_zero(z, table.arena, table.now)
    if result == ZERO_SET:
        z.runs = z.due = False
        device.drive.silent = False                          # its angle is certain
        z.set += 1
        events.publish(number, ZEROED, <int64_t>table.arena[TICK])
    elif result == ZERO_KEPT or result == ZERO_UNKNOWN:
        z.runs = False
    if result != ZERO_LOST or not may_be_zeroed(z, table.now):
        return False
    if z.runs:
        repeat_zero(z, table.now)
    else:
        begin_zero(z, table.arena, table.now)
    return True

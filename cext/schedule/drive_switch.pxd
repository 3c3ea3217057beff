from libc.stdint cimport int64_t

from cext.safety.drive_watch cimport DriveWatch
from cext.schedule.buses cimport Buses
from cext.schedule.device_events cimport DeviceEvents
from cext.schedule.device_table cimport Device, DeviceTable
from cext.schedule.handover cimport Handover
from cext.schedule.live cimport LiveTable

cdef class DriveSwitch:
    """Drives of one schedule that can be taken out of a run."""
    cdef DeviceTable table
    cdef Buses buses
    cdef DriveWatch drives
    cdef DeviceEvents events
    cdef LiveTable live          # the table with the parameters `disabled`
    cdef object may_return       # function of a path: whether its joint's position is certain, or None

    cdef Handover *handover      # handover of the watchdog; NULL without one

    cdef int update(self, int number) noexcept nogil
    cdef void take_out(self, int number) noexcept nogil
    cdef void begin_out(self, int number) noexcept nogil
    cdef int disable(self, Device *device, int64_t now, bint zero) noexcept nogil
    cdef void judge_out(self, int number, int64_t passed) noexcept nogil
    cdef void disable_again(self, int number) noexcept nogil
    cdef bint is_fit(self, int number) noexcept nogil
    cdef int permission(self, int number) noexcept nogil
    cdef int limit_exceeded(self, int number) noexcept nogil
    cdef int send(self, int64_t now) noexcept nogil

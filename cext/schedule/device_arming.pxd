from libc.stdint cimport int64_t

from cext.schedule.buses cimport Buses
from cext.schedule.device_events cimport DeviceEvents
from cext.schedule.device_table cimport DeviceTable
from cext.schedule.drive_switch cimport DriveSwitch

cdef class DeviceArming:
    """Arming of the devices of one schedule, and the wait for their replies."""
    cdef DeviceTable table
    cdef Buses buses
    cdef DeviceEvents events
    cdef DriveSwitch switch
    cdef int64_t start_time      # ns of arming in which only relays are sent frames

    cdef void begin(self, bint looked) noexcept nogil
    cdef void ask_again(self) noexcept nogil
    cdef void enable(self) noexcept nogil
    cdef bint enable_answered(self) noexcept nogil
    cdef bint advance(self, int *status) noexcept nogil
    cdef int fitness(self) noexcept nogil
    cdef bint was_unheard(self) noexcept nogil
    cdef bint all_answered(self) noexcept nogil
    cdef bint only_zeros_are_due(self) noexcept nogil
    cdef int send_relays(self, int64_t now) noexcept nogil
    cdef int send(self, bint set_up, int64_t now) noexcept nogil
    cdef void keep_ready(self) noexcept nogil
    cdef void restore_ready(self) noexcept nogil

from libc.stdint cimport int64_t

from cext.schedule.buses cimport Buses
from cext.schedule.device_events cimport DeviceEvents
from cext.schedule.device_table cimport DeviceTable

cdef class DeviceArming:
    """Arming of the devices of one schedule, and the wait for their replies."""
    cdef DeviceTable table
    cdef Buses buses
    cdef DeviceEvents events
    cdef int64_t start_time      # ns of arming in which only relays are sent frames

    cdef void begin(self) noexcept nogil
    cdef void expect_replies(self) noexcept nogil
    cdef bint all_answered(self) noexcept nogil
    cdef bint only_zeros_are_due(self) noexcept nogil
    cdef int send_relays(self, int64_t now) noexcept nogil
    cdef int send_batches(self, bint enable, int64_t now) noexcept nogil
    cdef void keep_ready(self) noexcept nogil
    cdef void restore_ready(self) noexcept nogil

from libc.stdint cimport int64_t

from cext.schedule.buses cimport Buses
from cext.schedule.device_table cimport DeviceTable

cdef class SafeStop:
    """Safe stop of the devices of one schedule."""
    cdef DeviceTable table
    cdef Buses buses
    cdef int64_t longest_damping # ns
    cdef int64_t due             # ns since the begin of the stop, of the next round of zero torque and disable

    cdef void begin(self) noexcept nogil
    cdef int64_t send(self, int64_t since, int64_t now, int64_t round) noexcept nogil
    cdef void note_speeds(self) noexcept nogil
    cdef void note_speeds_of(self, int bus) noexcept nogil

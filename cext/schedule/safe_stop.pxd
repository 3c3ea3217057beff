from libc.stdint cimport int64_t

from cext.schedule.buses cimport Buses
from cext.schedule.device_table cimport Device, DeviceTable

cdef class SafeStop:
    """Safe stop of the devices of one schedule."""
    cdef DeviceTable table
    cdef Buses buses
    cdef int64_t longest_damping # ns
    cdef int64_t due             # ns since the begin of the stop, of the next round of zero torque and disable
    cdef int64_t pace            # ns, newest period of these rounds

    cdef void begin(self, int64_t now) noexcept nogil
    cdef int64_t send(self, int64_t since, int64_t now, int64_t round) noexcept nogil
    cdef void judge(self, int64_t now, int64_t round) noexcept nogil
    cdef bint is_confirmed(self, int64_t since, int64_t now, int64_t round) noexcept nogil
    cdef int send_disable(self, int64_t now) noexcept nogil
    cdef void note_speeds(self) noexcept nogil
    cdef void note_speeds_of(self, int bus) noexcept nogil

cdef int64_t under_way(const Device *device) noexcept nogil
cdef int64_t damping_transit(const Device *device) noexcept nogil
cdef int ask(Device *device, Buses buses, int64_t now, bint zero, bint stopping) noexcept nogil

from libc.stdint cimport int64_t, uint64_t

from cext.memory.shared_state cimport SharedLayout

cdef enum:
    ZEROED
    ZERO_REFUSED
    ZERO_NOT_SET
    TAKEN_OUT
    RETURNED
    NOT_RETURNED
    NOT_STOPPED
    STOPPED
    DEVICE_EVENTS

cdef class DeviceEvents:
    """Events of the devices of one schedule."""
    cdef list templates          # EventTemplate, DEVICE_EVENTS of each device that has them
    cdef void **places           # the same, borrowed: DEVICE_EVENTS of each device; NULL for none
    cdef SharedLayout *layout      # NULL: none

    cdef uint64_t share(self, SharedLayout *layout)
    cdef void publish(self, int device, int event, int64_t tick) noexcept nogil

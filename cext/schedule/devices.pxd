from libc.stdint cimport int32_t, int64_t, uint64_t

from cext.abi cimport Frame
from cext.clock.stopwatch cimport Laps
from cext.memory.shared_state cimport SharedLayout
from cext.safety.drive_warnings cimport DriveWarnings
from cext.safety.drive_watch cimport DriveWatch
from cext.schedule.buses cimport Buses
from cext.schedule.device_arming cimport DeviceArming
from cext.schedule.device_events cimport DeviceEvents
from cext.schedule.device_table cimport Device, DeviceTable
from cext.schedule.drive_switch cimport DriveSwitch
from cext.schedule.safe_stop cimport SafeStop

cdef struct Blame:               # last failure, -1 for other causes
    int device
    int bus

cdef class Devices:
    """Devices of one schedule, for the executor."""
    cdef DeviceTable table
    cdef Buses buses
    cdef DriveWatch drives
    cdef DriveWarnings warnings
    cdef DeviceEvents events
    cdef DriveSwitch switch
    cdef DeviceArming arming
    cdef SafeStop stop
    cdef readonly object reports # DeviceReports
    cdef Frame *outgoing
    cdef int32_t *outgoing_count # per bus
    cdef Laps *laps              # NULL: not timed
    cdef int item                # stopwatch item of the first device
    cdef bint ran
    cdef double fade             # s, over which the commands of one device fade in
    cdef double counted_from     # tick from which missing replies are counted

    cdef void reset(self)
    cdef uint64_t share(self, SharedLayout *layout)
    cdef Blame failed(self) noexcept nogil
    cdef void blame(self, Blame failed) noexcept nogil
    cdef int receive(self, int64_t now) noexcept nogil
    cdef int offer(self, int bus, int count) noexcept nogil
    cdef int offer_one(self, int bus, Frame *frame, int *status) noexcept nogil
    cdef bint is_foreign_command(self, const Frame *frame, int answer, int number) noexcept nogil
    cdef bint is_twin(self, Device *device, const Frame *frame) noexcept nogil
    cdef bint is_prompt(self, const Device *device) noexcept nogil
    cdef bint may_have_restarted(self, const Device *device, int64_t now) noexcept nogil
    cdef bint is_unconfigured(self, const Device *device) noexcept nogil
    cdef int watch(self, int64_t now) noexcept nogil
    cdef int command(self) noexcept nogil
    cdef int encode(self, Device *device, Frame *frames) noexcept nogil
    cdef int transmit(self, int64_t now) noexcept nogil
    cdef void note_commands(self, int bus, int64_t at, int64_t sent) noexcept nogil

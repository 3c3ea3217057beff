# cython: freethreading_compatible=True
"""Arming of devices: enable and zero torque until each has replied, and has returned what arming writes to it."""

from libc.stdint cimport int64_t
from libc.string cimport memcpy

from cext.abi cimport FRAMES_PER_BATCH, OK
from cext.safety.drive_state cimport ACTIVE, OUT
from cext.safety.stop_confirmation cimport StopConfirmation
from cext.safety.twins cimport forget_twins, note_questions
from cext.safety.zeroing cimport begin_rest
from cext.schedule.device_table cimport Device
from cext.schedule.drive_zeroing cimport zero_while_arming
from cext.schedule.relays cimport pump, pump_all


cdef class DeviceArming:
    """Arming of the devices of one schedule. Its frames were encoded at compile time."""

    def __init__(self, DeviceTable table, Buses buses, DeviceEvents events):
        self.table, self.buses, self.events = table, buses, events
        self.start_time = max((round(device.start_time * 1e9) for device in table.schedule.devices), default=0)

    cdef void begin(self) noexcept nogil:
        """Require every device to reply and to return what is written to it, even if it has before, as its power may
        have been off.
        """
        cdef int number
        cdef Device *device
        self.table.waiting = False
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if device.ready >= 0:
                self.table.arena[device.ready] = 0.0
            device.fades_from = -1
            if device.drive.disabled >= 0:
                device.drive.state = OUT if self.table.arena[device.drive.disabled] > 0.5 else ACTIVE
                device.drive.unconfirmed = device.drive.state == OUT
                if device.drive.unconfirmed and device.confirmation != NULL:
                    (<StopConfirmation>device.confirmation).begin(self.table.now)
            begin_rest(&device.zeroing, self.table.now)
            # frames of a stop were not counted
            forget_twins(&device.twins, self.table.now, FRAMES_PER_BATCH if self.table.stopping else 0)
        self.expect_replies()

    cdef void expect_replies(self) noexcept nogil:
        """Count replies to zero torque from now on."""
        cdef int number
        cdef Device *device
        self.table.stopping = False
        for number in range(self.table.count):
            device = &self.table.devices[number]
            device.replies = device.rounds = 0
            device.replies_wanted = device.zero.count
            if device.zero.count == 0 and device.timeout > 0.0:
                # a sensor that sends by itself, and is checked for silence
                device.replies_wanted = 1

    cdef bint all_answered(self) noexcept nogil:
        cdef int number
        for number in range(self.table.count):
            if not self.table.has_answered(&self.table.devices[number]):
                return False
        return True

    cdef bint only_zeros_are_due(self) noexcept nogil:
        """Return whether arming waits for nothing but the zeros of drives."""
        cdef int number
        cdef Device *device
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if device.drive.state == ACTIVE and not self.table.has_replied(device):
                return False
        return True

    cdef int send_relays(self, int64_t now) noexcept nogil:
        """Send frames only to the devices that hold relays, while the drives behind the relays start."""
        return pump_all(self.table, self.buses, now)

    cdef int send_batches(self, bint enable, int64_t now) noexcept nogil:
        """Send zero torque to every device, and enable to those that have not replied, if wanted."""
        cdef int number, count
        cdef Device *device
        cdef int status = OK
        for number in range(self.table.count):
            device = &self.table.devices[number]
            count = device.zero.count
            if device.drive.state != ACTIVE:
                status |= self.buses.send(device.bus, device.disable.frames, device.disable.count, now, False)
                continue
            if enable and not self.table.has_replied(device) and device.enable.count > 0:
                if device.rounds % device.enable.count == 0:       # less often for many frames, to limit the bus load
                    status |= self.buses.send(device.bus, device.enable.frames, device.enable.count, now, False)
                    count += device.enable.count
                device.rounds += 1
            status |= self.buses.send(device.bus, device.zero.frames, device.zero.count, now, False)
            if enable and zero_while_arming(self.table, self.events, number):
                status |= self.buses.send(device.bus, device.set_zero.frames, device.set_zero.count, now, False)
                count += device.set_zero.count
            note_questions(&device.twins, count, now)
            if device.relay > 0:
                status |= pump(self.table, self.buses, device, now, False)
        return self.buses.status(status, False)

    cdef void keep_ready(self) noexcept nogil:
        """Save the values that arming has read back, before the blocks reset."""
        cdef int number
        cdef Device *device
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if device.ready >= 0:
                memcpy(device.ready_kept, self.table.arena + device.ready, device.ready_size * sizeof(double))

    cdef void restore_ready(self) noexcept nogil:
        cdef int number
        cdef Device *device
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if device.ready >= 0:
                memcpy(self.table.arena + device.ready, device.ready_kept, device.ready_size * sizeof(double))

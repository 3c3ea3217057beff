# cython: freethreading_compatible=True
"""Arming of devices, in two phases.

    asking      the settings of a device are written and read back, its zero is set if arming requires it, and it is
                asked for its state; nothing enables an actuator
    enabling    enable and zero torque, until each actuator has replied as an enabled one

The executor waits for the operator between the two; it may ask again before it enables.
"""

from libc.stdint cimport int64_t
from libc.string cimport memcpy

from cext.abi cimport OK
from cext.safety.drive_state cimport ACTIVE, OUT
from cext.schedule.arming_round cimport begin_asking, begin_enabling, send_round
from cext.schedule.device_table cimport Device
from cext.schedule.relays cimport pump, pump_all


cdef class DeviceArming:
    """Arming of the devices of one schedule. Its frames were encoded at compile time."""

    def __init__(self, DeviceTable table, Buses buses, DeviceEvents events, DriveSwitch switch):
        self.table, self.buses, self.events, self.switch = table, buses, events, switch
        self.start_time = max((round(device.start_time * 1e9) for device in table.schedule.devices), default=0)

    cdef void begin(self, bint looked) noexcept nogil:
        """Begin to ask every device, even if it has replied before, as its power may have been off.

        looked : whether the operator looks at the replies: then every device must reply
        """
        cdef int number
        cdef Device *device
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if device.drive.state == OUT:
                self.switch.begin_out(number)
            begin_asking(self.table, device, looked)
        self.table.waiting = self.table.stopping = False
        self.table.arming, self.table.looked = True, looked

    cdef void ask_again(self) noexcept nogil:
        """Require the actuators to return what is written to them once more, as the operator may have taken his time."""
        cdef int number
        for number in range(self.table.count):
            if self.table.devices[number].zero.count > 0:
                begin_asking(self.table, &self.table.devices[number], False)

    cdef void enable(self) noexcept nogil:
        """Enable every actuator from now on."""
        cdef int number
        for number in range(self.table.count):
            begin_enabling(&self.table.devices[number], self.table.now)

    cdef bint enable_answered(self) noexcept nogil:
        """Enable the actuators that have answered. Returns whether there are any."""
        cdef int number
        cdef bint found = False
        cdef Device *device
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if device.zero.count > 0 and not device.enabling and self.table.has_answered(device):
                begin_enabling(device, self.table.now)
                found = True
        return found

    cdef bint advance(self, int *status) noexcept nogil:
        """Return whether every device is enabled. Enables them as soon as all have replied and may be commanded.

        status : set to what prevents that
        """
        if not self.all_answered():
            return False
        if all_are(self.table, is_enabling):
            return True
        status[0] = self.fitness()
        if status[0] == OK:
            self.enable()
        return status[0] == OK and self.all_answered()

    cdef int fitness(self) noexcept nogil:
        """Return OK, or why a drive would fault as soon as it is enabled."""
        cdef int number, status
        for number in range(self.table.count):
            status = self.switch.limit_exceeded(number)
            if status != OK and self.table.devices[number].drive.state == ACTIVE and (
                    self.table.devices[number].answered):
                self.table.failed = number
                return status
        return OK

    cdef bint was_unheard(self) noexcept nogil:
        """Return whether an actuator does not reply before it is enabled."""
        return not all_are(self.table, is_heard)

    cdef bint all_answered(self) noexcept nogil:
        return self.table.all_answered()

    cdef bint only_zeros_are_due(self) noexcept nogil:
        """Return whether arming waits for nothing but the zeros of drives."""
        return all_are(self.table, has_replied)

    cdef int send_relays(self, int64_t now) noexcept nogil:
        """Send frames only to the devices that hold relays, while the drives behind the relays start."""
        return pump_all(self.table, self.buses, now)

    cdef int send(self, bint set_up, int64_t now) noexcept nogil:
        """Send the frames of a round of arming. set_up : whether to write settings that are not read back yet"""
        cdef int number
        cdef Device *device
        cdef int status = OK
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if device.drive.state != ACTIVE:
                status |= self.switch.disable(device, now, False)
                continue
            status |= send_round(self.table, self.buses, self.events, number, set_up, now)
            if device.relay > 0:
                status |= pump(self.table, self.buses, device, now)
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


ctypedef bint (*test_t)(DeviceTable table, const Device *device) noexcept nogil


cdef inline bint all_are(DeviceTable table, test_t test) noexcept nogil:
    """Return whether every device passes a test."""
    cdef int number
    for number in range(table.count):
        if not test(table, &table.devices[number]):
            return False
    return True


cdef bint is_enabling(DeviceTable table, const Device *device) noexcept nogil:
    return device.enabling


cdef bint is_heard(DeviceTable table, const Device *device) noexcept nogil:
    return device.drive.state != ACTIVE or device.zero.count == 0 or device.ask.count > 0


cdef bint has_replied(DeviceTable table, const Device *device) noexcept nogil:
    return device.drive.state != ACTIVE or table.has_replied(device)

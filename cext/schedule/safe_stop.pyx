# cython: freethreading_compatible=True
"""Safe stop of devices: damping where a drive has it, then zero torque and disable until each device has confirmed.

After STOP_LIMIT the rounds continue at a falling rate, for devices whose bus returns.
"""

from libc.stdint cimport int64_t

from cext.bus.batch cimport Batch
from cext.safety.drive_state cimport OUT
from cext.abi cimport ERROR_FRAME, OK
from cext.safety.speed_bands cimport SpeedBands
from cext.safety.stop_confirmation cimport StopConfirmation
from cext.safety.thresholds cimport STOP_LIMIT, STOP_ROUND_MAXIMUM
from cext.safety.transit cimport longest_possible, note_asked
from cext.schedule.device_table cimport Device
from cext.schedule.relays cimport holds_relay, pump


cdef class SafeStop:
    """Safe stop of the devices of one schedule. Its frames were encoded at compile time."""

    def __init__(self, DeviceTable table, Buses buses):
        self.table, self.buses = table, buses
        for index in range(table.count):
            self.longest_damping = max(self.longest_damping, table.devices[index].damping)

    cdef void begin(self, int64_t now) noexcept nogil:
        """Begin a safe stop. Damping depends on the first `since` of `send`. now : ns since the begin of the run"""
        cdef int number
        cdef Device *device
        self.due = self.pace = 0
        self.table.stopping, self.table.arming = True, False
        for number in range(self.table.count):
            device = &self.table.devices[number]
            device.zeroing.runs = False
            device.damped = device.bands != NULL and device.drive.state < OUT
            device.damp_due = 0
            if device.confirmation != NULL:
                (<StopConfirmation>device.confirmation).begin(now, under_way(device))

    cdef int64_t send(self, int64_t since, int64_t now, int64_t round) noexcept nogil:
        """Send the due frames of the safe stop `since` ns after its begin: damping by the newest speeds, zero torque
        and disable every `round` ns to the devices that have not confirmed.

        A device is damped until the first round after its time. Returns when the next frames are due, in ns since the
        begin of the stop.

        A relay is held while any device is damped, unless it may have dropped: a safe stop never restores a drive's
        power.
        """
        cdef int number
        cdef Device *device
        cdef Batch *batch
        cdef bint disabling = since >= self.due
        cdef int64_t due
        if disabling:
            self.pace = round if since < self.longest_damping + STOP_LIMIT else min(2 * self.pace, STOP_ROUND_MAXIMUM)
            self.due = next_due(self.due, since, self.pace)
        due = self.due
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if device.relay > 0:
                if disabling and since < self.longest_damping and holds_relay(self.table, self.buses, device, now):
                    pump(self.table, self.buses, device, now)
            elif device.damped and (since < device.damping or not disabling):
                if since >= device.damp_due:
                    batch = <Batch *>(<SpeedBands>device.bands).choose(now, damping_transit(device))
                    self.buses.send(device.bus, batch.frames, batch.count, now, True)
                    note_asked(&device.transit, batch.count, now, now, -1)
                    device.damp_due = next_due(device.damp_due, since, (<SpeedBands>device.bands).round)
                due = min(due, device.damp_due)
            elif disabling:
                device.damped = False
                if device.confirmation != NULL and not (<StopConfirmation>device.confirmation).confirmed:
                    ask(device, self.buses, now, True, True)
        return due

    cdef void judge(self, int64_t now, int64_t round) noexcept nogil:
        """Judge the replies of every device at the end of a round. round : ns"""
        cdef int number
        for number in range(self.table.count):
            if self.table.devices[number].confirmation != NULL and not self.table.devices[number].damped:
                (<StopConfirmation>self.table.devices[number].confirmation).judge(now, round)

    cdef bint is_confirmed(self, int64_t since, int64_t now, int64_t round) noexcept nogil:
        """Return whether every device has confirmed; judged where a round has ended. Arguments as of `send`"""
        if since >= self.due:
            self.judge(now, max(round, self.pace))
        return self.table.all_answered()

    cdef int send_disable(self, int64_t now) noexcept nogil:
        """Send a round of disable to every device, confirmed or not, while a run waits behind the fence."""
        cdef int number
        cdef int status = OK
        for number in range(self.table.count):
            if self.table.devices[number].confirmation != NULL:
                status |= ask(&self.table.devices[number], self.buses, now, False, True)
        return self.buses.status(status, True)

    cdef void note_speeds(self) noexcept nogil:
        """Read frames for the speeds of damped devices. The arena stays as the hung tick has left it."""
        cdef int bus, number
        for bus in range(self.buses.count):
            for number in range(self.table.count):
                if self.table.devices[number].bus == bus and self.table.devices[number].damped:
                    self.note_speeds_of(bus)
                    break

    cdef void note_speeds_of(self, int bus) noexcept nogil:
        cdef int index, number
        cdef Device *device
        for index in range(self.buses.receive(bus)):
            for number in range(self.table.count):
                device = &self.table.devices[number]
                if device.bus == bus and device.bands != NULL:
                    (<SpeedBands>device.bands).note(&self.buses.received[index])
            if self.buses.layout != NULL:
                self.buses.layout.frames_received += not self.buses.received[index].id & ERROR_FRAME
                self.buses.log_frame(&self.buses.received[index])


cdef int ask(Device *device, Buses buses, int64_t now, bint zero, bint stopping) noexcept nogil:
    """Send disable, after zero torque if wanted, unless the device is waited for. Returns the status of `Buses.send`.

    stopping : whether the frames belong to a safe stop, and pass the fence
    """
    cdef int status = OK
    cdef int answers = device.disable.count - device.unanswered
    if not (<StopConfirmation>device.confirmation).may_send():
        return OK
    if zero:
        answers += device.zero.count
        status = buses.send(device.bus, device.zero.frames, device.zero.count, now, stopping)
    status |= buses.send(device.bus, device.disable.frames, device.disable.count, now, stopping)
    (<StopConfirmation>device.confirmation).sent(now, answers)
    note_asked(&device.transit, answers, now, now, -1)
    return status


cdef int64_t under_way(const Device *device) noexcept nogil:
    """Return the time in ns that a reply to an earlier command may still be under way, as was measured."""
    return min(longest_possible(&device.transit), STOP_LIMIT // 4)


cdef int64_t damping_transit(const Device *device) noexcept nogil:
    """Return the time in ns that damping allows for from a frame to its reply: the longest that may be true."""
    cdef int64_t measured = longest_possible(&device.transit)
    if device.transit.answers and device.transit.measured:
        return measured
    return max(measured, (<SpeedBands>device.bands).transit)


cdef inline int64_t next_due(int64_t due, int64_t now, int64_t round) noexcept nogil:
    """Return the round after the one sent now: on the same grid, unless that one is missed as well."""
    return due + round if due + round > now else now + round

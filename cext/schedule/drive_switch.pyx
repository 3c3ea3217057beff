# cython: freethreading_compatible=True
"""Drives that are taken out of a run, and armed again. The states are in cext.safety.drive_state."""

from libc.math cimport fabs, isfinite
from libc.stdint cimport int64_t

from cext.abi cimport OK, PERIOD, POWER_LOSS, TICK
from cext.atomics cimport store_i64
from cext.bus.batch cimport Batch
from cext.safety.drive_state cimport ACTIVE, DAMPED, OUT, RETURNING, enter
from cext.safety.drive_watch cimport Watched
from cext.safety.speed_bands cimport SpeedBands
from cext.safety.thresholds cimport ARMING_LIMIT, STOP_LIMIT, TRAVEL_MARGIN, ZERO_LIMIT
from cext.safety.zeroing cimport begin_rest
from cext.schedule.device_events cimport NOT_RETURNED, RETURNED, TAKEN_OUT
from cext.schedule.drive_zeroing cimport zero_while_arming

cdef int64_t SILENT_ROUND = 500000000    # ns between frames to a drive that is taken out and does not reply
cdef int64_t RETURN_DELAY = 20000000     # ns without frames to a drive before it is armed again, for late replies


cdef class DriveSwitch:
    """Switch of the drives of one schedule: each leaves the run, and returns to it, as its parameter requires."""

    def __init__(self, DeviceTable table, Buses buses, DriveWatch drives, DeviceEvents events, LiveTable live):
        self.table, self.buses, self.drives, self.events, self.live = table, buses, drives, events, live
        self.may_return = None

    cdef void update(self, int number) noexcept nogil:
        """Take a drive out, or let it return, as its parameter and its input require."""
        cdef Device *device = &self.table.devices[number]
        cdef double *arena = self.table.arena
        cdef int64_t now = self.table.now
        cdef int64_t passed = now - device.drive.since
        cdef bint disabled
        if not arena[device.drive.disable] <= 0.5 and not arena[device.drive.disabled] > 0.5:
            self.live.assume(device.drive.disabled, 1.0)
            self.live.show(self.events.page)
        disabled = arena[device.drive.disabled] > 0.5
        device.drive.silent |= now - device.reply_time > POWER_LOSS
        if self.table.waiting:
            device.drive.silent |= disabled and device.drive.state == ACTIVE
            device.drive.state = OUT if disabled else ACTIVE     # all are disabled, and armed together
        elif device.drive.state == ACTIVE and disabled:
            self.take_out(number)
        elif device.drive.state == DAMPED and passed >= device.damping:
            enter(&device.drive, OUT, now)
        elif device.drive.state == OUT and not disabled:
            enter(&device.drive, RETURNING, now)
            if device.ready >= 0:
                arena[device.ready] = 0.0
            device.replies = device.rounds = 0
            device.replies_wanted = device.zero.count
            begin_rest(&device.zeroing, now)
        elif device.drive.state == RETURNING and disabled:
            enter(&device.drive, OUT, now)
        elif device.drive.state == RETURNING and passed < RETURN_DELAY:
            device.replies = 0                                   # to the disable
        elif device.drive.state == RETURNING and self.table.has_answered(device) and self.is_fit(number):
            enter(&device.drive, ACTIVE, now)
            device.fades_from = <int64_t>arena[TICK]
            device.drive.returned += 1
            self.events.publish(number, RETURNED, <int64_t>arena[TICK])
        elif device.drive.state == RETURNING and passed >= ARMING_LIMIT + (
                ZERO_LIMIT if device.zeroing.due and self.table.has_replied(device) else 0):
            self.disable_again(number)

    cdef void take_out(self, int number) noexcept nogil:
        cdef Device *device = &self.table.devices[number]
        enter(&device.drive, OUT if device.bands == NULL else DAMPED, self.table.now)
        device.damp_due = device.drive.sent = 0
        device.drive.silent = False
        device.zeroing.runs = False
        device.drive.taken_out += 1
        self.events.publish(number, TAKEN_OUT, <int64_t>self.table.arena[TICK])

    cdef void disable_again(self, int number) noexcept nogil:
        """Take out a drive that cannot be armed again."""
        cdef Device *device = &self.table.devices[number]
        self.live.assume(device.drive.disabled, 1.0)
        self.live.show(self.events.page)
        enter(&device.drive, OUT, self.table.now)
        device.zeroing.runs = False
        self.events.publish(number, NOT_RETURNED, <int64_t>self.table.arena[TICK])

    cdef bint is_fit(self, int number) noexcept nogil:
        """Return whether a drive that has replied may be commanded without an immediate fault."""
        cdef Device *device = &self.table.devices[number]
        if (self.table.now - device.reply_time) * 1e-9 > 0.5 * device.timeout and device.timeout > 0.0:
            return False
        if device.fault >= 0 and self.table.arena[device.fault] != 0.0:
            return False
        if not self.is_within_limits(number):
            return False
        if self.may_return is None or not device.drive.silent:
            return True
        with gil:
            try:
                return bool(self.may_return(self.table.schedule.devices[number].name))
            except Exception:
                return False

    cdef bint is_within_limits(self, int number) noexcept nogil:
        """Return whether temperature, position and velocity of a drive are within their limits."""
        cdef const Watched *watched
        cdef const double *arena = self.table.arena
        cdef double position
        cdef int place
        for place in range(self.drives.count):
            watched = &self.drives.drives[place]
            if watched.device != number:
                continue
            if watched.temperature >= 0 and arena[watched.temperature] >= watched.hot:
                return False
            if watched.motion.position < 0:
                continue
            position = arena[watched.motion.position]
            if not isfinite(position) or not (watched.motion.low - 1e-3 * TRAVEL_MARGIN <= position
                    <= watched.motion.high + 1e-3 * TRAVEL_MARGIN):
                return False
            if watched.motion.velocity >= 0 and not fabs(arena[watched.motion.velocity]) <= watched.motion.fastest:
                return False
        return True

    cdef int send(self, int64_t now) noexcept nogil:
        """Send the frames of the drives that are taken out or return.

        A drive in OUT that does not reply gets its frames twice a second, so that they do not fill the queue of a bus
        without another node.
        """
        cdef int number
        cdef int status = OK
        cdef int64_t period = <int64_t>(1e9 * self.table.arena[PERIOD])
        cdef int64_t out = 0
        cdef Device *device
        cdef Batch *batch
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if device.drive.state >= OUT and number < 64:
                out |= <int64_t>1 << number
            if device.drive.state == DAMPED:                     # in force until the next tick, which may be late
                batch = <Batch *>(<SpeedBands>device.bands).choose(now + 2 * period)
                status |= self.buses.send(device.bus, batch.frames, batch.count, now, False)
                self.table.ask_batches(device, False, True, False, now)
            elif device.drive.state == OUT and (
                    now - device.drive.since < STOP_LIMIT or now - device.reply_time < STOP_LIMIT
                    or now - device.drive.sent >= SILENT_ROUND):
                device.drive.sent = now
                self.table.ask_batches(device, False, now - device.drive.since < STOP_LIMIT, True, now)
                if now - device.drive.since < STOP_LIMIT:
                    status |= self.buses.send(device.bus, device.zero.frames, device.zero.count, now, False)
                status |= self.buses.send(device.bus, device.disable.frames, device.disable.count, now, False)
            elif device.drive.state == RETURNING and now - device.drive.since >= RETURN_DELAY:
                if not self.table.has_replied(device) and device.enable.count > 0:
                    if device.rounds % device.enable.count == 0:
                        status |= self.buses.send(device.bus, device.enable.frames, device.enable.count, now, False)
                        self.table.ask_batches(device, True, False, False, now)
                    device.rounds += 1
                self.table.ask_batches(device, False, True, False, now)
                status |= self.buses.send(device.bus, device.zero.frames, device.zero.count, now, False)
                if zero_while_arming(self.table, self.events, number):
                    status |= self.buses.send(device.bus, device.set_zero.frames, device.set_zero.count, now, False)
        if self.buses.page != NULL:
            store_i64(&self.buses.page.out, out)                 # the guardian does not damp them
        return self.buses.status(status, False)

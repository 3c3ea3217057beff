# cython: freethreading_compatible=True
"""Drives that are taken out of a run, and armed again. The states are in cext.safety.drive_state."""

from libc.math cimport NAN, fabs, isfinite
from libc.stdint cimport int64_t

from cext.abi cimport OK, PERIOD, POWER_LOSS, TICK
from cext.status cimport HUNG, IMPLAUSIBLE, OVERSPEED, OVER_TRAVEL, TOO_HOT, UNCLEAR_POSE
from cext.bus.batch cimport Batch
from cext.safety.drive_state cimport ACTIVE, DAMPED, OUT, RETURNING, enter
from cext.safety.drive_watch cimport Watched
from cext.safety.speed_bands cimport SpeedBands
from cext.memory.shared_state cimport set_out
from cext.safety.stop_confirmation cimport StopConfirmation
from cext.safety.thresholds cimport ARMING_LIMIT, STOP_LIMIT, TRAVEL_MARGIN, ZERO_LIMIT
from cext.safety.motion_watch cimport POSITION, VELOCITY, blame
from cext.safety.zeroing cimport begin_rest
from cext.safety.transit cimport note_asked
from cext.schedule.arming_round cimport begin_asking, begin_enabling, send_round
from cext.schedule.device_events cimport NOT_RETURNED, NOT_STOPPED, RETURNED, STOPPED, TAKEN_OUT
from cext.schedule.handover cimport acquire, release
from cext.schedule.safe_stop cimport ask, damping_transit, under_way

cdef int64_t SILENT_ROUND = 500000000    # ns between frames to a drive that is taken out and does not reply
cdef int64_t RETURN_DELAY = 20000000     # ns without frames to a drive before it is armed again, for late replies


cdef class DriveSwitch:
    """Switch of the drives of one schedule: each leaves the run, and returns to it, as its parameter requires."""

    def __init__(self, DeviceTable table, Buses buses, DriveWatch drives, DeviceEvents events, LiveTable live):
        self.table, self.buses, self.drives, self.events, self.live = table, buses, drives, events, live
        self.may_return = None

    cdef int update(self, int number) noexcept nogil:
        """Take a drive out, or let it return, as its parameter and its input require.

        Returns OK, or HUNG if the watchdog has taken the devices while `may_return` was called.
        """
        cdef Device *device = &self.table.devices[number]
        cdef double *arena = self.table.arena
        cdef int64_t now = self.table.now
        cdef int64_t passed = now - device.drive.since
        cdef bint disabled
        cdef int permitted = OK
        if not arena[device.drive.disable] <= 0.5 and not arena[device.drive.disabled] > 0.5:
            self.live.assume(device.drive.disabled, 1.0)
            self.live.show(self.events.layout)
        disabled = arena[device.drive.disabled] > 0.5
        device.drive.silent |= now - device.reply_time > POWER_LOSS
        if self.table.waiting:
            device.drive.silent |= disabled and device.drive.state == ACTIVE
            device.drive.state = OUT if disabled else ACTIVE     # all are disabled, and armed together
        elif device.drive.state == ACTIVE and disabled:
            self.take_out(number)
        elif device.drive.state == DAMPED and passed >= device.damping:
            self.begin_out(number)
        elif device.drive.state == OUT and disabled:
            self.judge_out(number, passed)
        elif device.drive.state == OUT:
            enter(&device.drive, RETURNING, now)
            begin_asking(self.table, device, True)
            begin_rest(&device.zeroing, now)
        elif device.drive.state == RETURNING and disabled:
            self.begin_out(number)
        elif device.drive.state == RETURNING and passed < RETURN_DELAY:
            device.replies = 0                                   # to the disable
        elif device.drive.state == RETURNING:
            if device.enabling or device.ask.count > 0:
                permitted = self.permission(number)
            else:                                                # it replies only once it is enabled
                permitted = OK if self.table.has_answered(device) else UNCLEAR_POSE
            if permitted == HUNG:
                return HUNG
            if permitted == OK and not device.enabling:
                begin_enabling(device, now)
            elif permitted == OK:
                enter(&device.drive, ACTIVE, now)
                device.fades_from = <int64_t>arena[TICK]
                device.drive.returned += 1
                self.events.publish(number, RETURNED, <int64_t>arena[TICK])
            elif passed >= ARMING_LIMIT + (
                    ZERO_LIMIT if device.zeroing.due and self.table.has_replied(device) else 0):
                self.disable_again(number)
        return OK

    cdef void take_out(self, int number) noexcept nogil:
        cdef Device *device = &self.table.devices[number]
        if device.bands == NULL:
            self.begin_out(number)
        else:
            enter(&device.drive, DAMPED, self.table.now)
        device.damp_due = device.drive.sent = 0
        device.drive.silent = False
        device.zeroing.runs = False
        device.drive.taken_out += 1
        self.events.publish(number, TAKEN_OUT, <int64_t>self.table.arena[TICK])

    cdef void begin_out(self, int number) noexcept nogil:
        """Disable a drive, from now on until it returns."""
        cdef Device *device = &self.table.devices[number]
        enter(&device.drive, OUT, self.table.now)
        device.drive.unconfirmed = True
        device.drive.reported = False
        if device.confirmation != NULL:
            (<StopConfirmation>device.confirmation).begin(self.table.now, under_way(device))

    cdef int disable(self, Device *device, int64_t now, bint zero) noexcept nogil:
        """Send disable to a drive that is out, after zero torque if wanted. Returns the status of the sends."""
        device.drive.sent = now
        if device.confirmation == NULL:
            return OK
        return ask(device, self.buses, now, zero, False)

    cdef void judge_out(self, int number, int64_t passed) noexcept nogil:
        """Report whether a drive that is out has confirmed that it is disabled. passed : ns since it was"""
        cdef Device *device = &self.table.devices[number]
        cdef int64_t period = <int64_t>(1e9 * self.table.arena[PERIOD])
        cdef bint before = device.drive.unconfirmed
        if device.confirmation == NULL:
            return
        device.drive.unconfirmed = not (<StopConfirmation>device.confirmation).judge(self.table.now, period)
        if device.drive.unconfirmed and not device.drive.reported and passed >= STOP_LIMIT:
            device.drive.reported = True
            self.events.publish(number, NOT_STOPPED, <int64_t>self.table.arena[TICK])
        elif before and not device.drive.unconfirmed and device.drive.reported:
            device.drive.reported = False
            self.events.publish(number, STOPPED, <int64_t>self.table.arena[TICK])

    cdef void disable_again(self, int number) noexcept nogil:
        """Take out a drive that cannot be armed again."""
        cdef Device *device = &self.table.devices[number]
        self.live.assume(device.drive.disabled, 1.0)
        self.live.show(self.events.layout)
        self.begin_out(number)
        device.zeroing.runs = False
        self.events.publish(number, NOT_RETURNED, <int64_t>self.table.arena[TICK])

    cdef bint is_fit(self, int number) noexcept nogil:
        """Return whether a drive that has replied may be commanded without an immediate fault."""
        cdef Device *device = &self.table.devices[number]
        if (self.table.now - device.reply_time) * 1e-9 > 0.5 * device.timeout and device.timeout > 0.0:
            return False
        if device.fault >= 0 and self.table.arena[device.fault] != 0.0:
            return False
        return self.limit_exceeded(number) == OK

    cdef int permission(self, int number) noexcept nogil:
        """Return OK if a drive may be commanded again, UNCLEAR_POSE if not yet, or HUNG without the devices.

        `may_return` is Python, and may wait for the GIL: the devices are released meanwhile, as around a step.
        """
        cdef Device *device = &self.table.devices[number]
        cdef int permitted = UNCLEAR_POSE
        if not self.table.has_answered(device) or not self.is_fit(number):
            return UNCLEAR_POSE
        if self.may_return is None or not device.drive.silent:
            return OK
        release(self.handover)
        with gil:
            try:
                if self.may_return(self.table.schedule.devices[number].name):
                    permitted = OK
            except Exception:
                pass
        return permitted if acquire(self.handover) else HUNG

    cdef int limit_exceeded(self, int number) noexcept nogil:
        """Return OK, or which limit a drive exceeds: of temperature, position or velocity."""
        cdef Watched *watched
        cdef const double *arena = self.table.arena
        cdef double position
        cdef int place
        for place in range(self.drives.count):
            watched = &self.drives.drives[place]
            if watched.device != number:
                continue
            if watched.temperature >= 0 and arena[watched.temperature] >= watched.hot:
                return TOO_HOT
            if watched.motion.position < 0:
                continue
            position = arena[watched.motion.position]
            if not isfinite(position):
                return blame(&watched.motion, IMPLAUSIBLE, POSITION, position, NAN)
            if not (watched.motion.low - 1e-3 * TRAVEL_MARGIN <= position
                    <= watched.motion.high + 1e-3 * TRAVEL_MARGIN):
                return blame(&watched.motion, OVER_TRAVEL, POSITION, position,
                    watched.motion.low if position < watched.motion.low else watched.motion.high)
            if watched.motion.velocity >= 0 and not fabs(arena[watched.motion.velocity]) <= watched.motion.fastest:
                return blame(
                    &watched.motion, OVERSPEED, VELOCITY, arena[watched.motion.velocity], watched.motion.fastest)
        return OK

    cdef int send(self, int64_t now) noexcept nogil:
        """Send the frames of the drives that are taken out or return.

        A drive in OUT that does not reply gets its frames twice a second, so that they do not fill the queue of a bus
        without another node.
        """
        cdef int number
        cdef int status = OK
        cdef int64_t period = <int64_t>(1e9 * self.table.arena[PERIOD])
        cdef Device *device
        cdef Batch *batch
        for number in range(self.table.count):
            device = &self.table.devices[number]
            if self.buses.layout != NULL:                          # the guardian does not damp them
                set_out(self.buses.layout, number, device.drive.state >= OUT)
            if device.drive.state == DAMPED:                     # in force until the next tick, which may be late
                batch = <Batch *>(<SpeedBands>device.bands).choose(
                    now + 2 * period, damping_transit(device))
                status |= self.buses.send(device.bus, batch.frames, batch.count, now, False)
                note_asked(&device.transit, batch.count, now, now, -1)
            elif device.drive.state == OUT and (
                    now - device.drive.since < STOP_LIMIT or now - device.reply_time < STOP_LIMIT
                    or now - device.drive.sent >= SILENT_ROUND):
                status |= self.disable(device, now, device.drive.unconfirmed)
            elif device.drive.state == RETURNING and now - device.drive.since >= RETURN_DELAY:
                status |= send_round(self.table, self.buses, self.events, number, True, now)
        return self.buses.status(status, False)

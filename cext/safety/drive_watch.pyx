# cython: freethreading_compatible=True
"""Monitor of each actuator: RMS torque, which heats it, temperature, and motion.

    RMS          √(Σ τ² dt / window) over the last window, in 64 buckets; time before the run counts as zero
    warn         an event and a count
    saturate     from 90 % to 100 % of the rated torque the limit decreases to the rated torque; while the window fills,
                 the RMS may still exceed it by a factor of √2, as earlier torque counts until it leaves the window
    throttle     from 90 % to 110 % the limit decreases to zero
    disable      above the rated torque the run ends
    silent       no action

    temperature  an event from `warm` on; from `derate` to `hot` the limit decreases to zero; at `hot` the run ends
    power        where it is limited, the limit decreases with the measured speed

    motion       cext/safety/motion_watch.pxd, from the first reply of a drive on; an event where the angle is at an end of
                 the range that its frames can carry

The remaining fraction of a limit, and of stiffness and damping, is written to the drive's kernel before it encodes.
"""

from libc.math cimport INFINITY, NAN, fabs, fmax, fmin, log, sqrt
from libc.stdlib cimport calloc, free
from libc.string cimport memset

from cext.abi cimport OK, PERIOD
from cext.status cimport RMS_TORQUE, TOO_HOT
from cext.safety.motion_watch cimport (
    NOTHING, POSITION, TEMPERATURE, TORQUE, VELOCITY, forget_motion, judge_jump, judge_motion, judge_uncommanded,
    judge_values, stiff,
)
from cext.safety.jump_watch cimport is_at_end, set_acceleration
from cext.memory.event_template cimport EventTemplate
from cext.safety.torque_watch cimport forget_uncommanded

MODES = {"silent": SILENT_MODE, "warn": WARN, "saturate": SATURATE, "throttle": THROTTLE, "disable": DISABLE}
ABOUT = {NOTHING: None, TEMPERATURE: "temperature", POSITION: "position", VELOCITY: "velocity", TORQUE: "torque"}


cdef class DriveWatch:
    """Monitor of the devices of a `graph.Schedule` that request it."""

    def __cinit__(self, schedule):
        cdef Watched *drive
        watched = [(index, device) for index, device in enumerate(schedule.devices) if device.watch is not None]
        self.count, self.failed = len(watched), -1
        self.drives = <Watched *>calloc(max(1, self.count), sizeof(Watched))
        self.templates = <void **>calloc(max(1, self.count) * EVENT_KINDS, sizeof(void *))
        self.names, self.news = [], []
        for place, (index, device) in enumerate(watched):
            drive, steps, watch = &self.drives[place], device.watch, device.watch.watch
            drive.device, drive.torque, drive.temperature, drive.rms, drive.law_limit, drive.full = (
                index, steps.torque, steps.temperature, steps.rms, steps.law_limit, steps.full)
            drive.mode, drive.rated = MODES[watch.mode], watch.rated
            drive.limit, drive.window, drive.power = watch.limit, watch.window, watch.power
            drive.warm, drive.derate, drive.hot = watch.warm, watch.derate, watch.hot
            self.place_motion(drive, steps)
            self.names.append(device.name)
            for words in watch.words():
                self.news.append(EventTemplate({"event": "warning", "device": device.name, "what": words}))
                self.templates[len(self.news) - 1] = <void *>self.news[len(self.news) - 1]

    cdef void place_motion(self, Watched *drive, steps):
        """Set the slots and bounds of a drive's motion."""
        cdef Motion *m = &drive.motion
        motion = steps.watch.motion
        m.torque = steps.torque
        m.position = m.velocity = m.stiffness = m.damping = m.law = m.current = m.gains = -1
        if motion is None:
            return
        m.position, m.velocity, m.stiffness, m.damping = steps.position, steps.velocity, steps.stiffness, steps.damping
        m.law, m.current, m.gains, m.current_scale = steps.law, steps.current, steps.gains, motion.current_scale
        low, high = motion.range or (float("-inf"), float("inf"))
        m.low, m.high = low, high
        m.fastest, m.limit, m.accuracy, m.rated = motion.fastest, motion.limit, motion.accuracy, steps.watch.rated
        m.offset, m.position_end, m.velocity_end = motion.offset, motion.position_end, motion.velocity_end
        m.acceleration.bound, m.acceleration.codes = motion.acceleration, 2.0 * motion.velocity_code
        m.jump.step, m.jump.offset = motion.position_code, motion.offset
        m.jump.position_end, m.jump.velocity_end = motion.position_end, motion.velocity_end
        set_acceleration(&m.jump, motion.acceleration)
        m.velocity_scale.tolerance = log(1.0 + motion.velocity_tolerance)
        m.torque_scale.tolerance = log(1.0 + motion.torque_tolerance)

    def __dealloc__(self):
        free(self.drives)
        free(self.templates)

    @property
    def found(self) -> list[dict[str, Any]]:
        """Return a dict for each drive.

        Keys: device (path), rms (N·m) and temperature (°C) maxima, number of ticks of each warning, and about, value
        and bound of the newest motion fault.
        """
        return [
            {"device": self.names[i], "rms": self.drives[i].largest, "temperature": self.drives[i].hottest,
                "rms_ticks": self.drives[i].ticks[RMS_EVENT],
             "warm_ticks": self.drives[i].ticks[WARM_EVENT], "derated_ticks": self.drives[i].ticks[DERATED_EVENT],
             "acceleration_ticks": self.drives[i].ticks[ACCELERATION_EVENT],
             "transit_ticks": self.drives[i].ticks[TRANSIT_EVENT], "end_ticks": self.drives[i].ticks[END_EVENT],
             "about": ABOUT[self.drives[i].motion.about],
             "value": self.drives[i].motion.value, "bound": self.drives[i].motion.bound}
            for i in range(self.count)
        ]

    cdef void reset(self) noexcept nogil:
        cdef int i
        cdef Watched *drive
        self.failed = -1
        for i in range(self.count):
            drive = &self.drives[i]
            memset(drive.squares, 0, sizeof(drive.squares))
            memset(drive.ticks, 0, sizeof(drive.ticks))
            drive.filled = drive.past = drive.largest = 0.0
            drive.hottest = -1e300
            drive.place = 0
            drive.left = 1.0
            drive.motion.about = NOTHING
            drive.off = drive.out = drive.stays_out = drive.replied = False
            drive.motion.early = drive.motion.free = False
            forget_motion(&drive.motion)
            forget_uncommanded(&drive.motion.uncommanded)

    cdef uint64_t share(self, SharedLayout *layout):
        """Set the shared state for events, or NULL. Returns the ring bytes that one tick may need."""
        self.layout = layout
        return sum(8 + (<EventTemplate>news).size() for news in self.news)

    cdef int look(self, double *arena, int64_t tick, double dt) noexcept nogil:
        """Check once a tick, between receiving and commanding. Returns OK, or the fault of the device `failed`."""
        cdef int i
        cdef int status = OK
        for i in range(self.count):
            status = self.look_at(&self.drives[i], arena, tick, dt)
            if status != OK:
                self.failed = self.drives[i].device
                return status
        return OK

    cdef int look_at(self, Watched *drive, double *arena, int64_t tick, double dt) noexcept nogil:
        """Check one drive, from its first reply on."""
        cdef double temperature = arena[drive.temperature] if drive.temperature >= 0 else NAN
        cdef int status = OK
        drive.motion.beyond = False
        if not drive.replied:
            return OK
        if drive.out:
            forget_motion(&drive.motion)
            return judge_uncommanded(&drive.motion, 0.0, arena[drive.torque], drive.reply_time) if (
                drive.stays_out and drive.motion.position >= 0) else OK
        if drive.off:
            forget_motion(&drive.motion)
        else:
            status = judge_values(&drive.motion, arena, temperature)
        if not drive.off and status == OK:
            status = judge_jump(&drive.motion, arena, drive.reply_time, drive.transit, not drive.motion.early)
        if not drive.off and status == OK and arena[PERIOD] > 0.0:
            status = judge_motion(&drive.motion, arena, drive.reply_time, arena[PERIOD], drive.left, drive.late)
            if drive.late and stiff(&drive.motion, arena):
                self.note(drive, TRANSIT_EVENT, tick)
            if drive.motion.beyond:
                self.note(drive, ACCELERATION_EVENT, tick)
            if drive.motion.position >= 0 and is_at_end(&drive.motion.jump, arena[drive.motion.position]):
                self.note(drive, END_EVENT, tick)
        return status if status != OK else self.look_at_heat(drive, arena, temperature, tick, dt)

    cdef int look_at_heat(self, Watched *drive, double *arena, double temperature, int64_t tick,
            double dt) noexcept nogil:
        cdef double torque = arena[drive.torque]
        cdef double bucket = drive.window / (BUCKETS - 1)
        cdef double left = 1.0
        cdef double rms, floor, cool
        cdef int i
        dt = min(dt, drive.window)          # the torque of a longer tick fills the window
        drive.squares[drive.place] += torque * torque * dt
        drive.filled += dt
        if drive.filled >= bucket:
            for i in range(BUCKETS):
                if drive.filled < bucket:
                    break
                drive.filled -= bucket
                drive.place = (drive.place + 1) % BUCKETS
                drive.squares[drive.place] = 0.0
            drive.past = 0.0
            for i in range(BUCKETS):
                drive.past += drive.squares[i]
        rms = arena[drive.rms] = sqrt((drive.past + drive.squares[drive.place]) / drive.window)
        if rms > drive.largest:
            drive.largest = rms
        if drive.mode == SATURATE and drive.limit > drive.rated and rms > 0.9 * drive.rated:
            floor = drive.rated / drive.limit
            left = floor if rms >= drive.rated else floor + (1.0 - floor) * (drive.rated - rms) / (0.1 * drive.rated)
            self.note(drive, RMS_EVENT, tick)
        elif drive.mode == THROTTLE and rms > 0.9 * drive.rated:
            left = 0.0 if rms >= 1.1 * drive.rated else (1.1 * drive.rated - rms) / (0.2 * drive.rated)
            self.note(drive, RMS_EVENT, tick)
        elif (drive.mode == WARN or drive.mode == DISABLE) and rms > drive.rated:
            self.note(drive, RMS_EVENT, tick)
            if drive.mode == DISABLE:
                return RMS_TORQUE
        if temperature > drive.hottest:
            drive.hottest = temperature
        if temperature >= drive.warm:
            self.note(drive, WARM_EVENT, tick)
        if temperature >= drive.derate:
            self.note(drive, DERATED_EVENT, tick)
            if temperature >= drive.hot:
                return TOO_HOT
            cool = (drive.hot - temperature) / (drive.hot - drive.derate)
            left = cool if cool < left else left
        if drive.law_limit >= 0:
            drive.left = left
            if drive.power < INFINITY:
                left = fmin(left, drive.power / fmax(fabs(arena[drive.motion.velocity]) * drive.limit, 1e-300))
            arena[drive.law_limit] = left * drive.full
        return OK

    cdef void note(self, Watched *drive, int kind, int64_t tick) noexcept nogil:
        if drive.ticks[kind] == 0:
            (<EventTemplate>self.templates[(drive - self.drives) * EVENT_KINDS + kind]).publish(self.layout, tick)
        drive.ticks[kind] += 1

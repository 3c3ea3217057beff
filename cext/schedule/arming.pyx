# cython: freethreading_compatible=True
"""Arming and halting of the executor.

    begin      set the zero of the run's time
    arm        ask every device for its state until all have replied, without enabling an actuator
    look over  show the replies, and ask for new ones until confirmation
    enable     send enable and zero torque until every actuator has replied
    start      start blocks from the present measurement
    halt       raise the fence; send zero torque and disable until every device has confirmed
"""

from libc.stdint cimport int32_t, int64_t

from cext.abi cimport OK, PERIOD
from cext.status cimport NO_ANSWER, PYTHON_ERROR, UNCLEAR_POSE
from cext.schedule.devices cimport Blame
from cext.clock.histogram cimport add
from cext.schedule.live cimport apply_changes, record_request
from cext.ring.mailbox cimport CONFIRM
from cext.ring.operator cimport NO_CONSENT
from cext.clock.deadline_clock cimport clock, monotonic, suspended_time
from cext.memory.shared_state cimport ARMING, READY, STOPPING, SharedLayout, load_u64, store_i64
from cext.posix cimport CLOCK_REALTIME
from cext.safety.thresholds cimport (
    ARM_HOLD, LOOP_STALL_PERIODS, PAUSE_LIMIT, SIGNAL_HANDLER_PERIOD, STOP_ROUND, STOP_ROUND_MINIMUM, ZERO_LIMIT)


cdef class Arming:
    """Base class of cext.schedule.executor.Executor for arming and halting."""

    cdef void begin(self) noexcept nogil:
        """Set the zero of the run's time, one period from now."""
        self.began = self.watchdog.zero = monotonic() + self.clock.period
        self.first_tick = 0
        self.control.devices.buses.begin(self.began)
        if self.layout == NULL:
            return
        self.layout.wall = clock(CLOCK_REALTIME) + self.clock.period
        self.layout.began = self.began
        self.layout.asleep = suspended_time()
        self.layout.paused = self.layout.pause_limit = 0
        if self.publisher.guard > 0 and not self.virtual:
            self.layout.pause_limit = max(LOOP_STALL_PERIODS * self.clock.period, <int64_t>PAUSE_LIMIT, self.grace)
        self.layout.first_tick = 0

    cdef int arm(self, double timeout) noexcept nogil:
        """Ask every device, wait for the operator, and enable the actuators. Returns OK also after a signal.

        First close the relays and wait for the drives to start. Nothing enables an actuator before the operator has
        confirmed, and before its settings were read back. Without an operator and a guardian, as in simulation, each is
        enabled as soon as its settings were read back.

        timeout : s for the replies to each of the phases. A drive whose zero is set gets more time
        """
        cdef bint looked = self.answered is not None or (self.replay is not None and self.replay.confirmed >= 0)
        cdef bint each = not looked and not self.control.devices.table.alone
        cdef int status
        self.publisher.beat(monotonic())
        self.publisher.set_state(ARMING)
        if self.control.devices.table.count == 0:
            return OK
        self.control.arena[PERIOD] = 1.0 / self.clock.rate
        self.point, self.rounds = -1, 0
        self.control.devices.arming.begin(looked)
        if each:
            self.control.devices.arming.enable_answered()
        status = self.next_round()
        if status == OK:
            status = self.close_relays()
        if status == OK:
            status = self.await_answers(timeout, each)
        if status == OK and not each:
            if looked:
                status = self.look_over_again() if self.answered is None else self.look_over()
            if status == OK and looked:
                self.control.devices.arming.ask_again()
                status = self.await_answers(timeout, False)
            if status == OK:
                status = self.control.devices.arming.fitness()
            if status == OK:
                self.control.devices.arming.enable()
                status = self.await_answers(timeout, False)
        if status == OK and looked and self.control.devices.arming.was_unheard():
            status = self.permission()                         # of a joint whose drive replies only when enabled
        if status != OK:
            return OK if status == CUT else status
        self.control.devices.table.arming = False
        self.first_tick = self.now                             # tick 0 begins with the replies just received
        if self.layout != NULL:
            self.layout.first_tick = self.now
        self.body.set_clock(0, -1, 0)
        return self.start_from_here()

    cdef int next_round(self) noexcept nogil:
        """Wait for the next round of arming, receive its replies, and check them.

        Returns OK, CUT if a signal or the reader ends the run, or a fault.
        """
        cdef int status
        if self.replay is not None and self.rounds < self.replay.drains:
            self.now = self.replay.drained[self.rounds]
        elif self.replay is not None:
            self.now += self.clock.period
        else:
            self.point = self.next_point(self.point, 0)
            self.now = self.clock.grid(self.point)
        if not self.virtual:
            self.clock.sleep_until(self.began + self.now)
        if self.signals.caught[0] or not self.publisher.make_room(False):
            return CUT
        self.rounds += 1
        status = self.receive_while_arming()
        return status if status != OK else self.control.devices.watch(self.now)

    cdef int finish_round(self, bint set_up) noexcept nogil:
        """Send the frames of a round, and advance the plant. set_up : as of DeviceArming.send"""
        cdef int status = self.control.devices.arming.send(set_up, self.now)
        return status if status != OK else self.body.advance_plant(self.now)

    cdef int close_relays(self) noexcept nogil:
        """Close the relays, and wait until the drives behind them have started."""
        cdef int status = OK
        while status == OK and self.now < self.control.devices.arming.start_time:
            status = self.control.devices.arming.send_relays(self.now)
            if status == OK:
                status = self.body.advance_plant(self.now)
            if status == OK:
                status = self.next_round()
        return status

    cdef int await_answers(self, double timeout, bint each) noexcept nogil:
        """Send the frames of this phase of arming, one round a period, until every device has replied.

        each : whether a device that has answered is enabled although others have not
        """
        cdef int64_t allowed = <int64_t>(1e9 * min(timeout, 1e9)) + self.clock.period
        cdef int64_t limit = self.now + allowed
        cdef int status
        while True:
            if each and self.control.devices.arming.enable_answered():
                limit = self.now + allowed
            if self.control.devices.arming.all_answered():
                return OK
            if self.now > limit and not (
                    self.now <= limit + ZERO_LIMIT and self.control.devices.arming.only_zeros_are_due()):
                return NO_ANSWER
            status = self.finish_round(True)
            if status == OK:
                status = self.next_round()
            if status != OK:
                return status

    cdef int start_from_here(self) noexcept nogil:
        """Start the blocks; this may hang, as a tick may, and take longer."""
        cdef int status
        self.watchdog.begin_work(monotonic() + self.watchdog.start_allowance)
        status = self.control.start_from_here()
        self.watchdog.end_work()
        return status

    cdef int look_over(self) noexcept nogil:
        """Show the replies, and ask for new ones until the operator confirms.

        Every device must keep replying without a fault. Where no confirmation is asked for, wait for the page whose loss
        ends the run. Returns OK, CUT or a fault.
        """
        cdef int status
        cdef bint confirmed = not self.confirm and self.publisher.may_arm(monotonic())
        cdef int32_t consent = NO_CONSENT
        self.publisher.ask()                                         # the table has the number of the question
        status = self.call_answered()
        if status == OK and confirmed:
            status = self.permission()
        if not confirmed:
            self.publisher.set_state(READY)
        self.forget_input()
        while status == OK and not confirmed:
            status = self.finish_round(False)
            if status == OK:
                status = self.next_round()
            if status == OK:
                consent = self.publisher.consent()
            if status == OK and (
                    consent != NO_CONSENT or self.is_held() if self.confirm else self.publisher.may_arm(monotonic())):
                status = self.permission()
                confirmed = status == OK
                self.forget_input()
                if confirmed and consent != NO_CONSENT:
                    record_request(self.layout, CONFIRM, consent, load_u64(&self.layout.operator.process), -1)
                if status == UNCLEAR_POSE and self.confirm:
                    status = OK                                    # the operator may move the joint and confirm again
        if status == OK:
            self.publisher.set_state(ARMING)
            if self.publisher.pages:
                self.publisher.watch_page()
        return status

    cdef void forget_input(self) noexcept nogil:
        """Let the input for arming count only from the next time on that it is inactive."""
        self.released = False
        self.pressed = -1

    cdef bint is_held(self) noexcept nogil:
        """Return whether the input for arming has been active for ARM_HOLD, and was inactive before.

        An input that is active from the start, such as a button that sticks, has no effect. Both must be seen: NaN is
        neither, and the time between two rounds counts only if the input is active in both.
        """
        cdef double value
        if self.arm_slot < 0:
            return False
        value = self.control.arena[self.arm_slot]
        if value > 0.5:
            if self.pressed < 0:
                self.pressed = self.now
            return self.released and self.now - self.pressed >= ARM_HOLD
        self.pressed = -1
        self.released = value <= 0.5                               # not NaN
        return False

    cdef int look_over_again(self) noexcept nogil:
        """Repeat `look_over` of a recorded run, at its times."""
        cdef int status = OK
        while status == OK and self.rounds < self.replay.confirmed:
            status = self.finish_round(False)
            if status == OK:
                status = self.next_round()
        return status

    cdef int call_answered(self) noexcept nogil:
        with gil:
            try:
                self.answered()
            except BaseException as error:
                self.control.error = error
                return PYTHON_ERROR
        return OK

    cdef int permission(self) noexcept nogil:
        """Return OK, UNCLEAR_POSE if the position of a joint is ambiguous, or PYTHON_ERROR."""
        if self.permitted is None:
            return OK
        with gil:
            try:
                return OK if self.permitted() else UNCLEAR_POSE
            except BaseException as error:
                self.control.error = error
                return PYTHON_ERROR

    cdef int receive_while_arming(self) noexcept nogil:
        cdef int status = self.publisher.attend(monotonic())
        if status == OK:
            status = apply_changes(self.control.live, self.layout, -1, 0.0)
        if status == OK:
            status = self.control.devices.receive(self.now)
        return status

    cdef int64_t next_point(self, int64_t point, int64_t zero) noexcept nogil:
        """Return the next grid point, in real time one in the future. zero : ns from the begin of the run to point 0"""
        if self.virtual:
            return point + 1
        return self.point_after_stall(
            point + 1, max(point, self.clock.newest(monotonic() - self.began - zero)) + 1)

    cdef bint is_stall(self, int64_t point, int64_t due) noexcept nogil:
        """Return whether the host stalls a simulation for so long that emulated devices would time out.

        point : next grid point; due : the one at which it would run
        """
        return due > point and self.stall > 0 and (due - point + 1) * self.clock.period >= self.stall

    cdef int64_t point_after_stall(self, int64_t point, int64_t due) noexcept nogil:
        """Return `point` after a stall, when it begins in place of `due`, as simulated time stands still; else `due`."""
        if not self.is_stall(point, due):
            return due
        self.began += self.clock.grid(due) - self.clock.grid(point)
        if self.layout != NULL:
            store_i64(&self.layout.began, self.began)
        return point

    cdef int advance_plant_to(self, int64_t tick) noexcept nogil:
        """Advance the plant through skipped ticks before this one, until a signal ends the run."""
        cdef int64_t skipped = self.previous + 1
        cdef int status = OK
        while self.plant is not None and skipped < tick and status == OK and not self.signals.caught[0]:
            status = self.body.advance_plant(self.first_tick + self.clock.grid(skipped))
            skipped += 1
        return status

    cdef void keep_signals(self, int64_t tick) noexcept nogil:
        """Install the signal handlers again after Python steps, which may have replaced or blocked them."""
        if self.control.gil_taken != self.signals_kept and (not self.virtual or tick % SIGNAL_HANDLER_PERIOD == 0):
            self.signals.install(NULL, NULL)
            self.signals_kept = self.control.gil_taken

    cdef void halt(self, double timeout) noexcept nogil:
        """Raise the fence, then send zero torque and disable until every device has confirmed or time is up.

        timeout : s after the damping; below 0 for one round only

        Devices with damping are damped first if they may have been under torque.
        """
        cdef int64_t round = max(STOP_ROUND_MINIMUM, min(self.clock.period, STOP_ROUND))
        cdef int64_t now = self.now + self.clock.period if self.virtual else monotonic() - self.began
        cdef int64_t damping = self.control.devices.stop.longest_damping
        cdef int64_t since = 0 if self.tick >= 0 and not self.halted else damping     # ns since the begin of the stop
        cdef int64_t limit = damping + <int64_t>(min(timeout, 1e9) * 1e9) if timeout >= 0.0 else 0
        cdef int64_t began = now - since                           # ns from the begin of the run
        cdef int64_t patience = monotonic() + 2 * limit            # with a stop of the guardian
        cdef int64_t due
        self.control.keep_values()                                 # later replies are not a cause of the fault
        if self.plant is not None:
            self.plant.keep_values()
        cdef Blame failed = self.control.devices.failed()           # later failures are not the cause
        self.publisher.raise_fence()
        self.publisher.set_state(STOPPING)
        self.body.advance_plant_until(now)                         # it moves under the last commands
        # replies to them confirm nothing; the last tick left space for them
        self.control.devices.receive(now)
        self.control.devices.stop.begin(now)
        while self.control.devices.table.count > 0:
            self.publisher.beat(monotonic())
            self.publisher.make_room(True)
            while monotonic() < patience and self.publisher.guardian_stops(monotonic()):
                # one sender at a time: begin again after it, without the damping
                self.publisher.beat(monotonic())
                self.clock.sleep_until(monotonic() + round)
                now = monotonic() - self.began
                began, since = now - damping, damping
                self.control.devices.receive(now)
                self.control.devices.stop.begin(now)
            due = began + self.control.devices.stop.send(since, now, round)
            if limit == 0 or (self.carried and self.publisher.guardian_is_gone(monotonic())):
                break                                              # the caller continues it
            self.body.advance_plant_until(due)
            if not self.virtual:
                self.clock.sleep_until(self.began + due)
            now = due if self.virtual else monotonic() - self.began
            since = now - began
            self.control.devices.receive(now)
            if self.control.devices.stop.is_confirmed(since, now, round) or since >= limit:
                break
        self.control.devices.blame(failed)
        self.halted = True
        if self.virtual:
            self.now = now

    cdef void count(self, int64_t tick, int64_t awaited, int64_t late, int64_t began) noexcept nogil:
        """Count a completed tick in the shared state.

        awaited : grid point for lateness and period: `tick`, or an earlier one that was missed
        late : ns after `tick`
        """
        cdef SharedLayout *layout = self.layout
        cdef int64_t ended = self.control.laps.last if self.control.laps != NULL else monotonic()
        add(&layout.execution, ended - began, tick)
        cdef int64_t behind = late + self.clock.grid(tick) - self.clock.grid(awaited)
        add(&layout.lateness, behind, tick)
        if not self.virtual and self.previous >= 0:
            add(&layout.period, behind - self.late if behind > self.late else self.late - behind, tick)
        layout.gil_taken = self.control.gil_taken + self.control.live.gil_taken + (self.plant.gil_taken
            if self.plant is not None else 0)
        layout.sleeps, layout.spins = self.clock.sleeps, self.clock.spins
        store_i64(&layout.tick, tick)
        store_i64(&layout.ticks, layout.ticks + 1)

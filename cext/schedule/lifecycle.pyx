# cython: freethreading_compatible=True
"""Handling of a fault: its cause, and the wait behind the fence until the run is armed again.

While it waits, every tick is computed, and only disable is sent.
"""

import sys

from libc.stdint cimport int32_t, int64_t

from cext.abi cimport AUTHORITY, ESTOP, FIRST_OWN_STATUS, OK
from cext.status cimport FENCED, HUNG, NO_ANSWER, OVERRUN, PAGE_LOST, PYTHON_ERROR, SILENT, SUSPENDED, UNGUARDED
from cext.schedule.live cimport STOP_WANTED, apply_changes, record_request
from cext.schedule.program cimport run_phase
from cext.ring.mailbox cimport REARM
from cext.ring.operator cimport NO_CONSENT
from cext.clock.deadline_clock cimport monotonic
from cext.memory.shared_state cimport ARMING, load_u64
from cext.safety.thresholds cimport DISABLE_CONFIRM_LIMIT

from cext.schedule.outcome import SURVIVED, Outcome, name_of
from cext.clock.stopwatch import names


cdef class Waiting(Arming):
    """Base class of cext.schedule.executor.Executor for faults."""

    cdef int request(self, slots) except -1:
        if len(slots) > REQUESTS:
            raise ValueError("at most %d inputs can request arming again, not %d" % (REQUESTS, len(slots)))
        self.request_count = len(slots)
        for index, slot in enumerate(slots):
            self.request_slots[index] = slot
        return 0

    cdef int cause(self, int status) noexcept nogil:
        """Return why a run ends.

        A hung tick may return any status, and drives seem silent if the guardian that carries their frames is late.
        """
        if self.watchdog.has_bitten():
            self.hung = monotonic() - self.watchdog.began + (self.watchdog.start_allowance if self.tick < 0 else 0)
            self.watchdog.dismiss()
            self.control.publish_held()
            return HUNG
        if status == SILENT and self.carried and self.publisher.guardian_is_late():
            self.control.devices.table.failed = -1
            return UNGUARDED
        # whatever it was noticed by: devices without power, late ticks, another process's fence
        return SUSPENDED if status > OK and self.publisher.was_suspended() else status

    cdef bint is_survived(self, int status):
        """Return whether a run with this fault may be armed again."""
        if self.plant is not None and self.plant.culprit is not None:
            return False
        return self.tick >= 0 and not self.signals.caught[0] and (status in SURVIVED or status >= FIRST_OWN_STATUS)

    cdef object outcome(self, int status, tuple unanswered=()):
        """Return the Outcome of a run that ended now."""
        error = self.control.error or self.control.live.error
        culprit = self.control.culprit if status != OK else None
        if self.plant is not None and culprit is None and error is None and status != OK:
            error, culprit = self.plant.error, self.plant.culprit
        if status == OVERRUN:
            culprit = self.body.watch.name(self.to_blame)
        if status == HUNG:
            culprit = names(self.control.schedule)[self.watchdog.at] if self.watchdog.at >= 0 else self.control.culprit
            error = error if culprit == self.control.culprit else None      # a later step was interrupted instead
        silent = tuple(self.control.devices.reports.silent)
        if status == NO_ANSWER and self.tick >= 0:
            unanswered = silent
        return Outcome(
            name_of(status), culprit, self.tick, self.signals.caught[0], error, silent, unanswered,
            hung=self.hung * 1e-9)

    cdef void call_notify(self, str what, outcome):
        """Call `notify`. Its exceptions do not affect the run."""
        self.publisher.attend_fenced(monotonic())
        if self.notify is not None:
            try:
                self.notify(what, outcome)
            except Exception:
                sys.excepthook(*sys.exc_info())
        self.publisher.attend_fenced(monotonic())

    cdef void notify_standing(self, str what, int standing) noexcept nogil:
        with gil:
            self.call_notify(what, self.outcome(standing))

    cdef int wait(self, int64_t ticks, double arming_timeout) noexcept nogil:
        """Wait behind the fence for a request to arm again, after a whole tick in which all conditions of arming were
        met.

        Then arms, and returns OK or why that failed. Returns ENDED or STOP_WANTED if the run ends first, or a fault
        that cannot be survived.
        """
        cdef int64_t tick = max(self.tick, self.clock.newest(
            (self.now if self.virtual else monotonic() - self.began) - self.first_tick)) + 1
        cdef int64_t began
        cdef int status
        cdef int standing = NO_ANSWER
        cdef int32_t consent
        cdef bint high = True                                      # only a rising input is a request
        cdef bint before
        # from when a missing reply prevents arming
        cdef int64_t judged = self.first_tick + self.clock.grid(tick) + DISABLE_CONFIRM_LIMIT
        self.control.devices.stop.begin(self.now)
        self.previous = tick - 1
        while ticks < 0 or tick < ticks:
            if not self.virtual:
                self.clock.wait(self.began + self.first_tick + self.clock.grid(tick))
            if self.signals.caught[0] or not self.publisher.make_room(False):
                return ENDED
            began = monotonic()
            self.tick = tick
            self.now = self.first_tick + self.clock.grid(tick)
            self.body.watch.begin(tick, began)
            status = self.publisher.attend_fenced(began)
            if status != OK:
                return status
            consent = self.publisher.consent() if standing != NO_ANSWER or self.now > judged else NO_CONSENT
            if consent != NO_CONSENT:
                standing = self.permission() if standing == OK else standing
                if standing == OK:
                    record_request(self.layout, REARM, consent, load_u64(&self.layout.operator.process), tick)
                    return self.arm_again(tick, arming_timeout)
                self.notify_standing("refused", standing)
            self.late = 0 if self.virtual else began - self.began - self.first_tick - self.clock.grid(tick)
            standing = self.look_around(tick, standing, &status)
            if status != OK or (self.publisher.records and not self.publisher.push_row(tick)):
                return status if status != OK else ENDED
            if self.layout != NULL:
                self.count(tick, tick, self.late, began)
            self.keep_signals(tick)
            before, high = high, self.input_requests(high)
            if high and not before:
                standing = self.permission() if standing == OK else standing
                if standing == OK:
                    return self.arm_again(self.next_point(tick, self.first_tick), arming_timeout)
                self.notify_standing("refused", standing)
            self.previous = tick
            tick = self.next_point(tick, self.first_tick)
        return ENDED

    cdef bint input_requests(self, bint before) noexcept nogil:
        """Return whether an input requests arming again; `before`, the last answer, without inputs or while one is NaN."""
        cdef bint known = self.request_count > 0
        cdef int index
        cdef double value
        for index in range(self.request_count):
            value = self.control.arena[self.request_slots[index]]
            if value > 0.5:
                return True
            known = known and value <= 0.5
        return before and not known

    cdef int look_around(self, int64_t tick, int before, int *status) noexcept nogil:
        """Run one tick and send only disable.

        Returns what prevents arming, OK for nothing; sets `status` if the run cannot continue.

        before : what prevented arming in the previous tick
        """
        cdef int computed
        cdef int standing = OK
        self.forgive(before)
        self.advance_plant_to(tick)
        self.body.set_clock(tick, self.previous, self.late)
        self.control.arena[AUTHORITY] = 0.0
        self.control.devices.table.waiting = True
        computed = apply_changes(self.control.live, self.layout, tick, (tick - self.previous) / self.clock.rate)
        if computed == STOP_WANTED:
            status[0] = computed
            return computed
        status[0] = self.control.devices.receive(self.now)
        if status[0] == ESTOP:
            status[0] = OK                                         # the device remembers it and refuses commands
        if status[0] != OK:
            return status[0]
        if computed == OK:
            computed = run_phase(self.control, &self.control.output, tick, self.previous)
        if computed == OK:
            computed = self.control.devices.command()              # encoded, but not sent
        if computed == OK:
            computed = run_phase(self.control, &self.control.update, tick, self.previous)
        self.control.publish_held()
        self.control.devices.stop.judge(self.now, self.clock.period)
        standing = self.control.devices.watch(self.now)
        if standing == OK:
            standing = computed if computed != OK or self.control.devices.arming.all_answered() else NO_ANSWER
        if standing == OK and self.publisher.link != 0 and not self.publisher.may_arm(monotonic()):
            self.publisher.note_lost_page()
            standing = PAGE_LOST
        status[0] = self.control.devices.stop.send_disable(self.now)
        if status[0] == OK:
            status[0] = self.body.advance_plant(self.now)
        return standing

    cdef void forgive(self, int status) noexcept nogil:
        """Clear the causes of earlier failures."""
        self.control.devices.table.failed = self.control.devices.buses.failed = -1
        self.control.failed.step = -1
        if status == OK:
            return
        with gil:
            self.control.error = None
            self.control.live.forgive()

    cdef int arm_again(self, int64_t tick, double timeout) noexcept nogil:
        """Arm as at the begin, from grid point `tick` on; the loop may continue at `armed`.

        The fence is lowered only here.
        """
        cdef int64_t rounds = <int64_t>min(timeout * self.clock.rate, 1e15) + 1
        cdef int64_t round
        cdef int status
        self.notify_standing("rearm", OK)
        self.forgive(PYTHON_ERROR)
        if not self.publisher.lower_fence():
            return FENCED
        self.halted = False
        self.publisher.set_state(ARMING)
        if self.publisher.link != 0:
            self.publisher.watch_page()
        self.overrun.reset()
        for round in range(rounds + 1):
            tick = tick if round == 0 else self.next_point(tick, self.first_tick)
            self.now = self.first_tick + self.clock.grid(tick)
            if not self.virtual:
                self.clock.sleep_until(self.began + self.now)
            if self.signals.caught[0] or not self.publisher.make_room(False):
                return ENDED
            self.tick = tick
            status = self.receive_while_arming()
            if round == 0:
                self.control.devices.arming.begin(False)           # later replies are to the disabling
            if status == OK:
                status = self.control.devices.watch(self.now)
            if status == OK and self.control.devices.arming.advance(&status):
                self.control.devices.table.arming = False
                self.armed, self.previous, self.late = tick, tick - 1, 0
                self.body.set_clock(tick, tick - 1, 0)
                return self.start_from_here()
            if status == OK:
                status = self.control.devices.arming.send(True, self.now)
            if status == OK:
                status = self.body.advance_plant(self.now)
            if status != OK:
                return status
        return NO_ANSWER

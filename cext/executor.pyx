# cython: freethreading_compatible=True
"""The executor: one thread, one clock, and the life cycle of a run.

    arming     enable and zero-torque frames until every device has answered
    ready      what was answered is shown; zero torque goes on until somebody confirms
    settle     blocks start from the present measurement, so that nothing kicks
    running    the tick, at absolute deadlines that keep their grid
    stopping   the fence goes up; zero torque and disable until every device has confirmed
    waiting    after a fault, where the run may be armed again: behind the fence every tick is computed, and nothing of it sent
    safe       nothing moves

It runs on the main thread without the GIL, with signal handlers of its own that set a flag, which is read after every sleep.
"""

import gc
import sys
from dataclasses import replace

from cpython.exc cimport PyErr_CheckSignals
from libc.stdint cimport int64_t

from cext.abi cimport (
    AUTHORITY, DEVICE_FAULT, ESTOP, FENCED, FIRST_OWN_STATUS, HUNG, NO_ANSWER, NOT_FINITE, OK, OUT_OF_LIMITS, OVERRUN, PYTHON_ERROR,
    RMS_TORQUE, SILENT, TOO_HOT, UNGUARDED,
)
from cext.devices cimport Blame
from cext.fatal cimport give_back_fatal, take_fatal
from cext.histogram cimport add
from cext.journal cimport Journal
from cext.live cimport STOP_WANTED, apply_changes
from cext.mailbox cimport CONFIRM, NOT_NOW, REARM, TAKEN
from cext.overrun cimport Overrun
from cext.pace cimport Pace, clock, monotonic
from cext.page cimport ARMING, READY, RUNNING, SAFE, STOPPING, WAITING, Page, PageLayout, store_i32, store_i64
from cext.posix cimport CLOCK_REALTIME, PR_SET_TIMERSLACK, prctl
from cext.program cimport Program
from cext.signals cimport Signals
from cext.stopwatch cimport RECORD, WOKEN_LATE, lap
from cext.tape cimport Tape
from cext.tick cimport Tick
from cext.watchdog cimport Watchdog, let_go, take_back

from cext.outcome import STATUS, Outcome, name_of
from cext.stopwatch import names


cdef enum:
    REQUESTS = 16               # inputs that ask for arming again
    ANSWERING = 100000000       # ns in which drives answer that they were disabled
    ENDED = -2                  # beside the statuses of kernels: the run ends while it waits to be armed again

SWITCH = 1e-4                   # s after which another Python thread has to hand over the GIL: 5 ms without this, five ticks at 1000 Hz


cdef class Executor:
    """Runs a program at a fixed rate, with the plant of a simulation behind it if there is one.

    Parameters
    ----------
    control : Program, the robot's diagram
    rate : Hz
    plant : Program or None, run `substeps` times a tick, at the tick's end
    page : Page or None; with one, rows, frames and statistics go through it
    virtual : do not sleep: as fast as the machine goes; a full ring makes the loop wait instead of dropping
    reader : a file descriptor that hangs up when nobody drains the page any more, or -1; that frees a loop that waits for it
    overrun : what a tick does that comes too late, in the words of cext.overrun.Overrun
    spin : s before a deadline in which it spins instead of sleeping
    profile : whether every step is timed, as `profile` tells afterwards
    tape : Tape of a recorded run, whose ticks are run again in virtual time, as late as they were
    guard : s of the guardian's silence that end the run; then nobody else may command the devices either, and in real time a watchdog
        looks for blocks that hang. 0 where there is no guardian
    carried : whether the guardian carries the frames of some bus: after its death the safe stop is one round here, the rest is the caller's
    """

    cdef Program control, plant
    cdef PageLayout *layout
    cdef Signals signals
    cdef Pace pace
    cdef Journal journal
    cdef Overrun overrun
    cdef Tick body
    cdef Tape tape
    cdef Watchdog watchdog
    cdef int to_blame            # item of the stopwatch that the last overrun came from
    cdef bint virtual, simulated, carried
    cdef int64_t began, first_tick, tick, previous
    cdef int64_t armed           # the tick from which on it is armed
    cdef int64_t hung            # ns that a tick had worked which hung, 0 if none has
    cdef bint halted             # since then it has been brought to its safe stop
    cdef object answered         # called when every device has answered, or None
    cdef bint confirm            # whether somebody has to confirm, then
    cdef object told             # called with what there is to tell of faults that are survived, or None
    cdef int[REQUESTS] request_slots         # of the arena, each true while its input asks for arming again
    cdef int request_count
    cdef int64_t late            # ns, of the previous tick
    cdef int64_t now             # ns from the run's begin to the present round or tick

    def __init__(self, Program control, double rate, *, Program plant=None, int substeps=1, Page page=None, bint virtual=False,
                 int reader=-1, str overrun="skip", double spin=0.0, bint profile=False, Tape tape=None,
                 double guard=0.0, bint carried=False):
        self.signals = Signals()
        self.pace = Pace(rate, self.signals, spin=round(spin * 1e9))
        self.overrun = Overrun(overrun)
        self.journal = Journal(page, control, virtual, reader, self.signals, round(guard * 1e9))
        self.body = Tick(control, plant, substeps, self.pace, self.journal, not virtual, profile)
        self.watchdog = Watchdog(control, self.journal, self.signals, self.pace.period, guard > 0.0 and not virtual)
        self.body.handover = self.watchdog.handover
        self.control, self.plant, self.layout, self.virtual = control, plant, self.journal.layout, virtual
        self.simulated = plant is not None or control.devices.count == 0 if tape is None else tape.simulated
        self.tape = tape
        self.carried = carried
        control.devices.alone = guard > 0.0
        if tape is not None and not virtual:
            raise ValueError("a recorded run is run again in virtual time")

    def run(self, int64_t ticks=-1, *, double fade=0.5, double arming_timeout=1.0, double stopping_timeout=0.2, answered=None,
            bint confirm=False, rearm=None, told=None):
        """Arm, run `ticks` grid points (-1: until a signal), stop safely, and say how it ended.

        fade : s, over which commands grow to their full size after arming
        arming_timeout : s, in which every device must answer
        stopping_timeout : s, after which the safe stop no longer waits for confirmations
        answered : called once, when every device has answered; it should take a few ms at most. Zero torque goes on for a round or more
        confirm : with `answered`, until somebody confirms through the mailbox
        rearm : slots of the arena that are true while their inputs ask for arming again; with None a fault ends the run. After a fault
            that may be survived the run waits in its safe stop, until one of them rises or a letter asks, and nothing stands in the way
        told : called with "fault", "refused" or "rearm", and the Outcome that a fault, or what stands in the way, would be
        """
        cdef int status
        cdef int waited = OK
        cdef tuple unanswered = ()
        cdef bint stopped = False
        faults = []
        self.hung = 0
        self.answered, self.confirm, self.told = answered, confirm, told
        self.request(rearm or ())
        if not (fade >= 0.0 and arming_timeout >= 0.0 and stopping_timeout >= 0.0):
            raise ValueError("times of a run are 0 s or more: fade %r, arming_timeout %r, stopping_timeout %r" % (
                fade, arming_timeout, stopping_timeout))
        self.body.reset()
        self.tick = self.previous = -1
        self.now = self.armed = 0
        self.halted = False
        self.pace.sleeps = self.pace.spins = 0
        self.overrun.reset()
        self.journal.clear()
        switching = sys.getswitchinterval()
        sys.setswitchinterval(min(switching, SWITCH))
        collecting = gc.isenabled()
        gc.collect()
        gc.freeze()
        gc.disable()
        self.signals.take()
        try:
            self.watchdog.start()
            if self.watchdog.handover != NULL and self.layout != NULL:
                take_fatal(self.layout, &self.control.at)
            PyErr_CheckSignals()                                   # one that Python caught until now would wait for the end of the run
            with nogil:
                prctl(PR_SET_TIMERSLACK, 1)
                self.begin()
                status = self.arm(arming_timeout)
            if status == NO_ANSWER:
                unanswered = tuple(self.control.devices.silent())
            with nogil:
                if status == OK and not self.signals.caught[0]:
                    status = self.loop(ticks, fade)
                status = self.cause(status)
            while rearm is not None and self.is_survived(status):
                with nogil:
                    self.halt(stopping_timeout)
                    while self.control.live.asked(self.layout, REARM, self.tick, NOT_NOW):
                        pass                                       # who asked before the fault was told did not mean it
                    self.control.live.awaited = REARM
                    self.journal.set_state(WAITING)
                fault = self.outcome(status)
                faults.append(fault)
                self.tell("fault", fault)
                with nogil:
                    waited = status = self.cause(self.wait(ticks, arming_timeout))
                    if status == OK:
                        status = self.cause(self.loop(ticks, fade))
            with nogil:
                if status == STOP_WANTED:
                    stopped, status = True, OK
                self.stop(0.0 if status == UNGUARDED and self.carried else stopping_timeout)
        finally:
            self.watchdog.end()
            give_back_fatal()
            self.signals.give_back()
            sys.setswitchinterval(switching)
            gc.unfreeze()
            if collecting:
                gc.enable()
        if self.layout != NULL:
            store_i32(&self.layout.status, max(status, 0))
        self.control.live.leave()
        ended = self.outcome(status if status != ENDED else OK, unanswered)
        if waited == ENDED or waited == STOP_WANTED:                # the fault stood when the run ended
            ended = replace(faults.pop(), signal=ended.signal, unconfirmed=ended.unconfirmed)
        return replace(ended, stopped=stopped, faults=tuple(faults))

    cdef int request(self, slots) except -1:
        if len(slots) > REQUESTS:
            raise ValueError("at most %d inputs ask for arming again, not %d" % (REQUESTS, len(slots)))
        self.request_count = len(slots)
        for index, slot in enumerate(slots):
            self.request_slots[index] = slot
        return 0

    cdef object outcome(self, int status, tuple unanswered=()):
        """The Outcome of a run that ended here."""
        error = self.control.error or self.control.live.error
        culprit = self.control.culprit if status != OK else None
        if self.plant is not None and culprit is None and error is None and status != OK:
            error, culprit = self.plant.error, self.plant.culprit
        if status == OVERRUN:
            culprit = self.body.watch.name(self.to_blame)
        if status == HUNG:
            culprit = names(self.control.schedule)[self.watchdog.at] if self.watchdog.at >= 0 else self.control.culprit
            error = error if culprit == self.control.culprit else None      # a later step was broken off in its place
        silent = tuple(self.control.devices.silent())
        if status == NO_ANSWER and self.tick >= 0:
            unanswered = silent
        return Outcome(
            name_of(status), culprit, self.tick, self.signals.caught[0], error, silent, unanswered, hung=self.hung * 1e-9)

    @property
    def watch(self):
        """The Stopwatch of the robot."""
        return self.body.watch

    @property
    def overruns(self):
        """Who took the time where grid points were missed: cext.stopwatch.Stopwatch.overruns of the run."""
        return self.body.watch.overruns()

    @property
    def newest(self):
        """The rows of the newest ticks, as cext.journal.Journal.newest has them."""
        return self.journal.newest()

    @property
    def profile(self):
        """(rows of the robot, rows of its plant) as cext.stopwatch.Stopwatch.rows has them."""
        return self.body.watch.rows(), [] if self.body.plant_watch is None else self.body.plant_watch.rows()

    def spin(self, int64_t ticks):
        """Run bare ticks as fast as possible: no arming, no clock, no plant, and what is recorded goes nowhere.

        For `bench`: returns the ns of this thread's processor time that they took.
        """
        status, took = self.body.spin(ticks)
        if status != OK:
            raise RuntimeError("%s at %s" % (name_of(status), self.control.culprit)) from self.control.error
        return took

    cdef void begin(self) noexcept nogil:
        """Set the zero of the run's time, one period from now."""
        self.began = self.watchdog.zero = monotonic() + self.pace.period
        self.first_tick = 0
        self.control.devices.begin(self.began)
        if self.layout == NULL:
            return
        self.layout.wall = clock(CLOCK_REALTIME) + self.pace.period
        self.layout.began = self.began
        self.layout.first_tick = 0

    cdef int arm(self, double timeout) noexcept nogil:
        """Zero-torque frames, one round a period, until every device has answered."""
        cdef int64_t rounds = <int64_t>min(timeout * self.pace.rate, 1e15) + 1
        cdef int64_t round, now
        cdef int status = OK
        self.journal.attend(monotonic())
        self.journal.set_state(ARMING)
        self.control.devices.want_replies(True, False)
        for round in range(rounds + 1 if self.control.devices.count else 0):
            self.now = now = self.pace.grid(round)
            if not self.virtual:
                self.pace.sleep_until(self.began + now)
            if self.signals.caught[0] or not self.journal.make_room(False):
                return OK
            status = self.journal.attend(monotonic())
            if status == OK:
                status = apply_changes(self.control.live, self.layout, -1, 0.0)
            if status == OK:
                status = self.control.devices.receive(now, self.layout)
            if status != OK:
                return status
            if self.control.devices.all_answered():
                if self.answered is not None:
                    status = self.look_over(timeout)
                    if status != OK or self.signals.caught[0]:
                        return status
                    now = self.now
                elif self.tape is not None:
                    status = self.look_over_again(round + 1)
                    if status != OK:
                        return status
                    now = self.now
                self.first_tick = now                              # tick 0 is here, with the answers just heard
                if self.layout != NULL:
                    self.layout.first_tick = now
                self.body.set_clock(0, -1, 0)
                return self.start_from_here()
            status = self.control.devices.send_batches(True, True, False, now, self.layout)
            if status == OK:
                status = self.body.advance_plant(now)
            if status != OK:
                return status
        return NO_ANSWER if self.control.devices.count else OK

    cdef int start_from_here(self) noexcept nogil:
        """Blocks start; that may hang, as a tick may, and take longer."""
        cdef int status
        self.watchdog.begin_work(monotonic() + self.watchdog.patience)
        let_go(self.watchdog.handover)
        status = self.control.start_from_here()
        if not take_back(self.watchdog.handover):
            status = HUNG
        self.watchdog.end_work()
        return status

    cdef int loop(self, int64_t ticks, double fade) noexcept nogil:
        cdef int64_t now, began, skipped
        cdef int64_t tick = self.armed
        cdef int64_t late = 0
        cdef int64_t epoch = self.began + self.first_tick
        cdef int status = OK
        self.journal.set_state(RUNNING)
        while ticks < 0 or tick < ticks:
            if not self.virtual:
                self.pace.wait(epoch + self.pace.grid(tick))
            if self.signals.caught[0] or not self.journal.make_room(False):
                break
            began = monotonic()
            self.watchdog.begin_work(began)
            if self.tape is not None:
                if not self.tape.advance(&tick, &late):
                    break
            elif not self.virtual:
                tick = self.place(tick, began - epoch, ticks)
                if self.overrun.fault:
                    status = OVERRUN
                if self.overrun.fault or tick == ticks:
                    break
                late = began - epoch - self.pace.grid(tick)
            self.now = now = self.first_tick + self.pace.grid(tick)
            self.tick = tick
            self.body.watch.begin(tick, began)
            status = self.journal.attend(began)
            for skipped in range(self.previous + 1, tick):         # the plant does not stand still meanwhile
                if status == OK:
                    status = self.body.advance_plant(self.first_tick + self.pace.grid(skipped))
            if status != OK:
                break
            self.body.set_clock(tick, self.previous, late)
            self.control.arena[AUTHORITY] = self.authority(tick - self.armed, fade)
            status = self.body.run(                                # the first tick after arming is one for every block
                tick, self.previous if self.previous >= self.armed else -1, now if self.simulated else now + late)
            if status != OK or (self.layout != NULL and not self.journal.push_row(tick)):
                break
            if self.control.laps != NULL:
                lap(self.control.laps, RECORD)
            if self.layout != NULL:
                self.count(tick, late, began)
            self.previous = tick
            self.late = late
            tick += 1
            self.watchdog.end_work()
        self.watchdog.end_work()
        return status

    cdef double authority(self, int64_t ticks, double fade) noexcept nogil:
        """The share of every command that is let through so many ticks after arming."""
        return 1.0 if fade <= 0.0 or ticks / self.pace.rate >= fade else ticks / (self.pace.rate * fade)

    cdef int64_t place(self, int64_t tick, int64_t since, int64_t ticks) noexcept nogil:
        """The grid point at which a tick runs that should run at `tick` and wakes up `since` ns after the first. Counts what is missed."""
        cdef int64_t due = max(tick, self.pace.newest(since))
        cdef int64_t behind = self.overrun.late
        cdef int64_t chosen
        if 0 <= ticks < due:
            due = ticks
        chosen = self.overrun.decide(tick, due)
        if due > tick and behind == 0:                             # those that catch up did not cause it
            if tick > 0 and self.body.watch.laps.last - self.began - self.first_tick >= self.pace.grid(tick + 1):
                self.to_blame = self.body.watch.laps.item
                self.body.watch.blame(self.to_blame, self.body.watch.laps.longest, due - tick)
            else:
                self.to_blame = WOKEN_LATE
                self.body.watch.blame(WOKEN_LATE, since - self.pace.grid(tick), due - tick)
        if self.layout != NULL and due > tick:
            store_i64(&self.layout.missed, self.layout.missed + chosen - tick)
            self.layout.caught_up += chosen == tick
        return chosen

    cdef void count(self, int64_t tick, int64_t late, int64_t began) noexcept nogil:
        """A tick that is done, on the page."""
        cdef PageLayout *page = self.layout
        cdef int64_t ended = self.control.laps.last if self.control.laps != NULL else monotonic()
        add(&page.execution, ended - began, tick)
        add(&page.lateness, late, tick)
        if not self.virtual and self.previous >= 0:
            add(&page.period, late - self.late if late > self.late else self.late - late, tick)
        page.gil_taken = self.control.gil_taken + self.control.live.gil_taken + (self.plant.gil_taken if self.plant is not None else 0)
        page.sleeps, page.spins = self.pace.sleeps, self.pace.spins
        store_i64(&page.tick, tick)
        store_i64(&page.ticks, page.ticks + 1)

    cdef void stop(self, double timeout) noexcept nogil:
        """The safe stop, at the end of a run."""
        self.halt(timeout)
        self.control.live.dismiss(self.layout)
        self.journal.set_state(SAFE)

    cdef void halt(self, double timeout) noexcept nogil:
        """Fence, then zero torque and disable, again and again until every device has confirmed or time is up.

        Devices that are to be damped first are, where they may have been under torque.
        """
        cdef int64_t step = max(100000, min(self.pace.period, 5000000))
        cdef int64_t now = self.now + self.pace.period if self.virtual else monotonic() - self.began
        cdef int64_t damping = self.control.devices.longest_damping
        cdef int64_t since = 0 if self.tick >= 0 and not self.halted else damping     # ns since the stop began
        cdef int64_t limit = damping + <int64_t>(timeout * 1e9)
        cdef bint damped
        self.control.keep_values()                                 # what the devices say from here on did not lead to this
        if self.plant is not None:
            self.plant.keep_values()
        cdef Blame blame = self.control.devices.failed             # what fails from here on is not why
        self.journal.raise_fence()
        self.journal.set_state(STOPPING)
        self.journal.make_room(True)
        self.control.devices.receive(now, self.layout)             # answers to the last commands confirm nothing
        while self.control.devices.count > 0:
            self.journal.attend(monotonic())
            self.control.devices.want_replies(True, True)
            self.journal.make_room(True)
            damped = since < damping
            self.control.devices.send_stop(since, now, self.layout)
            self.body.advance_plant(now)
            now += step
            since += step
            if not self.virtual:
                self.pace.sleep_until(monotonic() + step)
            self.control.devices.receive(now, self.layout)
            if since >= limit or (not damped and self.control.devices.all_answered()):
                break
        self.control.devices.failed = blame
        self.halted = True
        if self.virtual:
            self.now = now

    # Ready

    cdef int look_over(self, double timeout) noexcept nogil:
        """Show what was answered; then zero torque until somebody has confirmed, and once more. Leaves `now` where it may begin.

        Every device has to go on answering, without a fault. OK too where a signal came.
        """
        cdef int64_t point = self.pace.newest(self.now)
        cdef int64_t patience = <int64_t>min(timeout * self.pace.rate, 1e15) + 1
        cdef int status = self.call_answered()
        cdef bint confirmed = not self.confirm
        while self.control.live.asked(self.layout, CONFIRM, -1, NOT_NOW):
            pass                                                   # who confirmed before anything was shown did not mean it
        self.control.devices.want_replies(True, False)
        self.journal.set_state(READY)
        while status == OK:
            point = self.next_point(point, 0)
            self.now = self.pace.grid(point)
            if not self.virtual:
                self.pace.sleep_until(self.began + self.now)
            if self.signals.caught[0] or not self.journal.make_room(False):
                return OK
            status = self.hear_while_arming()
            if status == OK:
                status = self.control.devices.watch(self.now)
            if status == OK and confirmed:
                if self.control.devices.all_answered():
                    return OK
                patience -= 1
                if patience <= 0:
                    return NO_ANSWER
            if status == OK and not confirmed and self.control.live.asked(self.layout, CONFIRM, -1, TAKEN):
                confirmed = True
                self.control.devices.want_replies(True, False)
            if status == OK:
                status = self.control.devices.send_batches(False, True, False, self.now, self.layout)
            if status == OK:
                status = self.body.advance_plant(self.now)
        return status

    cdef int look_over_again(self, int64_t drain) noexcept nogil:
        """The same of a recorded run, as often and when it was. drain : how many have been before"""
        cdef int status = OK
        while drain < self.tape.drains:
            self.now = self.tape.drained[drain]
            drain += 1
            if not self.journal.make_room(False):
                return OK
            status = self.control.devices.receive(self.now, self.layout)
            if status == OK and drain < self.tape.drains:
                status = self.control.devices.send_batches(False, True, False, self.now, self.layout)
            if status != OK:
                return status
        return status

    cdef int call_answered(self) noexcept nogil:
        with gil:
            try:
                self.answered()
            except BaseException as error:
                self.control.error = error
                return PYTHON_ERROR
        return OK

    cdef int hear_while_arming(self) noexcept nogil:
        cdef int status = self.journal.attend(monotonic())
        if status == OK:
            status = apply_changes(self.control.live, self.layout, -1, 0.0)
        if status == OK:
            status = self.control.devices.receive(self.now, self.layout)
        return status

    cdef int64_t next_point(self, int64_t point, int64_t zero) noexcept nogil:
        """The grid point after this one, in real time one that is not past. zero : ns from the run's begin to point 0"""
        return point + 1 if self.virtual else max(point + 1, self.pace.newest(monotonic() - self.began - zero) + 1)

    # After a fault

    cdef int cause(self, int status) noexcept nogil:
        """Why a run ends. A tick that hung may return anything; drives seem silent where the guardian is late, which carries their frames."""
        if self.watchdog.has_bitten():
            self.hung = monotonic() - self.watchdog.began + (self.watchdog.patience if self.tick < 0 else 0)
            self.watchdog.dismiss()
            return HUNG
        if status == SILENT and self.carried and self.journal.guardian_is_late():
            self.control.devices.failed.device = -1
            return UNGUARDED
        return status

    cdef bint is_survived(self, int status):
        """Whether a run that fails like this may be armed again. Never where another process has stopped it, nor where nobody can tell."""
        if self.plant is not None and self.plant.culprit is not None:
            return False
        return self.tick >= 0 and not self.signals.caught[0] and (
            status in (NOT_FINITE, OUT_OF_LIMITS, PYTHON_ERROR, NO_ANSWER, SILENT, DEVICE_FAULT, OVERRUN, ESTOP, RMS_TORQUE, TOO_HOT)
            or status >= FIRST_OWN_STATUS)

    cdef void tell(self, str what, outcome):
        """Tell whoever wants to know. What that raises is no matter of the run."""
        self.journal.attend_fenced(monotonic())
        if self.told is not None:
            try:
                self.told(what, outcome)
            except Exception:
                sys.excepthook(*sys.exc_info())
        self.journal.attend_fenced(monotonic())

    cdef void tell_standing(self, str what, int standing) noexcept nogil:
        with gil:
            self.tell(what, self.outcome(standing))

    cdef int wait(self, int64_t ticks, double arming_timeout) noexcept nogil:
        """Behind the fence, until somebody asks for arming again after a whole tick in which nothing stood in the way.

        Then arms, and returns OK, or why that failed. ENDED or STOP_WANTED where the run ends first, else what is no more survived.
        """
        cdef int64_t epoch = self.began + self.first_tick
        cdef int64_t tick = max(self.tick, self.pace.newest(
            (self.now if self.virtual else monotonic() - self.began) - self.first_tick)) + 1
        cdef int64_t began
        cdef int status
        cdef int standing = NO_ANSWER
        cdef bint high = True                                      # an input that was true all the time asks for nothing
        cdef bint before
        cdef int64_t judged = self.first_tick + self.pace.grid(tick) + ANSWERING     # from when on a missing answer stands in the way
        self.control.devices.want_replies(False, True)
        self.previous = tick - 1
        while ticks < 0 or tick < ticks:
            if not self.virtual:
                self.pace.wait(epoch + self.pace.grid(tick))
            if self.signals.caught[0] or not self.journal.make_room(False):
                return ENDED
            began = monotonic()
            self.tick = tick
            self.now = self.first_tick + self.pace.grid(tick)
            self.body.watch.begin(tick, began)
            status = self.journal.attend_fenced(began)
            if status != OK:
                return status
            if (standing != NO_ANSWER or self.now > judged) and self.control.live.asked(
                    self.layout, REARM, tick, TAKEN if standing == OK else NOT_NOW):
                if standing == OK:
                    return self.arm_again(tick, arming_timeout)
                self.tell_standing("refused", standing)
            self.late = 0 if self.virtual else began - epoch - self.pace.grid(tick)
            standing = self.look_around(tick, standing, &status)
            if status != OK or (self.layout != NULL and not self.journal.push_row(tick)):
                return status if status != OK else ENDED
            if self.layout != NULL:
                self.count(tick, self.late, began)
            before, high = high, self.asked(high)
            if high and not before:
                if standing == OK:
                    return self.arm_again(self.next_point(tick, self.first_tick), arming_timeout)
                self.tell_standing("refused", standing)
            self.previous = tick
            tick = self.next_point(tick, self.first_tick)
        return ENDED

    cdef bint asked(self, bint before) noexcept nogil:
        """Whether an input asks for arming again."""
        if self.request_count == 0:
            return before
        cdef int index
        for index in range(self.request_count):
            if self.control.arena[self.request_slots[index]] > 0.5:
                return True
        return False

    cdef int look_around(self, int64_t tick, int before, int *status) noexcept nogil:
        """One tick of which nothing is sent but disable. Returns what stands in the way of arming; `status` where the run cannot go on.

        before : what stood in the way in the tick before
        """
        cdef int computed
        cdef int standing = OK
        cdef int64_t skipped
        self.forgive(before)
        for skipped in range(self.previous + 1, tick):
            self.body.advance_plant(self.first_tick + self.pace.grid(skipped))
        self.body.set_clock(tick, self.previous, self.late)
        self.control.arena[AUTHORITY] = 0.0
        computed = apply_changes(self.control.live, self.layout, tick, (tick - self.previous) / self.pace.rate)
        if computed == STOP_WANTED:
            status[0] = computed
            return computed
        status[0] = self.control.devices.receive(self.now, self.layout)
        if status[0] == ESTOP:
            status[0] = OK                                         # the device holds it against every command from here on
        if status[0] != OK:
            return status[0]
        if computed == OK:
            computed = self.control.run(&self.control.output, tick, self.previous)
        if computed == OK:
            computed = self.control.devices.command()              # what it would be; none of it goes out
        if computed == OK:
            computed = self.control.run(&self.control.update, tick, self.previous)
        standing = self.control.devices.watch(self.now)
        if standing == OK:
            standing = computed if computed != OK or self.control.devices.all_answered() else NO_ANSWER
        status[0] = self.control.devices.send_batches(False, False, True, self.now, self.layout)
        if status[0] == OK:
            status[0] = self.body.advance_plant(self.now)
        return standing

    cdef void forgive(self, int status) noexcept nogil:
        """What failed is no longer why anything fails."""
        self.control.devices.failed.device = self.control.devices.failed.bus = -1
        self.control.failed.step = -1
        if status == OK:
            return
        with gil:
            self.control.error = None
            self.control.live.forgive()

    cdef int arm_again(self, int64_t tick, double timeout) noexcept nogil:
        """As at the beginning, from grid point `tick` on: the loop may go on at `armed`. The fence is lowered here, and nowhere else."""
        cdef int64_t rounds = <int64_t>min(timeout * self.pace.rate, 1e15) + 1
        cdef int64_t round
        cdef int status
        self.tell_standing("rearm", OK)
        self.forgive(PYTHON_ERROR)
        if not self.journal.lower_fence():
            return FENCED
        self.control.live.awaited = -1
        self.halted = False
        self.journal.set_state(ARMING)
        self.overrun.reset()
        for round in range(rounds + 1):
            tick = tick if round == 0 else self.next_point(tick, self.first_tick)
            self.now = self.first_tick + self.pace.grid(tick)
            if not self.virtual:
                self.pace.sleep_until(self.began + self.now)
            if self.signals.caught[0] or not self.journal.make_room(False):
                return ENDED
            self.tick = tick
            status = self.hear_while_arming()
            if round == 0:
                self.control.devices.want_replies(True, False)     # from here on: what comes now answers the disabling
            elif status == OK and self.control.devices.all_answered():
                status = self.control.devices.watch(self.now)
                if status == OK:
                    self.armed, self.previous, self.late = tick, tick - 1, 0
                    self.body.set_clock(tick, tick - 1, 0)
                    return self.start_from_here()
            if status == OK:
                status = self.control.devices.send_batches(True, True, False, self.now, self.layout)
            if status == OK:
                status = self.body.advance_plant(self.now)
            if status != OK:
                return status
        return NO_ANSWER

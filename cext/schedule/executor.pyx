# cython: freethreading_compatible=True
"""Executor: one thread, one clock, and the life cycle of a run.

    arming     every device is asked for its state, until all have replied
    ready      the replies are shown; nothing is enabled before the confirmation
    arming     enable and zero torque until every actuator has replied
    settle     blocks start from the present measurement, without a step in their outputs
    running    the tick, at absolute deadlines on the grid
    stopping   the fence is raised; zero torque and disable until every device has confirmed
    waiting    after a fault, if the run may be armed again: ticks are computed behind the fence, and no commands are
               sent
    safe       nothing moves

It runs on the main thread without the GIL. Its own signal handlers set a flag, which it reads after every sleep.
"""

import gc
import sys
import threading
from dataclasses import replace

from cpython.exc cimport PyErr_CheckSignals
from libc.stdint cimport int64_t

from cext.abi cimport AUTHORITY, OK
from cext.status cimport NO_ANSWER, OVERRUN, UNGUARDED
from cext.atomics cimport store_i32_relaxed
from cext.safety.forks cimport begin_run
from cext.safety.fatal cimport end_hung, give_back_fatal, take_fatal
from cext.schedule.publisher cimport Publisher
from cext.schedule.live cimport STOP_WANTED
from cext.clock.overrun cimport Overrun
from cext.clock.deadline_clock cimport DeadlineClock, clock, monotonic
from cext.memory.shared_state cimport RUNNING, SAFE, WAITING, SharedState, store_i32, store_i64
from cext.posix cimport PR_SET_TIMERSLACK, prctl
from cext.schedule.program cimport Program
from cext.clock.signals cimport Signals
from cext.clock.stopwatch cimport RECORD, WOKEN_LATE, lap
from cext.bus.replay_bus cimport ReplayClock
from cext.safety.thresholds cimport ARMING_LIMIT, FADE_IN, STOP_LIMIT
from cext.schedule.tick cimport TickBody
from cext.schedule.lifecycle cimport ENDED, Waiting
from cext.schedule.watchdog cimport Watchdog

from cext.clock.stopwatch import names, python_steps
from cext.schedule.outcome import name_of


# s until another Python thread must release the GIL: by default 5 ms, five ticks at 1000 Hz
SWITCH = 1e-4


cdef class Executor(Waiting):
    """Executor of a program at a fixed rate, with the plant of a simulation if there is one.

    Parameters
    ----------
    control : Program, the robot's diagram
    rate : Hz
    plant : Program or None, run `substeps` times a tick, at the tick's end
    shared : SharedState or None; with one, rows, frames and statistics go through it
    virtual : run as fast as possible, without sleeping; the loop waits for space in a full ring instead of dropping
        records
    reader : file descriptor that hangs up when the reader of the shared state has ended, or -1; it ends a wait for
        space
    drain : callable that empties the ring in this process instead, in virtual time. Its exception ends the run safely
        and
        is raised then
    overrun : policy for late ticks, in the syntax of cext.clock.overrun.Overrun
    spin : s before a deadline in which it spins instead of sleeping
    profile : time every step, for `profile`
    replay : ReplayClock of a recorded run, whose ticks are repeated in virtual time with their lateness
    guard : s of the guardian's silence that end the run; no other node may then command the devices, and in real time a
        watchdog checks for blocks that hang. 0 without a guardian
    grace : s of a delay that the run tolerates at least, where nothing must be stopped: all of it of a pause of every
        process and of the start of the blocks, half of it of a step. 0 for the ordinary limits
    carried : whether the guardian carries the frames of any bus: after its death, the safe stop is one round here, and
        the caller continues it
    others : processors of the watchdog; by default those of the thread that runs
    rows : destination of the rows for cext.schedule.publisher.Publisher, or None
    hosted : whether the process belongs to another program, such as a notebook or a test: the garbage collector and the
        switch interval are not changed, nor are the signal handlers outside the main thread
    waits : whether simulated time stops while the host stalls for so long that emulated devices would time out; for a
        plant only
    fade_out : s, over which commands decrease to zero before grid point `ends_at`, where the run ends; 0 for none
    pages : whether the loss of the page of the panel that has the controls ends the run, in real time. With a guardian
        no drive is enabled before there is one
    """

    cdef bint hosted
    cdef bint collecting             # whether the garbage collector was enabled before `enter`
    cdef double switching            # s, the switch interval before `enter`
    cdef int status                  # of the newest tick, or why the run ends
    cdef double fade_out             # s
    cdef int64_t ends_at             # grid point before which commands have faded out; -1: none
    cdef bytes items                 # names of the items of the stopwatch, each with a line feed
    cdef bytes python                # whether each is a step in Python
    cdef bint begun                  # whether `advance` has armed
    cdef tuple unanswered            # devices that did not reply while arming

    def __init__(self, Program control, double rate, *, Program plant=None, int substeps=1, SharedState shared=None,
        bint virtual=False,
                 int reader=-1, str overrun="skip", double spin=0.0, bint profile=False, ReplayClock replay=None,
                 double guard=0.0, double grace=0.0, bint carried=False, others=(), rows=None, bint hosted=False,
                 drain=None, bint waits=False, bint pages=False, double fade_out=0.0, int64_t ends_at=-1):
        self.hosted, self.fade_out, self.ends_at, self.grace = hosted, fade_out, ends_at, round(grace * 1e9)
        self.signals = Signals(not hosted or threading.current_thread() is threading.main_thread())
        self.clock = DeadlineClock(rate, self.signals, spin=round(spin * 1e9))
        self.overrun = Overrun(overrun)
        self.publisher = Publisher(shared, control, virtual, reader, self.signals, round(guard * 1e9), rows, drain,
            plant, pages and not virtual)
        self.body = TickBody(control, plant, substeps, self.clock, self.publisher, not virtual, profile)
        self.watchdog = Watchdog(control, self.publisher, self.signals, self.clock.period, self.grace,
            guard > 0.0 and not virtual, others)
        self.body.handover = self.watchdog.handover
        self.items = "".join(f"{name}\n" for name in names(control.schedule)).encode()
        self.python = python_steps(control.schedule)
        if self.body.handover == NULL:                               # else the watchdog ends a step that hangs
            self.signals.ignored = end_hung
        self.control, self.plant, self.layout, self.virtual = control, plant, self.publisher.layout, virtual
        self.simulated = plant is not None or control.devices.table.count == 0 if replay is None else replay.simulated
        if waits and (plant is None or guard > 0.0):
            raise ValueError("the time of real devices passes while the host stalls: only a plant can wait for it")
        self.stall = control.devices.longest_stall() if waits and not virtual else 0
        self.replay = replay
        self.carried = carried
        control.devices.table.alone = guard > 0.0
        if guard > 0.0 and not virtual:
            control.devices.table.time_replies()
        if replay is not None and not virtual:
            raise ValueError("a recorded run can be replayed only in virtual time")

    def run(self, int64_t ticks=-1, *, double fade=FADE_IN / 1e9, double arming_timeout=ARMING_LIMIT / 1e9,
            double stopping_timeout=STOP_LIMIT / 1e9, answered=None,
            bint confirm=False, int arm_slot=-1, permitted=None, rearm=None, notify=None, may_return=None) -> Outcome:
        """Arm, run `ticks` grid points (-1: until a signal), and stop safely. Returns an Outcome.

        fade : s, over which commands increase to full size after arming
        arming_timeout : s, in which every device must reply
        stopping_timeout : s, after which the safe stop no longer waits for confirmations
        answered : called once, when every device has replied; it should take a few ms at most
        confirm : with `answered`, wait for a confirmation by the operator, or by the input of `arm_slot`
        arm_slot : slot of the arena with an output of a device, such as a button: held for ARM_HOLD, it confirms. -1
            for none
        permitted : called before arming, and at each request to arm: False refuses it. With `confirm` the run then
            continues to wait, without it the run ends as an unclear pose
        rearm : slots of the arena that are true while their inputs request arming again; with None a fault ends the
            run. After a fault that can be survived, the run waits in its safe stop for one of them to rise or for a
            confirmation, and for all conditions of arming
        may_return : called with the path of a drive that was silent while it was taken out, before it is armed again:
            False refuses it
        notify : called with "fault", "refused" or "rearm", and the Outcome of the fault or of the unmet condition
        """
        cdef int waited = OK
        cdef bint asked = False
        faults = []
        self.answered, self.confirm, self.permitted, self.notify = answered, confirm, permitted, notify
        self.arm_slot = arm_slot
        self.request(rearm or ())
        if not (fade >= 0.0 and arming_timeout >= 0.0 and stopping_timeout >= 0.0):
            raise ValueError("times of a run must be 0 s or more: fade %r, arming_timeout %r, stopping_timeout %r" % (
                fade, arming_timeout, stopping_timeout))
        self.reset(fade, may_return)
        self.enter()
        try:
            self.begin_watch()
            self.arm_and_loop(ticks, fade, arming_timeout)
            while rearm is not None and self.is_survived(self.status):
                with nogil:
                    self.halt(stopping_timeout)
                    self.publisher.ask()                             # an earlier confirmation does not count
                    self.publisher.set_state(WAITING)
                fault = self.outcome(self.status)
                faults.append(fault)
                self.call_notify("fault", fault)
                with nogil:
                    waited = self.status = self.cause(self.wait(ticks, arming_timeout))
                    if self.status == OK:
                        self.status = self.cause(self.loop(ticks, fade))
            with nogil:
                if self.status == STOP_WANTED:
                    asked, self.status = True, OK
                self.stop(-1.0 if self.status == UNGUARDED and self.carried else stopping_timeout)
        finally:
            self.leave()
        ended = self.end()
        if waited == ENDED or waited == STOP_WANTED:                # the fault persisted when the run ended
            ended = replace(faults.pop(), signal=ended.signal, unconfirmed=ended.unconfirmed)
        return replace(ended, stopped=self.publisher.shared.stopped_by if asked else "", faults=tuple(faults))

    def advance(self, int64_t ticks) -> bool:
        """Run the next `ticks` grid points in virtual time; the first call, which may be with 0, resets and arms.

        Between the calls, signals, the garbage collector and the arena belong to the caller. `finish` ends the run.
        Returns whether all ticks were done: not after a fault or a signal. A fault ends the run.
        """
        if not self.virtual:
            raise ValueError("a run in real time cannot be divided into steps")
        if not self.begun:
            self.reset(FADE_IN / 1e9, None)
        elif self.status != OK:
            return False
        self.enter()
        try:
            self.begin_watch()
            if not self.begun:
                self.arm_and_loop(ticks, FADE_IN / 1e9, ARMING_LIMIT / 1e9)
                self.begun = not self.signals.caught[0] or self.tick >= 0      # else a signal has interrupted arming
            else:
                with nogil:
                    self.status = self.cause(self.loop(self.previous + 1 + ticks, FADE_IN / 1e9))
        finally:
            self.leave()
        return self.status == OK and not self.signals.caught[0]

    def finish(self) -> Outcome:
        """Perform the safe stop after `advance`. Returns an Outcome."""
        self.begun = False
        self.enter()
        try:
            with nogil:
                self.stop(STOP_LIMIT / 1e9)
        finally:
            self.leave()
        return self.end()

    cdef void reset(self, double fade, may_return):
        """Restore the state before arming."""
        self.hung = 0
        self.body.reset()
        self.control.devices.fade, self.control.devices.switch.may_return = fade, may_return
        self.tick = self.previous = -1
        self.now = self.armed = self.signals_kept = 0
        self.halted = False
        self.status = OK
        self.unanswered = ()
        self.clock.sleeps = self.clock.spins = self.stalled = 0
        self.overrun.reset()
        self.publisher.clear()

    cdef void enter(self):
        """Take the signals, and outside of another program the collector and the switch interval, until `leave`."""
        self.switching = sys.getswitchinterval()
        self.collecting = not self.hosted and gc.isenabled()
        if not self.hosted:
            sys.setswitchinterval(min(self.switching, SWITCH))
        if self.collecting:
            gc.collect()
            gc.disable()
        begin_run()
        self.signals.take()

    cdef int begin_watch(self) except -1:
        self.watchdog.start()
        take_fatal(self.layout, self.control.code_map(), self.control.at, self.items, self.python)
        # else a signal that Python has caught would wait for the end of the run
        PyErr_CheckSignals()
        return 0

    cdef void leave(self):
        self.watchdog.end()
        give_back_fatal()
        self.signals.give_back()
        if not self.hosted:
            sys.setswitchinterval(self.switching)
        if self.collecting:
            gc.enable()

    cdef void arm_and_loop(self, int64_t ticks, double fade, double arming_timeout):
        """Arm, then run the ticks. Leaves `status`, and the devices that did not reply."""
        with nogil:
            if not self.virtual:
                prctl(PR_SET_TIMERSLACK, 1)
            self.begin()
            self.status = self.arm(arming_timeout)
        if self.status == NO_ANSWER:
            self.unanswered = tuple(self.control.devices.reports.silent)
        with nogil:
            if self.status == OK and not self.signals.caught[0]:
                self.status = self.loop(ticks, fade)
            self.status = self.cause(self.status)

    cdef object end(self):
        """Return the Outcome after the safe stop. Raises the exception of a reader."""
        error = self.publisher.error or (self.replay.error if self.replay is not None else None)
        if error is not None:
            raise error
        if self.layout != NULL:
            store_i32(&self.layout.status, max(self.status, 0))
        self.control.live.leave()
        return self.outcome(self.status if self.status != ENDED else OK, self.unanswered)

    @property
    def watch(self) -> Stopwatch:
        """The Stopwatch of the robot."""
        return self.body.watch

    @property
    def overruns(self) -> list[dict[str, Any]]:
        """Items that caused missed grid points: cext.clock.stopwatch.Stopwatch.overruns of the run."""
        return self.body.watch.overruns()

    @property
    def newest(self) -> list[tuple]:
        """Rows of the newest ticks, as in cext.schedule.publisher.Publisher.newest."""
        return self.publisher.newest()

    @property
    def signal(self) -> int:
        """Number of the signal that has ended the newest `advance`, 0 for none."""
        return self.signals.caught[0]

    @property
    def failed(self) -> bool:
        """Whether `advance` has ended in a fault."""
        return self.status != OK

    @property
    def arming_rounds(self) -> int:
        """Number of rounds of arming so far, each with a drain of the buses."""
        return self.rounds

    @property
    def rows(self) -> int:
        """Number of recorded rows."""
        return self.publisher.recent_count

    @property
    def profile(self) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        """(rows of the robot, rows of its plant), as in cext.clock.stopwatch.Stopwatch.rows."""
        return self.body.watch.rows(), [] if self.body.plant_watch is None else self.body.plant_watch.rows()

    def spin(self, int64_t ticks) -> int:
        """Run bare ticks as fast as possible: no arming, no clock, no plant, no recording.

        For `bench`. Returns the ns of this thread's processor time.
        """
        status, took = self.body.spin(ticks)
        if status != OK:
            raise RuntimeError("%s at %s" % (name_of(status), self.control.culprit)) from self.control.error
        return took

    cdef int loop(self, int64_t ticks, double fade) noexcept nogil:
        cdef int64_t now, began, stood
        cdef int64_t tick = self.previous + 1
        cdef int64_t late = 0
        # grid point after the previous tick; a late tick runs at a newer one
        cdef int64_t awaited
        cdef int64_t epoch = self.began + self.first_tick
        cdef int status = OK
        if 0 <= self.ends_at and not 0 <= ticks <= self.ends_at:
            ticks = self.ends_at
        self.publisher.set_state(RUNNING)
        while ticks < 0 or tick < ticks:
            awaited = tick
            stood = 0
            if not self.virtual:
                self.clock.wait(epoch + self.clock.grid(tick))
            if self.signals.caught[0] or not self.publisher.make_room(False):
                break
            began = monotonic()
            self.watchdog.begin_work(began)
            if self.replay is not None:
                if not self.replay.advance(&tick, &late):
                    break
            elif not self.virtual:
                tick = self.place(tick, began - epoch, ticks)
                if self.overrun.fault:
                    status = OVERRUN
                if self.overrun.fault or tick == ticks:
                    break
                stood = self.began + self.first_tick - epoch       # ns that the simulation stood still
                epoch += stood
                late = began - epoch - self.clock.grid(tick)
            self.now = now = self.first_tick + self.clock.grid(tick)
            self.tick = tick
            self.body.watch.begin(tick, began)
            status = self.publisher.attend(began)
            if status == OK:
                status = self.advance_plant_to(tick)
            if status != OK:
                break
            self.body.set_clock(tick, self.previous, late)
            self.control.arena[AUTHORITY] = self.authority(tick, fade)
            status = self.body.run(                                # in the first tick after arming every block runs
                tick, self.previous if self.previous >= self.armed else -1, now if self.simulated else now + late)
            if status != OK or (self.publisher.records and not self.publisher.push_row(tick)):
                break
            if self.control.laps != NULL:
                lap(self.control.laps, RECORD)
            if self.layout != NULL:
                self.count(tick, awaited, late + stood, began)
            self.keep_signals(tick)
            self.previous = tick
            self.late = late
            tick += 1
            store_i32_relaxed(self.control.at, -1)
            self.watchdog.end_work()
        self.watchdog.end_work()
        return status

    cdef double authority(self, int64_t tick, double fade) noexcept nogil:
        """Return the permitted share of every command at a grid point: it increases after arming, and ends with 0."""
        cdef double rate = self.clock.rate
        cdef int64_t since = tick - self.armed
        cdef double share = 1.0 if fade <= 0.0 or since / rate >= fade else since / (rate * fade)
        if self.ends_at >= 0 and (self.ends_at - tick) / rate < self.fade_out:
            share = min(share, (self.ends_at - tick) / (rate * self.fade_out))
        return share

    cdef int64_t place(self, int64_t tick, int64_t since, int64_t ticks) noexcept nogil:
        """Return the grid point at which tick `tick` runs if it wakes up `since` ns after the first.

        Counts missed ones. A stall of a simulation stops its time, so that none is missed: the tick runs late, at its
        own grid point.
        """
        cdef int64_t due = max(tick, self.clock.newest(since))
        cdef int64_t behind = self.overrun.late
        cdef int64_t chosen
        cdef bint stalled = self.is_stall(tick, due)
        if 0 <= ticks < due and not stalled:
            due = ticks
        chosen = self.overrun.decide(tick, due)
        if due > tick and behind == 0:                             # ticks that catch up did not cause it
            if tick > 0 and self.body.watch.laps.last - self.began - self.first_tick >= self.clock.grid(tick + 1):
                self.to_blame = self.body.watch.laps.item
                self.body.watch.blame(self.to_blame, self.body.watch.laps.longest, due - tick)
            else:
                self.to_blame = WOKEN_LATE
                self.body.watch.blame(WOKEN_LATE, since - self.clock.grid(tick), due - tick)
        if self.layout != NULL and due > tick:
            store_i64(&self.layout.missed, self.layout.missed + (0 if stalled else chosen - tick))
            self.layout.caught_up += chosen == tick
        if self.overrun.fault or not stalled:
            return chosen
        self.stalled += chosen - tick
        return self.point_after_stall(tick, chosen)

    cdef void stop(self, double timeout) noexcept nogil:
        """Perform the safe stop at the end of a run."""
        store_i32_relaxed(self.control.at, -1)
        self.halt(timeout)
        self.control.live.dismiss(self.layout)
        self.publisher.set_state(SAFE)

# cython: freethreading_compatible=True
"""Watchdog of a run on a rig: a native thread that stops the motors if a step of a tick does not return.

    watch     measure the work of the present tick. The sleep between ticks does not count, so a late wake-up is not a
              hang
    fence     raise it when a tick has worked for max(3 periods, 15 ms), apart from the time of steps with an `allowance`,
              up to that
    stop      send the frames of the safe stop to every device, every 5 ms and after 200 ms at a falling rate, until the
              guardian sends them, which judges the replies, or the loop returns
    break     send a signal that ends a system call of a Python step and becomes a KeyboardInterrupt there
    exit      if the step cannot be interrupted, wait with the motors stopped until the operator ends the run, then exit
              the process

It never takes the GIL, and sleeps until a tick can first have worked for too long: one or two wake-ups in that time.

The buses, the devices and the ring have one owner at a time (cext.schedule.handover). The watchdog takes them from a hung
step, begins its stop then, and keeps them until the loop, which sends no further commands, has ended and dismissed it. If
the tick hangs elsewhere, as in a bus's own call or in the encoding of a command, the fence is raised and the guardian
stops the motors.
"""

import signal
import threading

from cpython.exc cimport PyErr_CheckSignals
from libc.stdint cimport int32_t, int64_t
from posix.unistd cimport _exit

from cext.atomics cimport load_i32_relaxed, load_i64, store_i32
from cext.fused.locate cimport IN_RUN, begin_samples, end_samples, sample
from cext.clock.deadline_clock cimport monotonic
from cext.memory.shared_state cimport RUNNING
from cext.posix cimport (
    CPU_COUNT, CPU_SET, CPU_ZERO, SCHED_FIFO, SCHED_RESET_ON_FORK, SIGURG, cpu_set_t, pthread_join, pthread_kill,
    pthread_self, sched_getparam, sched_getscheduler, sched_param, sched_setaffinity,
)
from cext.clock.signals cimport Signals, unblock
from cext.schedule.handover cimport LOOP, take_over
from cext.threads cimport be_called, doze, start_thread, wake
from cext.safety.thresholds cimport (
    BUS_TAKEOVER_PERIOD, HANG_MINIMUM, HANG_PERIODS, HANG_SIGNAL_PERIOD, HANG_SIGNAL_PERIOD_STOPPED,
    LOOP_STALL_MINIMUM, LOOP_STALL_PERIODS, STOP_LIMIT, STOP_ROUND,
)

cdef size_t STACK = 256 << 10           # bytes
cdef int64_t START_LIMIT = 1_000_000_000      # ns that the loop waits at most for the thread to have its priority
cdef int EXIT_CODE = 3                  # exit code of a run that ends in a fault


cdef void *enter(void *context) noexcept nogil:
    (<Watchdog>context).watch()
    return NULL


cdef class Watchdog:
    """Watchdog of one Executor.

    program : Program whose ticks are watched, and whose devices are stopped
    period : ns
    grace : ns of a delay that the run tolerates at least. The start of the blocks may take
        all of it, and a tick half of it: earlier than the guardian
    wanted : whether to watch at all
    processors : processors of the thread; those of the loop if empty
    """

    def __init__(self, Program program, Publisher publisher, Signals signals, int64_t period, int64_t grace,
                 bint wanted, processors):
        CPU_ZERO(&self.processors)
        for number in processors:
            CPU_SET(number, &self.processors)
        self.program, self.publisher, self.caught = program, publisher, signals.caught
        self.limit = max(HANG_PERIODS * period, HANG_MINIMUM, grace // 2)
        self.start_allowance = max(LOOP_STALL_PERIODS * period, LOOP_STALL_MINIMUM, grace) - self.limit
        self.handover = &self.shared if wanted else NULL
        program.hand_over(self.handover)

    cdef int start(self) except -1:
        """Start to watch; the calling thread is the loop's."""
        cdef sched_param parameters
        cdef int failed
        cdef int64_t started
        if self.handover == NULL:
            return 0
        self.shared.user, self.shared.since = LOOP, 0
        self.leave = self.awake = self.hung = 0
        self.at = -1
        self.loop = pthread_self()
        self.priority = 0
        if sched_getscheduler(0) & ~SCHED_RESET_ON_FORK == SCHED_FIFO and sched_getparam(0, &parameters) == 0:
            self.priority = parameters.sched_priority + 1
        begin_samples(self.program.code_map())
        self.before = None
        if threading.current_thread() is threading.main_thread():       # only the main thread can be interrupted
            self.before = signal.signal(SIGURG, signal.default_int_handler)
        failed = start_thread(&self.thread, enter, <void *>self, STACK)
        if failed:
            raise OSError(failed, "cannot start the thread of the watchdog")
        self.running = True
        # a new thread has no priority of its own: a busy machine can keep it waiting while the loop already runs
        started = monotonic()
        with nogil:
            while not load_i32(&self.awake) and monotonic() < started + START_LIMIT:
                doze(&self.awake, started + START_LIMIT)
        return 0

    cdef int end(self) except -1:
        """End the thread, and restore the state before `start`."""
        self.dismiss()
        if self.before is None:
            return 0
        try:
            # a signal that arrived after the step had returned
            PyErr_CheckSignals()
        except KeyboardInterrupt:
            if not self.has_bitten():
                raise
        finally:
            signal.signal(SIGURG, self.before)
            self.before = None
        return 0

    cdef void dismiss(self) noexcept nogil:
        """Wait until it has ended. The loop then owns everything again."""
        if not self.running:
            return
        self.running = False
        store_i32(&self.leave, 1)
        wake(&self.leave)
        pthread_join(self.thread, NULL)
        end_samples()
        self.shared.user, self.shared.since = LOOP, 0

    cdef void sleep(self, int64_t until) noexcept nogil:
        doze(&self.leave, until)

    cdef void watch(self) noexcept nogil:
        cdef int64_t now, since, allowed
        cdef int64_t due = monotonic() + self.limit
        cdef int64_t spared = 0
        if CPU_COUNT(&self.processors):
            sched_setaffinity(0, sizeof(cpu_set_t), &self.processors)
        name_and_priority(self.priority)
        store_i32(&self.awake, 1)
        wake(&self.awake)
        while not load_i32(&self.leave):
            self.sleep(due)
            # before `since` is read, as a lower bound of the work
            now = monotonic()
            # before `since`, which the end of a step moves first
            allowed = load_i64(&self.shared.allowed)
            since = load_i64(&self.shared.since)
            if since != 0 and allowed != 0 and now - since < self.limit + allowed:
                due = now + self.limit // 5
            elif since == 0 or now - since < self.limit:
                due = (now if since == 0 else since) + self.limit
            # this thread was delayed, perhaps with the whole machine
            elif now - due > self.limit // 4 and since != spared:
                spared = since
                due = now + self.limit // 3
            elif now >= due:
                self.began = since
                self.stop(now)

    cdef void stop(self, int64_t now) noexcept nogil:
        """Stop the motors of a hung tick. Returns when the loop has returned."""
        cdef int64_t began = now
        cdef int64_t damping = self.program.devices.stop.longest_damping
        # ns of unneeded damping, as nothing was under torque
        cdef int64_t damped = 0 if self.running_ticks() else damping
        cdef int64_t due = now
        cdef int64_t nudge = now
        cdef bint mine = False
        cdef bint over = False
        cdef bint in_run
        self.at = load_i32_relaxed(self.program.at)
        in_run = self.at >= IN_RUN
        store_i32(&self.hung, 1)
        if in_run:
            self.at = sample(self.loop)
        self.publisher.report_hang(self.at)
        self.publisher.raise_fence()
        while not load_i32(&self.leave):
            if in_run and self.at < 0:      # the loop's thread was not scheduled in time
                self.at = sample(self.loop)
                self.publisher.report_hang(self.at)
            now = monotonic()
            over = now - began >= STOP_LIMIT + damping - damped
            if not mine and take_over(&self.shared):
                mine = True
                self.program.devices.stop.begin(now - self.zero)
            if mine and now >= due and not self.publisher.guardian_stops(now):
                self.program.devices.stop.note_speeds()
                due = began - damped + self.program.devices.stop.send(
                    now - began + damped, now - self.zero, STOP_ROUND)
            if now >= nudge:
                pthread_kill(self.loop, SIGURG)
                nudge = now + (HANG_SIGNAL_PERIOD_STOPPED if over else HANG_SIGNAL_PERIOD)
            if over:
                unblock(NULL)                # the loop's thread may have blocked them
                if self.caught[0]:
                    _exit(EXIT_CODE)
            if mine:
                self.sleep(min(nudge, due if due > now else now + STOP_ROUND))
            else:
                self.sleep(nudge if over else now + BUS_TAKEOVER_PERIOD)

    cdef bint running_ticks(self) noexcept nogil:
        return self.publisher.layout == NULL or load_i32(&self.publisher.layout.state) == RUNNING


cdef void name_and_priority(int priority) noexcept nogil:
    """Set a priority one above the loop if granted, else the same.

    Without a grant the guardian, with its own priority, stops the motors.
    """
    if not be_called("tickwork-watch", priority):
        be_called("tickwork-watch", priority - 1)

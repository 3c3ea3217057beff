# cython: freethreading_compatible=True
"""The watchdog of a run on a rig: a native thread that stops the motors where a step of a tick does not come back.

    watch     for how long the present tick has been at work. The sleep between ticks is no work, so a late wake-up is no hang
    fence     raised when a tick has worked for max(3 periods, 15 ms)
    stop      the frames of the safe stop to every device, every 5 ms, for 200 ms or until the loop is back
    break     a signal ends the system call that a Python step may wait in, and becomes a KeyboardInterrupt there
    exit      what cannot be broken stays, with its motors stopped, until a person asks for the end: then the process exits

It never takes the GIL, and sleeps until the first moment at which a tick can have worked for too long: a wake-up or two in that time.

The buses have one user at a time. The loop lets go of them while it is in steps, and takes them back with a compare-and-swap; the
watchdog takes them from a step that hangs, with another, and keeps them until the loop, which then sends no command any more, has come
to its end and dismissed it. Where the tick hangs elsewhere, as in a bus's own call, the fence is up and the guardian stops the motors.
"""

import signal
import threading

from cpython.exc cimport PyErr_CheckSignals
from libc.stdint cimport int32_t, int64_t
from posix.unistd cimport _exit

from cext.atomics cimport load_i64, store_i32
from cext.clock.deadline_clock cimport monotonic
from cext.safety.shared_state cimport RUNNING
from cext.posix cimport (
    CPU_COUNT, CPU_SET, CPU_ZERO, SCHED_FIFO, SCHED_RESET_ON_FORK, SIG_UNBLOCK, SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGURG, SIGUSR1, cpu_set_t, pthread_join,
    pthread_kill, pthread_self, pthread_sigmask, sched_getparam, sched_getscheduler, sched_param, sched_setaffinity, sigaddset, sigemptyset,
    sigset_t,
)
from cext.clock.signals cimport Signals
from cext.threads cimport be_called, doze, start_thread, wake
from cext.safety.thresholds cimport (
    BUS_TAKEOVER_PERIOD, HANG_MINIMUM, HANG_PERIODS, HANG_SIGNAL_PERIOD, HANG_SIGNAL_PERIOD_STOPPED, LOOP_STALL_MINIMUM, LOOP_STALL_PERIODS,
    STOP_LIMIT, STOP_ROUND,
)

cdef size_t STACK = 256 << 10           # bytes
cdef int EXIT_CODE = 3                  # of a run that ends in a fault


cdef void *enter(void *context) noexcept nogil:
    (<Watchdog>context).watch()
    return NULL


cdef class Watchdog:
    """The watchdog of one Executor.

    program : Program whose ticks are watched, and whose devices are stopped
    period : ns
    wanted : whether to watch at all
    processors : that it stays on; where there are none, those of the loop
    """

    def __init__(self, Program program, Publisher journal, Signals signals, int64_t period, bint wanted, processors):
        CPU_ZERO(&self.processors)
        for number in processors:
            CPU_SET(number, &self.processors)
        self.program, self.journal, self.caught = program, journal, signals.caught
        self.limit = max(HANG_PERIODS * period, HANG_MINIMUM)
        self.patience = max(LOOP_STALL_PERIODS * period, LOOP_STALL_MINIMUM) - self.limit
        self.handover = &self.shared if wanted else NULL

    cdef int start(self) except -1:
        """Watch from now on; the calling thread is the loop's."""
        cdef sched_param parameters
        cdef int failed
        if self.handover == NULL:
            return 0
        self.shared.user, self.shared.since = LOOP, 0
        self.leave = self.hung = 0
        self.at = -1
        self.loop = pthread_self()
        self.priority = 0
        if sched_getscheduler(0) & ~SCHED_RESET_ON_FORK == SCHED_FIFO and sched_getparam(0, &parameters) == 0:
            self.priority = parameters.sched_priority + 1
        self.before = None
        if threading.current_thread() is threading.main_thread():       # no other can be interrupted
            self.before = signal.signal(SIGURG, signal.default_int_handler)
        failed = start_thread(&self.thread, enter, <void *>self, STACK)
        if failed:
            raise OSError(failed, "there is no thread for the watchdog")
        self.running = True
        return 0

    cdef int end(self) except -1:
        """Everything is as before `start`."""
        self.dismiss()
        if self.before is None:
            return 0
        try:
            PyErr_CheckSignals()                                        # a signal that found the step gone already
        except KeyboardInterrupt:
            if not self.has_bitten():
                raise
        finally:
            signal.signal(SIGURG, self.before)
            self.before = None
        return 0

    cdef void dismiss(self) noexcept nogil:
        """Wait until it has gone. From then on everything is the loop's again."""
        if not self.running:
            return
        self.running = False
        store_i32(&self.leave, 1)
        wake(&self.leave)
        pthread_join(self.thread, NULL)
        self.shared.user, self.shared.since = LOOP, 0

    cdef void sleep(self, int64_t until) noexcept nogil:
        doze(&self.leave, until)

    cdef void watch(self) noexcept nogil:
        cdef int64_t now, since
        cdef int64_t due = monotonic() + self.limit
        cdef int64_t spared = 0
        if CPU_COUNT(&self.processors):
            sched_setaffinity(0, sizeof(cpu_set_t), &self.processors)
        name_and_priority(self.priority)
        while not load_i32(&self.leave):
            self.sleep(due)
            now = monotonic()                                           # before `since` is read: so long it has worked for certain
            since = load_i64(&self.shared.since)
            if since == 0 or now - since < self.limit:
                due = (now if since == 0 else since) + self.limit
            elif now - due > self.limit // 4 and since != spared:       # we were away ourselves: so, perhaps, was the whole machine
                spared = since
                due = now + self.limit // 3
            elif now >= due:
                self.began = since
                self.stop(now)

    cdef void stop(self, int64_t now) noexcept nogil:
        """The tick hangs. Returns when the loop is back."""
        cdef int64_t began = now
        cdef int64_t damping = self.program.devices.longest_damping
        cdef int64_t damped = 0 if self.running_ticks() else damping    # ns of damping that are not needed: nothing was under torque
        cdef int64_t due = now
        cdef int64_t nudge = now
        cdef bint mine = False
        cdef bint over = False
        self.at = self.program.at
        store_i32(&self.hung, 1)
        self.journal.raise_fence_for(self.at)
        self.program.devices.begin_stop()
        while not load_i32(&self.leave):
            now = monotonic()
            over = now - began >= STOP_LIMIT + damping - damped
            mine = mine or swap(&self.shared.user, NOBODY, WATCHDOG)
            if mine and not over and now >= due:
                self.program.devices.note_speeds(self.journal.layout)
                due = began - damped + self.program.devices.send_stop(
                    now - began + damped, now - self.zero, STOP_ROUND, self.journal.layout)
            if now >= nudge:
                pthread_kill(self.loop, SIGURG)
                nudge = now + (HANG_SIGNAL_PERIOD_STOPPED if over else HANG_SIGNAL_PERIOD)
            if over:
                hear_signals()
                if self.caught[0]:
                    _exit(EXIT_CODE)
            self.sleep(nudge if over else due if mine else now + BUS_TAKEOVER_PERIOD)

    cdef bint running_ticks(self) noexcept nogil:
        return self.journal.layout == NULL or load_i32(&self.journal.layout.state) == RUNNING


cdef void name_and_priority(int priority) noexcept nogil:
    """One above the loop where that is granted, else beside it. Without a grant the guardian is there, who has one of its own."""
    if not be_called("tickwork-watch", priority):
        be_called("tickwork-watch", priority - 1)


cdef void hear_signals() noexcept nogil:
    """Take the signals that end a run here, too: the loop's thread may have blocked them."""
    cdef sigset_t ours
    sigemptyset(&ours)
    sigaddset(&ours, SIGINT)
    sigaddset(&ours, SIGTERM)
    sigaddset(&ours, SIGHUP)
    sigaddset(&ours, SIGQUIT)
    sigaddset(&ours, SIGUSR1)
    pthread_sigmask(SIG_UNBLOCK, &ours, NULL)

# cython: freethreading_compatible=True
"""The executor: one thread, one clock, and the life cycle of a run.

    arming     enable and zero-torque frames until every device has answered
    settle     blocks start from the present measurement, so that nothing kicks
    running    the tick, at absolute deadlines that keep their grid
    stopping   the fence goes up; zero torque and disable until every device has confirmed
    safe       nothing moves

It runs on the main thread without the GIL. Python's own signal handlers would wait for the end of the loop, so it has
its own: they set a flag that is read after every sleep, and are taken away again at the end.
"""

import gc
from dataclasses import dataclass

from cpython.exc cimport PyErr_CheckSignals
from libc.errno cimport EINTR
from libc.stdint cimport int32_t, int64_t, uint32_t, uint64_t
from libc.stdlib cimport calloc, free
from libc.string cimport memset

from cext.abi cimport (
    AUTHORITY, BUS_ERROR, DEVICE_FAULT, DT, FENCED, FRAMES_PER_DEVICE, FRAMES_PER_TICK, LATENESS, NO_ANSWER, NOT_FINITE, OK, OUT_OF_LIMITS,
    PERIOD, PYTHON_ERROR, SILENT, TICK, TIME, WAKE, Frame,
)
from cext.histogram cimport Histogram, add
from cext.page cimport ARMING, ROW, RUNNING, SAFE, STOPPING, Page, PageLayout, commit, load_i32, load_u64, reserve, store_i32, store_i64
from cext.posix cimport (
    CLOCK_MONOTONIC, CLOCK_REALTIME, CLOCK_THREAD_CPUTIME_ID, PR_SET_TIMERSLACK, POLLIN, SIGHUP, SIGINT, SIGTERM, TIMER_ABSTIME,
    action, clock_gettime, clock_nanosleep, poll, pollfd, prctl, sigaction, timespec,
)
from cext.program cimport Blame, Device, Program

cdef extern from *:
    """
    static volatile int tw_signal = 0;
    static void tw_on_signal(int number) { if (!tw_signal) tw_signal = number; }
    """
    int caught "tw_signal"               # a handler has nowhere else to put it
    void on_signal "tw_on_signal"(int number) noexcept nogil

cdef int[3] SIGNALS = [SIGINT, SIGTERM, SIGHUP]

STATUS = {
    OK: "ok",
    NOT_FINITE: "not finite",
    OUT_OF_LIMITS: "out of limits",
    PYTHON_ERROR: "exception",
    NO_ANSWER: "no answer",
    SILENT: "silent",
    DEVICE_FAULT: "device fault",
    BUS_ERROR: "bus error",
    FENCED: "fenced",
}


@dataclass(frozen=True)
class Outcome:
    """How a run ended.

    status : "ok", or the fault: one of the values of STATUS, or "kernel status N"
    culprit : path of the block, device or bus the fault came from, or None
    tick : the grid point it happened at; -1 while arming
    signal : number of the signal that ended the run, 0 if none
    error : the exception of a Python block, or None
    unconfirmed : paths of the devices that did not confirm the safe stop
    unanswered : paths of the devices that did not answer while arming
    """

    status: str
    culprit: str | None
    tick: int
    signal: int
    error: BaseException | None
    unconfirmed: tuple
    unanswered: tuple

    @property
    def faulted(self):
        return self.status != "ok"


cdef inline int64_t clock(int which) noexcept nogil:
    cdef timespec now
    clock_gettime(which, &now)
    return <int64_t>now.tv_sec * 1000000000 + now.tv_nsec


cdef inline int64_t monotonic() noexcept nogil:
    return clock(CLOCK_MONOTONIC)


cdef inline void sleep_until(int64_t deadline) noexcept nogil:
    """Sleep to an absolute instant; a signal that we act on ends the sleep, any other does not."""
    cdef timespec request
    request.tv_sec = deadline // 1000000000
    request.tv_nsec = deadline % 1000000000
    while clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &request, NULL) == EINTR and caught == 0:
        pass


cdef class Executor:
    """Runs a program at a fixed rate, with the plant of a simulation behind it if there is one.

    Parameters
    ----------
    control : Program, the robot's diagram
    rate : Hz
    plant : Program or None, run `substeps` times a tick, at the tick's end
    page : Page or None; with one, rows, frames and statistics go through it
    virtual : do not sleep: as fast as the machine goes; a full ring makes the loop wait instead of dropping
    reader : a pidfd of the process that drains the page, or -1; its end frees a loop that waits for it
    """

    cdef Program control, plant
    cdef Page page
    cdef PageLayout *layout
    cdef double rate
    cdef int substeps, reader
    cdef bint virtual, simulated
    cdef int64_t began, first_tick, period, tick, previous, plant_tick
    cdef int64_t now             # ns from the run's begin to the present round or tick

    def __init__(self, Program control, double rate, *, Program plant=None, int substeps=1, Page page=None, bint virtual=False,
                 int reader=-1):
        if not 0.0 < rate <= 1e9:
            raise ValueError("the rate must be above 0 Hz and at most 1e9 Hz, as the grid is in ns, not %r" % rate)
        if substeps < 1:
            raise ValueError("the plant's rate must be a whole multiple of the diagram's")
        if page is not None and 16 * (3 + control.column_count) > <int64_t>page.layout.capacity:
            raise ValueError("a ring of %d bytes cannot hold two rows of %d numbers" % (page.layout.capacity, 2 + control.column_count))
        self.control, self.plant, self.page = control, plant, page
        self.layout = NULL if page is None else page.layout
        self.rate, self.substeps, self.virtual, self.reader = rate, substeps, virtual, reader
        self.simulated = plant is not None or control.device_count == 0
        self.period = <int64_t>(1e9 / rate + 0.5)

    def run(self, int64_t ticks=-1, *, double fade=0.5, double arming_timeout=1.0, double stopping_timeout=0.2):
        """Arm, run `ticks` grid points (-1: until a signal), stop safely, and say how it ended.

        fade : s, over which commands grow to their full size after arming
        arming_timeout : s, in which every device must answer
        stopping_timeout : s, after which the safe stop no longer waits for confirmations
        """
        cdef action install
        cdef action[3] before
        cdef int index, status
        cdef tuple unanswered = ()
        global caught
        if not (fade >= 0.0 and arming_timeout >= 0.0 and stopping_timeout >= 0.0):
            raise ValueError("times of a run are 0 s or more: fade %r, arming_timeout %r, stopping_timeout %r" % (
                fade, arming_timeout, stopping_timeout))
        self.control.reset()
        if self.plant is not None:
            self.plant.reset()
        self.tick = self.previous = -1
        self.plant_tick = self.now = 0
        self.clear_page()
        collecting = gc.isenabled()
        gc.collect()
        gc.freeze()
        gc.disable()
        caught = 0
        memset(&install, 0, sizeof(action))
        install.sa_handler = on_signal
        for index in range(3):
            sigaction(SIGNALS[index], &install, &before[index])
        try:
            PyErr_CheckSignals()                                   # one that Python caught until now would wait for the end of the run
            with nogil:
                prctl(PR_SET_TIMERSLACK, 1)
                self.begin()
                status = self.arm(arming_timeout)
            if status == NO_ANSWER:
                unanswered = tuple(self.control.silent_devices())
            with nogil:
                if status == OK and not caught:
                    status = self.loop(ticks, fade)
                self.stop(stopping_timeout)
        finally:
            for index in range(3):
                sigaction(SIGNALS[index], &before[index], NULL)
            gc.unfreeze()
            if collecting:
                gc.enable()
        if self.layout != NULL:
            store_i32(&self.layout.status, status)
        error = self.control.error
        culprit = self.control.culprit if status != OK else None
        if self.plant is not None and culprit is None and status != OK:
            error, culprit = self.plant.error, self.plant.culprit
        return Outcome(
            STATUS.get(status, "kernel status %d" % status), culprit, self.tick, caught, error,
            tuple(self.control.silent_devices()), unanswered,
        )

    def spin(self, int64_t ticks):
        """Run bare ticks as fast as possible: no arming, no clock, no plant, and what is recorded goes nowhere.

        For `bench`: returns the ns of this thread's processor time that they took.
        """
        cdef int64_t start, tick
        cdef int status = OK
        cdef double *row = NULL
        self.control.reset()
        row = <double *>calloc(max(1, self.control.column_count), sizeof(double))
        with nogil:
            start = clock(CLOCK_THREAD_CPUTIME_ID)
            for tick in range(ticks):
                self.set_clock(self.control, tick, tick - 1, self.rate, 0)
                status = self.control.run(&self.control.output, tick, tick - 1)
                if status == OK:
                    status = self.control.run(&self.control.update, tick, tick - 1)
                if status != OK:
                    break
                self.control.record(row)
            start = clock(CLOCK_THREAD_CPUTIME_ID) - start
        free(row)
        if status != OK:
            raise RuntimeError("%s at %s" % (STATUS.get(status, status), self.control.culprit)) from self.control.error
        return start

    cdef void clear_page(self):
        """Forget an earlier run on the same page; the ring keeps what has not been read."""
        cdef PageLayout *page = self.layout
        if page == NULL:
            return
        page.tick = -1
        page.ticks = page.missed = page.dropped = page.busy = page.waited = 0
        page.frames_received = page.frames_sent = page.frames_foreign = page.frames_malformed = 0
        page.status = page.closed = 0
        if page.began != 0:
            page.fence = 0              # of the run before; one that was raised ahead of the first run holds
        memset(&page.lateness, 0, sizeof(Histogram))
        memset(&page.execution, 0, sizeof(Histogram))

    cdef void set_state(self, int32_t state) noexcept nogil:
        if self.layout != NULL:
            store_i32(&self.layout.state, state)

    cdef void set_clock(self, Program program, int64_t tick, int64_t previous, double rate, int64_t late) noexcept nogil:
        program.arena[TIME] = tick / rate
        program.arena[TICK] = <double>tick
        program.arena[DT] = (tick - previous) / rate
        program.arena[PERIOD] = 1.0 / rate
        program.arena[LATENESS] = late * 1e-9
        program.arena[WAKE] = program.arena[TIME] + late * 1e-9

    cdef inline int64_t grid(self, int64_t tick) noexcept nogil:
        """ns from tick 0 to `tick`, without the drift of a rounded period."""
        cdef double at = tick * (1e9 / self.rate)
        return <int64_t>(at + 0.5 if at >= 0.0 else at - 0.5)

    cdef int advance_plant(self, int64_t now) noexcept nogil:
        """The plant's share of a period: it hears what was sent, moves, and answers."""
        cdef int index, status
        cdef double rate = self.rate * self.substeps
        cdef int64_t instant
        if self.plant is None:
            return OK
        for index in range(self.substeps):
            instant = now + index * self.period / self.substeps
            self.set_clock(self.plant, self.plant_tick, self.plant_tick - 1, rate, 0)
            status = self.plant.receive(instant, NULL)
            if status == OK:
                status = self.plant.run(&self.plant.output, self.plant_tick, self.plant_tick - 1)
            if status == OK:
                status = self.plant.command()
            if status == OK:
                status = self.plant.transmit(instant, NULL)
            if status == OK:
                status = self.plant.run(&self.plant.update, self.plant_tick, self.plant_tick - 1)
            self.plant_tick += 1
            if status != OK:
                return status
        return OK

    cdef int send_batches(self, bint enable, bint zero, bint disable, int64_t now) noexcept nogil:
        """Frames that were encoded at compile time, to every device; `enable` only to those that have not answered."""
        cdef int number
        cdef Device *device
        cdef int status = OK
        for number in range(self.control.device_count):
            device = &self.control.devices[number]
            if enable and device.replies < device.replies_wanted:
                status |= self.control.send(device.bus, device.enable.frames, device.enable.count, now, self.layout)
            if zero:
                status |= self.control.send(device.bus, device.zero.frames, device.zero.count, now, self.layout)
            if disable:
                status |= self.control.send(device.bus, device.disable.frames, device.disable.count, now, self.layout)
        return BUS_ERROR if status != OK else OK

    cdef bint all_answered(self) noexcept nogil:
        cdef int number
        for number in range(self.control.device_count):
            if self.control.devices[number].replies < self.control.devices[number].replies_wanted:
                return False
        return True

    cdef void want_replies(self, bint zero, bint disable) noexcept nogil:
        cdef int number
        cdef Device *device
        for number in range(self.control.device_count):
            device = &self.control.devices[number]
            device.replies = 0
            device.replies_wanted = 0
            if zero:
                device.replies_wanted += device.zero.count
            if zero and not disable and device.zero.count == 0 and device.timeout > 0.0:
                device.replies_wanted = 1                          # a sensor that is never asked, and is missed when it is silent
            if disable:
                device.replies_wanted += device.disable.count

    cdef void begin(self) noexcept nogil:
        """Set the zero of the run's time, one period from now."""
        cdef timespec wall
        self.began = monotonic() + self.period
        self.first_tick = 0
        if self.layout == NULL:
            return
        clock_gettime(CLOCK_REALTIME, &wall)
        self.layout.wall = <int64_t>wall.tv_sec * 1000000000 + wall.tv_nsec + self.period
        self.layout.began = self.began
        self.layout.first_tick = 0

    cdef int arm(self, double timeout) noexcept nogil:
        """Zero-torque frames, one round a period, until every device has answered."""
        cdef int64_t rounds = <int64_t>min(timeout * self.rate, 1e15) + 1
        cdef int64_t round, now
        cdef int status = OK
        self.set_state(ARMING)
        self.want_replies(True, False)
        for round in range(rounds + 1 if self.control.device_count else 0):
            self.now = now = self.grid(round)
            if not self.virtual:
                sleep_until(self.began + now)
            if caught or not self.make_room(False):
                return OK
            if self.fenced():
                return FENCED
            status = self.control.receive(now, self.layout)
            if status != OK:
                return status
            if self.all_answered():
                self.first_tick = now                              # tick 0 is here, with the answers just heard
                if self.layout != NULL:
                    self.layout.first_tick = now
                self.set_clock(self.control, 0, -1, self.rate, 0)
                return self.control.start_from_here()
            status = self.send_batches(True, True, False, now)
            if status == OK:
                status = self.advance_plant(now)
            if status != OK:
                return status
        return NO_ANSWER if self.control.device_count else OK

    cdef inline bint fenced(self) noexcept nogil:
        return self.layout != NULL and load_i32(&self.layout.fence) != 0

    cdef int loop(self, int64_t ticks, double fade) noexcept nogil:
        cdef int64_t now, began, behind, skipped
        cdef int64_t tick = 0
        cdef int64_t late = 0
        cdef int64_t epoch = self.began + self.first_tick
        cdef int status = OK
        cdef PageLayout *page = self.layout
        self.set_state(RUNNING)
        while ticks < 0 or tick < ticks:
            if not self.virtual:
                sleep_until(epoch + self.grid(tick))
            if caught or not self.make_room(False):
                break
            began = monotonic()
            if not self.virtual:
                behind = <int64_t>((began - epoch) * (self.rate * 1e-9))        # the grid point we are really at
                if behind > tick:
                    if ticks >= 0 and behind > ticks:
                        behind = ticks
                    if page != NULL:
                        store_i64(&page.missed, page.missed + behind - tick)
                    tick = behind
                    if tick == ticks:
                        break
                late = began - epoch - self.grid(tick)
            self.now = now = self.first_tick + self.grid(tick)
            self.tick = tick
            for skipped in range(self.previous + 1, tick):         # the plant does not stand still meanwhile
                if status == OK:
                    status = self.advance_plant(self.first_tick + self.grid(skipped))
            if status != OK:
                break
            self.set_clock(self.control, tick, self.previous, self.rate, late)
            self.control.arena[AUTHORITY] = 1.0 if fade <= 0.0 or tick / self.rate >= fade else tick / (self.rate * fade)
            status = self.body(tick, now if self.simulated else now + late)
            if status != OK:
                break
            if page != NULL:
                if not self.push_row(page, tick):
                    break
                add(&page.lateness, late, tick)
                store_i64(&page.tick, tick)
                store_i64(&page.ticks, page.ticks + 1)
            self.previous = tick
            if page != NULL:
                began = monotonic() - began
                add(&page.execution, began, tick)
                page.busy += began
            tick += 1
        return status

    cdef int body(self, int64_t tick, int64_t now) noexcept nogil:
        """One tick, from the first frame received to the last state updated."""
        cdef int status = self.control.receive(now, self.layout)
        if status == OK:
            status = self.control.watch(now)
        if status == OK:
            status = self.control.run(&self.control.output, tick, self.previous)
        if status == OK:
            status = self.control.command()
        if status == OK:
            status = FENCED if self.fenced() else self.control.transmit(now, self.layout)
        if status == OK:
            status = self.control.run(&self.control.update, tick, self.previous)
        if status == OK:
            status = self.advance_plant(now)
        return status

    cdef bint push_row(self, PageLayout *page, int64_t tick) noexcept nogil:
        """The recorded signals of this tick into the ring. False: a signal came while waiting for room."""
        cdef double *row = <double *>reserve(page, ROW, 8 * (2 + self.control.column_count))
        cdef int64_t since
        while row == NULL:
            if not self.virtual:
                page.dropped += 1
                return True
            since = monotonic()
            if not self.wait_for_reader():
                page.dropped += 1
                return True
            page.waited += monotonic() - since
            if caught:
                return False
            row = <double *>reserve(page, ROW, 8 * (2 + self.control.column_count))
        row[0] = <double>tick
        row[1] = self.control.arena[TIME]
        self.control.record(row + 2)
        commit(page)
        return True

    cdef bint make_room(self, bint stopping) noexcept nogil:
        """In virtual time: wait until the ring can take all that one tick pushes, so that nothing is dropped.

        False: a signal came. `stopping` waits through signals, for a second at most.
        """
        cdef PageLayout *page = self.layout
        cdef uint64_t need
        cdef int64_t since
        cdef int patience = 1000
        if page == NULL or not self.virtual:
            return True
        need = 8 * (3 + self.control.column_count)
        need += (sizeof(Frame) + 8) * (FRAMES_PER_TICK * self.control.bus_count + 3 * FRAMES_PER_DEVICE * self.control.device_count)
        need = min(need, page.capacity // 2)                       # a ring too small for that drops
        if page.capacity - (page.head - load_u64(&page.tail)) >= need:
            return True
        since = monotonic()
        while page.capacity - (page.head - load_u64(&page.tail)) < need and self.wait_for_reader():
            patience -= 1
            if (stopping and patience == 0) or (not stopping and caught != 0):
                break
        page.waited += monotonic() - since
        return stopping or not caught

    cdef bint wait_for_reader(self) noexcept nogil:
        """A millisecond for the recorder to make room. False: there is no recorder, or it has ended."""
        cdef pollfd ended
        if self.reader < 0:
            return False
        ended.fd, ended.events, ended.revents = self.reader, POLLIN, 0
        return poll(&ended, 1, 1) <= 0

    cdef void stop(self, double timeout) noexcept nogil:
        """The safe stop: fence, then zero torque and disable, again and again until every device has confirmed or time is up."""
        cdef int64_t step = max(100000, min(self.period, 5000000))
        cdef int64_t now = self.now + self.period
        cdef int64_t waited = 0
        cdef Blame blame = self.control.failed                     # what fails from here on is not why
        if self.layout != NULL:
            store_i32(&self.layout.fence, 1)
        self.set_state(STOPPING)
        self.make_room(True)
        self.control.receive(now, self.layout)                     # answers to the last commands confirm nothing
        while self.control.device_count > 0:
            self.want_replies(True, True)
            self.make_room(True)
            self.send_batches(False, True, True, now)
            self.advance_plant(now)
            now += step
            waited += step
            if not self.virtual:
                sleep_until(monotonic() + step)
            self.control.receive(now, self.layout)
            if self.all_answered() or waited >= timeout * 1e9:
                break
        self.control.failed = blame
        self.set_state(SAFE)

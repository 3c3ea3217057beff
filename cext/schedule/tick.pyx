# cython: freethreading_compatible=True
"""One tick of a robot, and the part of its period for the plant."""

from libc.stdlib cimport calloc, free

from cext.abi cimport DT, LATENESS, OK, PERIOD, REAL_TIME, TICK, TIME, WAKE
from cext.status cimport HUNG
from cext.atomics cimport store_i32_relaxed
from cext.clock.histogram cimport add
from cext.schedule.live cimport apply_changes
from cext.schedule.program cimport run_phase
from cext.clock.deadline_clock cimport clock, monotonic
from cext.posix cimport CLOCK_THREAD_CPUTIME_ID
from cext.clock.stopwatch cimport COMMAND, PLANT, RECEIVE, RECORD, TRANSMIT, Laps, lap
from cext.schedule.handover cimport acquire, release


cdef class TickBody:
    """Programs of a tick, in order.

    plant : Program or None, run `substeps` times at the end of the tick
    real_time : whether ticks keep real time; their parts are then timed
    profile : whether every step is timed
    """

    def __init__(self, Program control, Program plant, int substeps, DeadlineClock clock, Publisher publisher,
            bint real_time, bint profile):
        if substeps < 1:
            raise ValueError("the plant's rate must be an integer multiple of the diagram's")
        self.control, self.plant, self.substeps, self.clock, self.publisher = control, plant, substeps, clock, publisher
        self.real_time = real_time
        self.watch = Stopwatch(control.schedule, profile)
        control.stamp(self.watch if real_time or profile else None)
        if publisher.layout != NULL:
            self.watch.laps.waits = &publisher.layout.gil
        if plant is not None:
            self.plant_watch = Stopwatch(plant.schedule, True) if profile else None
            plant.stamp(self.plant_watch)

    cdef void reset(self):
        self.control.reset()
        self.control.arena[REAL_TIME] = self.real_time
        if self.plant is not None:
            self.plant.reset()
            self.plant.arena[REAL_TIME] = self.real_time
            if self.plant_watch is not None:
                self.plant_watch.reset()
        self.watch.reset()
        self.plant_tick = self.plant_due = 0

    cdef void set_clock(self, int64_t tick, int64_t previous, int64_t late) noexcept nogil:
        write_clock(self.control.arena, tick, previous, self.clock.rate, late)

    cdef int run(self, int64_t tick, int64_t previous, int64_t now) noexcept nogil:
        """Run a tick, from the mailbox and the first received frame to the last state update.

        now : ns from the start of the run
        """
        cdef Laps *laps = self.control.laps if self.control.devices.buses.count > 0 else NULL
        cdef int64_t on_wires = 0
        cdef int status
        store_i32_relaxed(self.control.at, -1)
        status = apply_changes(self.control.live, self.publisher.layout, tick, self.control.arena[DT])
        store_i32_relaxed(self.control.at, RECEIVE)
        if status == OK:
            status = self.control.devices.receive(now)
        if laps != NULL:
            on_wires = lap(laps, RECEIVE)
        if status == OK:
            status = self.control.devices.watch(now)
        release(self.handover)
        if status == OK:
            status = run_phase(self.control, &self.control.output, tick, previous)
        if not acquire(self.handover):
            return HUNG
        self.control.publish_held()
        store_i32_relaxed(self.control.at, COMMAND)
        if status == OK:
            status = self.control.devices.command()
            if status == HUNG:                              # the watchdog owns the devices
                return HUNG
        store_i32_relaxed(self.control.at, TRANSMIT)
        if status == OK:
            status = self.control.devices.transmit(now)
        if laps != NULL:
            on_wires += lap(laps, TRANSMIT)
            if self.publisher.layout != NULL:
                add(&self.publisher.layout.bus, on_wires, tick)
        release(self.handover)
        if status == OK:
            status = run_phase(self.control, &self.control.update, tick, previous)
        if not acquire(self.handover):
            return HUNG
        self.control.publish_held()
        store_i32_relaxed(self.control.at, RECORD if self.plant is None else PLANT)
        if status == OK and self.plant is not None:
            status = self.advance_plant(now)
            if self.control.laps != NULL:
                lap(self.control.laps, PLANT)
        return status

    cdef int advance_plant(self, int64_t now) noexcept nogil:
        """Run the plant for a period: it receives frames, moves, and replies."""
        cdef int index, status
        if self.plant is None:
            return OK
        for index in range(self.substeps):
            status = self.step_plant(now + index * self.clock.period / self.substeps)
            if status != OK:
                return status
        self.plant_due = now + self.clock.period
        return OK

    cdef void advance_plant_until(self, int64_t until) noexcept nogil:
        """Run all steps of the plant that begin before `until`, in ns from the start of the run.

        For a safe stop, whose rounds are not periods.
        """
        if self.plant is None:
            return
        while self.plant_due < until:
            self.step_plant(self.plant_due)
            self.plant_due += max(self.clock.period // self.substeps, 1)

    cdef int step_plant(self, int64_t instant) noexcept nogil:
        cdef int status
        write_clock(self.plant.arena, self.plant_tick, self.plant_tick - 1, self.clock.rate * self.substeps, 0)
        if self.plant.laps != NULL:
            self.plant_watch.begin(self.plant_tick, monotonic())
        status = self.plant.devices.receive(instant)
        if self.plant.laps != NULL:
            lap(self.plant.laps, RECEIVE)
        if status == OK:
            status = run_phase(self.plant, &self.plant.output, self.plant_tick, self.plant_tick - 1)
        if status == OK:
            status = self.plant.devices.command()
        if status == OK:
            status = self.plant.devices.transmit(instant)
        if self.plant.laps != NULL:
            lap(self.plant.laps, TRANSMIT)
        if status == OK:
            status = run_phase(self.plant, &self.plant.update, self.plant_tick, self.plant_tick - 1)
        self.plant_tick += 1
        return status

    def spin(self, int64_t ticks) -> tuple[int, int]:
        """Run bare ticks as fast as possible: no devices, no clock, no plant, no recording.

        Returns the status and the ns of this thread's processor time.
        """
        cdef int64_t start, tick
        cdef int status = OK
        cdef double *row = <double *>calloc(max(1, self.control.column_count), sizeof(double))
        cdef Laps *laps = self.control.laps
        self.control.reset()
        self.control.laps = NULL
        with nogil:
            start = clock(CLOCK_THREAD_CPUTIME_ID)
            for tick in range(ticks):
                write_clock(self.control.arena, tick, tick - 1, self.clock.rate, 0)
                status = run_phase(self.control, &self.control.output, tick, tick - 1)
                if status == OK:
                    status = run_phase(self.control, &self.control.update, tick, tick - 1)
                if status != OK:
                    break
                self.control.record(row)
            start = clock(CLOCK_THREAD_CPUTIME_ID) - start
        free(row)
        self.control.laps = laps
        return status, start


cdef inline void write_clock(double *arena, int64_t tick, int64_t previous, double rate, int64_t late) noexcept nogil:
    # A division takes longer than a step: its result is kept while the rate is the same, which DT and PERIOD show.
    if tick - previous != 1 or arena[DT] != arena[PERIOD] or arena[PERIOD] == 0.0:
        arena[DT] = (tick - previous) / rate
        arena[PERIOD] = 1.0 / rate
    arena[TIME] = tick / rate
    arena[TICK] = <double>tick
    arena[LATENESS] = late * 1e-9
    arena[WAKE] = arena[TIME] + late * 1e-9

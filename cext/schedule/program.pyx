# cython: freethreading_compatible=True
"""Program: a schedule in native memory, with its arena and its steps in order.

    look       steps that read the present measurement for the start of blocks
    settle     steps that start blocks from it
    output     steps of a tick, in segments of one kind, so that the GIL is acquired once for consecutive Python steps
    update     steps that prepare the next tick

Its devices communicate; the executor has the life cycle, the clock and the recording.
"""

import numpy as np

from libc.stdint cimport uintptr_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy

from cext.fused.join cimport Code
from cext.fused.locate cimport CodeMap
from cext.safety.forks cimport is_child, leave
from cext.abi cimport DT, LATENESS, OK, PERIOD
from cext.status cimport HUNG, PYTHON_ERROR
from cext.atomics cimport store_i32_relaxed, store_i64
from cext.clock.deadline_clock cimport monotonic
from cext.clock.histogram cimport add
from cext.schedule.handover cimport acquire, release
from cext.schedule.python_step cimport PythonStep
from cext.clock.stopwatch cimport FIRST_STEP, GIL_WAIT, lap

from cext.schedule.device_reports import DeviceReports
from cext.fused import library
from cext.schedule.kernel_table import address, words

cdef enum:
    UNTIMED = -1000000              # so far below 0 that no step of the phase becomes an item


cdef class Program:
    """Program of a `graph.Schedule`.

    Parameters
    ----------
    schedule : graph.Schedule
    ends : BusEnd, one for each of schedule.buses
    """

    def __init__(self, schedule, ends=()):
        self.schedule = schedule
        self.image = np.ascontiguousarray(schedule.arena, dtype=np.float64)
        self.memory = self.image.copy()
        self.arena = <double *><uintptr_t>self.memory.ctypes.data
        self.initial = <const double *><uintptr_t>self.image.ctypes.data
        self.size = len(self.memory)
        self.kept = self.memory.copy()
        self.last = <double *><uintptr_t>self.kept.ctypes.data
        self.keep = []
        self.at = &self.own_at
        self.blocks = list(schedule.python_blocks)
        self.calls = []
        self.live = LiveTable(schedule.live, schedule.live_rules, schedule.held_bounds, self.memory)
        self.held_start, self.memory_start = schedule.held_start, schedule.memory_start
        self.load_phase(&self.look, schedule.look, False)
        self.load_phase(&self.settle, schedule.settle, False)
        self.load_phase(&self.output, schedule.output, True)
        self.load_phase(&self.update, schedule.update, True)
        self.fuse()
        self.look.item = self.settle.item = UNTIMED
        self.output.item, self.update.item = FIRST_STEP, FIRST_STEP + len(schedule.output)
        self.devices = Devices(schedule, ends, self.memory, self.live)
        self.column_count = len(schedule.columns)
        self.columns = <int32_t *>calloc(max(1, self.column_count), sizeof(int32_t))
        for index, slot in enumerate(schedule.columns):
            self.columns[index] = slot

    def __dealloc__(self):
        free(self.look.steps); free(self.look.segments)
        free(self.settle.steps); free(self.settle.segments)
        free(self.output.steps); free(self.output.segments)
        free(self.update.steps); free(self.update.segments)
        free(self.columns)

    cdef int load_phase(self, Phase *phase, steps, bint holds) except -1:
        """Copy the steps, and split them into segments of consecutive steps of one kind, rate and condition.

        holds : whether steps may hold exceptions, which they may not while a robot is being armed
        """
        cdef Step *step
        cdef Segment *segment = NULL
        cdef int index
        cdef int first = 0
        # The tables of all steps are contiguous, in the order of the tick, for prefetching.
        tables = [entry.table for entry in steps if entry.kernel is not None]
        cdef const int32_t *table = self.hold(words(word for each in tables for word in (*each.slots, *each.sizes)))
        phase.steps = <Step *>calloc(max(1, len(steps)), sizeof(Step))
        phase.segments = <Segment *>calloc(max(1, len(steps)), sizeof(Segment))
        phase.step_count = len(steps)
        phase.segment_count = 0
        previous = None
        for index, entry in enumerate(steps):
            step = &phase.steps[index]
            if entry.kernel is not None:
                step.kernel = <kernel_t><uintptr_t>address(entry.kernel)
                self.keep.append(entry.kernel)
                step.slots = table
                step.sizes = step.slots + len(entry.table.slots)
                table = step.sizes + len(entry.table.sizes)
            else:
                call = PythonStep(entry.function, entry.name, entry.inputs, entry.outputs, self.memory, entry.hold
                    if holds else 0)
                self.keep.append(call)
                if holds:
                    self.calls.append(call)
                step.python = <PyObject *>call
            kind = (
                step.kernel == NULL, entry.every, entry.conditions, entry.name if entry.allowance else "", entry.repeat)
            if segment == NULL or kind != previous:
                segment = &phase.segments[phase.segment_count]
                phase.segment_count += 1
                segment.repeat, segment.back = entry.repeat, -1
                segment.first, segment.every, segment.python = index, entry.every, step.kernel == NULL
                segment.allowance = round(entry.allowance * 1e9)
                segment.condition_count, segment.conditions = len(entry.conditions), self.hold(words(entry.conditions))
                previous = kind
            segment.last = index + 1
        for index in range(phase.segment_count):
            segment = &phase.segments[index]
            if index == 0 or phase.segments[index - 1].repeat != segment.repeat:
                first = index
            if segment.repeat and (
                    index + 1 == phase.segment_count or phase.segments[index + 1].repeat != segment.repeat):
                segment.back = first
        return 0

    cdef int fuse(self) except -1:
        """Join the machine code of the native segments of a tick. Without stencils, or memory for code, there is none."""
        cdef Phase *phases[2]
        cdef Segment *segment
        cdef int part, index
        self.code, self.fused = None, 0
        stencils = library.library()
        if stencils is None:
            return 0
        phases = [&self.output, &self.update]
        items = FIRST_STEP, FIRST_STEP + len(self.schedule.output)
        runs = []
        for part, steps in enumerate((self.schedule.output, self.schedule.update)):
            for index in range(phases[part].segment_count):
                segment = &phases[part].segments[index]
                if not segment.python:
                    runs.append((items[part] + segment.first, self.run_of(phases[part], segment, items[part], steps)))
        try:
            self.code = Code(runs, stencils.parts["end"], stencils.target)
        except OSError:
            return 0
        entries = iter(self.code.entries)
        for part in range(2):
            for index in range(phases[part].segment_count):
                segment = &phases[part].segments[index]
                if not segment.python:
                    segment.code = <fused_t><uintptr_t>next(entries)
                    segment.plain = (
                        segment.every == 1 and segment.condition_count == 0 and segment.allowance == 0
                        and segment.repeat == 0)
            if phases[part].segment_count == 1 and phases[part].segments.plain:
                phases[part].code = phases[part].segments.code
        self.fused = sum(not addresses for _, run in runs for *_, addresses in run)
        return 0

    cdef const CodeMap *code_map(self) noexcept:
        """Return the steps of the machine code, or NULL without any."""
        return NULL if self.code is None else &self.code.map

    cdef list run_of(self, const Phase *phase, const Segment *segment, int item, list steps):
        """Return the stencils of a segment, as cext.fused.join.Code receives them.

        item : item of the stopwatch of the first step of the phase
        """
        cdef const Step *step
        cdef int index
        run = []
        for index in range(segment.first, segment.last):
            entry = steps[index]
            stencil = library.stencil_of(entry.kernel, entry.table.sizes)
            if stencil is not None:
                run.append((stencil, entry.table.slots, entry.table.sizes, ()))
            else:
                step = &phase.steps[index]
                run.append((library.library().parts["call"], (), (), (
                    <uintptr_t>step.kernel, <uintptr_t>step.slots, <uintptr_t>step.sizes, <uintptr_t>&self.at,
                    item + index)))
        return run

    cdef int32_t *hold(self, array) except? NULL:
        """Return the address of an array, and keep the array as long as the program."""
        self.keep.append(array)
        return <int32_t *><uintptr_t>array.ctypes.data

    def reset(self) -> None:
        """Restore the state of the first tick: arena, devices, Python blocks."""
        self.memory[:] = self.image
        self.live.reset()
        for block in self.blocks:
            block.reset()
        for call in self.calls:
            (<PythonStep>call).reset()
        self.devices.reset()
        self.error = None
        self.failed.step = -1
        self.gil_taken = 0

    @property
    def values(self) -> np.ndarray:
        """The arena as an array that shares its memory."""
        return self.memory

    @property
    def late(self) -> float:
        """Lateness of the newest tick in s."""
        return float(self.arena[LATENESS])

    @property
    def held(self) -> list[tuple[str, int, int, BaseException]]:
        """Held exceptions: a list of (path, count, first tick, last exception) of each block that held any."""
        found = {}
        for call in self.calls:
            if call.held:
                path, count, first, last = found.get(call.name, (call.name, 0, call.first_held, None))
                found[path] = path, count + call.held, min(first,
                    call.first_held), call.last_held if last is None else last
        return list(found.values())

    @property
    def nan(self) -> list[tuple[str, int, int]]:
        """Outputs of Python blocks that were NaN: a list of (path, number of such steps, number of steps)."""
        return [(path, count, call.returned) for call in self.calls for path, count in call.nan]

    @property
    def reports(self) -> DeviceReports:
        """Reports of the devices."""
        return self.devices.reports

    def count_from(self, int64_t tick) -> None:
        """Count missing replies from this tick on, as arming may fill the bus before."""
        self.devices.counted_from = tick

    @property
    def culprit(self) -> str | None:
        """Path of the block, device or bus whose step failed last, or None."""
        if self.reports.culprit is not None:
            return self.reports.culprit
        if self.failed.step >= 0:
            phases = self.schedule.look, self.schedule.settle, self.schedule.output, self.schedule.update
            return phases[self.failed.phase][self.failed.step].name
        return self.live.culprit

    cdef void stamp(self, Stopwatch watch):
        """Time the parts of each tick with a stopwatch, or not, with None."""
        self.watch = watch
        self.laps = self.devices.laps = self.live.laps = NULL if watch is None else &watch.laps
        self.devices.item = FIRST_STEP + self.output.step_count + self.update.step_count

    def inputs(self, str path) -> dict[str, float]:
        """Return the values at the scalar inputs of a block at the end of the run, by name; empty for an unknown
        block.
        """
        return {name: float(self.kept[slot]) for name, slot in self.schedule.inputs.get(path, {}).items()}

    @property
    def final(self) -> np.ndarray:
        """The arena at the end of the run, before the safe stop received anything."""
        return self.kept

    cdef void keep_values(self) noexcept nogil:
        memcpy(self.last, self.arena, self.size * sizeof(double))

    cdef int run(self, Phase *phase, int64_t tick, int64_t previous) noexcept nogil:
        cdef int index = 0
        cdef int status = OK
        cdef Segment *segment
        cdef int64_t periods, began
        cdef double dt = self.arena[DT]
        cdef double period = self.arena[PERIOD]
        while index < phase.segment_count:
            segment = &phase.segments[index]
            if segment.plain and self.laps == NULL:
                status = self.run_code(phase, segment.first, segment.code)
                if status != OK:
                    return status
                index += 1
                continue
            periods = self.due(segment, tick, previous)
            if periods > 0 and not segment.python:
                if segment.every != 1:
                    self.set_clock(segment, periods, dt, period)
                began = self.begin_allowance(segment) if segment.allowance else 0
                status = self.run_native(phase, segment)
                if segment.allowance:
                    self.end_allowance(segment, began)
            elif periods > 0:
                status = self.run_python(phase, &index, tick, previous)
            if periods > 0 and (segment.python or segment.every != 1):
                self.arena[DT], self.arena[PERIOD] = dt, period
            if status != OK:
                return status
            segment = &phase.segments[index]        # run_python may have run those that follow
            index = segment.back if segment.back >= 0 and self.arena[segment.repeat] != 0.0 else index + 1
        return OK

    cdef int64_t due(self, Segment *segment, int64_t tick, int64_t previous) noexcept nogil:
        """Return how many of its periods have passed since it ran; with 0 it does not run."""
        if segment.condition_count and not self.enabled(segment):
            return 0
        return 1 if segment.every == 1 or previous < 0 else tick // segment.every - previous // segment.every

    cdef void set_clock(self, Segment *segment, int64_t periods, double dt, double period) noexcept nogil:
        """Set the clock of a slow block: its period, and the number of periods passed."""
        if segment.every != 1:
            period *= segment.every
            dt = periods * period
        self.arena[DT], self.arena[PERIOD] = dt, period

    cdef int64_t begin_allowance(self, Segment *segment) noexcept nogil:
        """Begin a step that may take longer than the limits of watchdog and guardian. Returns the time."""
        if self.handover != NULL:
            store_i64(&self.handover.allowed, segment.allowance)
        if self.layout != NULL:
            store_i64(&self.layout.beat, self.layout.beat + segment.allowance)
        return monotonic()

    cdef void end_allowance(self, Segment *segment, int64_t began) noexcept nogil:
        """End it: the time that it took, up to its allowance, does not count as work of the tick."""
        cdef int64_t took = min(monotonic() - began, segment.allowance)
        if self.handover != NULL:
            store_i64(&self.handover.since, self.handover.since + took)
            store_i64(&self.handover.allowed, 0)
        if self.layout != NULL:
            store_i64(&self.layout.beat, self.layout.beat + took - segment.allowance)

    cdef int run_native(self, Phase *phase, Segment *segment) noexcept nogil:
        cdef int status
        cdef double *arena = self.arena
        cdef const Step *first = phase.steps + segment.first
        cdef const Step *step = first
        cdef const Step *last = phase.steps + segment.last
        cdef Laps *laps = self.laps if phase.item >= 0 else NULL
        cdef bint each = laps != NULL and laps.each != NULL
        cdef int item = phase.item + segment.first
        cdef int32_t *at = self.at
        if segment.code != NULL and not each:
            status = self.run_code(phase, segment.first, segment.code)
            if status == OK and laps != NULL:
                lap(laps, item)
            return status
        while step < last:
            store_i32_relaxed(at, item)
            item += 1
            status = step.kernel(arena, step.slots, step.sizes)
            if status != OK:
                self.blame_step(phase, <int>(step - phase.steps))
                return status
            if each:
                lap(laps, phase.item + <int>(step - phase.steps))
            step += 1
        if laps != NULL and not each:
            lap(laps, phase.item + segment.first)
        return OK

    cdef int failed_in(self, Phase *phase, int first, int64_t outcome) noexcept nogil:
        """Attribute the outcome of a segment's machine code to its step. Returns the status."""
        cdef int step = first + <int>(outcome >> 32)
        store_i32_relaxed(self.at, phase.item + step)
        self.blame_step(phase, step)
        return <int>outcome

    cdef bint enabled(self, Segment *segment) noexcept nogil:
        cdef int index
        for index in range(segment.condition_count):
            if not self.arena[segment.conditions[index]] > 0.5:
                return False    # NaN does not enable
        return True

    cdef void blame_step(self, Phase *phase, int step) noexcept nogil:
        self.failed.step = step
        self.failed.phase = (
            0 if phase == &self.look else 1 if phase == &self.settle else 2 if phase == &self.output else 3)

    cdef int run_python(self, Phase *phase, int *index, int64_t tick, int64_t previous) noexcept nogil:
        """Run the segment at `index` and all consecutive Python segments under one acquisition of the GIL.

        Leaves `index` at the last.
        """
        cdef Segment *segment
        cdef int step = -1
        cdef int64_t periods
        cdef double dt = self.arena[DT]
        cdef double period = self.arena[PERIOD]
        cdef Laps *laps = self.laps if phase.item >= 0 else NULL
        cdef int64_t waited, began
        self.gil_taken += 1
        store_i32_relaxed(self.at, GIL_WAIT)
        with gil:
            if laps != NULL:
                waited = lap(laps, GIL_WAIT)
                if laps.waits != NULL:
                    add(laps.waits, waited, laps.tick)
            try:
                while True:
                    segment = &phase.segments[index[0]]
                    periods = self.due(segment, tick, previous)
                    if periods > 0:
                        self.set_clock(segment, periods, dt, period)
                        began = self.begin_allowance(segment) if segment.allowance else 0
                        for step in range(segment.first, segment.last):
                            store_i32_relaxed(self.at, phase.item + step)
                            if (<PythonStep>phase.steps[step].python).hold == 0:
                                (<PythonStep>phase.steps[step].python).call(self.arena)
                            elif (<PythonStep>phase.steps[step].python).attempt(self.arena, tick):
                                (<PythonStep>phase.steps[step].python).has_news = self.held_news = True
                            if laps != NULL:
                                lap(laps, phase.item + step)
                        if segment.allowance:
                            self.end_allowance(segment, began)
                    if (segment.back >= 0 or index[0] + 1 == phase.segment_count
                            or not phase.segments[index[0] + 1].python):
                        break
                    index[0] += 1
            except BaseException as error:
                if is_child():
                    leave()
                self.error = error
                self.blame_step(phase, step)
                return PYTHON_ERROR
        if is_child():
            leave()
        return OK

    cdef uint64_t share(self, SharedLayout *layout):
        """Set the shared state for events of held exceptions and actuators, or NULL.

        Returns the ring bytes that one tick may need.
        """
        self.layout = layout
        self.at = &self.own_at if layout == NULL else &layout.at
        return self.devices.share(layout) + sum(
            8 + (<PythonStep>call).news.size() for call in self.calls if call.hold)

    cdef int start_from_here(self) noexcept nogil:
        """Restart blocks from the present measurement: run `look`, reset all state, then run `settle`.

        The outputs of a disabled subsystem are 0 again, and not those from before a fault. Returns HUNG if the watchdog
        has taken the devices meanwhile.
        """
        cdef int status
        memcpy(self.arena + self.held_start, self.initial + self.held_start, (self.memory_start - self.held_start)
            * sizeof(double))
        self.devices.arming.keep_ready()
        release(self.handover)
        status = self.run(&self.look, 0, -1)
        store_i32_relaxed(self.at, -1)
        if status == OK:
            status = self.reset_blocks()
        if not acquire(self.handover):
            return HUNG
        self.devices.arming.restore_ready()
        release(self.handover)
        if status == OK:
            status = self.run(&self.settle, 0, -1)
        return status if acquire(self.handover) else HUNG

    cdef void hand_over(self, Handover *handover) noexcept nogil:
        """Set the owner of buses, devices and ring, with the times of the watchdog; NULL without a watchdog."""
        self.handover = self.devices.switch.handover = handover

    cdef void publish_held(self) noexcept nogil:
        """Publish the events of held exceptions. Steps do not own the ring: they leave this to its owner."""
        if self.held_news:
            self.held_news = False
            self.publish_held_in(&self.output)
            self.publish_held_in(&self.update)

    cdef void publish_held_in(self, const Phase *phase) noexcept nogil:
        cdef int index
        for index in range(phase.step_count):
            if phase.steps[index].python != NULL:
                (<PythonStep>phase.steps[index].python).publish(self.layout)

    cdef int reset_blocks(self) noexcept nogil:
        memcpy(self.arena + self.memory_start, self.initial + self.memory_start, (self.size - self.memory_start)
            * sizeof(double))
        with gil:
            try:
                for block in self.blocks:
                    block.reset()
            except BaseException as error:
                self.error = error
                return PYTHON_ERROR
        return OK

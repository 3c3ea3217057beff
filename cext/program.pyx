# cython: freethreading_compatible=True
"""A schedule loaded into native memory: its arena, its steps in order, its devices, and the phases of a tick over them.

    receive    every bus drained, each frame offered to the devices on it
    output     steps in order, in segments of one kind, so that the GIL is taken once for neighbouring Python steps
    command    each device encodes its frames; nothing is sent if one of them refuses
    transmit   the frames go out
    update     steps that prepare the next tick

The life cycle around these, the clock and the recording are the executor's.
"""

import numpy as np

from cpython.pycapsule cimport PyCapsule_CheckExact, PyCapsule_GetPointer
from libc.stdint cimport uint8_t, uint32_t, uintptr_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy, memset

from cext.abi cimport (
    BUS_ERROR, DECODE, DEVICE_FAULT, DT, ENCODE, EXTENDED, FOREIGN, KERNEL, MALFORMED, OK, PERIOD, PYTHON_ERROR, SILENT,
    TAKEN,
)
from cext.page cimport FRAME, commit, reserve
from cext.python_step cimport PythonStep


def address(kernel, kind="kernel"):
    """The address of a native kernel, given as a PyCapsule named by its C signature, a ctypes function pointer, or a Numba cfunc.

    kind is "kernel", "decode" or "encode". TypeError if it is none of these, or its signature is another.
    """
    cdef const char *name = DECODE() if kind == "decode" else ENCODE() if kind == "encode" else KERNEL()
    if PyCapsule_CheckExact(kernel):
        try:
            return <uintptr_t>PyCapsule_GetPointer(kernel, name)
        except ValueError:
            raise TypeError("the capsule of a native %s must be named %r: %r is not" % (kind, name.decode(), kernel)) from None
    if isinstance(getattr(kernel, "address", None), int):
        return int(kernel.address)
    import ctypes

    wanted = 3 if kind == "kernel" else 4
    if not isinstance(kernel, ctypes._CFuncPtr):
        raise TypeError("a native %s is a PyCapsule, a ctypes function or a Numba cfunc, not %r" % (kind, kernel))
    if kernel.argtypes is not None and len(kernel.argtypes) != wanted:
        raise TypeError("a native %s takes %d arguments, and %r takes %d" % (kind, wanted, kernel, len(kernel.argtypes)))
    function = ctypes.cast(kernel, ctypes.c_void_p).value
    if not function:
        raise TypeError("a native %s cannot be a null pointer" % kind)
    return int(function)


def call_kernel(kernel, double[::1] arena, table):
    """Run one kernel once, with the GIL, and return its status. For `block.step` and tests, not for the tick.

    table : graph.layout.KernelTable
    """
    cdef kernel_t function = <kernel_t><uintptr_t>address(kernel)
    cdef int32_t[::1] slots = slot_words(table)
    cdef int32_t[::1] sizes = words(table.sizes)
    return function(&arena[0], &slots[0] + 4, &sizes[0])


def words(values):
    return np.array(list(values) or [0], dtype=np.int32)


def slot_words(table):
    """The counts of a KernelTable, then its slots: a kernel is given the address behind the counts."""
    return words(table.counts + table.slots + (0,))


cdef class Program:
    """Loads a `graph.Schedule`.

    Parameters
    ----------
    schedule : graph.Schedule
    ends : BusEnd, one for each of schedule.buses
    """

    def __init__(self, schedule, ends=()):
        if len(ends) != len(schedule.buses):
            raise ValueError("the schedule has %d buses, and %d ends were given" % (len(schedule.buses), len(ends)))
        self.schedule = schedule
        self.image = np.ascontiguousarray(schedule.arena, dtype=np.float64)
        self.memory = self.image.copy()
        self.arena = <double *><uintptr_t>self.memory.ctypes.data
        self.initial = <const double *><uintptr_t>self.image.ctypes.data
        self.size = len(self.memory)
        self.keep = []
        self.blocks = list(schedule.python_blocks)
        self.memory_start = schedule.memory_start
        self.load_phase(&self.look, schedule.look)
        self.load_phase(&self.settle, schedule.settle)
        self.load_phase(&self.output, schedule.output)
        self.load_phase(&self.update, schedule.update)
        self.ends = list(ends)
        self.bus_count = len(ends)
        self.bus_ends = <void **>calloc(max(1, len(ends)), sizeof(void *))
        for index, end in enumerate(self.ends):
            self.bus_ends[index] = <void *>(<BusEnd?>end)
        self.load_devices(schedule.devices)
        self.column_count = len(schedule.columns)
        self.columns = <int32_t *>calloc(max(1, self.column_count), sizeof(int32_t))
        for index, slot in enumerate(schedule.columns):
            self.columns[index] = slot

    def __dealloc__(self):
        free(self.look.steps); free(self.look.segments)
        free(self.settle.steps); free(self.settle.segments)
        free(self.output.steps); free(self.output.segments)
        free(self.update.steps); free(self.update.segments)
        free(self.devices); free(self.outgoing); free(self.outgoing_count); free(self.bus_ends); free(self.columns)

    cdef int load_phase(self, Phase *phase, steps) except -1:
        """Copy the steps and cut them into segments of neighbours of one kind, rate and condition."""
        cdef Step *step
        cdef Segment *segment = NULL
        cdef int index
        # The tables of all steps lie in one run of memory, in the order of the tick, so that the cache gets them ahead of time.
        cdef const int32_t *table = self.hold(np.array(
            [word for entry in steps if entry.kernel is not None for word in (*entry.table.counts, *entry.table.slots, *entry.table.sizes)] or [0],
            dtype=np.int32))
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
                step.slots = table + 4
                step.sizes = step.slots + len(entry.table.slots)
                table = step.sizes + len(entry.table.sizes)
            else:
                call = PythonStep(entry.function, entry.name, entry.inputs, entry.outputs, self.memory)
                self.keep.append(call)
                step.python = <PyObject *>call
            kind = (step.kernel == NULL, entry.every, entry.conditions)
            if segment == NULL or kind != previous:
                segment = &phase.segments[phase.segment_count]
                phase.segment_count += 1
                segment.first, segment.every, segment.python = index, entry.every, step.kernel == NULL
                segment.condition_count, segment.conditions = len(entry.conditions), self.hold(words(entry.conditions))
                previous = kind
            segment.last = index + 1
        return 0

    cdef int32_t *hold(self, array) except? NULL:
        """Address of an array that lives as long as the program."""
        self.keep.append(array)
        return <int32_t *><uintptr_t>array.ctypes.data

    cdef int load_devices(self, devices) except -1:
        cdef Device *device
        cdef int index
        self.device_count = len(devices)
        self.devices = <Device *>calloc(max(1, len(devices)), sizeof(Device))
        self.outgoing = <Frame *>calloc(max(1, len(devices)) * FRAMES_PER_DEVICE, sizeof(Frame))
        self.outgoing_count = <int32_t *>calloc(max(1, self.bus_count), sizeof(int32_t))
        for index, entry in enumerate(devices):              # the schedule lists them bus by bus
            device = &self.devices[index]
            device.decode = <decode_t><uintptr_t>address(entry.decode, "decode")
            device.encode = <encode_t><uintptr_t>address(entry.encode, "encode")
            self.keep += [entry.decode, entry.encode]
            device.slots, device.sizes = self.hold(slot_words(entry.table)) + 4, self.hold(words(entry.table.sizes))
            device.bus, device.age, device.fault, device.timeout = entry.bus, entry.age, entry.fault, entry.timeout
            load_batch(&device.enable, entry.enable)
            load_batch(&device.zero, entry.zero)
            load_batch(&device.disable, entry.disable)
        return 0

    def reset(self):
        """Everything as at the first tick: arena, devices, Python blocks. What buses heard in an earlier run is forgotten."""
        cdef int index
        if self.ran:
            self.discard()
        self.ran = True
        self.memory[:] = self.image
        for block in self.blocks:
            block.reset()
        for index in range(self.device_count):
            self.devices[index].heard = self.devices[index].replies = self.devices[index].replies_wanted = 0
        self.error = None
        self.failed.step = self.failed.device = self.failed.bus = -1

    @property
    def values(self):
        """The arena as an array: the live memory, not a copy."""
        return self.memory

    @property
    def culprit(self):
        """Path of the block, device or bus whose step failed last, or None."""
        if self.failed.device >= 0:
            return self.schedule.devices[self.failed.device].name
        if self.failed.bus >= 0:
            return self.schedule.buses[self.failed.bus]
        if self.failed.step >= 0:
            phases = self.schedule.look, self.schedule.settle, self.schedule.output, self.schedule.update
            return phases[self.failed.phase][self.failed.step].name
        return None

    def inputs(self, str path):
        """Present values at the scalar inputs of a block, by name; empty if the schedule does not know it."""
        return {name: float(self.memory[slot]) for name, slot in self.schedule.inputs.get(path, {}).items()}

    def silent_devices(self):
        """Paths of the devices that have sent fewer replies than were wanted of them."""
        return [
            self.schedule.devices[index].name
            for index in range(self.device_count)
            if self.devices[index].replies < self.devices[index].replies_wanted
        ]

    cdef int run(self, Phase *phase, int64_t tick, int64_t previous) noexcept nogil:
        cdef int index
        cdef int status = OK
        cdef Segment *segment
        cdef int64_t periods
        cdef double dt = self.arena[DT]
        cdef double period = self.arena[PERIOD]
        for index in range(phase.segment_count):
            segment = &phase.segments[index]
            if segment.condition_count and not self.enabled(segment):
                continue
            if segment.every == 1:
                status = self.run_segment(phase, segment)
            else:
                periods = tick // segment.every - previous // segment.every if previous >= 0 else 1
                if periods > 0:
                    # A slow block sees its own clock: its period, and how many of them have passed.
                    self.arena[PERIOD] = period * segment.every
                    self.arena[DT] = periods * self.arena[PERIOD]
                    status = self.run_segment(phase, segment)
                    self.arena[DT], self.arena[PERIOD] = dt, period
            if status != OK:
                return status
        return OK

    cdef int run_segment(self, Phase *phase, Segment *segment) noexcept nogil:
        cdef int status
        cdef double *arena = self.arena
        cdef const Step *step = phase.steps + segment.first
        cdef const Step *last = phase.steps + segment.last
        if segment.python:
            return self.run_python(phase, segment)
        while step < last:
            status = step.kernel(arena, step.slots, step.sizes)
            if status != OK:
                self.blame_step(phase, <int>(step - phase.steps))
                return status
            step += 1
        return OK

    cdef bint enabled(self, Segment *segment) noexcept nogil:
        cdef int index
        for index in range(segment.condition_count):
            if not self.arena[segment.conditions[index]] > 0.5:
                return False    # NaN does not enable
        return True

    cdef void blame_step(self, Phase *phase, int step) noexcept nogil:
        self.failed.step = step
        self.failed.phase = 0 if phase == &self.look else 1 if phase == &self.settle else 2 if phase == &self.output else 3

    cdef int run_python(self, Phase *phase, Segment *segment) noexcept nogil:
        cdef int step = segment.first
        with gil:
            try:
                for step in range(segment.first, segment.last):
                    (<PythonStep>phase.steps[step].python).call(self.arena)
            except BaseException as error:
                self.error = error
                self.blame_step(phase, step)
                return PYTHON_ERROR
        return OK

    cdef int start_from_here(self) noexcept nogil:
        """Blocks start anew from the present measurement: one look at it, then all state as at reset, then those that can settle do."""
        cdef int status = self.run(&self.look, 0, -1)
        if status == OK:
            status = self.reset_blocks()
        if status == OK:
            status = self.run(&self.settle, 0, -1)
        return status

    cdef int reset_blocks(self) noexcept nogil:
        memcpy(self.arena + self.memory_start, self.initial + self.memory_start, (self.size - self.memory_start) * sizeof(double))
        with gil:
            try:
                for block in self.blocks:
                    block.reset()
            except BaseException as error:
                self.error = error
                return PYTHON_ERROR
        return OK

    cdef int receive(self, int64_t now, PageLayout *page) noexcept nogil:
        """Drain every bus, at most FRAMES_PER_TICK each; offer each frame to the devices on it. `page` may be NULL."""
        cdef int bus, count, index, number
        cdef Frame *frame
        cdef Device *device
        cdef int answer = FOREIGN
        for bus in range(self.bus_count):
            count = (<BusEnd>self.bus_ends[bus]).bus.receive(
                (<BusEnd>self.bus_ends[bus]).bus.context, self.received, FRAMES_PER_TICK)
            if count < 0:
                self.failed.bus = bus
                return BUS_ERROR
            for index in range(count):
                frame = &self.received[index]
                frame.bus = <uint8_t>bus
                frame.sent = 0
                answer = FOREIGN
                for number in range(self.device_count):
                    device = &self.devices[number]
                    if device.bus != bus:
                        continue
                    answer = device.decode(self.arena, device.slots, device.sizes, frame)
                    if answer == TAKEN:
                        device.heard = frame.time
                        device.replies += 1
                    if answer != FOREIGN:
                        break
                if page != NULL:
                    page.frames_received += 1
                    page.frames_foreign += answer == FOREIGN
                    page.frames_malformed += answer == MALFORMED
                    log_frame(page, frame)
        for number in range(self.device_count):
            device = &self.devices[number]
            if device.age >= 0:
                self.arena[device.age] = (now - device.heard) * 1e-9
        return OK

    cdef int watch(self, int64_t now) noexcept nogil:
        """A device that is silent past its timeout, or reports a fault, ends the run."""
        cdef int number
        cdef Device *device
        for number in range(self.device_count):
            device = &self.devices[number]
            if device.timeout > 0.0 and (now - device.heard) * 1e-9 > device.timeout:
                self.failed.device = number
                return SILENT
            if device.fault >= 0 and self.arena[device.fault] != 0.0:
                self.failed.device = number
                return DEVICE_FAULT
        return OK

    cdef int command(self) noexcept nogil:
        """Each device encodes into `outgoing`, bus by bus. If one refuses, nothing of the tick is sent."""
        cdef int number, count
        cdef int total = 0
        cdef Device *device
        memset(self.outgoing_count, 0, self.bus_count * sizeof(int32_t))
        for number in range(self.device_count):
            device = &self.devices[number]
            count = device.encode(self.arena, device.slots, device.sizes, &self.outgoing[total])
            if count < 0:
                memset(self.outgoing_count, 0, self.bus_count * sizeof(int32_t))
                self.failed.device = number
                return -count
            total += count
            self.outgoing_count[device.bus] += count
        return OK

    cdef int transmit(self, int64_t now, PageLayout *page) noexcept nogil:
        cdef int bus, status
        cdef int first = 0
        for bus in range(self.bus_count):
            status = self.send(bus, &self.outgoing[first], self.outgoing_count[bus], now, page)
            if status != OK:
                return status
            first += self.outgoing_count[bus]
        return OK

    cdef int send(self, int bus, Frame *frames, int count, int64_t now, PageLayout *page) noexcept nogil:
        cdef int index
        if count == 0:
            return OK
        for index in range(count):
            frames[index].time = now
            frames[index].bus = <uint8_t>bus
            frames[index].sent = 1
        count = (<BusEnd>self.bus_ends[bus]).bus.send((<BusEnd>self.bus_ends[bus]).bus.context, frames, count)
        if count < 0:
            self.failed.bus = bus
            return BUS_ERROR
        if page != NULL:                        # a full queue takes fewer than all: what it took is what was sent
            page.frames_sent += count
            for index in range(count):
                log_frame(page, &frames[index])
        return OK

    cdef void discard(self) noexcept nogil:
        """Forget what buses have heard: an answer to an earlier run is none."""
        cdef int bus, rounds
        for bus in range(self.bus_count):
            for rounds in range(64):
                if (<BusEnd>self.bus_ends[bus]).bus.receive((<BusEnd>self.bus_ends[bus]).bus.context, self.received, FRAMES_PER_TICK) <= 0:
                    break

    cdef void record(self, double *row) noexcept nogil:
        cdef int index
        for index in range(self.column_count):
            row[index] = self.arena[self.columns[index]]


cdef inline void log_frame(PageLayout *page, const Frame *frame) noexcept nogil:
    cdef void *room = reserve(page, FRAME, sizeof(Frame))
    if room == NULL:
        page.dropped += 1
        return
    memcpy(room, frame, sizeof(Frame))
    commit(page)


cdef int load_batch(Batch *batch, frames) except -1:
    """frames: a list of (arbitration id, is extended, data)."""
    cdef Frame *frame
    if len(frames) > FRAMES_PER_DEVICE:
        raise ValueError("at most %d frames a device, not %d" % (FRAMES_PER_DEVICE, len(frames)))
    batch.count = len(frames)
    for index, (identifier, extended, data) in enumerate(frames):
        frame = &batch.frames[index]
        frame.id = <uint32_t>identifier | (<uint32_t>EXTENDED if extended else 0)
        frame.length = <uint8_t>len(data)
        for position, byte in enumerate(data):
            frame.data[position] = byte
    return 0

from cpython.object cimport PyObject
from libc.stdint cimport int32_t, int64_t, uint64_t

from cext.abi cimport OK, kernel_t
from cext.atomics cimport store_i32_relaxed
from cext.fused.join cimport Code
from cext.fused.locate cimport IN_RUN, CodeMap
from cext.schedule.devices cimport Devices
from cext.schedule.handover cimport Handover
from cext.schedule.live cimport LiveTable
from cext.memory.shared_state cimport SharedLayout
from cext.schedule.python_step cimport PythonStep
from cext.clock.stopwatch cimport Laps, Stopwatch

# Runs the steps of a segment. Returns OK, or the status of the step that failed, with its number in the upper half.
ctypedef int64_t (*fused_t)(double *arena) noexcept nogil

cdef struct Step:
    kernel_t kernel              # NULL: a Python step
    const int32_t *slots
    const int32_t *sizes
    PyObject *python             # a PythonStep

cdef struct Segment:             # consecutive steps of one kind, one rate and one condition
    int first
    int last
    int every                    # runs when floor(tick / every) has changed
    int condition_count
    const int32_t *conditions    # slots that must all be true; else the segment holds its outputs
    int64_t allowance            # ns
    bint python
    fused_t code                 # all of its steps as one run of machine code, or NULL
    bint plain                   # has code, and runs in every tick without conditions, an allowance or repetition
    int repeat                   # slot: while it is not 0, the segments with it run again; 0: once
    int back                     # in the last of them, the first of them; else -1

cdef struct Phase:
    Step *steps
    Segment *segments
    int step_count
    int segment_count
    int item                     # stopwatch item of its first step, below 0 for none
    fused_t code                 # of its only segment if that is plain, else NULL

cdef struct FailedStep:          # -1: none
    int phase
    int step

cdef class Program:
    """Tables of one schedule, for the executor."""
    cdef double *arena
    cdef const double *initial   # arena at reset
    cdef int size
    cdef object memory, image, keep, kept
    cdef double *last            # arena at the end of the run
    cdef Phase look, settle, output, update
    cdef int held_start          # first slot of the outputs of conditional blocks
    cdef int memory_start        # first slot of the state
    cdef Devices devices
    cdef readonly LiveTable live
    cdef int32_t *columns
    cdef int column_count
    cdef public object error     # exception of a Python step
    cdef FailedStep failed
    cdef Stopwatch watch
    cdef Laps *laps              # NULL: not timed
    cdef int32_t *at             # present stopwatch item, below 0: none; in the shared state if there is one
    cdef int32_t own_at
    cdef Handover *handover      # handover of the watchdog; NULL without one
    cdef bint held_news          # a step has held an exception, whose event is not published yet
    cdef int64_t gil_taken
    cdef list blocks
    cdef list calls              # PythonSteps of the tick
    cdef SharedLayout *layout        # for the event of the first held exception; NULL: none
    cdef object schedule
    cdef Code code               # of the segments, or None
    cdef readonly int fused      # steps in machine code

    cdef const CodeMap *code_map(self) noexcept
    cdef int fuse(self) except -1
    cdef list run_of(self, const Phase *phase, const Segment *segment, int item, list steps)
    cdef void stamp(self, Stopwatch watch)
    cdef int load_phase(self, Phase *phase, steps, bint holds) except -1
    cdef uint64_t share(self, SharedLayout *layout)
    cdef int32_t *hold(self, array) except? NULL
    cdef void blame_step(self, Phase *phase, int step) noexcept nogil
    cdef void keep_values(self) noexcept nogil
    cdef int run(self, Phase *phase, int64_t tick, int64_t previous) noexcept nogil
    cdef int64_t due(self, Segment *segment, int64_t tick, int64_t previous) noexcept nogil
    cdef void set_clock(self, Segment *segment, int64_t periods, double dt, double period) noexcept nogil
    cdef int64_t begin_allowance(self, Segment *segment) noexcept nogil
    cdef void end_allowance(self, Segment *segment, int64_t began) noexcept nogil
    cdef int run_native(self, Phase *phase, Segment *segment) noexcept nogil
    cdef int run_python(self, Phase *phase, int *index, int64_t tick, int64_t previous) noexcept nogil
    cdef int failed_in(self, Phase *phase, int first, int64_t outcome) noexcept nogil
    cdef bint enabled(self, Segment *segment) noexcept nogil
    cdef void hand_over(self, Handover *handover) noexcept nogil
    cdef void publish_held(self) noexcept nogil
    cdef void publish_held_in(self, const Phase *phase) noexcept nogil
    cdef int start_from_here(self) noexcept nogil
    cdef int reset_blocks(self) noexcept nogil

    cdef inline int run_code(self, Phase *phase, int first, fused_t code) noexcept nogil:
        """Run the machine code of a segment. first : number of its first step"""
        cdef int64_t outcome
        store_i32_relaxed(self.at, IN_RUN + phase.item + first)
        outcome = code(self.arena)
        return OK if outcome == OK else self.failed_in(phase, first, outcome)

    cdef inline void record(self, double *row) noexcept nogil:
        cdef int index
        for index in range(self.column_count):
            row[index] = self.arena[self.columns[index]]


cdef inline int run_phase(Program program, Phase *phase, int64_t tick, int64_t previous) noexcept nogil:
    """Run the steps of a phase that are due in a tick. Returns OK, or the status of the step that failed."""
    if phase.code != NULL and program.laps == NULL:
        return program.run_code(phase, 0, phase.code)
    return OK if phase.segment_count == 0 else program.run(phase, tick, previous)

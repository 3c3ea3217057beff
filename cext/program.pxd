from cpython.object cimport PyObject
from libc.stdint cimport int32_t, int64_t

from cext.abi cimport FRAMES_PER_DEVICE, FRAMES_PER_TICK, Frame, decode_t, encode_t, kernel_t
from cext.buses cimport BusEnd
from cext.page cimport PageLayout

cdef struct Step:
    kernel_t kernel              # NULL: a Python step
    const int32_t *slots
    const int32_t *sizes
    PyObject *python             # a PythonStep

cdef struct Segment:             # neighbours of one kind, one rate and one condition
    int first
    int last
    int every                    # runs when floor(tick / every) has changed
    int condition_count
    const int32_t *conditions    # slots that must all be true; the segment holds while one is not
    bint python

cdef struct Phase:
    Step *steps
    Segment *segments
    int step_count
    int segment_count

cdef struct Batch:               # frames encoded at compile time
    Frame frames[FRAMES_PER_DEVICE]
    int count

cdef struct Device:
    decode_t decode
    encode_t encode
    const int32_t *slots
    const int32_t *sizes
    int bus
    int age                      # slot, -1 if it has none
    int fault                    # slot, -1 if it has none
    double timeout               # s
    Batch enable
    Batch zero
    Batch disable
    int64_t heard                # ns, when the newest sample arrived
    int64_t replies
    int64_t replies_wanted       # before it counts as answered

cdef struct Blame:               # what failed last, -1 where it was something else
    int phase
    int step
    int device
    int bus

cdef class Program:
    """The tables of one schedule, ready for the executor."""
    cdef double *arena
    cdef const double *initial   # what the arena holds at reset
    cdef int size
    cdef object memory, image, keep
    cdef Phase look, settle, output, update
    cdef int memory_start        # slot from which on the arena is state
    cdef Device *devices
    cdef int device_count
    cdef list ends               # BusEnd, one a bus
    cdef int bus_count
    cdef void **bus_ends         # the same, borrowed
    cdef int32_t *columns
    cdef int column_count
    cdef Frame[FRAMES_PER_TICK] received
    cdef Frame *outgoing
    cdef int32_t *outgoing_count # a bus
    cdef public object error     # what a Python step raised
    cdef Blame failed
    cdef bint ran
    cdef list blocks
    cdef object schedule

    cdef int load_phase(self, Phase *phase, steps) except -1
    cdef int32_t *hold(self, array) except? NULL
    cdef int load_devices(self, devices) except -1
    cdef void blame_step(self, Phase *phase, int step) noexcept nogil
    cdef int run(self, Phase *phase, int64_t tick, int64_t previous) noexcept nogil
    cdef int run_segment(self, Phase *phase, Segment *segment) noexcept nogil
    cdef bint enabled(self, Segment *segment) noexcept nogil
    cdef int run_python(self, Phase *phase, Segment *segment) noexcept nogil
    cdef int start_from_here(self) noexcept nogil
    cdef int reset_blocks(self) noexcept nogil
    cdef int receive(self, int64_t now, PageLayout *page) noexcept nogil
    cdef int watch(self, int64_t now) noexcept nogil
    cdef int command(self) noexcept nogil
    cdef int transmit(self, int64_t now, PageLayout *page) noexcept nogil
    cdef int send(self, int bus, Frame *frames, int count, int64_t now, PageLayout *page) noexcept nogil
    cdef void discard(self) noexcept nogil
    cdef void record(self, double *row) noexcept nogil

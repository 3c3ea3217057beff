"""Kernel ABI of native blocks. Public: labs compile their own blocks against this file.

Everything a schedule computes with lies in one contiguous array of doubles, the arena: the clock first, then signals,
parameters and the memory of blocks. A kernel is a C function. It gets the arena and two tables of the items that it
names (cext/kernel.py):

    slots   position of each item in the arena
    sizes   number of doubles of each item, 1 for a scalar

A kernel runs without the GIL. It must not allocate, lock, print or wait. It returns OK, or a status of its own from
FIRST_OWN_STATUS on, which is a fault.

Python holds a kernel as a `cext.kernel.Kernel`: the names of its items, and the function as a PyCapsule whose name is
its C signature (KERNEL below), as in SciPy's LowLevelCallable, or as a ctypes function pointer or a Numba cfunc.
"""

from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t

ctypedef int (*kernel_t)(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil

# A device has two more: decode receives every frame of its bus, and encode fills the frames to send.
ctypedef int (*decode_t)(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil
ctypedef int (*encode_t)(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil

cdef enum: # slots at the start of every arena, written by the executor
    TIME = 0                # s, nominal: tick / rate
    TICK = 1                # the grid point
    DT = 2                  # s since the previous executed tick: more than PERIOD after a skip
    PERIOD = 3              # s, 1 / rate
    WAKE = 4                # s, actual begin of the tick
    LATENESS = 5            # s, WAKE - TIME
    AUTHORITY = 6           # 0 to 1, permitted share of every command: increases after arming
    REAL_TIME = 7           # 1 if ticks keep real time; 0 in virtual time, where a kernel may wait for its own thread
    CLOCK_SLOTS = 8

cdef enum: # return values of a kernel; encode_t returns these negated, or a number of frames
    OK = 0
    NOT_FINITE = 1          # a command is NaN or infinite
    OUT_OF_LIMITS = 2       # a command is outside the proved interval
    ESTOP = 13              # an emergency stop
    FIRST_OWN_STATUS = 64

cdef enum: # return values of decode_t
    FOREIGN = 0             # not for this device
    TAKEN = 1               # a reply of this device
    NOTED = 2               # of this device, but not a reply to a command: a report
    COMMANDED = 3           # a command to this device from another node
    TWIN = 4                # a reply of a second device with the same id
    PRESSED = 5             # a reply of this device with a request to end the run
    ANSWERED = 6            # a reply of this device without a sample, such as one to a query of its faults
    IDLE = 7                # a reply of this device, which is not enabled: confirms no enabling
    MALFORMED = -1          # for this device, but short, long or corrupt: nothing was changed

cdef enum:
    POWER_LOSS = 100000000      # ns without a frame of a drive, after which it may have restarted

cdef enum:
    FRAME_BYTES = 64        # CAN FD
    FRAMES_PER_DEVICE = 4   # limit for encode_t
    FRAMES_PER_BATCH = 16   # limit for a device in one round of arming or the safe stop
    FRAMES_PER_TICK = 64    # limit of received frames per bus and tick

cdef enum: # Linux's struct can_frame: flags in the high bits of the identifier
    EXTENDED = 0x80000000
    REMOTE = 0x40000000
    ERROR_FRAME = 0x20000000
    ID_MASK = 0x1FFFFFFF

cdef struct Frame:
    int64_t time            # ns since the begin of the run, which is its arming
    uint32_t id
    uint8_t length
    uint8_t flags           # of CAN FD
    uint8_t bus
    uint8_t sent            # 1 for sent, 0 for received
    uint8_t data[FRAME_BYTES]

cdef struct Bus:
    # Neither blocks. receive fills at most `capacity` frames and returns their number; send returns the number of sent
    # frames.
    # A negative result reports a failure of the bus.
    # begin, which may be NULL, sets the zero of the frames' times, in ns of CLOCK_MONOTONIC.
    int (*receive)(void *context, Frame *frames, int capacity) noexcept nogil
    int (*send)(void *context, const Frame *frames, int count) noexcept nogil
    void (*begin)(void *context, int64_t began) noexcept nogil
    void *context
    # at, which may be NULL, sets the time of the run in ns before each receive, for buses with a clock of their own.
    void (*at)(void *context, int64_t now) noexcept nogil

# Names of capsules.
cdef inline const char *KERNEL() noexcept nogil:
    return "int (double *, int32_t const *, int32_t const *)"

cdef inline const char *DECODE() noexcept nogil:
    return "int (double *, int32_t const *, int32_t const *, Frame const *)"

cdef inline const char *ENCODE() noexcept nogil:
    return "int (double *, int32_t const *, int32_t const *, Frame *)"


from cpython.pycapsule cimport PyCapsule_New

cdef extern from *:
    """
    #define TICKWORK_ITEMS ((void *)(int[1024]){0})
    #ifndef TICKWORK_SOURCES
    #define TICKWORK_SOURCES "none"
    #endif
    #define TICKWORK_EXPORT(kernel, items) tickwork_export((void *)(kernel), TICKWORK_SOURCES " " #kernel, items)

    CYTHON_UNUSED static PyObject *tickwork_export(void *kernel, const char *text, PyObject *items) {
        PyObject *made = NULL, *module = PyImport_ImportModule("cext.kernel");
        PyObject *capsule = module ? PyCapsule_New(kernel, "int (double *, int32_t const *, int32_t const *)", NULL) : NULL;
        if (capsule && PyCapsule_SetContext(capsule, (void *)text) == 0)
            made = PyObject_CallMethod(module, "Kernel", "OO", capsule, items);
        Py_XDECREF(module);
        Py_XDECREF(capsule);
        return made;
    }
    """
    void *ITEMS "TICKWORK_ITEMS"    # (<Gain *>ITEMS)[0] is a Gain, from which `items` reads the names of its fields

    # The Kernel of a function: `gain = export(<kernel_t>gain_kernel, GAIN)`. The context of its capsule is the hash of
    # its sources and the C text of the first argument, by which cext.fused finds its machine code.
    object export "TICKWORK_EXPORT" (kernel_t kernel, tuple items)

cdef struct Rest:               # field `inputs` or `outputs` in the struct of a kernel: all that the struct leaves out
    int32_t count
    int32_t first               # index in the table, slots or sizes, of the entry of the first of them

cdef inline const int32_t *each(const void *table, Rest rest) noexcept nogil:
    """The positions, or sizes, of a Rest: `each(at, at.inputs)[k]`."""
    return <const int32_t *>table + rest.first

cdef inline tuple items(dict fields, str sizes=""):
    """The items of a kernel from the struct that names them: `GAIN = items((<Gain *>ITEMS)[0], "u[...] y[...]")`.

    sizes : the items that are not one number
    """
    from cext.kernel import of_struct
    return of_struct(fields, sizes)

cdef inline object export_decode(decode_t decode, tuple items):
    """The Kernel of a device's decode, as `export`."""
    from cext.kernel import Kernel
    return Kernel(PyCapsule_New(<void *>decode, DECODE(), NULL), items)

cdef inline object export_encode(encode_t encode, tuple items):
    """The Kernel of a device's encode, as `export`."""
    from cext.kernel import Kernel
    return Kernel(PyCapsule_New(<void *>encode, ENCODE(), NULL), items)

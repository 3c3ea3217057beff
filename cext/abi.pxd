"""The kernel ABI: what a native block is made of. Public: labs compile their own blocks against this file.

Everything a schedule computes with lives in one contiguous array of doubles, the arena: the clock first, then signals,
parameters and the memory of blocks. A kernel is a C function that is told where in the arena its things are:

    slots[i]   where item i begins
    sizes[i]   how many doubles it has (1 for a scalar)

    slots[INPUTS], slots[OUTPUTS], slots[PARAMETERS], slots[MEMORIES]   how many items of each kind there are

with the items in the order of the block's declaration: inputs, outputs, parameters, memory. It runs without the GIL; it
must not allocate, lock, print or wait. It returns OK, or a status of its own above FIRST_OWN_STATUS, which is a fault.

Handed over from Python, a kernel is a PyCapsule whose name is its C signature (KERNEL below), as SciPy's LowLevelCallable
has it, or anything with a ctypes address, such as a Numba cfunc.
"""

from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t

ctypedef int (*kernel_t)(double *arena, const int32_t *slots, const int32_t *sizes) noexcept nogil

# A device has two more: it is offered every frame its bus receives, and fills the frames it wants sent.
ctypedef int (*decode_t)(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil
ctypedef int (*encode_t)(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil

cdef enum: # slots at the start of every arena, written by the executor
    TIME = 0                # s, nominal: tick / rate
    TICK = 1                # the grid point
    DT = 2                  # s from the previous executed tick: more than PERIOD after a skip
    PERIOD = 3              # s, 1 / rate
    WAKE = 4                # s, when the tick really began
    LATENESS = 5            # s, WAKE - TIME
    AUTHORITY = 6           # 0 to 1, the share of every command that is let through: fades in after arming
    CLOCK_SLOTS = 8

cdef enum: # in front of slots[0]
    INPUTS = -4
    OUTPUTS = -3
    PARAMETERS = -2
    MEMORIES = -1

cdef enum: # what a kernel returns; encode_t returns these negated, or a number of frames
    OK = 0
    NOT_FINITE = 1          # a command is NaN or infinite
    OUT_OF_LIMITS = 2       # a command has left the interval that was proved
    PYTHON_ERROR = 3        # a Python block raised
    NO_ANSWER = 4           # a device did not answer while arming
    SILENT = 5              # a device has been silent for longer than its timeout
    DEVICE_FAULT = 6        # a device reports a fault
    BUS_ERROR = 7           # a bus cannot receive or send
    FENCED = 8              # another process has stopped the run
    OVERRUN = 9             # more grid points were missed than the run allows
    UNGUARDED = 10          # the guardian does not answer
    FOREIGN_COMMAND = 11    # somebody else commands one of our devices
    HUNG = 12               # a step did not come back, and the watchdog has stopped the devices
    ESTOP = 13              # an emergency stop
    RMS_TORQUE = 14         # a drive's RMS torque is above the rated one, and that shall end the run
    TOO_HOT = 15            # a drive is too hot
    BEYOND_ACCELERATION = 16    # a joint goes on accelerating beyond the bound on which its limit rests
    BEYOND_TORQUE = 17      # a drive measures more torque than its limit and its accuracy
    OVER_TRAVEL = 18        # a joint is outside its range
    OVERSPEED = 19          # a joint is faster than its max_velocity
    NOT_FOLLOWING = 20      # a drive does not give the torque that is commanded
    SCALE_MISMATCH = 21     # two measurements of one thing differ: a wire range or a constant is not the drive's
    IMPLAUSIBLE = 22        # a measurement that cannot be
    UNCLEAR_POSE = 23       # a joint may stand elsewhere than its drive reads
    FIRST_OWN_STATUS = 64

cdef enum: # what decode_t returns
    FOREIGN = 0             # not for this device
    TAKEN = 1               # an answer of this device
    NOTED = 2               # of this device, but no answer to a command: a report, or the reply of a drive that is not enabled yet
    COMMANDED = 3           # for this device, from somebody else who commands it
    MOVING = 4              # an answer of this device, which says that it is not at rest: none to the safe stop
    PRESSED = 5             # an answer of this device, which says that somebody wants the run to end
    ANSWERED = 6            # an answer of this device without a sample, as to a question about its faults
    MALFORMED = -1          # for this device, but short, long or corrupt: nothing was changed

cdef enum:
    FRAME_BYTES = 64        # CAN FD
    FRAMES_PER_DEVICE = 4   # most that encode_t may fill
    FRAMES_PER_BATCH = 12   # most that arming or the safe stop sends a device at once
    FRAMES_PER_TICK = 64    # most that a bus hands over in one tick

cdef enum: # Linux's struct can_frame: flags in the high bits of the identifier
    EXTENDED = 0x80000000
    REMOTE = 0x40000000
    ERROR_FRAME = 0x20000000
    ID_MASK = 0x1FFFFFFF

cdef struct Frame:
    int64_t time            # ns since the run began, that is, since its arming
    uint32_t id
    uint8_t length
    uint8_t flags           # CAN FD's own
    uint8_t bus
    uint8_t sent            # 1 we sent it, 0 we received it
    uint8_t data[FRAME_BYTES]

cdef struct Bus:
    # Neither waits. receive fills at most `capacity` frames and returns how many; send returns how many went out.
    # Below zero: the bus failed.
    # begin, which may be NULL, is told the zero of the frames' times, in ns of CLOCK_MONOTONIC.
    int (*receive)(void *context, Frame *frames, int capacity) noexcept nogil
    int (*send)(void *context, const Frame *frames, int count) noexcept nogil
    void (*begin)(void *context, int64_t began) noexcept nogil
    void *context
    # at, which may be NULL, is told the time of the run in ns before anything is received: for buses that have a time of their own.
    void (*at)(void *context, int64_t now) noexcept nogil

# The names of capsules.
cdef inline const char *KERNEL() noexcept nogil:
    return "int (double *, int32_t const *, int32_t const *)"

cdef inline const char *DECODE() noexcept nogil:
    return "int (double *, int32_t const *, int32_t const *, Frame const *)"

cdef inline const char *ENCODE() noexcept nogil:
    return "int (double *, int32_t const *, int32_t const *, Frame *)"


from cpython.pycapsule cimport PyCapsule_New

cdef inline object export(kernel_t kernel):
    """The capsule by which a kernel is handed over: `gain = export(gain_kernel)`."""
    return PyCapsule_New(<void *>kernel, KERNEL(), NULL)

cdef inline object export_decode(decode_t decode):
    return PyCapsule_New(<void *>decode, DECODE(), NULL)

cdef inline object export_encode(encode_t encode):
    return PyCapsule_New(<void *>encode, ENCODE(), NULL)

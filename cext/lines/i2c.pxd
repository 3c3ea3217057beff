from libc.stdint cimport int32_t, int64_t, uint8_t, uint16_t, uint32_t, uint64_t

from cext.abi cimport FRAME_BYTES
from cext.bus.memory_bus cimport BusEnd
from cext.ring.newest_ring cimport NewestRing
from cext.posix cimport pthread_t

cdef enum:
    STEPS = 4                   # steps in one exchange
    # limit of a write (without its register), of bytes appended to an answer, and of a check
    BYTES = 16
    READ_LIMIT = 32             # bytes of one step, as for an SMBus block
    MUXES = 8
    IDENTITIES = 2              # identity registers of a device

# One exchange with one chip: `count` bytes are read or written from a register on, or without a register if it is below
# 0. Returns 0 or an errno.
ctypedef int (*exchange_t)(void *context, uint8_t address, int register, bint reads, uint8_t *data,
    int count) noexcept nogil

cdef struct Adapter:
    exchange_t exchange
    void *context

cdef class I2cAdapter:
    cdef Adapter adapter
    cdef object owner           # keeps the memory behind the context alive

cdef struct Step:
    bint reads
    uint8_t register
    uint8_t count
    uint8_t data[BYTES]

cdef struct Exchange:
    uint8_t address
    int steps
    Step step[STEPS]
    int appended
    uint8_t tail[BYTES]
    uint32_t id

cdef struct Cycle:              # exchanges in sequence, one a period
    int member
    int first                   # exchange
    int count
    int at
    int64_t period
    int64_t settle
    int64_t due

cdef struct SetUp:
    uint8_t address
    uint8_t register
    uint8_t count
    uint8_t data[BYTES]
    int64_t wait

cdef struct Identity:           # value of a register in the bits where the mask is 1
    uint8_t register
    uint8_t value
    uint8_t mask

cdef enum: # states of a member
    FINE
    SETTING_UP
    LOST

cdef struct Member:
    int place
    uint8_t address
    uint32_t trouble            # id of its failure frames
    int first_setup
    int setups
    int setups_sent                    # number of them that were sent
    int first_cycle
    int cycles
    int checked                 # bytes of its check, 0 for none
    uint8_t check_register
    uint8_t expected[BYTES]
    int identities
    Identity identity[IDENTITIES]
    int64_t next_check
    bint unverified             # an exchange has failed: its settings are checked before further exchanges
    int32_t state
    int64_t due                 # time of the next step of its set-up, or of the next attempt
    int consecutive_failures
    int32_t error               # errno of the last
    uint64_t failures_before    # failures before the start of the run
    uint64_t failures
    uint64_t answers
    uint64_t samples            # answers of its first round
    uint64_t losses
    uint64_t returns

cdef struct Inbox:
    int64_t began               # ns of CLOCK_MONOTONIC: zero of the frames' times; owned by the reader
    int32_t runs                # number of runs
    NewestRing ring

cdef class I2cBus:
    cdef I2cAdapter adapter
    cdef Inbox *inbox
    cdef list tables
    cdef Member *members
    cdef Cycle *cycles
    cdef Exchange *exchanges
    cdef SetUp *setups
    cdef int count
    cdef int open               # open place, 0 for none, -1 if unknown
    cdef bint[MUXES] present    # multiplexers
    cdef uint64_t switches
    cdef uint64_t rounds
    cdef int64_t origin         # ns of CLOCK_MONOTONIC: exchanges are due whole periods later
    cdef int64_t ended          # ns of CLOCK_MONOTONIC; 0 while the thread runs
    cdef int32_t run            # whose failures are counted
    cdef pthread_t thread
    cdef bint running
    cdef int32_t leave
    cdef int32_t bell
    cdef int priority
    cdef bytes thread_name
    cdef const char *called     # the text of `thread_name`
    cdef readonly str name
    cdef readonly BusEnd end
    cdef int lay_out(self) except -1
    cdef void serve(self) noexcept nogil
    cdef int64_t run_due(self, int64_t now) noexcept nogil
    cdef void run_place(self, int place, int64_t now) noexcept nogil
    cdef void run_member(self, Member *member, int64_t now) noexcept nogil
    cdef int64_t due_of(self, const Member *member) noexcept nogil
    cdef void continue_set_up(self, Member *member, int64_t now) noexcept nogil
    cdef bint has_identity(self, Member *member, int64_t now) noexcept nogil
    cdef bint has_settings(self, Member *member, int64_t now) noexcept nogil
    cdef bint run_cycle(self, Member *member, Cycle *cycle, int64_t now) noexcept nogil
    cdef int exchange(self, Member *member, uint8_t address, int register, bint reads, uint8_t *data,
        int count) noexcept nogil
    cdef int switch_to(self, int place) noexcept nogil
    cdef void fail(self, Member *member, int error, int64_t now) noexcept nogil
    cdef void begin_set_up(self, Member *member, int64_t now) noexcept nogil
    cdef void log(self, const Member *member, int64_t now) noexcept nogil

from libc.stdint cimport int32_t, int64_t, uint64_t

from cext.abi cimport FRAME_BYTES, FRAMES_PER_BATCH, FRAMES_PER_DEVICE, FRAMES_PER_TICK, Frame, decode_t, encode_t
from cext.bus.batch cimport Batch
from cext.bus.memory_bus cimport BusEnd
from cext.safety.drive_warnings cimport DriveWarnings
from cext.safety.drive_state cimport DriveState
from cext.safety.drive_watch cimport DriveWatch, Watched
from cext.safety.zeroing cimport Zeroing
from cext.clock.histogram cimport Histogram
from cext.safety.shared_state cimport SharedLayout
from cext.clock.stopwatch cimport Laps
from cext.schedule.live cimport LiveTable

cdef enum:
    READY_NUMBERS = 16           # limit of values that outlive the start
    DEEPEST = 16                 # rounds: QUEUE and the ring of a stream hold this many times FRAMES_PER_TICK

cdef enum:                       # events of a device
    ZEROED
    ZERO_REFUSED
    ZERO_NOT_SET
    TAKEN_OUT
    RETURNED
    NOT_RETURNED
    DEVICE_EVENTS

cdef struct Device:
    decode_t decode
    encode_t encode
    const int32_t *decode_slots
    const int32_t *decode_sizes
    const int32_t *encode_slots
    const int32_t *encode_sizes
    int bus
    int age                      # slot, -1 if it has none
    int fault                    # slot, -1 if it has none
    int ready                    # slot, -1 if arming reads nothing back
    int ready_size               # number of values from there that outlive the start of the blocks
    double ready_kept[READY_NUMBERS]
    double timeout               # s
    Batch enable
    Batch zero
    Batch disable
    void *bands                  # SpeedBands, borrowed: damping in a safe stop; NULL for none
    int64_t damping              # ns of damping
    int64_t damp_due             # ns since the begin of the stop, of the next damping frame
    bint damped                  # whether it is damped, and not disabled yet
    int unanswered               # of the frames of disable
    int64_t relay                # ns without a frame after which its relay drops; 0: it holds none
    int64_t pumped               # ns of the last frame to it
    int64_t reply_time           # ns, arrival of the newest reply or sample
    int64_t asked                # ns of the newest command without a reply; -1: none
    Histogram *latency           # from a command to its reply; NULL in virtual time
    bint only_reads[FRAMES_PER_BATCH]       # of the frames of enable: not a command if sent by another controller
    bint owed                    # the newest command has no reply yet
    int64_t missed               # commands without a reply before the next one
    int64_t replies
    bint answered                # since the begin of the run
    bint doubtful                # a frame was its own reply with another id, or a command of another controller
    int32_t malformed[FRAME_BYTES + 1]      # frames that its decode rejected, by length
    int rejected_id              # first byte of the newest rejected one
    int64_t rounds               # of arming so far
    int64_t replies_wanted       # before it counts as replying
    Batch set_zero               # makes the present position of the drive its zero; empty if it cannot
    Zeroing zeroing
    DriveState drive
    int64_t fades_from           # tick from which its commands fade in; -1: with those of all devices

cdef struct Blame:               # last failure, -1 for other causes
    int device
    int bus

cdef class Devices:
    """Devices of one schedule, for the executor."""
    cdef double *arena
    cdef object schedule, memory
    cdef list keep
    cdef list ends               # BusEnd, one per bus
    cdef int bus_count
    cdef void **bus_ends         # the same, borrowed
    cdef int32_t *rounds         # per bus: limit of reads of FRAMES_PER_TICK in one drain
    cdef Device *devices
    cdef int count
    cdef Frame[FRAMES_PER_TICK] received
    cdef Frame *outgoing
    cdef int32_t *outgoing_count # per bus
    cdef Blame failed
    cdef DriveWatch drives
    cdef DriveWarnings warnings
    cdef Laps *laps              # NULL: not timed
    cdef int item                # stopwatch item of the first device
    cdef bint ran
    cdef public double fade              # s, over which the commands of one device fade in
    cdef int64_t now             # ns since the begin of the run, of the newest drain
    cdef list news               # EventTemplate, DEVICE_EVENTS of each device that has them
    cdef void **templates        # the same, borrowed: DEVICE_EVENTS of each device; NULL for none
    cdef SharedLayout *page      # for events; NULL: none
    cdef LiveTable live          # the table with the parameters `disabled`
    cdef public object may_return        # function of a path: whether its joint's position is certain, or None
    cdef bint waiting            # after a fault, to be armed again: nothing is sent
    cdef bint stopping           # replies to a safe stop are expected
    cdef bint alone              # no other node may command the devices
    cdef int64_t longest_damping # ns
    cdef int64_t start_time      # ns of arming in which only relays are sent frames
    cdef int64_t stop_due        # ns since the begin of the stop, of the next round of zero torque and disable
    cdef public double counted_from     # tick from which missing replies are counted

    cdef int64_t began           # ns of CLOCK_MONOTONIC: zero of the frames' times
    cdef int load(self) except -1
    cdef int time_replies(self) except -1
    cdef void note_asked(self, int bus, int64_t at) noexcept nogil
    cdef void reset(self)
    cdef void begin(self, int64_t began) noexcept nogil
    cdef int receive(self, int64_t now, SharedLayout *page) noexcept nogil
    cdef int offer(self, int bus, int count, SharedLayout *page) noexcept nogil
    cdef int commanded(self, const Frame *frame) noexcept nogil
    cdef bint may_be_reply(self, Device *device, const Frame *frame) noexcept nogil
    cdef int watch(self, int64_t now) noexcept nogil
    cdef int command(self) noexcept nogil
    cdef int transmit(self, int64_t now, SharedLayout *page) noexcept nogil
    cdef int send(self, int bus, Frame *frames, int count, int64_t now, SharedLayout *page, bint stopping) noexcept nogil
    cdef int send_batches(self, bint enable, bint zero, bint disable, int64_t now, SharedLayout *page) noexcept nogil
    cdef int sent(self, int status, bint stopping, SharedLayout *page) noexcept nogil
    cdef int pump(self, Device *device, int64_t now, SharedLayout *page, bint stopping) noexcept nogil
    cdef bint holds_relay(self, const Device *device, int64_t now) noexcept nogil
    cdef int pump_all(self, int64_t now, SharedLayout *page) noexcept nogil
    cdef void begin_stop(self) noexcept nogil
    cdef int64_t send_stop(self, int64_t since, int64_t now, int64_t round, SharedLayout *page) noexcept nogil
    cdef void note_speeds(self, SharedLayout *page) noexcept nogil
    cdef bint has_answered(self, const Device *device) noexcept nogil
    cdef bint all_answered(self) noexcept nogil
    cdef void begin_arming(self) noexcept nogil
    cdef void keep_ready(self) noexcept nogil
    cdef void restore_ready(self) noexcept nogil
    cdef void want_replies(self, bint zero, bint disable) noexcept nogil
    cdef void discard(self) noexcept nogil
    cdef uint64_t share(self, SharedLayout *page)
    cdef void note(self, int number, int event) noexcept nogil
    cdef int encode(self, Device *device, Frame *frames) noexcept nogil
    cdef bint has_replied(self, const Device *device) noexcept nogil
    cdef bint only_zeros_are_due(self) noexcept nogil
    cdef bint zero_while_arming(self, int number) noexcept nogil
    cdef int add_zero(self, int number, Frame *frames, int count) noexcept nogil
    cdef int look_at_zero(self, int number) noexcept nogil
    cdef void look_at_state(self, int number) noexcept nogil
    cdef void take_out(self, int number) noexcept nogil
    cdef void disable_again(self, int number, int event) noexcept nogil
    cdef bint is_fit(self, int number) noexcept nogil
    cdef int send_state(self, int64_t now, SharedLayout *page) noexcept nogil

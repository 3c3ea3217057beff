from libc.stdint cimport int32_t, int64_t

from cext.abi cimport FRAME_BYTES, FRAMES_PER_BATCH, decode_t, encode_t
from cext.bus.batch cimport Batch
from cext.clock.histogram cimport Histogram
from cext.safety.drive_state cimport DriveState
from cext.safety.twins cimport Twins
from cext.safety.transit cimport Transit
from cext.safety.zeroing cimport Zeroing

cdef enum:
    READY_NUMBERS = 16           # limit of values that outlive the start

cdef struct Device:
    decode_t decode
    encode_t encode
    const int32_t *decode_slots
    const int32_t *decode_sizes
    const int32_t *encode_slots
    const int32_t *encode_sizes
    int bus
    int age                      # slot, -1 if it has none
    int transit_slot             # first of three numbers, s: the memory `transit` of a joint; -1: none
    double unseen                # s, the second of them
    int stiffness, damping_command      # slots, -1: none
    int64_t gap                  # ns, longest wait for a reply since the previous tick; of a drive that reports, between two reports
    double report_period         # s between its reports; 0 if it answers commands
    double max_transit           # s
    double restart_time          # s of silence in which it may restart, and obeys again without an enable; 0: none
    Transit transit
    int sends                    # frames in this tick
    int set_up_replies           # samples with which it answers the frames of set_up
    int fault                    # slot, -1 if it has none
    int ready                    # slot, -1 if arming reads nothing back
    int ready_size               # number of values from there that outlive the start of the blocks
    double ready_kept[READY_NUMBERS]
    double timeout               # s
    Batch ask                    # with replies, and without enabling it
    Batch set_up                 # writes and reads settings
    Batch enable
    Batch zero
    Batch disable
    void *bands                  # SpeedBands, borrowed: damping in a safe stop; NULL for none
    int64_t damping              # ns of damping
    int64_t damp_due             # ns since the start of the stop, of the next damping frame
    bint damped                  # whether it is damped, and not disabled yet
    void *confirmation           # StopConfirmation, borrowed; NULL for a device without frames of a safe stop
    Twins twins
    int unanswered               # number of disable frames without a reply
    int64_t relay                # ns without a frame after which its relay drops; 0: it holds none
    int64_t pumped               # ns of the last frame to it
    int64_t reply_time           # ns, arrival of the newest reply or sample
    Histogram *latency           # from a command to its reply, where that is certain; NULL in virtual time
    bint only_reads[FRAMES_PER_BATCH]       # whether a frame of set_up is not a command if sent by another controller
    bint reports_enabled         # its replies contain whether it is enabled
    bint enabling                # arming enables it, or has: replies of a disabled drive do not count
    int64_t enabled_since        # ns, start of that
    bint was_enabled             # it has replied as an enabled drive before arming has enabled it
    bint owed                    # the newest command has no reply yet
    int64_t missed               # commands without a reply before the next one
    int64_t replies
    bint answered                # since the start of the run
    bint doubtful                # a frame was its own reply with another id, or a command of another controller
    int32_t malformed[FRAME_BYTES + 1]      # frames that its decode rejected, by length
    int rejected_id              # first byte of the newest rejected one
    int64_t rounds               # rounds of arming so far
    int64_t replies_wanted       # before it counts as replying
    Batch set_zero               # makes the present position of the drive its zero; empty if it cannot
    Zeroing zeroing
    DriveState drive
    int64_t fades_from           # tick from which its commands fade in; -1: with those of all devices

cdef class DeviceTable:
    """Devices of one schedule, and the state of the run that all parts of `Devices` share."""
    cdef double *arena
    cdef object schedule, memory
    cdef list keep
    cdef Device *devices
    cdef int count
    cdef int failed              # index of the device that failed last, -1 for other causes
    cdef int64_t now             # ns since the start of the run, of the newest drain
    cdef bint waiting            # after a fault, to be armed again: nothing is sent
    cdef bint stopping           # replies to a safe stop are expected
    cdef bint arming             # until the blocks start
    cdef bint looked             # the operator looks at the replies of this arming
    cdef bint timed              # the replies are timed
    cdef bint alone              # no other node may command the devices

    cdef int load(self) except -1
    cdef int load_device(self, Device *device, entry) except -1
    cdef int load_zeroing(self, Zeroing *z, entry) except -1
    cdef int time_replies(self) except -1
    cdef void reset(self)
    cdef bint has_replied(self, const Device *device) noexcept nogil
    cdef bint may_answer_late(self, const Device *device) noexcept nogil
    cdef bint may_come_in_bursts(self, const Device *device) noexcept nogil
    cdef bint has_answered(self, const Device *device) noexcept nogil
    cdef bint all_answered(self) noexcept nogil

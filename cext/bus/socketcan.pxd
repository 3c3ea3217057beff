from libc.stdint cimport int64_t, uint8_t, uint32_t

from cext.abi cimport FRAMES_PER_TICK
from cext.bus.memory_bus cimport BusEnd
from cext.posix cimport iovec, mmsghdr

cdef extern from "<linux/can.h>" nogil:
    cdef struct canfd_frame:        # begins like struct can_frame
        uint32_t can_id
        uint8_t len
        uint8_t flags
        uint8_t data[64]
    const int CAN_MTU
    const int CANFD_MTU
    const int CANFD_FDF
    const int CAN_MAX_DLEN

cdef extern from "<linux/can/error.h>" nogil:
    const uint32_t CAN_ERR_CRTL
    const uint32_t CAN_ERR_BUSOFF
    const uint32_t CAN_ERR_RESTARTED
    const int CAN_ERR_CRTL_RX_OVERFLOW
    const int CAN_ERR_CRTL_RX_WARNING
    const int CAN_ERR_CRTL_TX_WARNING
    const int CAN_ERR_CRTL_RX_PASSIVE
    const int CAN_ERR_CRTL_TX_PASSIVE
    const int CAN_ERR_CRTL_ACTIVE

cdef enum:
    CONTROL_WORDS = 8               # words of eight bytes: space for one kernel timestamp

cdef enum: # states of a controller on its bus
    ACTIVE = 0
    WARNING = 1
    PASSIVE = 2
    OFF = 3

cdef enum: # errors other than an errno
    FULL = -1
    BUS_OFF = -2

cdef struct Counts:                 # frames since the begin
    int64_t refused                 # not sent because of a full queue
    int64_t echoes                  # sent by this machine
    int64_t corrupt                 # no valid CAN frames
    int64_t errors                  # error frames of the controller
    int64_t overflows               # error frames that report lost frames

cdef struct Socket:
    int fd
    bint flexible                   # CAN FD
    bint shared                     # other nodes are processes of this machine, so its own frames may be replies
    bint mute                       # receives only
    int queue_full_limit            # ticks with a full queue until the bus fails
    int64_t began                   # ns of CLOCK_MONOTONIC: zero of the frames' times
    int64_t drained                 # ns of CLOCK_MONOTONIC: the next frames arrived later
    int trouble                     # 0, an errno, or one of the errors above
    bint reported                   # reported to the executor
    bint refusing                   # in this tick
    int full                        # ticks in a row
    int state
    int worst
    Counts counts
    mmsghdr incoming[FRAMES_PER_TICK]
    mmsghdr outgoing[FRAMES_PER_TICK]
    iovec came[FRAMES_PER_TICK]
    iovec goes[FRAMES_PER_TICK]
    canfd_frame received[FRAMES_PER_TICK]
    canfd_frame sent[FRAMES_PER_TICK]
    int64_t control[FRAMES_PER_TICK][CONTROL_WORDS]

cdef class SocketCan:
    cdef Socket *socket
    cdef object file
    cdef readonly BusEnd end

from libc.stdint cimport int32_t, int64_t, uint8_t, uint64_t

from cext.abi cimport Frame
from cext.bus.memory_bus cimport BusEnd
from cext.ring.newest_ring cimport NewestRing

cdef extern from "<termios.h>" nogil:
    cdef struct termios:
        unsigned char c_cc[19]
    int tcgetattr(int fd, termios *settings)
    int tcsetattr(int fd, int when, const termios *settings)
    const int TCSANOW, VMIN, VTIME

cdef extern from "<sys/socket.h>" nogil:
    cdef struct sockaddr_storage:
        pass

cdef enum:
    PATH_LIMIT = 512
    SETUP_BYTES = 2048
    SETUP_MESSAGES = 64
    PROOF_LIMIT = 256               # bytes of an identification query, and of its answer
    EVENT = 48                      # bytes of a gpio_v2_line_event
    EVENT_KIND = 8                  # place of its kind
    RISING = 1

cdef enum: # in `level`
    UNKNOWN = -1
    ASK_CHIP = -2

cdef struct Source:
    int fd                          # number is kept: a new line replaces it
    int record                      # bytes of a record, which a frame never splits
    bint is_tty
    bint datagrams                  # which may be empty
    bint is_gpio                    # reads Linux's gpio_v2_line_event, and has a level
    int32_t level                    # by the newest event of an emulated line; UNKNOWN, or ASK_CHIP of a chip
    bint asks                       # for the level, at the next receive
    char path[PATH_LIMIT]         # "": not opened again, except for a connection
    sockaddr_storage peer           # address at the other end of the connection
    int peer_length                 # 0 for none
    # descriptor of a new connection, or of a line that has not identified yet; 0 for none
    int attempt
    uint8_t question[PROOF_LIMIT]   # identification query of a reconnected line
    int question_length             # 0: no identification
    uint8_t proof[PROOF_LIMIT]      # bytes that its answer must contain
    int proof_length
    uint8_t seen[PROOF_LIMIT]       # end of its answer
    int seen_length
    bint spoken                     # whether it has sent any data
    uint64_t strangers              # number of failed identifications
    int64_t wait                    # ns to the next attempt
    termios settings                # settings of a tty
    uint8_t setup[SETUP_BYTES]      # messages for a reconnected line
    int ends[SETUP_MESSAGES]        # end of each message
    int messages
    int64_t pause                   # ns before each message
    int messages_sent               # number of messages sent
    int64_t due                     # ns of CLOCK_MONOTONIC: when the next message, attempt or check is due
    int32_t gone
    uint64_t bytes                  # read
    uint64_t losses                 # losses of the line
    uint64_t returns
    int error                       # errno of the loss
    NewestRing ring
    int64_t began                   # ns of CLOCK_MONOTONIC: zero of the frames' times; owned by the reader
    uint64_t refused                # messages of the tick that it did not accept

cdef int gpio_send(void *context, const Frame *frames, int count) noexcept nogil

cdef class Stream:
    cdef Source *source
    cdef int own
    cdef readonly str name
    cdef readonly BusEnd end

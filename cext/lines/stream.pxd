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
    LONGEST_PATH = 512
    SETUP_BYTES = 2048
    SETUP_MESSAGES = 64
    LONGEST_PROOF = 256             # bytes of a question who is there, and of the answer

cdef struct Source:
    int fd                          # keeps its number: what is opened anew is put in its place
    int record                      # bytes that belong together: no frame ends within
    bint is_tty
    bint datagrams                  # one of which may be empty
    bint is_gpio                    # it gives Linux's gpio_v2_line_event, and its level when it is asked
    bint asks                       # for that, at the next receive
    char path[LONGEST_PATH]         # "": what is gone stays away, unless it is a connection that is made anew
    sockaddr_storage peer           # of that
    int peer_length                 # 0 for none
    int attempt                     # descriptor of a connection that is being made, or of a line that has not shown yet what it is; 0 for none
    uint8_t question[LONGEST_PROOF] # what a line that is back is asked
    int question_length             # 0: it is taken for what it was
    uint8_t proof[LONGEST_PROOF]    # bytes that are then somewhere in what it says
    int proof_length
    uint8_t seen[LONGEST_PROOF]     # the end of what it has said
    int seen_length
    bint spoken                     # whether it has said anything
    uint64_t strangers              # times that something else answered in its place
    int64_t wait                    # ns to the next attempt
    termios settings                # of a tty
    uint8_t setup[SETUP_BYTES]      # what is written to a line that is back, message by message
    int ends[SETUP_MESSAGES]        # where each ends
    int messages
    int64_t pause                   # ns in front of each
    int said                        # of them so far
    int64_t due                     # ns, CLOCK_MONOTONIC: when the next of them, the next attempt to open it, or the next look is due
    int32_t gone
    uint64_t bytes                  # that were read
    uint64_t losses                 # times that it was gone
    uint64_t returns
    int error                       # errno that it went with
    NewestRing ring
    int64_t began                   # ns, CLOCK_MONOTONIC: the zero of the frames' times; the reader's
    uint64_t refused                # messages of the tick that it did not take

cdef int gpio_send(void *context, const Frame *frames, int count) noexcept nogil

cdef class Stream:
    cdef Source *source
    cdef int own
    cdef readonly str name
    cdef readonly BusEnd end

# cython: freethreading_compatible=True
"""One stream for the tick: data of the thread with times of the run, and non-blocking sends."""

from libc.stdint cimport int64_t, uint8_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy, memset
from posix.unistd cimport close

from cext.abi cimport Frame
from cext.atomics cimport load_i32, load_u64, store_i32
from cext.lines.line_calls cimport gpio_level, set_gpio
from cext.ring.newest_ring cimport forget, pull
from cext.clock.deadline_clock cimport monotonic
from cext.posix cimport iovec
from cext.lines.stream_frames cimport BYTES, LEVEL

cdef extern from "<sys/uio.h>" nogil:
    ssize_t writev(int fd, const iovec *parts, int count)

cdef extern from "<sys/ioctl.h>" nogil:
    int ioctl(int fd, unsigned long request, ...)
    const unsigned long TIOCGPTN, TCFLSH
    const int TCOFLUSH

cdef enum:
    WRITE_FRAMES = 16                   # frames in one write


cdef int stream_receive(void *context, Frame *frames, int capacity) noexcept nogil:
    cdef Source *source = <Source *>context
    cdef int count = 0
    if source.asks and capacity > 0:
        source.asks = False
        count = level_of(source, frames)
    while count < capacity and pull(&source.ring, &frames[count]):
        frames[count].time = max(frames[count].time - source.began, 0)
        if source.is_gpio and frames[count].id == BYTES:
            move_times(&frames[count], source.began)
        count += 1
    return count


cdef int level_of(Source *source, Frame *frame) noexcept nogil:
    """Fill a frame with the level of a GPIO line. Earlier edges were discarded, so later ones follow this frame."""
    cdef int level = gpio_level(source.fd) if source.level == ASK_CHIP else load_i32(&source.level)
    if level < 0:
        return 0
    memset(frame, 0, sizeof(Frame))
    frame.id, frame.length = LEVEL, 1
    frame.data[0] = <uint8_t>level
    frame.time = max(monotonic() - source.began, 0)
    return 1


cdef void move_times(Frame *frame, int64_t began) noexcept nogil:
    """Convert the kernel's time stamps of edges, ns of CLOCK_MONOTONIC at the start of each record, to the clock of
    the run.
    """
    cdef int64_t when
    cdef int at = 0
    while at + EVENT <= frame.length:
        memcpy(&when, &frame.data[at], sizeof(int64_t))
        when -= began
        memcpy(&frame.data[at], &when, sizeof(int64_t))
        at += EVENT


cdef int stream_send(void *context, const Frame *frames, int count) noexcept nogil:
    cdef Source *source = <Source *>context
    cdef iovec[WRITE_FRAMES] parts
    cdef int index, number
    cdef int first = 0
    cdef ssize_t size
    while first < count:                                            # in one write, so that frames arrive together
        number = min(WRITE_FRAMES, count - first)
        size = 0
        for index in range(number):
            parts[index].iov_base, parts[index].iov_len = <void *>frames[first + index].data, frames[first
                + index].length
            size += frames[first + index].length
        if load_i32(&source.gone) or writev(source.fd, parts, number) != size and not (
                flushed(source.fd) and writev(source.fd, parts, number) == size):
            source.refused += 1
        first += number
    return count


cdef inline bint flushed(int fd) noexcept nogil:
    """Discard what no process has read from the terminal of an emulated line, as a port that is not open does, so that
    a program that opens it receives replies. Returns False for another line.
    """
    cdef unsigned int number
    return ioctl(fd, TIOCGPTN, &number) == 0 and ioctl(fd, TCFLSH, TCOFLUSH) == 0


cdef int gpio_send(void *context, const Frame *frames, int count) noexcept nogil:
    """Set the level of a GPIO line from the first byte of a frame."""
    cdef Source *source = <Source *>context
    cdef int index
    for index in range(count):
        if load_i32(&source.gone) or set_gpio(source.fd, frames[index].data[0]) != 0:
            source.refused += 1
    return count


cdef void stream_begin(void *context, int64_t began) noexcept nogil:
    cdef Source *source = <Source *>context
    forget(&source.ring)
    source.began = began
    source.asks = source.is_gpio


cdef class Stream:
    """One stream, created by `Streams.add`. end : its BusEnd"""

    def __cinit__(self):
        self.own = -1
        self.source = <Source *>calloc(1, sizeof(Source))
        if self.source == NULL:
            raise MemoryError
        memset(self.source, 0, sizeof(Source))                      # touch every page before the tick does
        self.end = BusEnd()
        self.end.bus.receive, self.end.bus.send, self.end.bus.begin = stream_receive, stream_send, stream_begin
        self.end.bus.context = self.source
        self.end.owner = self

    def __dealloc__(self):
        self.close()
        free(self.source)

    def close(self) -> None:
        """Close the line after the thread has ended. Earlier data can still be received."""
        store_i32(&self.source.gone, 1)
        if self.own >= 0:
            close(self.own)
        if self.source.attempt > 0:
            close(self.source.attempt)
        self.own, self.source.attempt = -1, 0

    def fileno(self) -> int:
        """Return the descriptor of the line, which this object owns."""
        return self.own

    def begin(self, int64_t began) -> None:
        """Discard earlier data, and time frames from `began`, in ns of CLOCK_MONOTONIC."""
        stream_begin(self.source, began)

    @property
    def gone(self) -> bool:
        """Whether the line is lost."""
        return bool(load_i32(&self.source.gone))

    @property
    def trouble(self) -> int | None:
        """errno of the loss, None while connected."""
        return (self.source.error or None) if self.gone else None

    @property
    def counts(self) -> dict[str, int]:
        """Counts: bytes read, overflows (frames overwritten unread), refused messages, losses, returns, and strangers
        (failed
        identifications)."""
        return {
            "bytes": load_u64(&self.source.bytes), "overflows": self.source.ring.skipped,
            "refused": self.source.refused,
            "losses": load_u64(&self.source.losses), "returns": load_u64(&self.source.returns),
            "strangers": load_u64(&self.source.strangers)}

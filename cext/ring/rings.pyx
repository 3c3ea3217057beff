# cython: freethreading_compatible=True
"""Lines behind the `Bus` struct: buses that another process owns.

The loop never waits. Each send signals an eventfd for the owner, which waits for that and for its interfaces. Frames in
the rings have times of CLOCK_MONOTONIC.
"""

import mmap
import os

from cpython.buffer cimport PyBUF_WRITABLE, PyObject_GetBuffer, PyBuffer_Release
from libc.stdint cimport uint8_t, uint32_t
from libc.string cimport memcpy, memset
from posix.unistd cimport close, write

from cext.abi cimport FRAME_BYTES
from cext.atomics cimport load_i32, load_u64, store_i32, store_u64

from cext.ring.sealed_memory import sealed_memory


cdef bint put(FrameRing *ring, const Frame *frame) noexcept nogil:
    cdef uint64_t head = ring.head
    if head - load_u64(&ring.tail) >= <uint64_t>RING_FRAMES:
        return False
    ring.frames[head % RING_FRAMES] = frame[0]
    store_u64(&ring.head, head + 1)
    return True


cdef bint get(FrameRing *ring, Frame *frame) noexcept nogil:
    cdef uint64_t tail = ring.tail
    if tail == load_u64(&ring.head):
        return False
    frame[0] = ring.frames[tail % RING_FRAMES]
    frame.length = min(frame.length, <uint8_t>FRAME_BYTES)      # a defective owner may write anything
    store_u64(&ring.tail, tail + 1)
    return True


cdef int line_receive(void *context, Frame *frames, int capacity) noexcept nogil:
    cdef LineEnd *end = <LineEnd *>context
    cdef int count = 0
    if failed(end):
        return -1
    while count < capacity and get(&end.line.inward, &frames[count]):
        # a frame just before the begin belongs to the run
        frames[count].time = max(frames[count].time - end.began, 0)
        count += 1
    return count


cdef int line_send(void *context, const Frame *frames, int count) noexcept nogil:
    cdef LineEnd *end = <LineEnd *>context
    cdef uint64_t once = 1
    cdef int sent = 0
    if failed(end):
        return -1
    while sent < count and put(&end.line.outward, &frames[sent]):
        sent += 1
    end.full = end.full + 1 if sent < count else 0
    end.refused += count - sent
    if end.full >= FULL_SENDS_LIMIT and end.trouble == 0:
        end.trouble = FULL
    if sent > 0 and end.bell >= 0:
        write(end.bell, &once, sizeof(once))
    return sent


cdef bint failed(LineEnd *end) noexcept nogil:
    """Return whether to report a failure of the bus now: once, so that the safe stop continues to send."""
    cdef int why = load_i32(&end.line.failed)
    if why != 0:
        end.trouble = why
    if end.trouble == 0 or end.reported:
        return False
    end.reported = True
    return True


cdef void line_begin(void *context, int64_t began) noexcept nogil:
    """Discard earlier frames, which are not replies."""
    cdef LineEnd *end = <LineEnd *>context
    store_u64(&end.line.inward.tail, load_u64(&end.line.inward.head))
    end.began, end.trouble, end.full, end.reported = began, 0, 0, False


cdef class Lines:
    """Memory of several lines, shared by the process of the loop and the owner of the buses.

    Lines(count)    creates it
    Lines(fd=fd)    maps the memory behind `fd`, which another process created

    The methods are for the owner.
    """

    def __cinit__(self, int count=0, fd=None):
        cdef Py_buffer buffer
        if fd is None:
            self.made_here = True
            fd = sealed_memory("tickwork-buses", max(count, 1) * sizeof(LineLayout))
        self.fd = fd
        self.memory = mmap.mmap(fd, 0)
        self.count = len(self.memory) // sizeof(LineLayout)
        if len(self.memory) != self.count * <Py_ssize_t>sizeof(LineLayout):
            raise ValueError("file descriptor %d has no rings of this version of Tickwork" % fd)
        PyObject_GetBuffer(self.memory, &buffer, PyBUF_WRITABLE)
        self.lines = <LineLayout *>buffer.buf
        PyBuffer_Release(&buffer)                  # self.memory keeps the mapping
        if self.made_here:
            memset(self.lines, 0, len(self.memory))     # touch every page before the loop does

    def __dealloc__(self):
        if self.made_here:
            close(self.fd)

    def take(self, int line, int most=RING_FRAMES) -> list[tuple[int, bytes, int]]:
        """Return the frames that the loop sends, as a list of (id with the flag bits of struct can_frame, data, CAN
        FD's flags).
        """
        cdef Frame frame
        taken = []
        while len(taken) < most and get(&self.lines[self.at(line)].outward, &frame):
            taken.append((frame.id, bytes(frame.data[: frame.length]), frame.flags))
        return taken

    def give(self, int line, uint32_t identifier, bytes data, int64_t time, int flags=0) -> None:
        """Pass a received frame to the loop; time in ns of CLOCK_MONOTONIC. A full ring counts as an overflow."""
        cdef Frame frame
        cdef LineLayout *place = &self.lines[self.at(line)]
        if len(data) > FRAME_BYTES:
            raise ValueError("a frame carries at most %d bytes, not %d" % (FRAME_BYTES, len(data)))
        memset(&frame, 0, sizeof(Frame))
        frame.id, frame.length, frame.flags, frame.time = identifier, <uint8_t>len(data), <uint8_t>flags, time
        memcpy(frame.data, <const char *>data, len(data))
        if not put(&place.inward, &frame):
            place.counts.overflows += 1

    def count_up(self, int line, str kind, int64_t more=1) -> None:
        """Add to a count. kind : field of LineCounts"""
        cdef LineCounts *counts = &self.lines[self.at(line)].counts
        if kind == "refused":
            counts.refused += more
        elif kind == "echoes":
            counts.echoes += more
        elif kind == "corrupt":
            counts.corrupt += more
        elif kind == "errors":
            counts.errors += more
        elif kind == "withheld":
            counts.withheld += more
        else:
            raise KeyError(kind)

    def fail(self, int line, int number) -> None:
        """Report a failure of the bus. number : errno of the reason"""
        store_i32(&self.lines[self.at(line)].failed, number)

    cdef int at(self, int line) except -1:
        if not 0 <= line < self.count:
            raise IndexError("no line %d" % line)
        return line


cdef class Line:
    """End of a line for the loop.

    lines : Lines
    index : number of the line
    bell : file descriptor of the owner's eventfd, or -1
    switching : whether the owner sends frames of more than eight bytes at the data bitrate of CAN FD

    end : the BusEnd
    """

    def __cinit__(self, Lines lines, int index, int bell=-1, bint switching=False):
        self.owner = lines
        self.context.line = &lines.lines[lines.at(index)]
        self.context.bell = bell
        self.end = BusEnd()
        self.end.switching = switching
        self.end.bus.receive, self.end.bus.send, self.end.bus.begin = line_receive, line_send, line_begin
        self.end.bus.context = &self.context
        self.end.owner = self

    def begin(self, int64_t began) -> None:
        """Time frames from `began`, in ns of CLOCK_MONOTONIC."""
        line_begin(&self.context, began)

    @property
    def counts(self) -> dict[str, int]:
        """Frames by kind."""
        counts = dict(self.context.line.counts)
        counts["refused"] += self.context.refused
        return counts

    @property
    def trouble(self) -> str | int | None:
        """Reason for a failure of the bus: "full", an errno, or None."""
        return "full" if self.context.trouble == FULL else self.context.trouble or None

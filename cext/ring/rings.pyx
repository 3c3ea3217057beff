# cython: freethreading_compatible=True
"""Buses that another process owns, behind the `Bus` struct: what the loop sends waits in one ring, what it receives in another.

The loop never waits. Each send rings a bell, an eventfd, for the owner, which sleeps on that and on its interfaces.
Frames in the rings carry times of CLOCK_MONOTONIC.
"""

import mmap
import os

from cpython.buffer cimport PyBUF_WRITABLE, PyObject_GetBuffer, PyBuffer_Release
from libc.stdint cimport uint8_t, uint32_t
from libc.string cimport memcpy, memset
from posix.unistd cimport close, write

from cext.abi cimport FRAME_BYTES
from cext.atomics cimport load_i32, load_u64, store_i32, store_u64


cdef bint put(FrameRing *ring, const Frame *frame) noexcept nogil:
    cdef uint64_t head = ring.head
    if head - load_u64(&ring.tail) >= <uint64_t>ROOM:
        return False
    ring.frames[head % ROOM] = frame[0]
    store_u64(&ring.head, head + 1)
    return True


cdef bint get(FrameRing *ring, Frame *frame) noexcept nogil:
    cdef uint64_t tail = ring.tail
    if tail == load_u64(&ring.head):
        return False
    frame[0] = ring.frames[tail % ROOM]
    store_u64(&ring.tail, tail + 1)
    return True


cdef int line_receive(void *context, Frame *frames, int capacity) noexcept nogil:
    cdef LineEnd *end = <LineEnd *>context
    cdef int count = 0
    if failed(end):
        return -1
    while count < capacity and get(&end.line.inward, &frames[count]):
        frames[count].time = max(frames[count].time - end.began, 0)         # what comes just before the zero is of the run, too
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
    if end.full >= PATIENCE and end.trouble == 0:
        end.trouble = FULL
    if sent > 0 and end.bell >= 0:
        write(end.bell, &once, sizeof(once))
    return sent


cdef bint failed(LineEnd *end) noexcept nogil:
    """Whether to say now that the bus has failed: once, so that the safe stop, which follows, goes on trying."""
    cdef int why = load_i32(&end.line.failed)
    if why != 0:
        end.trouble = why
    if end.trouble == 0 or end.told:
        return False
    end.told = True
    return True


cdef void line_begin(void *context, int64_t began) noexcept nogil:
    """What has come before is no answer to anything."""
    cdef LineEnd *end = <LineEnd *>context
    cdef Frame frame
    while get(&end.line.inward, &frame):
        pass
    end.began, end.trouble, end.full, end.told = began, 0, 0, False


cdef class Lines:
    """Memory for some lines, shared by the process that runs the loop and the one that owns the buses.

    Lines(count)    makes it
    Lines(fd=fd)    maps the one behind `fd`, which another process made

    The methods here are those of the owner.
    """

    def __cinit__(self, int count=0, fd=None):
        cdef Py_buffer buffer
        if fd is None:
            self.fd = fd = os.memfd_create("tickwork-buses")
            self.made_here = True
            os.ftruncate(fd, max(count, 1) * sizeof(LineLayout))
        self.fd = fd
        self.memory = mmap.mmap(fd, 0)
        self.count = len(self.memory) // sizeof(LineLayout)
        if len(self.memory) != self.count * <Py_ssize_t>sizeof(LineLayout):
            raise ValueError("file descriptor %d does not hold lines of this Tickwork" % fd)
        PyObject_GetBuffer(self.memory, &buffer, PyBUF_WRITABLE)
        self.lines = <LineLayout *>buffer.buf
        PyBuffer_Release(&buffer)                  # self.memory stays mapped as long as this object lives
        if self.made_here:
            memset(self.lines, 0, len(self.memory))     # the loop is not to be the first to touch it

    def __dealloc__(self):
        if self.made_here:
            close(self.fd)

    def take(self, int line, int most=ROOM):
        """What the loop wants sent: a list of (id with the flag bits of struct can_frame, data, CAN FD's flags)."""
        cdef Frame frame
        taken = []
        while len(taken) < most and get(&self.lines[self.at(line)].outward, &frame):
            taken.append((frame.id, bytes(frame.data[: min(frame.length, <uint8_t>FRAME_BYTES)]), frame.flags))
        return taken

    def give(self, int line, uint32_t identifier, bytes data, int64_t time, int flags=0):
        """Hand a frame to the loop, as `take` has them; time in ns of CLOCK_MONOTONIC. Where there is no room it is counted."""
        cdef Frame frame
        cdef LineLayout *place = &self.lines[self.at(line)]
        if len(data) > FRAME_BYTES:
            raise ValueError("a frame carries at most %d bytes, not %d" % (FRAME_BYTES, len(data)))
        memset(&frame, 0, sizeof(Frame))
        frame.id, frame.length, frame.flags, frame.time = identifier, <uint8_t>len(data), <uint8_t>flags, time
        memcpy(frame.data, <const char *>data, len(data))
        if not put(&place.inward, &frame):
            place.counts.overflows += 1

    def count_up(self, int line, str kind, int64_t more=1):
        """kind : of LineCounts"""
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

    def fail(self, int line, int number):
        """The bus can neither send nor receive. number : the errno that says why"""
        store_i32(&self.lines[self.at(line)].failed, number)

    cdef int at(self, int line) except -1:
        if not 0 <= line < self.count:
            raise IndexError("there is no line %d" % line)
        return line


cdef class Line:
    """The loop's end of one line.

    lines : Lines
    index : which of them
    bell : file descriptor of the owner's eventfd, or -1

    end : the BusEnd
    """

    def __cinit__(self, Lines lines, int index, int bell=-1):
        self.owner = lines
        self.context.line = &lines.lines[lines.at(index)]
        self.context.bell = bell
        self.end = BusEnd()
        self.end.bus.receive, self.end.bus.send, self.end.bus.begin = line_receive, line_send, line_begin
        self.end.bus.context = &self.context
        self.end.owner = self

    def begin(self, int64_t began):
        """As before a run: frames are timed from `began`, in ns of CLOCK_MONOTONIC."""
        line_begin(&self.context, began)

    @property
    def counts(self):
        """Frames by what became of them."""
        counts = dict(self.context.line.counts)
        counts["refused"] += self.context.refused
        return counts

    @property
    def trouble(self):
        """Why the bus failed: "full", an errno, or None."""
        return "full" if self.context.trouble == FULL else self.context.trouble or None

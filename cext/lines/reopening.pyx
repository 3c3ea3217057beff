# cython: freethreading_compatible=True
"""Lines that disconnect and reconnect.

A line with a path is opened again when it is present, with the previous settings of its tty and the set-up of its
device. If the line has a proof, the device must identify first; until then the line stays lost. A TCP connection is
made again without blocking: after 0.1 s, then less often, down to every 2 s.
"""

import os

from libc.errno cimport EAGAIN, EINTR, errno
from libc.stdint cimport uint32_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy, memset
from posix.unistd cimport close, read, write

from cext.abi cimport Frame
from cext.atomics cimport load_i32, store_i32, store_u64
from cext.lines.line_calls cimport begin_connection, holds, is_connected, open_line, put_in_place
from cext.ring.newest_ring cimport push
from cext.lines.stream cimport TCSANOW, tcsetattr
from cext.lines.stream_frames cimport BACK, LOST

cdef int64_t RETRY = 100000000          # ns between attempts to open a lost line
cdef int64_t RETRY_LIMIT = 2000000000   # ns between attempts to connect, at most
cdef int64_t CONNECT_TIMEOUT = 3000000000   # ns
cdef int64_t PROOF_TIMEOUT = 300000000  # ns for a reconnected line to identify


cdef class Reopening:
    """Part of the thread that reads streams: loss and reconnection of lines."""

    def __cinit__(self):
        self.epoll = self.nothing = -1

    def __init__(self):
        self.buffer = <uint8_t *>calloc(READ_SIZE, 1)
        if self.buffer == NULL:
            raise MemoryError
        memset(self.buffer, 0, READ_SIZE)
        self.epoll = epoll_create1(EPOLL_CLOEXEC)
        if self.epoll < 0:
            raise OSError(errno, os.strerror(errno))
        self.nothing = os.open("/dev/null", os.O_RDWR | os.O_CLOEXEC)

    def __dealloc__(self):
        for descriptor in (self.epoll, self.nothing):
            if descriptor >= 0:
                close(descriptor)
        free(self.buffer)

    cdef int listen(self, int fd, uint32_t events, int index) noexcept nogil:
        """Wake the thread on one of these events. Returns 0 or -1."""
        cdef epoll_event event
        memset(&event, 0, sizeof(event))
        event.events, event.data.u32 = events, <uint32_t>index
        return epoll_ctl(self.epoll, EPOLL_CTL_ADD, fd, &event)

    cdef void lose(self, Source *source, int error, int64_t now) noexcept nogil:
        """Mark the line as lost. Its descriptor stays valid but empty, so that a writer cannot reach another file."""
        cdef Frame frame
        if load_i32(&source.gone):
            return
        source.error = error
        epoll_ctl(self.epoll, EPOLL_CTL_DEL, source.fd, NULL)
        put_in_place(self.nothing, source.fd)
        store_u64(&source.losses, source.losses + 1)
        source.wait = RETRY
        source.due = now + source.wait
        memset(&frame, 0, sizeof(Frame))
        frame.time, frame.id = now, LOST
        push(&source.ring, &frame)
        store_i32(&source.gone, 1)                                  # last, after all details

    cdef void try_again(self, Source *source, int index, int64_t now) noexcept nogil:
        cdef int found
        source.due = now + source.wait
        if source.attempt > 0:                                      # no answer
            self.give_up(source, now)
            return
        if source.path[0] != 0:
            found = open_line(source.path, source.is_tty)
            if found < 0:
                return
            if source.is_tty and tcsetattr(found, TCSANOW, &source.settings) != 0:
                close(found)
            elif source.question_length > 0:
                self.request_identity(source, found, index, now)
            else:
                self.resume(source, found, index, now)
                close(found)
            return
        source.attempt = max(begin_connection(&source.peer, source.peer_length), 0)
        if source.attempt == 0 or self.listen(source.attempt, EPOLLOUT, index) != 0:
            self.give_up(source, now)
            return
        source.due = now + CONNECT_TIMEOUT

    cdef void request_identity(self, Source *source, int found, int index, int64_t now) noexcept nogil:
        source.attempt, source.seen_length, source.spoken = found, 0, False
        if (self.listen(found, EPOLLIN, index) != 0
                or write(found, source.question, source.question_length) != source.question_length):
            self.give_up(source, now)
            return
        source.due = now + PROOF_TIMEOUT

    cdef bint has_identified(self, Source *source) noexcept nogil:
        """Return whether the device has identified by now. Other data is discarded."""
        cdef ssize_t count
        cdef int kept
        memcpy(self.buffer, source.seen, source.seen_length)
        count = read(source.attempt, self.buffer + source.seen_length, READ_SIZE - source.seen_length)
        if count <= 0:
            if count == 0 or (errno != EAGAIN and errno != EINTR):
                source.due = 0                                      # lost again
            return False
        source.spoken = True
        count += source.seen_length
        if holds(self.buffer, count, source.proof, source.proof_length):
            return True
        kept = <int>min(count, <ssize_t>(source.proof_length - 1))
        memcpy(source.seen, self.buffer + count - kept, kept)
        source.seen_length = kept
        return False

    cdef void settle(self, Source *source, int index, int64_t now) noexcept nogil:
        """Handle the end of an attempt: a connection or an error, an answer or a part of one."""
        if source.attempt == 0:
            return
        if source.path[0] != 0 and not self.has_identified(source):
            return
        epoll_ctl(self.epoll, EPOLL_CTL_DEL, source.attempt, NULL)
        if (source.path[0] != 0 or is_connected(source.attempt)) and self.resume(source, source.attempt, index, now):
            close(source.attempt)
            source.attempt = 0
        else:
            self.give_up(source, now)

    cdef void give_up(self, Source *source, int64_t now) noexcept nogil:
        """End an attempt. The next one follows after a longer delay."""
        if source.attempt > 0:
            close(source.attempt)                                   # which also removes it from epoll
        if source.attempt > 0 and source.path[0] != 0 and source.spoken:
            store_u64(&source.strangers, source.strangers + 1)
        source.attempt = 0
        source.due = now + source.wait
        if source.path[0] == 0:
            source.wait = min(2 * source.wait, RETRY_LIMIT)

    cdef bint resume(self, Source *source, int found, int index, int64_t now) noexcept nogil:
        """Replace the lost line by a new one."""
        cdef Frame frame
        put_in_place(found, source.fd)
        if self.listen(source.fd, EPOLLIN, index) != 0:
            put_in_place(self.nothing, source.fd)
            return False
        memset(&frame, 0, sizeof(Frame))
        frame.time, frame.id = now, BACK
        push(&source.ring, &frame)
        source.messages_sent, source.due = 0, now + source.pause
        store_u64(&source.returns, source.returns + 1)
        store_i32(&source.gone, 0)
        return True


cdef void send_setup(Source *source) noexcept nogil:
    """Write the next message of its set-up."""
    cdef int begin = source.ends[source.messages_sent - 1] if source.messages_sent > 0 else 0
    write(source.fd, source.setup + begin, source.ends[source.messages_sent] - begin)
    source.messages_sent += 1

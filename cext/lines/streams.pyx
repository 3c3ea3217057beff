# cython: freethreading_compatible=True
"""Streams behind the `Bus` struct: all descriptors other than CAN buses, such as a tty, a socket, a GPIO line, an input
device.

One native thread reads all of them, stamps each read, and splits it into frames, which wait for the tick in a ring for
each stream. It never takes the GIL, never blocks on one of them, and sleeps while there is nothing to read.

    BYTES    up to 64 bytes, unchanged; flags START on the first frame of a read, GAP after frames that were overwritten
             unread
    LOST     the line was disconnected
    BACK     the line was connected and set up again
    LEVEL    level of a GPIO line at the start of a run: edges follow, with the kernel's times on the clock of the run
"""

import fcntl
import os
import socket
import stat

from libc.errno cimport EAGAIN, ECONNREFUSED, EHOSTUNREACH, EINTR, ENETDOWN, ENETUNREACH, errno
from libc.stdint cimport uint8_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy, memset
from posix.unistd cimport read

from cext.abi cimport FRAME_BYTES, Frame
from cext.atomics cimport load_i32, store_i32, store_u64
from cext.lines.line_calls cimport hung_up, keep_alive, peer_of
from cext.ring.newest_ring cimport START, push
from cext.clock.deadline_clock cimport monotonic
from cext.posix cimport pthread_join
from cext.lines.reopening cimport EPOLLERR, EPOLLHUP, EPOLLIN, READ_SIZE, epoll_event, epoll_wait, send_setup
from cext.lines.stream cimport (
    ASK_CHIP, EVENT, EVENT_KIND, PATH_LIMIT, PROOF_LIMIT, RISING, SETUP_BYTES, SETUP_MESSAGES, TCSANOW, UNKNOWN, VMIN,
    VTIME, Stream, gpio_send, tcgetattr, tcsetattr,
)
from cext.threads cimport be_called, start_thread

cdef enum:
    EVENTS = 32
    PATIENCE = 20                       # ms after which the thread sees that it is to end

cdef int64_t LOOK = 20000000            # ns between presence checks of a GPIO line's chip
cdef size_t STACK = 256 << 10           # bytes


cdef class Streams(Reopening):
    """Streams of a run, and the thread that reads them: started before arming, ended after the safe stop."""

    def __init__(self):
        super().__init__()
        self.streams = []

    def __dealloc__(self):
        self.end()
        free(self.sources)

    def add(self, int fd, str name="", *, path="", setup=(), double pause=0.02, int record=1, bint is_gpio=False,
            level=None, bint reconnects=False, proof=(b"", b"")) -> Stream:
        """Add a descriptor before `start`.

        It is duplicated: the caller closes its own. Returns a Stream; raises OSError if it cannot be polled.

        path : to open it again after a loss, "" for none. A path by id, as in /dev/serial/by-id, is independent of the
            port
        setup : messages, as bytes, that are written after a reconnect, `pause` s before each
        record : bytes of a record, 1 to 64; a frame contains whole records
        is_gpio : it is a request of one GPIO line, or a socket that emulates one; a sent frame sets its level
        level : level of the emulated line, None if unknown
        reconnects : it is a TCP connection, which is made again after a loss
        proof : (identification query for a line with a path, bytes that only this device's answer contains)
        """
        cdef Stream stream = Stream()
        cdef Source *source = stream.source
        cdef bytes message
        cdef int at = 0
        if self.running:
            raise ValueError("streams must be added before start")
        if not 1 <= record <= FRAME_BYTES:
            raise ValueError("a record has 1 to %d bytes, not %d" % (FRAME_BYTES, record))
        encoded = os.fsencode(path)
        if len(encoded) >= PATH_LIMIT or len(setup) > SETUP_MESSAGES or sum(map(len, setup)) > SETUP_BYTES:
            raise ValueError("at most %d bytes of path, %d messages and %d bytes of set-up" % (PATH_LIMIT - 1,
                SETUP_MESSAGES, SETUP_BYTES))
        query, answer = proof
        if max(len(query), len(answer)) > PROOF_LIMIT or bool(query) != bool(answer):
            raise ValueError("a proof is a query and an answer, each of at most %d bytes" % PROOF_LIMIT)
        source.question_length, source.proof_length = len(query), len(answer)
        memcpy(source.question, <const char *>query, len(query))
        memcpy(source.proof, <const char *>answer, len(answer))
        stream.name, stream.own = name, fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 3)
        source.fd, source.record, source.pause, source.is_gpio = stream.own, record, round(pause * 1e9), is_gpio
        source.level = UNKNOWN if stat.S_ISSOCK(os.fstat(fd).st_mode) else ASK_CHIP
        if level is not None:
            source.level = bool(level)
        if is_gpio:
            stream.end.bus.send = gpio_send
        memcpy(source.path, <const char *>encoded, len(encoded))
        for message in setup:
            memcpy(source.setup + at, <const char *>message, len(message))
            at += len(message)
            source.ends[source.messages] = at
            source.messages += 1
        source.messages_sent = source.messages                               # the caller has set it up
        os.set_blocking(fd, False)
        source.is_tty = os.isatty(fd) and stat.S_ISCHR(os.fstat(fd).st_mode)
        source.datagrams = is_datagram_socket(fd)
        if reconnects:
            source.peer_length = peer_of(fd, &source.peer)
            if source.peer_length < 0:
                raise OSError(errno, os.strerror(errno))
            keep_alive(fd)
        if source.is_tty:
            if tcgetattr(fd, &source.settings) != 0:
                raise OSError(errno, os.strerror(errno))
            # with 0, an empty line would read like a disconnected one
            source.settings.c_cc[VMIN], source.settings.c_cc[VTIME] = 1, 0
            tcsetattr(fd, TCSANOW, &source.settings)
        if self.listen(source.fd, EPOLLIN, len(self.streams)) != 0:
            raise OSError(errno, os.strerror(errno))
        self.streams.append(stream)
        return stream

    def start(self, int priority=0) -> None:
        """Start the thread. priority : of SCHED_FIFO if granted, 0 for an ordinary thread"""
        cdef int failed
        if self.running:
            return
        free(self.sources)
        self.count = len(self.streams)
        self.sources = <Source **>calloc(max(1, self.count), sizeof(Source *))
        if self.sources == NULL:
            raise MemoryError
        for index, stream in enumerate(self.streams):
            self.sources[index] = (<Stream>stream).source
        self.leave, self.priority = 0, priority
        failed = start_thread(&self.thread, enter, <void *>self, STACK)
        if failed:
            raise OSError(failed, "cannot start the thread that reads streams")
        self.running = True

    def end(self) -> None:
        """End the thread. Earlier data can still be received."""
        if not self.running:
            return
        self.running = False
        store_i32(&self.leave, 1)
        with nogil:
            pthread_join(self.thread, NULL)

    cdef void serve(self) noexcept nogil:
        cdef epoll_event[EVENTS] events
        cdef int count, index, why
        cdef int timeout = 0
        cdef Source *source
        be_called("tickwork-read", self.priority)
        while not load_i32(&self.leave):
            count = epoll_wait(self.epoll, events, EVENTS, timeout)
            if count < 0 and errno != EINTR:                                 # a block has closed it
                why = errno
                for index in range(self.count):
                    self.lose(self.sources[index], why, monotonic())
                return
            for index in range(count):
                source = self.sources[events[index].data.u32]
                if load_i32(&source.gone):
                    self.settle(source, events[index].data.u32, monotonic())
                elif not self.take(source) and events[index].events & (EPOLLHUP | EPOLLERR):
                    self.lose(source, 0, monotonic())
            timeout = self.look_after(monotonic())

    cdef bint take(self, Source *source) noexcept nogil:
        """Read available data into frames. Returns False if there was none; a lost line is not read any more."""
        cdef Frame frame
        cdef int64_t now
        cdef int at = 0
        cdef int part = FRAME_BYTES // source.record * source.record
        cdef ssize_t count = read(source.fd, self.buffer, READ_SIZE)
        cdef int why = errno
        now = monotonic()
        if count < 0:
            if why == EAGAIN or why == EINTR:
                return False
            # of a sent datagram
            if why == ECONNREFUSED or why == EHOSTUNREACH or why == ENETUNREACH or why == ENETDOWN:
                return True
            self.lose(source, why, now)
            return True
        if count == 0 and not source.datagrams:
            self.lose(source, 0, now)
            return True
        store_u64(&source.bytes, source.bytes + count)
        if source.is_gpio and source.level != ASK_CHIP and count % EVENT == 0:
            store_i32(&source.level, self.buffer[count - EVENT + EVENT_KIND] == RISING)
        memset(&frame, 0, sizeof(Frame))
        frame.time, frame.flags = now, START
        while at < count:
            frame.length = <uint8_t>min(part, count - at)
            memcpy(frame.data, self.buffer + at, frame.length)
            push(&source.ring, &frame)
            at += frame.length
            frame.flags = 0
        return True

    cdef int look_after(self, int64_t now) noexcept nogil:
        """Reopen lost lines, and set up reconnected ones. Returns ms until the next action is due, at most PATIENCE."""
        cdef int index
        cdef int64_t due = now + PATIENCE * 1000000
        cdef Source *source
        for index in range(self.count):
            source = self.sources[index]
            if load_i32(&source.gone):
                if source.path[0] == 0 and source.peer_length == 0:
                    continue
                if now >= source.due:
                    self.try_again(source, index, now)
            elif source.messages_sent < source.messages:
                if now >= source.due:
                    send_setup(source)
                    source.due = now + source.pause
            elif source.is_gpio:
                if now >= source.due:
                    source.due = now + LOOK
                    if hung_up(source.fd):
                        self.lose(source, 0, now)
                        continue
            else:
                continue
            due = min(due, source.due)
        return <int>(max(due - now, 0) // 1000000 + 1)


cdef void *enter(void *context) noexcept nogil:
    (<Streams>context).serve()
    return NULL


def is_datagram_socket(fd) -> bool:
    """Return whether a descriptor reads datagrams, which may be empty."""
    if not stat.S_ISSOCK(os.fstat(fd).st_mode):
        return False
    with socket.socket(fileno=os.dup(fd)) as copy:
        return copy.type == socket.SOCK_DGRAM

# cython: freethreading_compatible=True
"""Streams: everything with a file descriptor that is no CAN bus, a tty, a socket, an input of the computer, behind the `Bus` struct.

One native thread reads them all, whatever comes, stamps each read, and cuts it into frames, which wait in a ring of each stream for the tick
to drain. It never takes the GIL, never waits for one of them, and sleeps while there is nothing to read.

    BYTES    up to 64 bytes as they came; flags START on the first of a read, GAP where frames before it were written over unread
    LOST     the line is gone: nothing more comes
    BACK     it is there again, set up as it was
    LEVEL    a GPIO line's level as a run begins: its edges come behind, with the kernel's times on the clock of the run

A line with a path is opened again when it is back: with the settings that its tty had, and with what the device has to be told. One that can
be asked who it is has to say first that it is the one it was: until then it stays gone, whatever else is there. A TCP
connection is made anew, without waiting for it: tried after 0.1 s, and ever more rarely, down to every 2 s.
What the tick sends goes out at once, as far as the line takes it without waiting.
"""

import fcntl
import os
import socket
import stat

from libc.errno cimport EAGAIN, ECONNREFUSED, EHOSTUNREACH, EINTR, ENETDOWN, ENETUNREACH, errno
from libc.stdint cimport uint32_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy, memset
from posix.unistd cimport close, read, write

from cext.abi cimport Frame
from cext.atomics cimport load_i32, load_u64, store_i32, store_u64
from cext.line_calls cimport (
    begin_connection, gpio_level, holds, hung_up, is_connected, keep_alive, open_line, peer_of, put_in_place, set_gpio)
from cext.newest_ring cimport NEWEST, START, forget, pull, push
from cext.pace cimport monotonic
from cext.posix cimport iovec, pthread_join
from cext.threads cimport be_called, start_thread

cdef extern from "<sys/epoll.h>" nogil:
    ctypedef union epoll_data_t:
        uint32_t u32
    cdef struct epoll_event:
        uint32_t events
        epoll_data_t data
    int epoll_create1(int flags)
    int epoll_ctl(int epoll, int operation, int fd, epoll_event *event)
    int epoll_wait(int epoll, epoll_event *events, int most, int timeout)
    const int EPOLL_CLOEXEC, EPOLL_CTL_ADD, EPOLL_CTL_DEL
    const uint32_t EPOLLIN, EPOLLOUT, EPOLLHUP, EPOLLERR

cdef extern from "<sys/uio.h>" nogil:
    ssize_t writev(int fd, const iovec *parts, int count)

cdef enum:
    ROOM = 1 << 16                      # bytes of one read: the longest datagram
    BELL = 0xFFFFFFFF
    EVENTS = 32
    AT_ONCE = 16                        # frames of one write
    EVENT = 48                          # bytes of a gpio_v2_line_event

cdef int64_t RETRY = 100000000          # ns between attempts to open what is gone
cdef int64_t RAREST = 2000000000        # and between those to connect, at most
cdef int64_t PATIENCE = 3000000000      # ns for a connection to be made
cdef int64_t ANSWER = 300000000         # ns for a line that is back to say who it is
cdef int64_t LOOK = 20000000            # ns between looks whether the chip of a GPIO line is still there
cdef size_t STACK = 256 << 10           # bytes


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
    """A frame with the level of a GPIO line. What was read before has been forgotten, so that any edge since is told behind it."""
    cdef int level = gpio_level(source.fd)
    if level < 0:
        return 0
    memset(frame, 0, sizeof(Frame))
    frame.id, frame.length = LEVEL, 1
    frame.data[0] = <uint8_t>level
    frame.time = max(monotonic() - source.began, 0)
    return 1


cdef void move_times(Frame *frame, int64_t began) noexcept nogil:
    """The kernel's times of edges, ns of CLOCK_MONOTONIC, to the clock of the run. Each begins its record."""
    cdef int64_t when
    cdef int at = 0
    while at + EVENT <= frame.length:
        memcpy(&when, &frame.data[at], sizeof(int64_t))
        when -= began
        memcpy(&frame.data[at], &when, sizeof(int64_t))
        at += EVENT


cdef int stream_send(void *context, const Frame *frames, int count) noexcept nogil:
    cdef Source *source = <Source *>context
    cdef iovec[AT_ONCE] parts
    cdef int index, number
    cdef int first = 0
    cdef ssize_t size
    while first < count:                                            # together: what belongs together arrives together
        number = min(AT_ONCE, count - first)
        size = 0
        for index in range(number):
            parts[index].iov_base, parts[index].iov_len = <void *>frames[first + index].data, frames[first + index].length
            size += frames[first + index].length
        if load_i32(&source.gone) or writev(source.fd, parts, number) != size:
            source.refused += 1
        first += number
    return count


cdef int gpio_send(void *context, const Frame *frames, int count) noexcept nogil:
    """Its level is the first byte of a frame."""
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
    """One of them, made by `Streams.add`. end : its BusEnd"""

    def __cinit__(self):
        self.own = -1
        self.source = <Source *>calloc(1, sizeof(Source))
        if self.source == NULL:
            raise MemoryError
        memset(self.source, 0, sizeof(Source))                      # the tick is not to be the first to touch it
        self.end = BusEnd()
        self.end.bus.receive, self.end.bus.send, self.end.bus.begin = stream_receive, stream_send, stream_begin
        self.end.bus.context = self.source
        self.end.owner = self

    def __dealloc__(self):
        self.close()
        free(self.source)

    def close(self):
        """Let go of the line, once nothing reads it any more. What has been read can still be received."""
        store_i32(&self.source.gone, 1)
        if self.own >= 0:
            close(self.own)
        if self.source.attempt > 0:
            close(self.source.attempt)
        self.own, self.source.attempt = -1, 0

    def begin(self, int64_t began):
        """As before a run: frames are timed from `began`, in ns of CLOCK_MONOTONIC, and what has come so far is forgotten."""
        stream_begin(self.source, began)

    @property
    def gone(self):
        return bool(load_i32(&self.source.gone))

    @property
    def trouble(self):
        """errno that it went with, None while it is there."""
        return (self.source.error or None) if self.gone else None

    @property
    def counts(self):
        """bytes read; frames that were written over before a tick took them; messages refused; how often it was lost, came back, and something
        else answered in its place."""
        return {
            "bytes": load_u64(&self.source.bytes), "overflows": self.source.ring.skipped, "refused": self.source.refused,
            "losses": load_u64(&self.source.losses), "returns": load_u64(&self.source.returns),
            "strangers": load_u64(&self.source.strangers)}


cdef class Streams:
    """All streams of a run, and the thread that reads them: started before arming, ended after the safe stop."""

    def __cinit__(self):
        self.epoll = self.bell = self.nothing = -1

    def __init__(self):
        cdef epoll_event event
        self.streams = []
        self.buffer = <uint8_t *>calloc(ROOM, 1)
        if self.buffer == NULL:
            raise MemoryError
        memset(self.buffer, 0, ROOM)
        self.epoll = epoll_create1(EPOLL_CLOEXEC)
        self.bell = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self.nothing = os.open("/dev/null", os.O_RDWR | os.O_CLOEXEC)
        memset(&event, 0, sizeof(event))
        event.events, event.data.u32 = EPOLLIN, <uint32_t>BELL
        if self.epoll < 0 or epoll_ctl(self.epoll, EPOLL_CTL_ADD, self.bell, &event) != 0:
            raise OSError(errno, os.strerror(errno))

    def __dealloc__(self):
        self.end()
        for descriptor in (self.epoll, self.bell, self.nothing):
            if descriptor >= 0:
                close(descriptor)
        free(self.buffer)
        free(self.sources)

    def add(self, int fd, str name="", *, path="", setup=(), double pause=0.02, int record=1, bint is_gpio=False, bint reconnects=False,
            proof=(b"", b"")):
        """Read a descriptor from `start` on. It is duplicated: the caller closes its own. Returns a Stream; OSError where it cannot be polled.

        path : where it can be opened again when it has gone and is back, "" for nowhere. By its id, as in /dev/serial/by-id, it is found at
            whatever port it returns
        setup : messages, as bytes, that are then written to it, `pause` s before each
        record : bytes that belong together, 1 to 64; then a frame holds whole records
        is_gpio : it is a request of one GPIO line; what is sent to it sets its level
        reconnects : it is a TCP connection, which is made anew when it is lost
        proof : (bytes that ask a line with a path who it is, bytes that are in the answer of this one and of no other)
        """
        cdef Stream stream = Stream()
        cdef Source *source = stream.source
        cdef bytes message
        cdef epoll_event event
        cdef int at = 0
        if self.running:
            raise ValueError("streams are added before they are read")
        if not 1 <= record <= FRAME_BYTES:
            raise ValueError("a record has 1 to %d bytes, not %d" % (FRAME_BYTES, record))
        encoded = os.fsencode(path)
        if len(encoded) >= LONGEST_PATH or len(setup) > SETUP_MESSAGES or sum(map(len, setup)) > SETUP_BYTES:
            raise ValueError("at most %d bytes of path, %d messages and %d bytes of set-up" % (LONGEST_PATH - 1, SETUP_MESSAGES, SETUP_BYTES))
        asks, tells = proof
        if max(len(asks), len(tells)) > LONGEST_PROOF or bool(asks) != bool(tells):
            raise ValueError("a proof is a question and an answer, each of at most %d bytes" % LONGEST_PROOF)
        source.question_length, source.proof_length = len(asks), len(tells)
        memcpy(source.question, <const char *>asks, len(asks))
        memcpy(source.proof, <const char *>tells, len(tells))
        stream.name, stream.own = name, fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 3)
        source.fd, source.record, source.pause, source.is_gpio = stream.own, record, round(pause * 1e9), is_gpio
        if is_gpio:
            stream.end.bus.send = gpio_send
        memcpy(source.path, <const char *>encoded, len(encoded))
        for message in setup:
            memcpy(source.setup + at, <const char *>message, len(message))
            at += len(message)
            source.ends[source.messages] = at
            source.messages += 1
        source.said = source.messages                               # it has been set up by who opened it
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
            source.settings.c_cc[VMIN], source.settings.c_cc[VTIME] = 1, 0      # with 0 an empty line would read as one that hung up
            tcsetattr(fd, TCSANOW, &source.settings)
        memset(&event, 0, sizeof(event))
        event.events, event.data.u32 = EPOLLIN, <uint32_t>len(self.streams)
        if epoll_ctl(self.epoll, EPOLL_CTL_ADD, source.fd, &event) != 0:
            raise OSError(errno, os.strerror(errno))
        self.streams.append(stream)
        return stream

    def start(self, int priority=0):
        """Read from now on. priority : of SCHED_FIFO where the system grants it, 0 for an ordinary thread"""
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
            raise OSError(failed, "there is no thread to read streams")
        self.running = True

    def end(self):
        """Read no longer. What has been read can still be received."""
        if not self.running:
            return
        self.running = False
        store_i32(&self.leave, 1)
        os.eventfd_write(self.bell, 1)
        with nogil:
            pthread_join(self.thread, NULL)
        os.eventfd_read(self.bell)

    cdef void serve(self) noexcept nogil:
        cdef epoll_event[EVENTS] events
        cdef int count, index
        cdef int64_t now
        cdef int timeout = 0
        cdef Source *source
        be_called("tickwork-read", self.priority)
        while not load_i32(&self.leave):
            count = epoll_wait(self.epoll, events, EVENTS, timeout)
            for index in range(count):
                if events[index].data.u32 != <uint32_t>BELL:
                    source = self.sources[events[index].data.u32]
                    if load_i32(&source.gone):
                        self.settle(source, events[index].data.u32, monotonic())
                    elif not self.take(source) and events[index].events & (EPOLLHUP | EPOLLERR):
                        self.lose(source, 0, monotonic())
            now = monotonic()
            timeout = self.look_after(now)

    cdef bint take(self, Source *source) noexcept nogil:
        """What there is to read, into frames. False where there was nothing, and the line is no longer read if it is gone."""
        cdef Frame frame
        cdef int64_t now
        cdef int at = 0
        cdef int part = FRAME_BYTES // source.record * source.record
        cdef ssize_t count = read(source.fd, self.buffer, ROOM)
        cdef int why = errno
        now = monotonic()
        if count < 0:
            if why == EAGAIN or why == EINTR:
                return False
            if why == ECONNREFUSED or why == EHOSTUNREACH or why == ENETUNREACH or why == ENETDOWN:     # of a datagram that we sent
                return True
            self.lose(source, why, now)
            return True
        if count == 0 and not source.datagrams:
            self.lose(source, 0, now)
            return True
        store_u64(&source.bytes, source.bytes + count)
        memset(&frame, 0, sizeof(Frame))
        frame.time, frame.flags = now, START
        while at < count:
            frame.length = <uint8_t>min(part, count - at)
            memcpy(frame.data, self.buffer + at, frame.length)
            push(&source.ring, &frame)
            at += frame.length
            frame.flags = 0
        return True

    cdef void lose(self, Source *source, int error, int64_t now) noexcept nogil:
        """The line is gone. Its number stays, with nothing behind it, so that whoever writes to it meets nobody else's file."""
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
        store_i32(&source.gone, 1)                                  # last: who sees that has all that is told of it

    cdef int look_after(self, int64_t now) noexcept nogil:
        """Try to open what is gone; tell what is back how to be. Returns the ms until something is due, -1 for never."""
        cdef int index
        cdef int64_t due = -1
        cdef Source *source
        for index in range(self.count):
            source = self.sources[index]
            if load_i32(&source.gone):
                if source.path[0] == 0 and source.peer_length == 0:
                    continue
                if now >= source.due:
                    self.try_again(source, index, now)
            elif source.said < source.messages:
                if now >= source.due:
                    tell(source)
                    source.due = now + source.pause
            elif source.is_gpio:
                if now >= source.due:
                    source.due = now + LOOK
                    if hung_up(source.fd):
                        self.lose(source, 0, now)
                        continue
            else:
                continue
            if due < 0 or source.due < due:
                due = source.due
        return -1 if due < 0 else <int>(max(due - now, 0) // 1000000 + 1)

    cdef void try_again(self, Source *source, int index, int64_t now) noexcept nogil:
        cdef epoll_event event
        cdef int found
        source.due = now + source.wait
        if source.attempt > 0:                                      # nobody has answered
            self.give_up(source, now)
            return
        if source.path[0] != 0:
            found = open_line(source.path, source.is_tty)
            if found < 0:
                return
            if source.is_tty and tcsetattr(found, TCSANOW, &source.settings) != 0:
                close(found)
            elif source.question_length > 0:
                self.ask_who(source, found, index, now)
            else:
                self.resume(source, found, index, now)
                close(found)
            return
        source.attempt = max(begin_connection(&source.peer, source.peer_length), 0)
        if source.attempt == 0:
            self.give_up(source, now)
            return
        memset(&event, 0, sizeof(event))
        event.events, event.data.u32 = EPOLLOUT, <uint32_t>index
        if epoll_ctl(self.epoll, EPOLL_CTL_ADD, source.attempt, &event) != 0:
            self.give_up(source, now)
            return
        source.due = now + PATIENCE

    cdef void ask_who(self, Source *source, int found, int index, int64_t now) noexcept nogil:
        cdef epoll_event event
        source.attempt, source.seen_length, source.spoken = found, 0, False
        memset(&event, 0, sizeof(event))
        event.events, event.data.u32 = EPOLLIN, <uint32_t>index
        if (epoll_ctl(self.epoll, EPOLL_CTL_ADD, found, &event) != 0
                or write(found, source.question, source.question_length) != source.question_length):
            self.give_up(source, now)
            return
        source.due = now + ANSWER

    cdef bint is_the_one(self, Source *source) noexcept nogil:
        """Whether it has said by now what it has to say. What else it said is nothing that anybody waits for."""
        cdef ssize_t count
        cdef int kept
        memcpy(self.buffer, source.seen, source.seen_length)
        count = read(source.attempt, self.buffer + source.seen_length, ROOM - source.seen_length)
        if count <= 0:
            if count == 0 or (errno != EAGAIN and errno != EINTR):
                source.due = 0                                      # gone again
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
        """What was begun has come to something: a connection, or none; an answer, or a part of one."""
        if source.attempt == 0:
            return
        if source.path[0] != 0 and not self.is_the_one(source):
            return
        epoll_ctl(self.epoll, EPOLL_CTL_DEL, source.attempt, NULL)
        if (source.path[0] != 0 or is_connected(source.attempt)) and self.resume(source, source.attempt, index, now):
            close(source.attempt)
            source.attempt = 0
        else:
            self.give_up(source, now)

    cdef void give_up(self, Source *source, int64_t now) noexcept nogil:
        """Of one attempt. The next is made later than this one was."""
        if source.attempt > 0:
            close(source.attempt)                                   # which takes it out of epoll, too
        if source.attempt > 0 and source.path[0] != 0 and source.spoken:
            store_u64(&source.strangers, source.strangers + 1)
        source.attempt = 0
        source.due = now + source.wait
        if source.path[0] == 0:
            source.wait = min(2 * source.wait, RAREST)

    cdef bint resume(self, Source *source, int found, int index, int64_t now) noexcept nogil:
        """Put what was found in the place of what is gone."""
        cdef Frame frame
        cdef epoll_event event
        put_in_place(found, source.fd)
        memset(&event, 0, sizeof(event))
        event.events, event.data.u32 = EPOLLIN, <uint32_t>index
        if epoll_ctl(self.epoll, EPOLL_CTL_ADD, source.fd, &event) != 0:
            put_in_place(self.nothing, source.fd)
            return False
        memset(&frame, 0, sizeof(Frame))
        frame.time, frame.id = now, BACK
        push(&source.ring, &frame)
        source.said, source.due = 0, now + source.pause
        store_u64(&source.returns, source.returns + 1)
        store_i32(&source.gone, 0)
        return True


cdef void *enter(void *context) noexcept nogil:
    (<Streams>context).serve()
    return NULL


cdef void tell(Source *source) noexcept nogil:
    """The next message of its set-up."""
    cdef int begin = source.ends[source.said - 1] if source.said > 0 else 0
    write(source.fd, source.setup + begin, source.ends[source.said] - begin)
    source.said += 1


def is_datagram_socket(fd):
    """Whether what a descriptor gives are datagrams, of which one may be empty."""
    if not stat.S_ISSOCK(os.fstat(fd).st_mode):
        return False
    with socket.socket(fileno=os.dup(fd)) as copy:
        return copy.type == socket.SOCK_DGRAM

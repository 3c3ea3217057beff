# cython: freethreading_compatible=True
"""SocketCAN interface behind the `Bus` struct: one recvmmsg and one sendmmsg a tick, both non-blocking.

    time        the kernel stamps a received frame by the wall clock. Its age at the time of reading gives its time on
                the clock of the run; setting the wall clock moves it back to the previous reading at most
    echo        a frame that this machine sent is not a reply, except on a virtual bus, where all nodes are on this
                machine
    corrupt     a datagram without the size of a CAN frame is counted and discarded
    error       error frames of the controller are passed on for the recording; bus-off is a failure
    full        frames that the queue rejects are counted; a queue that is full for `queue_full_limit` ticks in a row is
                a failure

A failure is reported once, by the next receive or send. The safe stop that follows continues to send.
"""

from libc.errno cimport EAGAIN, EINTR, ENOBUFS, errno
from libc.stdint cimport int64_t, uint8_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy, memset

from cext.abi cimport ERROR_FRAME, Frame
from cext.bus.bits cimport is_flexible
from cext.clock.deadline_clock cimport clock, monotonic
from cext.posix cimport (
    CLOCK_REALTIME, CMSG_DATA, CMSG_FIRSTHDR, MSG_CONFIRM, MSG_DONTROUTE, MSG_DONTWAIT, MSG_NOSIGNAL, MSG_TRUNC,
    SCM_TIMESTAMPNS,
    SOL_SOCKET, cmsghdr, recvmmsg, sendmmsg, timespec,
)

STATES = ("active", "warning", "passive", "off")
TROUBLES = {FULL: "full", BUS_OFF: "bus-off"}


cdef int fail(Socket *socket, int trouble) noexcept nogil:
    socket.trouble = trouble
    socket.reported = True
    return -1


cdef inline bint unreported(Socket *socket) noexcept nogil:
    return socket.trouble != 0 and not socket.reported


cdef inline int64_t stamp_of(mmsghdr *message) noexcept nogil:
    """Return the ns of CLOCK_REALTIME at which the kernel received the frame; 0 if unknown."""
    cdef cmsghdr *part = CMSG_FIRSTHDR(&message.msg_hdr)
    cdef timespec stamp
    if part == NULL or part.cmsg_level != SOL_SOCKET or part.cmsg_type != SCM_TIMESTAMPNS:
        return 0
    memcpy(&stamp, CMSG_DATA(part), sizeof(timespec))
    return stamp.tv_sec * 1000000000 + stamp.tv_nsec


cdef inline bint is_whole(const Socket *socket, const mmsghdr *message, const canfd_frame *frame) noexcept nogil:
    """Return whether a datagram is a CAN frame; on a bus with CAN FD, of either kind."""
    if message.msg_hdr.msg_flags & MSG_TRUNC:
        return False
    if message.msg_len == <unsigned>CAN_MTU:
        return frame.len <= CAN_MAX_DLEN
    return socket.flexible and message.msg_len == <unsigned>CANFD_MTU and frame.len <= sizeof(frame.data)


cdef void note(Socket *socket, const canfd_frame *frame) noexcept nogil:
    """Record the controller's state from an error frame."""
    cdef int says = frame.data[1] if frame.can_id & CAN_ERR_CRTL else 0
    cdef int state = socket.state
    socket.counts.errors += 1
    socket.counts.overflows += says & CAN_ERR_CRTL_RX_OVERFLOW != 0
    if frame.can_id & CAN_ERR_RESTARTED or says & CAN_ERR_CRTL_ACTIVE:
        state = ACTIVE
    if says & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING):
        state = WARNING
    if says & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE):
        state = PASSIVE
    if frame.can_id & CAN_ERR_BUSOFF:
        state = OFF
        if socket.trouble == 0:
            socket.trouble = BUS_OFF
    socket.state = state
    socket.worst = max(socket.worst, state)


cdef int socket_receive(void *context, Frame *frames, int capacity) noexcept nogil:
    cdef Socket *socket = <Socket *>context
    cdef int count = 0
    cdef int wanted = min(capacity, FRAMES_PER_TICK)
    cdef int read, index, flags
    cdef int64_t before, now, wall, at
    cdef mmsghdr *message
    cdef canfd_frame *received
    socket.full = socket.full + 1 if socket.refusing else 0
    socket.refusing = False
    if socket.full >= socket.queue_full_limit and socket.trouble == 0:
        socket.trouble = FULL
    if unreported(socket):
        return fail(socket, socket.trouble)
    before = monotonic()
    read = recvmmsg(socket.fd, socket.incoming, wanted, MSG_DONTWAIT, NULL)
    if read < 0:
        if errno != EAGAIN and errno != EINTR:
            return fail(socket, errno)
        read = 0
    now, wall = monotonic(), clock(CLOCK_REALTIME)
    for index in range(read):
        message, received = &socket.incoming[index], &socket.received[index]
        flags = message.msg_hdr.msg_flags
        at = stamp_of(message)
        message.msg_hdr.msg_controllen = sizeof(socket.control[0])                  # for the next call
        if flags & MSG_CONFIRM or (flags & MSG_DONTROUTE and not socket.shared):
            socket.counts.echoes += 1
        elif not is_whole(socket, message, received):
            socket.counts.corrupt += 1
        else:
            if received.can_id & ERROR_FRAME:
                note(socket, received)
            at = now - (wall - at) if at else now
            memset(&frames[count], 0, sizeof(Frame))
            frames[count].time = min(max(at, socket.drained), now) - socket.began
            frames[count].id = received.can_id
            frames[count].length = received.len
            frames[count].flags = received.flags | CANFD_FDF if message.msg_len == <unsigned>CANFD_MTU else 0
            memcpy(frames[count].data, received.data, received.len)
            count += 1
    if read < wanted:
        socket.drained = before
    return count


cdef int socket_send(void *context, const Frame *frames, int count) noexcept nogil:
    cdef Socket *socket = <Socket *>context
    cdef int sent = 0
    cdef int index, batch, taken
    if unreported(socket):
        return fail(socket, socket.trouble)
    if socket.mute:
        return 0
    while sent < count:
        batch = min(count - sent, FRAMES_PER_TICK)
        for index in range(batch):
            put(socket, index, &frames[sent + index])
        taken = sendmmsg(socket.fd, socket.outgoing, batch, MSG_DONTWAIT | MSG_NOSIGNAL)
        if taken < 0 and errno != ENOBUFS and errno != EAGAIN and errno != EINTR:
            return fail(socket, errno)
        sent += max(taken, 0)
        if taken < batch:
            socket.refusing = True
            socket.counts.refused += count - sent
            break
    return sent


cdef inline void put(Socket *socket, int index, const Frame *frame) noexcept nogil:
    cdef canfd_frame *sent = &socket.sent[index]
    cdef bint flexible = is_flexible(frame)
    sent.can_id = frame.id
    sent.len = frame.length
    sent.flags = frame.flags if flexible else 0
    memcpy(sent.data, frame.data, min(frame.length, <uint8_t>sizeof(sent.data)))
    socket.goes[index].iov_len = CANFD_MTU if flexible else CAN_MTU


cdef void socket_begin(void *context, int64_t began) noexcept nogil:
    """Discard earlier frames, which are not replies; keep only the state of the controller."""
    cdef Socket *socket = <Socket *>context
    cdef int round, index
    cdef int read = FRAMES_PER_TICK
    for round in range(64):
        if read < FRAMES_PER_TICK:
            break
        read = recvmmsg(socket.fd, socket.incoming, FRAMES_PER_TICK, MSG_DONTWAIT, NULL)
        for index in range(read):
            socket.incoming[index].msg_hdr.msg_controllen = sizeof(socket.control[0])
            if is_whole(socket, &socket.incoming[index],
                    &socket.received[index]) and socket.received[index].can_id & ERROR_FRAME:
                note(socket, &socket.received[index])
    socket.began = began
    socket.drained = max(monotonic(), began)            # no frame is older than the run, which may begin later
    socket.trouble = BUS_OFF if socket.state == OFF else 0
    socket.full = 0
    socket.reported = socket.refusing = False
    socket.worst = socket.state
    memset(&socket.counts, 0, sizeof(Counts))


cdef class SocketCan:
    """Bus on an open and bound socket: raw CAN, or a packet socket such as UDP or AF_UNIX datagrams.

    file : socket.socket, kept open by this object
    fd : whether it receives frames of CAN FD
    switching : whether it sends frames of more than eight bytes at the data bitrate
    shared : whether the other nodes are processes of this machine, as on a virtual bus
    queue_full_limit : ticks in a row with a full queue until the bus fails
    mute : whether it never sends

    end : the BusEnd
    """

    def __cinit__(self, file, *, bint fd=False, bint switching=False, bint shared=False, int queue_full_limit=10, bint mute=False):
        cdef int index
        self.socket = <Socket *>calloc(1, sizeof(Socket))
        if self.socket == NULL:
            raise MemoryError
        self.file = file
        self.socket.mute = mute
        self.socket.fd, self.socket.flexible = file.fileno(), fd
        self.socket.shared, self.socket.queue_full_limit = shared, queue_full_limit
        for index in range(FRAMES_PER_TICK):
            self.socket.came[index].iov_base = &self.socket.received[index]
            self.socket.came[index].iov_len = CANFD_MTU if fd else CAN_MTU
            self.socket.goes[index].iov_base = &self.socket.sent[index]
            self.socket.incoming[index].msg_hdr.msg_iov = &self.socket.came[index]
            self.socket.outgoing[index].msg_hdr.msg_iov = &self.socket.goes[index]
            self.socket.incoming[index].msg_hdr.msg_iovlen = self.socket.outgoing[index].msg_hdr.msg_iovlen = 1
            self.socket.incoming[index].msg_hdr.msg_control = &self.socket.control[index]
            self.socket.incoming[index].msg_hdr.msg_controllen = sizeof(self.socket.control[0])
        self.end = BusEnd()
        self.end.switching = switching
        self.end.bus.receive, self.end.bus.send, self.end.bus.begin = socket_receive, socket_send, socket_begin
        self.end.bus.context = self.socket
        self.end.owner = self
        self.begin(0)

    def __dealloc__(self):
        free(self.socket)

    def begin(self, int64_t began) -> None:
        """Reset the counts, and time frames from `began`, in ns of CLOCK_MONOTONIC."""
        socket_begin(self.socket, began)

    @property
    def counts(self) -> dict[str, int]:
        """Frames since the begin, by kind."""
        return self.socket.counts

    @property
    def state(self) -> str:
        """Reported state of the controller: active, warning, passive or off."""
        return STATES[self.socket.state]

    @property
    def worst(self) -> str:
        """Worst state since the begin."""
        return STATES[self.socket.worst]

    @property
    def trouble(self) -> str | int | None:
        """Reason for a failure of the bus: "full", "bus-off", the errno of a system call, or None."""
        return TROUBLES.get(self.socket.trouble, self.socket.trouble) if self.socket.trouble else None

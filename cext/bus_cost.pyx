# cython: freethreading_compatible=True
"""What a bus costs a tick beside the system calls that it cannot do without. For `bench bus`."""

from libc.stdint cimport int64_t
from libc.string cimport memset

from cext.abi cimport FRAMES_PER_TICK, Frame
from cext.buses cimport BusEnd
from cext.pace cimport monotonic
from cext.posix cimport MSG_DONTWAIT, MSG_NOSIGNAL, iovec, mmsghdr, recvmmsg, sendmmsg
from cext.socketcan cimport CAN_MTU, CONTROL_WORDS, canfd_frame


cdef struct Calls:                      # what the two system calls need
    mmsghdr messages[FRAMES_PER_TICK]
    iovec places[FRAMES_PER_TICK]
    canfd_frame frames[FRAMES_PER_TICK]
    int64_t control[FRAMES_PER_TICK][CONTROL_WORDS]


cdef void prepare(Calls *calls, bint stamped) noexcept nogil:
    cdef int index
    memset(calls, 0, sizeof(Calls))
    for index in range(FRAMES_PER_TICK):
        calls.frames[index].can_id, calls.frames[index].len = index + 1, 8
        calls.places[index].iov_base, calls.places[index].iov_len = &calls.frames[index], CAN_MTU
        calls.messages[index].msg_hdr.msg_iov, calls.messages[index].msg_hdr.msg_iovlen = &calls.places[index], 1
        if stamped:
            calls.messages[index].msg_hdr.msg_control = &calls.control[index]
            calls.messages[index].msg_hdr.msg_controllen = sizeof(calls.control[0])


def time_of_ticks(BusEnd end, int own, int other, int frames, int rounds):
    """Two lists of ns: of a tick's receive and send through a bus, and of one recvmmsg and one sendmmsg alone, taken in turn.

    end : of a cext.socketcan.SocketCan over the datagram socket `own`
    own, other : file descriptors of two datagram sockets that are connected to each other
    frames : received and sent in every round
    """
    cdef Calls said, heard
    cdef Frame[FRAMES_PER_TICK] taken
    cdef int64_t began, bus, bare
    cdef int round, index, came
    if not 0 < frames <= FRAMES_PER_TICK:
        raise ValueError("1 to %d frames, not %d" % (FRAMES_PER_TICK, frames))
    through, alone = [], []
    prepare(&said, False)
    for round in range(rounds):
        if sendmmsg(other, said.messages, frames, MSG_DONTWAIT | MSG_NOSIGNAL) != frames:
            raise OSError("the other end cannot send")
        began = monotonic()
        came = end.bus.receive(end.bus.context, taken, FRAMES_PER_TICK)
        end.bus.send(end.bus.context, taken, frames)
        bus = monotonic() - began
        prepare(&heard, True)
        if came != frames or recvmmsg(other, heard.messages, FRAMES_PER_TICK, MSG_DONTWAIT, NULL) != frames:
            raise OSError("%d of %d frames arrived" % (came, frames))
        if sendmmsg(other, said.messages, frames, MSG_DONTWAIT | MSG_NOSIGNAL) != frames:
            raise OSError("the other end cannot send")
        prepare(&heard, True)
        began = monotonic()
        came = recvmmsg(own, heard.messages, FRAMES_PER_TICK, MSG_DONTWAIT, NULL)
        sendmmsg(own, said.messages, frames, MSG_DONTWAIT | MSG_NOSIGNAL)
        bare = monotonic() - began
        prepare(&heard, True)
        if came != frames or recvmmsg(other, heard.messages, FRAMES_PER_TICK, MSG_DONTWAIT, NULL) != frames:
            raise OSError("%d of %d frames arrived" % (came, frames))
        through.append(bus)
        alone.append(bare)
    return through, alone

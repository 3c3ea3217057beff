# cython: freethreading_compatible=True
"""Cost of a bus in a tick beyond its system calls, and cost of drives. For `bench bus` and `bench can`."""

from cpython.exc cimport PyErr_CheckSignals
from libc.stdint cimport int64_t
from libc.string cimport memcpy, memset

from cext.abi cimport AUTHORITY, DT, FRAMES_PER_TICK, OK, PERIOD, TICK, TIME, Frame
from cext.bus.memory_bus cimport BusEnd
from cext.clock.deadline_clock cimport monotonic
from cext.schedule.program cimport Program, run_phase
from cext.posix cimport MSG_DONTWAIT, MSG_NOSIGNAL, iovec, mmsghdr, recvmmsg, sendmmsg
from cext.bus.socketcan cimport CAN_MTU, CONTROL_WORDS, canfd_frame

from cext.schedule.outcome import name_of


cdef struct Calls:                      # arguments of the two system calls
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


def time_of_ticks(BusEnd end, int own, int other, int frames, int rounds) -> tuple[list[int], list[int]]:
    """Return two lists of ns: of a tick's receive and send through a bus, and of one recvmmsg and one sendmmsg alone,
    in turns.

    end : of a cext.bus.socketcan.SocketCan over the datagram socket `own`
    own, other : file descriptors of two datagram sockets that are connected to each other
    frames : received and sent in every round
    """
    cdef Calls to_send, received
    cdef Frame[FRAMES_PER_TICK] taken
    cdef int64_t began, bus, bare
    cdef int round, index, came
    if not 0 < frames <= FRAMES_PER_TICK:
        raise ValueError("1 to %d frames, not %d" % (FRAMES_PER_TICK, frames))
    through, alone = [], []
    prepare(&to_send, False)
    for round in range(rounds):
        PyErr_CheckSignals()
        if sendmmsg(other, to_send.messages, frames, MSG_DONTWAIT | MSG_NOSIGNAL) != frames:
            raise OSError("the other end of the bus cannot send")
        began = monotonic()
        came = end.bus.receive(end.bus.context, taken, FRAMES_PER_TICK)
        end.bus.send(end.bus.context, taken, frames)
        bus = monotonic() - began
        prepare(&received, True)
        if came != frames or recvmmsg(other, received.messages, FRAMES_PER_TICK, MSG_DONTWAIT, NULL) != frames:
            raise OSError("%d of %d frames arrived" % (came, frames))
        if sendmmsg(other, to_send.messages, frames, MSG_DONTWAIT | MSG_NOSIGNAL) != frames:
            raise OSError("the other end of the bus cannot send")
        prepare(&received, True)
        began = monotonic()
        came = recvmmsg(own, received.messages, FRAMES_PER_TICK, MSG_DONTWAIT, NULL)
        sendmmsg(own, to_send.messages, frames, MSG_DONTWAIT | MSG_NOSIGNAL)
        bare = monotonic() - began
        prepare(&received, True)
        if came != frames or recvmmsg(other, received.messages, FRAMES_PER_TICK, MSG_DONTWAIT, NULL) != frames:
            raise OSError("%d of %d frames arrived" % (came, frames))
        through.append(bus)
        alone.append(bare)
    return through, alone


def time_of_control(Program control, BusEnd other, answers, int rounds, double rate=1000.0) -> list[int]:
    """Return the ns of each tick of a robot on one bus: receive and decode, watch, steps, limits and encode, transmit.

    other : the far end of its bus
    answers : (id, data) of the frames present before every tick
    """
    cdef Frame[FRAMES_PER_TICK] to_send, received
    cdef int64_t zero, began, now
    cdef int count = len(answers)
    cdef int round, came, more, status
    if not 0 < count <= FRAMES_PER_TICK:
        raise ValueError("1 to %d frames, not %d" % (FRAMES_PER_TICK, count))
    memset(to_send, 0, sizeof(to_send))
    for index, (identifier, data) in enumerate(answers):
        to_send[index].id, to_send[index].length = identifier, len(data)
        memcpy(to_send[index].data, <const char *>data, len(data))
    control.reset()
    zero = monotonic()
    control.devices.buses.begin(zero)
    control.arena[AUTHORITY], control.arena[DT], control.arena[PERIOD] = 1.0, 1.0 / rate, 1.0 / rate
    took = []
    for round in range(rounds):
        PyErr_CheckSignals()
        for index in range(count):
            to_send[index].time = monotonic() - zero
        if other.bus.send(other.bus.context, to_send, count) != count:
            raise OSError("the other end of the bus cannot send")
        control.arena[TICK], control.arena[TIME] = round, round / rate
        began = monotonic()
        now = began - zero
        status = control.devices.receive(now)
        if status == OK:
            status = control.devices.watch(now)
        if status == OK:
            status = run_phase(control, &control.output, round, round - 1)
        if status == OK:
            status = control.devices.command()
        if status == OK:
            status = control.devices.transmit(now)
        if status == OK:
            status = run_phase(control, &control.update, round, round - 1)
        now = monotonic()
        came = other.bus.receive(other.bus.context, received, FRAMES_PER_TICK)
        if status != OK:
            raise OSError("the measurement ended in tick %d: %s at %s" % (round, name_of(status), control.culprit))
        if came < count:
            raise OSError("the measurement ended in tick %d: %d of %d commands arrived" % (round, came, count))
        took.append(now - began)
    return took

# cython: freethreading_compatible=True
"""I2C adapter over a socket of packets: the other end, in another process, emulates the chips of the bus.

    request     number, address, 1 for a read, 1 with a register, register, count of bytes; then the bytes of a write,
                on SPI those that are sent during the read, with the bytes of a frame as the register
    reply       number, errno or 0; then the bytes of a read
"""

import fcntl

from libc.errno cimport EINTR, EREMOTEIO, ETIMEDOUT, EAGAIN, errno as failed_with
from libc.stdint cimport uint8_t
from libc.string cimport memcpy
from posix.unistd cimport close

from cext.lines.i2c cimport READ_LIMIT, I2cAdapter

cdef extern from "<sys/socket.h>" nogil:
    ssize_t send(int fd, const void *data, size_t count, int flags)
    ssize_t recv(int fd, void *data, size_t count, int flags)
    const int MSG_NOSIGNAL

cdef enum:
    REQUEST_HEADER = 6
    REPLY_HEADER = 2

cdef struct Peer:
    int fd
    uint8_t number              # number of the newest request
    bint duplex                 # SPI: bytes are sent during a read


cdef int ask(void *context, uint8_t address, int register, bint reads, uint8_t *data, int count) noexcept nogil:
    cdef Peer *peer = <Peer *>context
    cdef uint8_t[REQUEST_HEADER + READ_LIMIT] request
    cdef uint8_t[REPLY_HEADER + READ_LIMIT] reply
    cdef int length = REQUEST_HEADER
    cdef ssize_t got
    peer.number += 1
    request[0], request[1], request[2], request[3] = peer.number, address, reads, register >= 0
    request[4], request[5] = <uint8_t>(register if register >= 0 else 0), <uint8_t>count
    if not reads or peer.duplex:
        memcpy(&request[length], data, count)
        length += count
    while send(peer.fd, request, length, MSG_NOSIGNAL) != length:
        if failed_with != EINTR:
            return EREMOTEIO
    while True:
        got = recv(peer.fd, reply, sizeof(reply), 0)
        if got < 0 and failed_with == EINTR:
            continue
        if got < 0 and failed_with == EAGAIN:
            return ETIMEDOUT
        if got < REPLY_HEADER:
            return EREMOTEIO    # the emulator has ended
        if reply[0] == peer.number:     # a reply after its time-out belongs to an earlier request
            break
    if reply[1] != 0:
        return reply[1]
    if reads:
        if got != REPLY_HEADER + count:
            return EREMOTEIO
        memcpy(data, &reply[REPLY_HEADER], count)
    return 0


cdef class SocketAdapter(I2cAdapter):
    """Adapter of a connected socket of packets, which it duplicates: the caller closes its own.

    The socket's own time-out limits an exchange. duplex : whether the bus is SPI
    """

    cdef Peer peer

    def __cinit__(self, int fd, bint duplex=False):
        self.peer.duplex = duplex
        self.peer.fd = fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 3)
        self.adapter.exchange, self.adapter.context = ask, &self.peer

    def __dealloc__(self):
        if self.peer.fd > 0:
            close(self.peer.fd)

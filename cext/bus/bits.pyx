# cython: freethreading_compatible=True
"""Length of a CAN frame in bits: exact, including stuffed bits and the intermission.

    standard    start, id 11, RTR, IDE, r0, length 4, data, CRC 15
    extended    start, id 11, SRR, IDE, id 18, RTR, r1, r0, length 4, data, CRC 15
    both        CRC delimiter, ACK, its delimiter, end of frame 7, intermission 3: not stuffed

After five equal bits an opposite one is stuffed, which counts as the first of the next run. The CRC, with the
polynomial 4599 (hex), covers the bits before stuffing. (ISO 11898-1.) Frames of CAN FD are counted like classic frames
with more data bytes.
"""

from libc.stdint cimport uint8_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport EXTENDED, FRAME_BYTES, ID_MASK, REMOTE

cdef enum:
    POLYNOMIAL = 0x4599
    UNSTUFFED = 13


cdef void put_bits(Counter *counter, uint32_t value, int count, bint checked) noexcept nogil:
    """Count the lowest `count` bits of a value, the most significant first. checked : whether the CRC covers them"""
    cdef int place, bit
    for place in range(count - 1, -1, -1):
        bit = value >> place & 1
        if checked:
            counter.crc = (counter.crc << 1 ^ (POLYNOMIAL if (counter.crc >> 14 & 1) != bit else 0)) & 0x7FFF
        counter.bits += 1
        counter.run = counter.run + 1 if bit == counter.last else 1
        counter.last = bit
        if counter.run == 5:
            counter.bits += 1
            counter.stuffed += 1
            counter.last, counter.run = 1 - bit, 1


cdef Counter count_bits(const Frame *frame) noexcept nogil:
    cdef Counter counter
    cdef uint32_t identifier = frame.id & ID_MASK
    cdef uint32_t remote = 1 if frame.id & REMOTE else 0
    cdef int index
    memset(&counter, 0, sizeof(Counter))
    counter.last = -1
    put_bits(&counter, 0, 1, True)
    if frame.id & EXTENDED:
        put_bits(&counter, identifier >> 18, 11, True)
        put_bits(&counter, 3, 2, True)
        put_bits(&counter, identifier & 0x3FFFF, 18, True)
    else:
        put_bits(&counter, identifier & 0x7FF, 11, True)
    put_bits(&counter, remote << 2, 3, True)
    put_bits(&counter, min(frame.length, <uint8_t>8), 4, True)
    for index in range(0 if remote else frame.length):
        put_bits(&counter, frame.data[index], 8, True)
    put_bits(&counter, counter.crc, 15, False)
    counter.bits += UNSTUFFED
    return counter


cdef int bits_of(const Frame *frame) noexcept nogil:
    return count_bits(frame).bits


def frame_bits(uint32_t arbitration_id, bytes data, bint extended=False) -> tuple[int, int]:
    """Return (bits on the wire including the intermission, number of stuffed bits) of a data frame."""
    cdef Frame frame
    cdef Counter counter
    if len(data) > FRAME_BYTES:
        raise ValueError("a frame carries at most %d bytes, not %d" % (FRAME_BYTES, len(data)))
    memset(&frame, 0, sizeof(Frame))
    frame.id = arbitration_id | (<uint32_t>EXTENDED if extended else 0)
    frame.length = <uint8_t>len(data)
    memcpy(frame.data, <const char *>data, len(data))
    counter = count_bits(&frame)
    return counter.bits, counter.stuffed

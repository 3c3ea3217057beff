# cython: freethreading_compatible=True
"""Length of a CAN frame in bits: exact, including stuffed bits and the intermission.

    standard    start, id 11, RTR, IDE, r0, length 4, data, CRC 15
    extended    start, id 11, SRR, IDE, id 18, RTR, r1, r0, length 4, data, CRC 15
    both        CRC delimiter, ACK, its delimiter, end of frame 7, intermission 3: not stuffed

After five equal bits an opposite one is stuffed, which counts as the first of the next run. The CRC, with the
polynomial 4599 (hex), covers the bits before stuffing. (ISO 11898-1.)

    CAN FD      start, id, RRS, FDF, res, BRS | ESI, length 4, data, stuff count 4, CRC 17 or 21 | CRC delimiter and on

Between the bars, after a recessive BRS, the bits have the data bitrate; BRS and the CRC delimiter, within which the rate
changes, are counted at the nominal one. Up to the data the stuffing is as above. Then come fixed stuff bits: one before
the stuff count, which also takes the place of a bit due after the data, and one after every fourth bit. More than 16
bytes of data have the longer CRC. (ISO 11898-1:2015, 10.4 and 10.5.)
"""

from libc.stdint cimport uint8_t, uint32_t
from libc.string cimport memcpy, memset

from cext.abi cimport EXTENDED, FRAME_BYTES, ID_MASK, REMOTE

cdef enum:
    POLYNOMIAL = 0x4599
    UNSTUFFED = 13
    FIXED_16 = 4 + 17 + 6       # stuff count, CRC and fixed stuff bits of up to 16 bytes
    FIXED_64 = 4 + 21 + 7


cdef void put_bits(Counter *counter, uint32_t value, int count, bint checked) noexcept nogil:
    """Count the lowest `count` bits of a value, the most significant first. checked : whether the CRC covers them"""
    cdef int place, bit
    for place in range(count - 1, -1, -1):
        bit = value >> place & 1
        if checked:
            counter.crc = (counter.crc << 1 ^ (POLYNOMIAL if (counter.crc >> 14 & 1) != bit else 0)) & 0x7FFF
        counter.bits += 1
        counter.run = counter.run + 1 if bit == counter.last else 1
        counter.last, counter.is_stuff = bit, counter.run == 5
        if counter.run == 5:
            counter.bits += 1
            counter.stuffed += 1
            counter.last, counter.run = 1 - bit, 1


cdef int padded(int length) noexcept nogil:
    """Return the number of data bytes on the wire: CAN FD has 12, 16, 20, 24, 32, 48 and 64 above 8."""
    if length <= 8:
        return length
    return length + 3 & ~3 if length <= 24 else 32 if length <= 32 else 48 if length <= 48 else 64


cdef Counter count_bits(const Frame *frame) noexcept nogil:
    cdef Counter counter
    cdef uint32_t identifier = frame.id & ID_MASK
    cdef uint32_t remote = 1 if frame.id & REMOTE else 0
    cdef bint flexible = is_flexible(frame)
    cdef uint32_t switched = frame.flags & RATE_SWITCH if flexible else 0
    cdef int length = padded(frame.length)
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
    if not flexible:
        put_bits(&counter, remote << 2, 3, True)
        put_bits(&counter, length, 4, True)
        for index in range(0 if remote else length):
            put_bits(&counter, frame.data[index], 8, True)
        put_bits(&counter, counter.crc, 15, False)
        counter.bits += UNSTUFFED
        return counter
    put_bits(&counter, 4 | switched, 4 if frame.id & EXTENDED else 5, False)
    counter.fast = -counter.bits
    put_bits(&counter, 1 if frame.flags & ERROR_STATE else 0, 1, False)
    put_bits(&counter, length if length <= 8 else 6 + length // 4 if length <= 24 else 11 + length // 16, 4, False)
    for index in range(length):
        put_bits(&counter, frame.data[index] if index < frame.length else 0, 8, False)
    if counter.is_stuff:
        counter.bits -= 1
        counter.stuffed -= 1
    counter.bits += FIXED_16 if length <= 16 else FIXED_64
    counter.fast = counter.fast + counter.bits if switched else 0
    counter.bits += UNSTUFFED
    return counter


cdef double bits_of(const Frame *frame, double ratio) noexcept nogil:
    cdef Counter counter = count_bits(frame)
    return counter.bits + counter.fast * (ratio - 1.0)


def frame_bits(uint32_t arbitration_id, bytes data, bint extended=False) -> tuple[int, int]:
    """Return (bits on the wire including the intermission, number of stuffed bits) of a data frame."""
    cdef Counter counter = counted(arbitration_id, data, extended, 0)
    return counter.bits, counter.stuffed


def phase_bits(uint32_t arbitration_id, bytes data, bint extended=False, int flags=FD | RATE_SWITCH) -> tuple[int, int]:
    """Return (bits at the nominal bitrate, bits at the data bitrate) of a frame. flags : of struct canfd_frame"""
    cdef Counter counter = counted(arbitration_id, data, extended, flags)
    return counter.bits - counter.fast, counter.fast


cdef Counter counted(uint32_t arbitration_id, bytes data, bint extended, int flags) except *:
    cdef Frame frame
    if len(data) > FRAME_BYTES:
        raise ValueError("a frame carries at most %d bytes, not %d" % (FRAME_BYTES, len(data)))
    memset(&frame, 0, sizeof(Frame))
    frame.id = arbitration_id | (<uint32_t>EXTENDED if extended else 0)
    frame.length, frame.flags = <uint8_t>len(data), <uint8_t>flags
    memcpy(frame.data, <const char *>data, len(data))
    return count_bits(&frame)

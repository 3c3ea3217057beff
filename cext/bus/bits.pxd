from libc.stdint cimport uint8_t, uint32_t

from cext.abi cimport Frame

cdef enum: # flags of struct canfd_frame
    RATE_SWITCH = 1
    ERROR_STATE = 2
    FD = 4

cdef enum:
    CLASSIC_BYTES = 8           # of data at most, without CAN FD

cdef struct Counter:            # counter of the bits on the wire
    int bits                    # including stuffed bits
    int fast                    # of them, those at the data bitrate
    int stuffed
    int run                     # equal bits at the end
    int last
    bint is_stuff               # whether the last one is a stuffed bit
    uint32_t crc

cdef inline bint is_flexible(const Frame *frame) noexcept nogil:
    """Return whether a frame has the format of CAN FD."""
    return frame.flags & FD or frame.length > CLASSIC_BYTES


cdef void put_bits(Counter *counter, uint32_t value, int count, bint checked) noexcept nogil
cdef Counter count_bits(const Frame *frame) noexcept nogil

# Return the bits of the nominal bitrate that a frame lasts. ratio : nominal bitrate / data bitrate
cdef double bits_of(const Frame *frame, double ratio) noexcept nogil

from libc.stdint cimport uint8_t, uint32_t

from cext.abi cimport Frame

cdef struct Counter:            # counter of the bits on the wire
    int bits                    # including stuffed bits
    int stuffed
    int run                     # equal bits at the end
    int last
    uint32_t crc

cdef void put_bits(Counter *counter, uint32_t value, int count, bint checked) noexcept nogil
cdef Counter count_bits(const Frame *frame) noexcept nogil
cdef int bits_of(const Frame *frame) noexcept nogil

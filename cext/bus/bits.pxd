from libc.stdint cimport uint8_t, uint32_t

from cext.abi cimport Frame

cdef struct Counter:            # of bits, as they go over the wire
    int bits                    # stuffed ones included
    int stuffed
    int run                     # of equal bits, up to the last
    int last
    uint32_t crc

cdef void put_bits(Counter *counter, uint32_t value, int count, bint checked) noexcept nogil
cdef Counter count_bits(const Frame *frame) noexcept nogil
cdef int bits_of(const Frame *frame) noexcept nogil

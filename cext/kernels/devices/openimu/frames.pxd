"""SAE J1939 identifiers, packets and settings of OpenIMUs, for the driver and the emulated sensor.

See blocks/imus/openimu/frames.py.
"""

from libc.stdint cimport uint8_t, uint32_t, uint64_t
from libc.string cimport memcpy

from cext.abi cimport ERROR_FRAME, EXTENDED, REMOTE

cdef enum: # parameter groups
    ADDRESS_CLAIM = 0xEE00
    REQUEST = 0xEA00
    SLOPE_1 = 0xF013            # slope of the 335RI: ±64°
    SLOPE = 0xF029
    ANGULAR_RATE = 0xF02A
    ACCELERATION = 0xF02D
    AMBIENT = 0xFEF5            # ambient conditions of J1939
    MAGNETIC_FIELD = 0xFF6A
    FINE_RATE = 0xFF6B          # fine angular rate of the 335RI
    FINE_ACCELERATION = 0xFF6D
    PACKET_RATE = 0xFF55
    PACKET_TYPE = 0xFF56
    FILTERS = 0xFF57
    ORIENTATION = 0xFF58
    BEHAVIOUR = 0xFF59

cdef enum: # bits of the packet type
    SENDS_SLOPE = 1
    SENDS_RATE = 2
    SENDS_ACCELERATION = 4
    SENDS_FIELD = 8             # bit of the 300RI; the 335RI has the next three instead
    SENDS_FINE_RATE = 8
    SENDS_FINE_ACCELERATION = 16
    SENDS_SLOPE_1 = 32

cdef enum: # bits of the settings that have been confirmed
    TOLD_BEHAVIOUR = 1
    TOLD_TYPE = 2
    TOLD_RATE = 4
    TOLD_ORIENTATION = 8
    TOLD_FILTERS = 16


cdef inline uint32_t group_of(uint32_t id) noexcept nogil:
    """Return the parameter group of an identifier, without the destination; 0 for a frame that is not J1939."""
    cdef uint32_t group = id >> 8 & 0x3FFFF
    if not id & EXTENDED or id & (REMOTE | ERROR_FRAME):
        return 0
    return group & 0x3FF00 if (group >> 8 & 0xFF) < 240 else group


cdef inline uint32_t u16(const uint8_t *data) noexcept nogil:
    return data[0] | <uint32_t>data[1] << 8


cdef inline uint32_t u24(const uint8_t *data) noexcept nogil:
    return data[0] | <uint32_t>data[1] << 8 | <uint32_t>data[2] << 16


cdef inline uint32_t fine(const uint8_t *data, int axis) noexcept nogil:
    """Return one of the three codes of 19 bits, least significant first, of a high-resolution packet."""
    cdef uint64_t word
    memcpy(&word, data, 8)                      # supported processors are little-endian
    return <uint32_t>(word >> 19 * axis) & 0x7FFFFu


cdef inline uint32_t merit(const uint8_t *data, int first, int axis) noexcept nogil:
    """Return the two bits of merit at bit `first`: 0 good, 1 degraded, 2 an error, 3 not available."""
    cdef uint64_t word
    memcpy(&word, data, 8)
    return <uint32_t>(word >> first + 2 * axis) & 3u

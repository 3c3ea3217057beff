"""What an OpenIMU and whoever listens to it have in common: SAE J1939 identifiers, packets and settings. (blocks/imus/openimu/frames.py)"""

from libc.stdint cimport uint8_t, uint32_t

from cext.abi cimport ERROR_FRAME, EXTENDED, REMOTE

cdef enum: # parameter groups
    ADDRESS_CLAIM = 0xEE00
    REQUEST = 0xEA00
    SLOPE = 0xF029
    ANGULAR_RATE = 0xF02A
    ACCELERATION = 0xF02D
    MAGNETIC_FIELD = 0xFF6A
    PACKET_RATE = 0xFF55
    PACKET_TYPE = 0xFF56
    FILTERS = 0xFF57
    ORIENTATION = 0xFF58
    BEHAVIOUR = 0xFF59

cdef enum: # bits of the packet type
    SENDS_SLOPE = 1
    SENDS_RATE = 2
    SENDS_ACCELERATION = 4
    SENDS_FIELD = 8

cdef enum: # bits of the settings that have been told
    TOLD_BEHAVIOUR = 1
    TOLD_TYPE = 2
    TOLD_RATE = 4
    TOLD_ORIENTATION = 8
    TOLD_FILTERS = 16


cdef inline uint32_t group_of(uint32_t id) noexcept nogil:
    """The parameter group of an identifier, 0 for a frame that is none of J1939. Groups with a destination come without it."""
    cdef uint32_t group = id >> 8 & 0x3FFFF
    if not id & EXTENDED or id & (REMOTE | ERROR_FRAME):
        return 0
    return group & 0x3FF00 if (group >> 8 & 0xFF) < 240 else group


cdef inline uint32_t u16(const uint8_t *data) noexcept nogil:
    return data[0] | <uint32_t>data[1] << 8


cdef inline uint32_t u24(const uint8_t *data) noexcept nogil:
    return data[0] | <uint32_t>data[1] << 8 | <uint32_t>data[2] << 16

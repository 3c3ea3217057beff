"""MIP, the packet protocol of MicroStrain sensors: framing, for the driver and the emulated sensor.

    75 65 | descriptor set | payload length | fields: length, descriptor, data | Fletcher's checksum

A field's length counts itself and its descriptor. The checksum is two running sums modulo 256 over everything before
it. All values are big-endian. (MIP SDK; Data Communications Protocol of the 3DM-GX5)
"""

from libc.math cimport cos, sin
from libc.stdint cimport int64_t, uint8_t, uint16_t, uint32_t, uint64_t
from libc.string cimport memchr, memcpy, memmove

from cext.abi cimport Frame
from cext.ring.newest_ring cimport GAP
from cext.lines.stream_frames cimport BYTES

cdef enum:
    SYNC_1 = 0x75
    SYNC_2 = 0x65
    HEAD = 4                    # bytes before the payload
    OVERHEAD = 6                # bytes before and after the payload
    PACKET_LIMIT = 261          # bytes of a packet
    ROOM = 512                  # bytes of an incomplete packet and one frame
    PENDING_DOUBLES = 65

cdef enum: # functions of a setting's command
    WRITE = 1
    READ = 2
    SAVE = 3
    LOAD = 4
    RESET = 5                   # to the factory setting
    WRITE_QUIETLY = 6           # without an acknowledgement

cdef struct Pending:            # in the memory of a block
    int64_t length
    uint8_t bytes[ROOM]


cdef inline uint16_t fletcher(const uint8_t *data, int count) noexcept nogil:
    """Return both sums, the first in the high byte.

    Four bytes per step; the sums of a packet fit into 32 bits and are reduced once.
    """
    cdef uint32_t one = 0
    cdef uint32_t two = 0
    cdef int i = 0
    while i + 4 <= count:
        two += 4 * one + 4 * data[i] + 3 * data[i + 1] + 2 * data[i + 2] + data[i + 3]
        one += data[i] + data[i + 1] + data[i + 2] + data[i + 3]
        i += 4
    while i < count:
        one += data[i]
        two += one
        i += 1
    return <uint16_t>((one & 0xFF) << 8 | (two & 0xFF))


cdef inline int next_packet(const uint8_t *data, int length, int *at, bint last, int64_t *corrupt) noexcept nogil:
    """Find the next packet with a correct checksum. Returns its length, 0 for none; sets its (possible) start.

    If a packet is invalid, the search resumes at the byte after its header, so that no valid packet is lost.

    last : no bytes follow, so that an incomplete packet is invalid
    """
    cdef const uint8_t *found
    cdef int need
    while at[0] < length:
        found = <const uint8_t *>memchr(data + at[0], SYNC_1, length - at[0])
        if found == NULL:
            at[0] = length
            return 0
        at[0] = <int>(found - data)
        if length - at[0] >= 2 and found[1] != SYNC_2:
            at[0] += 1
            continue
        need = OVERHEAD + found[3] if length - at[0] >= HEAD else OVERHEAD
        if need > length - at[0]:
            if not last:
                return 0
            at[0] += 1
            continue
        if fletcher(found, need - 2) == (<uint16_t>found[need - 2] << 8 | found[need - 1]):
            return need
        corrupt[0] += 1
        at[0] += 1
    return 0


cdef inline uint32_t big_32(const uint8_t *data) noexcept nogil:
    return <uint32_t>data[0] << 24 | <uint32_t>data[1] << 16 | <uint32_t>data[2] << 8 | data[3]


cdef inline uint64_t big_64(const uint8_t *data) noexcept nogil:
    return <uint64_t>big_32(data) << 32 | big_32(data + 4)


cdef inline double float_32(const uint8_t *data) noexcept nogil:
    cdef uint32_t bits = big_32(data)
    cdef float value
    memcpy(&value, &bits, 4)
    return value


cdef inline double float_64(const uint8_t *data) noexcept nogil:
    cdef uint64_t bits = big_64(data)
    cdef double value
    memcpy(&value, &bits, 8)
    return value


cdef inline void put_16(uint8_t *data, uint16_t value) noexcept nogil:
    data[0], data[1] = <uint8_t>(value >> 8), <uint8_t>value


cdef inline void put_32(uint8_t *data, uint32_t value) noexcept nogil:
    put_16(data, <uint16_t>(value >> 16))
    put_16(data + 2, <uint16_t>value)


cdef inline void put_64(uint8_t *data, uint64_t value) noexcept nogil:
    put_32(data, <uint32_t>(value >> 32))
    put_32(data + 4, <uint32_t>value)


cdef inline void put_float(uint8_t *data, double value) noexcept nogil:
    cdef float small = <float>value
    cdef uint32_t bits
    memcpy(&bits, &small, 4)
    put_32(data, bits)


cdef inline void put_double(uint8_t *data, double value) noexcept nogil:
    cdef uint64_t bits
    memcpy(&bits, &value, 8)
    put_64(data, bits)


cdef inline int finish(uint8_t *packet, int fields) noexcept nogil:
    """Add header and checksum to a packet whose set and fields are present. Returns the length."""
    cdef uint16_t sums
    packet[0], packet[1], packet[3] = SYNC_1, SYNC_2, <uint8_t>fields
    sums = fletcher(packet, HEAD + fields)
    put_16(packet + HEAD + fields, sums)
    return OVERHEAD + fields


# Attitude

cdef inline void product(const double *a, const double *b, double *c) noexcept nogil:
    """Compute c = a* b, the rotation from one attitude to the other."""
    c[0] = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    c[1] = a[0] * b[1] - a[1] * b[0] - a[2] * b[3] + a[3] * b[2]
    c[2] = a[0] * b[2] + a[1] * b[3] - a[2] * b[0] - a[3] * b[1]
    c[3] = a[0] * b[3] - a[1] * b[2] + a[2] * b[1] - a[3] * b[0]


cdef inline void from_angles(const double *euler, double *q) noexcept nogil:
    cdef double cr = cos(0.5 * euler[0])
    cdef double sr = sin(0.5 * euler[0])
    cdef double cp = cos(0.5 * euler[1])
    cdef double sp = sin(0.5 * euler[1])
    cdef double cy = cos(0.5 * euler[2])
    cdef double sy = sin(0.5 * euler[2])
    q[0] = cr * cp * cy + sr * sp * sy
    q[1] = sr * cp * cy - cr * sp * sy
    q[2] = cr * sp * cy + sr * cp * sy
    q[3] = cr * cp * sy - sr * sp * cy


cdef inline void to_matrix(const double *q, double *r) noexcept nogil:
    r[0] = 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3])
    r[1] = 2.0 * (q[1] * q[2] - q[0] * q[3])
    r[2] = 2.0 * (q[1] * q[3] + q[0] * q[2])
    r[3] = 2.0 * (q[1] * q[2] + q[0] * q[3])
    r[4] = 1.0 - 2.0 * (q[1] * q[1] + q[3] * q[3])
    r[5] = 2.0 * (q[2] * q[3] - q[0] * q[1])
    r[6] = 2.0 * (q[1] * q[3] - q[0] * q[2])
    r[7] = 2.0 * (q[2] * q[3] + q[0] * q[1])
    r[8] = 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])

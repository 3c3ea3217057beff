"""Device status of an emulated MicroStrain sensor: command 0C 64, reply 90.

The layout differs with the model: units with an estimation filter state whether they run. (Data communications
protocol of the 3DM-GX5; the CV5-10 as MSCL 68 decodes it)
"""

from libc.stdint cimport uint8_t, uint16_t, uint32_t
from libc.string cimport memcpy

from cext.abi cimport TIME
from cext.kernels.devices.microstrain.mip cimport put_16, put_32, put_float
from cext.kernels.devices.microstrain.settings cimport Sensor, Settings, State, supports

cdef enum:
    BASIC = 1                   # selector
    DIAGNOSTIC = 2
    RUNNING = 3                 # state of the system
    FULL_PERFORMANCE = 1        # power
    GYRO_RANGE = 300            # °/s
    ACCEL_RANGE = 5             # g


cdef inline uint8_t *word(uint8_t *out, uint32_t value) noexcept nogil:
    put_32(out, value)
    return out + 4


cdef inline int device_status(double *arena, const Sensor *at, const Sensor *sizes, const State *state, uint8_t *out,
        const uint8_t *data, int length) noexcept nogil:
    """Write the reply. Returns its length or the negated error code."""
    cdef const Settings *settings = <const Settings *>(arena + at.settings)
    cdef uint32_t now = <uint32_t>(arena[TIME] * 1000.0)
    cdef bint filtered = settings.number != 6259.0
    cdef uint8_t *next = out + 9
    if length < 3 or (data[0] << 8 | data[1]) != <int>settings.number or not BASIC <= data[2] <= DIAGNOSTIC:
        return -3
    memcpy(out + 2, data, 3)
    if filtered:
        put_16(next, RUNNING)
        next += 2
    next = word(next, now)
    if data[2] == DIAGNOSTIC:
        if filtered:
            next[0], next[1] = <uint8_t>state.now.streams[0], <uint8_t>state.now.streams[1]
            next = word(word(next + 2, <uint32_t>state.lost[0]), <uint32_t>state.lost[1])
        else:
            next[0], next[1] = supports(arena, at, sizes, 0x80, 0x06), supports(arena, at, sizes, 0x80, 0x17)
            next[2] = FULL_PERFORMANCE
            put_16(next + 3, GYRO_RANGE)
            put_16(next + 5, ACCEL_RANGE)
            put_float(next + 11, arena[at.temperature])
            put_32(next + 15, now)
            next[28] = <uint8_t>state.now.streams[0]
            put_32(next + 29, <uint32_t>state.lost[0])
            next += 33
        next = word(word(next, <uint32_t>state.written), <uint32_t>state.read) + 8
        if filtered:                                # samples without errors, and the time of the last one
            next = word(word(next + 4, <uint32_t>state.sample), now)
    out[0], out[1] = <uint8_t>(next - out), 0x90
    return out[0]

"""Settings that arming writes to a drive and reads back, for both protocols.

`settings` contains their number, and of each its index, its type and its value. `read_back` contains what the drive has
returned. Of a value of one or two bytes the other bytes are ignored; floats may differ by FLOAT_TOLERANCE, as a firmware
may convert them. A lost write is repeated, so that only WRONG_READS different values in a row decide.

Two parameters are compared with the replies: mechPos and mechVel, in rad and rad/s at the output of the drive. They
differ if the replies have other ranges than the table. They are read before the settings, so that the drive is not
ready before a difference has been confirmed.
"""

from libc.math cimport fabs, floor, isfinite
from libc.stdint cimport uint8_t, uint32_t
from libc.string cimport memcpy

cdef enum: # in `read_back`
    READY                       # the drive has returned every setting as written, or one of them wrong too often
    CONFIRMED                   # bits of the settings returned as written
    WRONG                       # reads in a row of one setting that differ
    PLACE                       # place of that setting, from 1 on
    VALUE                       # its raw bits; UNREADABLE if the drive has no such parameter
    READ_BACK_SIZE

cdef enum:
    SETTINGS_LIMIT = 8
    WRONG_READS = 3
    FLOAT = 0, BYTE = 1, WORD16 = 2, WORD32 = 4
    UNREADABLE = 0xFFFFFFFF
    FLOAT_TOLERANCE = 1000      # 10⁻⁶ of the value
    POSITION_INDEX = 0x7019, VELOCITY_INDEX = 0x701B
    POSITION_PLACE = SETTINGS_LIMIT + 1, VELOCITY_PLACE         # in PLACE; VALUE is then the ratio of reply to parameter


cdef inline str settings_size(): return "settings[25]"


cdef inline uint32_t little_endian(const uint8_t *data) noexcept nogil:
    return <uint32_t>data[3] << 24 | <uint32_t>data[2] << 16 | <uint32_t>data[1] << 8 | data[0]


cdef inline int place_of(const double *settings, uint32_t index) noexcept nogil:
    """Return the place of a parameter among the settings, from 0 on; -1 if it is none."""
    cdef int place
    for place in range(<int>settings[0]):
        if settings[1 + 3 * place] == index:
            return place
    return -1


cdef inline bint is_as_written(const double *settings, int place, uint32_t bits) noexcept nogil:
    cdef double written = settings[3 + 3 * place]
    cdef int kind = <int>settings[2 + 3 * place]
    cdef float single
    if kind == FLOAT:
        memcpy(&single, &bits, 4)
        return isfinite(single) and fabs(single - written) <= 1e-6 * FLOAT_TOLERANCE * fabs(written)
    return (bits & 0xFF if kind == BYTE else bits & 0xFFFF if kind == WORD16 else bits) == written


cdef inline bint differs(const double *read) noexcept nogil:
    """Return whether the drive has another value than the written one."""
    return read[WRONG] >= WRONG_READS


cdef inline void note_read(const double *settings, double *read, int place, uint32_t bits, bint exists) noexcept nogil:
    """Note the value of a setting that the drive has returned, before it is ready."""
    if exists and is_as_written(settings, place, bits):
        if read[PLACE] == place + 1:
            read[WRONG] = 0.0
        read[CONFIRMED] = <double>(<int>read[CONFIRMED] | 1 << place)
        if read[CONFIRMED] == (1 << <int>settings[0]) - 1 and read[WRONG] == 0.0:
            read[READY], read[CONFIRMED] = 1.0, 0.0
        return
    read[CONFIRMED] = <double>(<int>read[CONFIRMED] & ~(1 << place))
    if read[PLACE] != place + 1 and read[WRONG] > 0.0:
        return                                  # one at a time
    read[WRONG] += 1.0
    read[PLACE], read[VALUE] = place + 1, bits if exists else UNREADABLE
    if differs(read):
        read[READY], read[CONFIRMED] = 1.0, 0.0


cdef inline void note_comparison(double *read, int place, double reply, double parameter, bint agrees) noexcept nogil:
    """Note a comparison before the drive is ready. place : in PLACE"""
    cdef float ratio = <float>(reply / parameter if parameter != 0.0 else 0.0)
    cdef uint32_t bits
    if agrees:
        if read[PLACE] == place:
            read[WRONG] = 0.0
        return
    if read[PLACE] != place and read[WRONG] > 0.0:
        return                                  # one at a time
    memcpy(&bits, &ratio, 4)
    read[WRONG] += 1.0
    read[PLACE], read[VALUE] = place, bits
    if differs(read):
        read[READY], read[CONFIRMED] = 1.0, 0.0


cdef inline bint compare_motion(
        double *read, const uint8_t *data, double invert, double gear, double position, double velocity,
        double end) noexcept nogil:
    """Compare mechPos or mechVel with the newest reply. Returns whether the parameter is one of them.

    invert, gear : of the joint; position, velocity : of the reply, at the joint, without the offset
    end : half the range of the position, at the joint

    The reply is older than the parameter by a few milliseconds. A difference of whole turns is none, as no source
    states on which of them the parameter begins.
    """
    cdef uint32_t index = <uint32_t>data[1] << 8 | data[0]
    cdef uint32_t bits = little_endian(data + 4)
    cdef double scale = -gear if invert != 0.0 else gear
    cdef double turn = 6.283185307179586
    cdef double reply, apart, larger
    cdef float parameter
    if index != POSITION_INDEX and index != VELOCITY_INDEX:
        return False
    memcpy(&parameter, &bits, 4)
    if not isfinite(parameter) or parameter == 0.0:     # 0 is also the answer of firmware without the parameter
        return True
    reply = scale * (position if index == POSITION_INDEX else velocity)
    apart = reply - parameter
    larger = fabs(reply) if fabs(reply) > fabs(parameter) else fabs(parameter)
    if index == VELOCITY_INDEX:
        note_comparison(read, VELOCITY_PLACE, reply, parameter, fabs(apart) <= 0.3 + 0.1 * larger)
    elif fabs(position) < 0.99 * end:
        apart -= turn * floor(apart / turn + 0.5)
        note_comparison(read, POSITION_PLACE, reply, parameter,
            fabs(apart) <= 0.01 + 0.01 * larger + 0.03 * fabs(scale * velocity))
    return True

# cython: freethreading_compatible=True
"""Analogue to digital converters on I2C: what their registers say.

    ADS1115    transfer n, four bytes: conversion, then the configuration that it was made with. Its bits 14 to 12 say which input, 11 to 9
               the range; bit 15: it is done. (ADS111x, SBAS444E)
    NAU7802    transfer 0, four bytes: PU_CTRL, then 24 bits. Bit 5: this is a new one. (NAU7802 1.7)
"""

from libc.math cimport floor, isfinite
from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memset

from cext.abi cimport FOREIGN, INPUTS, MALFORMED, NOTED, NOT_FINITE, OUTPUTS, PARAMETERS, TAKEN, TIME, Frame, export_decode, export_encode
from cext.lines.i2c_answers cimport TROUBLE, answer_id, big, code_of, failures, put_big, transfer_of
from cext.kernels.devices.taring cimport tared

cdef enum: # memory of the driver of an ADS1115, behind its outputs: one a channel, then age and errors
    IDENTITY
    LAYOUT                      # V of a code, code of the range, output of each of the eight inputs or -1

cdef enum: # items of an NAU7802
    TARE
    COUNTS, RATIO, FORCE, AGE, ERRORS
    NAU_IDENTITY
    NAU_SCALES                  # V/V and N of a count
    NAU_TARE

cdef enum:
    DONE = 0x80                 # high byte of the configuration of an ADS1115
    NEW = 0x20                  # PU_CTRL of an NAU7802


cdef int ads_decode_(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef int outputs = slots[OUTPUTS]
    cdef double *layout = arena + slots[outputs + LAYOUT]
    cdef int transfer = transfer_of(frame, <uint32_t>arena[slots[outputs + IDENTITY]])
    cdef int place
    if transfer < 0:
        return FOREIGN
    if transfer == TROUBLE:
        if frame.length != 5:
            return MALFORMED
        arena[slots[outputs - 1]] = failures(frame)
        return NOTED
    if transfer > 7:
        return FOREIGN
    place = <int>layout[2 + (frame.data[2] >> 4 & 7)]
    if frame.length != 4 or (frame.data[2] >> 1 & 7) != <int>layout[1] or place < 0:
        return MALFORMED        # it was made with another configuration: the chip has lost its own, or somebody else asks it
    if not frame.data[2] & DONE:
        return NOTED
    arena[slots[place]] = layout[0] * big(frame.data)
    return TAKEN


cdef inline int32_t three(const uint8_t *data) noexcept nogil:
    """24 bits, two's complement, most significant first."""
    cdef int32_t code = <int32_t>(<uint32_t>data[0] << 16 | <uint32_t>data[1] << 8 | data[2])
    return code - 0x1000000 if code & 0x800000 else code


cdef int nau_decode_(double *arena, const int32_t *slots, const int32_t *sizes, const Frame *frame) noexcept nogil:
    cdef int transfer = transfer_of(frame, <uint32_t>arena[slots[NAU_IDENTITY]])
    cdef double *scales = arena + slots[NAU_SCALES]
    cdef double counts
    if transfer == TROUBLE:
        if frame.length != 5:
            return MALFORMED
        arena[slots[ERRORS]] = failures(frame)
        return NOTED
    if transfer != 0:
        return FOREIGN
    if frame.length != 4:
        return MALFORMED
    if not frame.data[0] & NEW:
        return NOTED
    counts = three(&frame.data[1])
    arena[slots[COUNTS]] = counts
    arena[slots[RATIO]] = scales[0] * counts
    arena[slots[FORCE]] = scales[1] * tared(arena + slots[NAU_TARE], counts, arena[slots[TARE]] != 0.0)
    return TAKEN


# The converters that are not there

cdef enum: # memory of an emulated one, behind its inputs
    OWN_IDENTITY
    OWN_LAYOUT                  # V of a code and s of a conversion, then the configuration, one a channel; or V/V of a count and s
    STATE                       # s of the next answer, channel, whether it is stuck, with which number

cdef enum: # the last inputs of every emulated one
    FAULTS = 4                  # silent, stuck, wrong_address, not_ready


cdef inline double *own(double *arena, const int32_t *slots, int item) noexcept nogil:
    return arena + slots[slots[INPUTS] + slots[OUTPUTS] + slots[PARAMETERS] + item]


cdef inline double fault(double *arena, const int32_t *slots, int number) noexcept nogil:
    return arena[slots[slots[INPUTS] - FAULTS + number]]


cdef inline bint due(double *arena, const int32_t *slots, double period) noexcept nogil:
    cdef double *state = own(arena, slots, STATE)
    if arena[TIME] + 1e-9 < state[0]:
        return False
    state[0] = max(state[0] + period, arena[TIME] + 1e-9)
    return True


cdef inline double stuck(double *arena, const int32_t *slots, double code) noexcept nogil:
    """A converter that is stuck goes on with the code that it had."""
    cdef double *state = own(arena, slots, STATE)
    if fault(arena, slots, 1) == 0.0:
        state[2] = 0.0
    elif state[2] == 0.0:
        state[2], state[3] = 1.0, code
    return state[3] if state[2] != 0.0 else code


cdef inline void begin(double *arena, const int32_t *slots, Frame *frame, int transfer) noexcept nogil:
    cdef uint32_t identity = <uint32_t>own(arena, slots, OWN_IDENTITY)[0]
    if fault(arena, slots, 2) > 0.0:
        identity = (identity & ~<uint32_t>0xFF) | (<uint32_t>fault(arena, slots, 2) & 0x7F)
    memset(frame, 0, sizeof(Frame))
    frame.id = answer_id(identity, transfer)
    frame.length = 4


cdef int ads_answers_(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef double *layout = own(arena, slots, OWN_LAYOUT)
    cdef double *state = own(arena, slots, STATE)
    cdef int channels = slots[INPUTS] - FAULTS
    cdef int channel = <int>state[1]
    cdef uint32_t configuration
    cdef double volts = arena[slots[channel]]
    if not isfinite(volts):
        return -NOT_FINITE
    if not due(arena, slots, layout[1]):
        return 0
    state[1] = (channel + 1) % channels
    begin(arena, slots, &frames[0], channel)
    configuration = <uint32_t>layout[2 + channel]
    if fault(arena, slots, 3) != 0.0:
        configuration &= 0x7FFF
    put_big(frames[0].data, code_of(stuck(arena, slots, volts), layout[0]))
    frames[0].data[2], frames[0].data[3] = <uint8_t>(configuration >> 8), <uint8_t>(configuration & 0xFF)
    return 0 if fault(arena, slots, 0) != 0.0 else 1


cdef int nau_answers_(double *arena, const int32_t *slots, const int32_t *sizes, Frame *frames) noexcept nogil:
    cdef double *layout = own(arena, slots, OWN_LAYOUT)
    cdef double code = arena[slots[0]]
    cdef uint32_t bits
    if not isfinite(code):
        return -NOT_FINITE
    if not due(arena, slots, layout[1]):
        return 0
    code = stuck(arena, slots, floor(code / layout[0] + 0.5))
    bits = <uint32_t><int32_t>(8388607.0 if code > 8388607.0 else -8388608.0 if code < -8388608.0 else code)
    begin(arena, slots, &frames[0], 0)
    frames[0].data[0] = 0x9E if fault(arena, slots, 3) != 0.0 else 0x9E | NEW
    frames[0].data[1], frames[0].data[2] = <uint8_t>(bits >> 16 & 0xFF), <uint8_t>(bits >> 8 & 0xFF)
    frames[0].data[3] = <uint8_t>(bits & 0xFF)
    return 0 if fault(arena, slots, 0) != 0.0 else 1


ads_decode = export_decode(ads_decode_)
nau_decode = export_decode(nau_decode_)
ads_answers = export_encode(ads_answers_)
nau_answers = export_encode(nau_answers_)

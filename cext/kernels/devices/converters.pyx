# cython: freethreading_compatible=True
"""Analogue-to-digital converters on I2C: decoding of their registers.

    ADS1115    transfer n, four bytes: conversion, then its configuration. Bits 14 to 12 of it are the input, 11 to 9
    the
               range, bit 15 is set when the conversion is done. (ADS111x, SBAS444E)
    NAU7802    transfer 0, four bytes: PU_CTRL, then 24 bits. Bit 5 is set for a new conversion. (NAU7802 1.7)
"""

from libc.math cimport floor, isfinite
from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memset

from cext.abi cimport (
    FOREIGN, ITEMS, MALFORMED, NOTED, NOT_FINITE, TAKEN, TIME, Frame, Rest, decode_t, each, encode_t, export_decode,
    export_encode, items,
)
from cext.conversion cimport to_u32
from cext.lines.i2c_answers cimport TROUBLE, answer_id, big, code_of, failures, put_big, transfer_of
from cext.kernels.devices.taring cimport tared

cdef enum:
    DONE = 0x80                 # high byte of the configuration of an ADS1115
    NEW = 0x20                  # PU_CTRL of an NAU7802


cdef struct Ads:
    int32_t age, errors, identity
    int32_t layout              # V per code, code of the range, output of each of the eight inputs or -1
    Rest outputs                # channels

ADS = items((<Ads *>ITEMS)[0], "layout[10]")


cdef int ads_decode_(double *arena, const Ads *at, const Ads *sizes, const Frame *frame) noexcept nogil:
    cdef double *layout = arena + at.layout
    cdef int transfer = transfer_of(frame, <uint32_t>arena[at.identity])
    cdef int place
    if transfer < 0:
        return FOREIGN
    if transfer == TROUBLE:
        if frame.length != 5:
            return MALFORMED
        arena[at.errors] = failures(frame)
        return NOTED
    if transfer > 7:
        return FOREIGN
    place = <int>layout[2 + (frame.data[2] >> 4 & 7)]
    if frame.length != 4 or (frame.data[2] >> 1 & 7) != <int>layout[1] or place < 0:
        # another configuration: the chip has lost its own, or another program uses it
        return MALFORMED
    if not frame.data[2] & DONE:
        return NOTED
    arena[each(at, at.outputs)[place]] = layout[0] * big(frame.data)
    return TAKEN


cdef inline int32_t three(const uint8_t *data) noexcept nogil:
    """Return 24 bits, two's complement, most significant byte first."""
    cdef int32_t code = <int32_t>(<uint32_t>data[0] << 16 | <uint32_t>data[1] << 8 | data[2])
    return code - 0x1000000 if code & 0x800000 else code


cdef struct Nau:
    int32_t tare, counts, ratio, force, errors, identity
    int32_t scales              # V/V and N per count
    int32_t taring

NAU = items((<Nau *>ITEMS)[0], "scales[2] taring[6]")


cdef int nau_decode_(double *arena, const Nau *at, const Nau *sizes, const Frame *frame) noexcept nogil:
    cdef int transfer = transfer_of(frame, <uint32_t>arena[at.identity])
    cdef double *scales = arena + at.scales
    cdef double counts
    if transfer == TROUBLE:
        if frame.length != 5:
            return MALFORMED
        arena[at.errors] = failures(frame)
        return NOTED
    if transfer != 0:
        return FOREIGN
    if frame.length != 4:
        return MALFORMED
    if not frame.data[0] & NEW:
        return NOTED
    counts = three(&frame.data[1])
    arena[at.counts] = counts
    arena[at.ratio] = scales[0] * counts
    arena[at.force] = scales[1] * tared(arena + at.taring, counts, arena[at.tare] != 0.0)
    return TAKEN


# Emulated converters


cdef struct Emulated:
    int32_t silent, stuck, wrong_address, not_ready, identity
    # V per code and s per conversion, then the configuration of each channel; or V/V per count, s and V/V per N
    int32_t layout
    int32_t state               # time of the next answer, s; channel; whether it is stuck; the stuck code

cdef struct EmulatedAds:
    Emulated emulated
    Rest inputs                 # channels

EMULATED_ADS = items((<EmulatedAds *>ITEMS)[0], "layout[...] state[4]")

cdef struct EmulatedNau:
    int32_t ratio, force
    Emulated emulated

EMULATED_NAU = items((<EmulatedNau *>ITEMS)[0], "layout[3] state[4]")


cdef inline bint due(double *arena, const Emulated *at, double period) noexcept nogil:
    cdef double *state = arena + at.state
    if arena[TIME] + 1e-9 < state[0]:
        return False
    state[0] = max(state[0] + period, arena[TIME] + 1e-9)
    return True


cdef inline double stuck(double *arena, const Emulated *at, double code) noexcept nogil:
    """Return the code of a channel; a stuck converter repeats its last code."""
    cdef double *state = arena + at.state
    if arena[at.stuck] == 0.0:
        state[2] = 0.0
    elif state[2] == 0.0:
        state[2], state[3] = 1.0, code
    return state[3] if state[2] != 0.0 else code


cdef inline void begin(double *arena, const Emulated *at, Frame *frame, int transfer) noexcept nogil:
    cdef uint32_t identity = <uint32_t>arena[at.identity]
    if arena[at.wrong_address] > 0.0:
        identity = (identity & ~<uint32_t>0xFF) | (to_u32(arena[at.wrong_address]) & 0x7F)
    memset(frame, 0, sizeof(Frame))
    frame.id = answer_id(identity, transfer)
    frame.length = 4


cdef int ads_answers_(double *arena, const EmulatedAds *at, const EmulatedAds *sizes, Frame *frames) noexcept nogil:
    cdef double *layout = arena + at.emulated.layout
    cdef double *state = arena + at.emulated.state
    cdef int channels = sizes.emulated.layout - 2
    cdef int channel = <int>state[1]
    cdef uint32_t configuration
    cdef double volts = arena[each(at, at.inputs)[channel]]
    if not isfinite(volts):
        return -NOT_FINITE
    if not due(arena, &at.emulated, layout[1]):
        return 0
    state[1] = (channel + 1) % channels
    begin(arena, &at.emulated, &frames[0], channel)
    configuration = <uint32_t>layout[2 + channel]
    if arena[at.emulated.not_ready] != 0.0:
        configuration &= 0x7FFF
    put_big(frames[0].data, code_of(stuck(arena, &at.emulated, volts), layout[0]))
    frames[0].data[2], frames[0].data[3] = <uint8_t>(configuration >> 8), <uint8_t>(configuration & 0xFF)
    return 0 if arena[at.emulated.silent] != 0.0 else 1


cdef int nau_answers_(double *arena, const EmulatedNau *at, const EmulatedNau *sizes, Frame *frames) noexcept nogil:
    cdef double *layout = arena + at.emulated.layout
    cdef double code = arena[at.ratio] + arena[at.force] * layout[2]
    cdef uint32_t bits
    if not isfinite(code):
        return -NOT_FINITE
    if not due(arena, &at.emulated, layout[1]):
        return 0
    code = stuck(arena, &at.emulated, floor(code / layout[0] + 0.5))
    bits = <uint32_t><int32_t>(8388607.0 if code > 8388607.0 else -8388608.0 if code < -8388608.0 else code)
    begin(arena, &at.emulated, &frames[0], 0)
    frames[0].data[0] = 0x9E if arena[at.emulated.not_ready] != 0.0 else 0x9E | NEW
    frames[0].data[1], frames[0].data[2] = <uint8_t>(bits >> 16 & 0xFF), <uint8_t>(bits >> 8 & 0xFF)
    frames[0].data[3] = <uint8_t>(bits & 0xFF)
    return 0 if arena[at.emulated.silent] != 0.0 else 1


ads_decode = export_decode(<decode_t>ads_decode_, ADS)
nau_decode = export_decode(<decode_t>nau_decode_, NAU)
ads_answers = export_encode(<encode_t>ads_answers_, EMULATED_ADS)
nau_answers = export_encode(<encode_t>nau_answers_, EMULATED_NAU)

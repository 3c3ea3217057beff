# cython: freethreading_compatible=True
"""Magnetic encoders on I2C and SPI: decoding of their registers.

    AS5600     transfer 0, three bytes: STATUS, then 12 bits. STATUS has 0x20 magnet detected, 0x10 too weak, 0x08 too
               strong. (AS5600 v1-06)
    AS5048B    transfer 0, five bytes: diagnostics, magnitude, then 14 bits in 8 and 6. Diagnostics have 0x01 offset
               compensated, 0x02 overflow: the angle is invalid, 0x04 strong field, 0x08 weak field. (AS5048 v1-11)
    AS5047,    transfer 0, three frames of 16 bits: error register, angle, diagnostics with the bits of an AS5048B from
    AS5048A    bit 8 on. Each has even parity in bit 15, an error bit 14, and 14 bits. (AS5047P, AS5048)
"""

from libc.math cimport floor, isfinite
from libc.stdint cimport int32_t, uint8_t, uint32_t
from libc.string cimport memset

from cext.abi cimport (
    FOREIGN, ITEMS, MALFORMED, NOTED, NOT_FINITE, TAKEN, TIME, Frame, decode_t, encode_t, export_decode, export_encode,
    items,
)
from cext.conversion cimport to_u32
from cext.lines.i2c_answers cimport TROUBLE, answer_id, failures, transfer_of

cdef enum:
    GOOD, WEAK, STRONG, NONE    # `magnet`
    CODES_5600 = 4096, CODES_5048 = 16384

cdef double TURN = 6.283185307179586


cdef struct Encoder:
    int32_t position, counts, magnet, errors, invert, offset, identity

ENCODER = items((<Encoder *>ITEMS)[0])


cdef inline int opened(double *arena, const Encoder *at, const Frame *frame, int length) noexcept nogil:
    """Return TAKEN for a reply with the registers, or what decode is to return."""
    cdef int transfer = transfer_of(frame, <uint32_t>arena[at.identity])
    if transfer == TROUBLE and frame.length == 5:
        arena[at.errors] = failures(frame)
        return NOTED
    if transfer == TROUBLE or (transfer == 0 and frame.length != length):
        return MALFORMED
    return TAKEN if transfer == 0 else FOREIGN


cdef inline int take(double *arena, const Encoder *at, int magnet, int counts, int codes) noexcept nogil:
    """Set the outputs. An angle without a magnet is not a sample, and keeps the last one."""
    cdef double angle = TURN * counts / codes
    arena[at.magnet] = magnet
    if magnet == NONE:
        return NOTED
    angle = (-angle if arena[at.invert] != 0.0 else angle) - arena[at.offset]
    arena[at.counts] = counts
    arena[at.position] = angle - TURN * floor(angle / TURN + 0.5)
    return TAKEN


cdef int as5600_decode_(double *arena, const Encoder *at, const Encoder *sizes, const Frame *frame) noexcept nogil:
    cdef const uint8_t *data = &frame.data[0]
    cdef int verdict = opened(arena, at, frame, 3)
    if verdict != TAKEN:
        return verdict
    return take(arena, at, NONE if not data[0] & 0x20 else WEAK if data[0] & 0x10 else STRONG if data[0] & 0x08 else GOOD,
        (data[1] & 0x0F) << 8 | data[2], CODES_5600)


cdef inline int magnet_of(int diagnostics) noexcept nogil:
    return NONE if diagnostics & 3 != 1 else WEAK if diagnostics & 0x08 else STRONG if diagnostics & 0x04 else GOOD


cdef int as5048b_decode_(double *arena, const Encoder *at, const Encoder *sizes, const Frame *frame) noexcept nogil:
    cdef const uint8_t *data = &frame.data[0]
    cdef int verdict = opened(arena, at, frame, 5)
    if verdict != TAKEN:
        return verdict
    return take(arena, at, magnet_of(data[0]), data[3] << 6 | data[4] & 0x3F, CODES_5048)


cdef struct SpiEncoder:
    Encoder encoder
    int32_t refused

SPI_ENCODER = items((<SpiEncoder *>ITEMS)[0])


cdef inline bint odd(uint32_t word) noexcept nogil:
    """Return whether the number of ones in 16 bits is odd."""
    word ^= word >> 8
    word ^= word >> 4
    return 0x6996 >> (word & 0xF) & 1


cdef inline int word_of(const uint8_t *data) noexcept nogil:
    """Return the 14 bits of a frame; -1 with a wrong parity or an error bit."""
    cdef uint32_t word = <uint32_t>data[0] << 8 | data[1]
    return -1 if odd(word) or word & 0x4000 else <int>(word & 0x3FFF)


cdef int as504x_decode_(double *arena, const SpiEncoder *at, const SpiEncoder *sizes, const Frame *frame) noexcept nogil:
    cdef const uint8_t *data = &frame.data[0]
    cdef int verdict = opened(arena, &at.encoder, frame, 6)
    cdef int counts = word_of(&data[2])
    cdef int diagnostics = word_of(&data[4])
    if verdict == NOTED:
        arena[at.encoder.errors] += arena[at.refused]
    if verdict != TAKEN:
        return verdict
    if word_of(data) < 0 or counts < 0 or diagnostics < 0:
        arena[at.refused] += 1.0
        arena[at.encoder.errors] += 1.0
        return NOTED
    return take(arena, &at.encoder, magnet_of(diagnostics >> 8), counts, CODES_5048)


# Emulated encoders

cdef struct Emulated:
    int32_t position, magnet, silent, stuck, wrong_address, invert, offset, identity
    int32_t rate                # reads per second
    int32_t state               # time of the next answer, s; whether it is stuck; the stuck code

EMULATED = items((<Emulated *>ITEMS)[0], "state[3]")


cdef int answer(double *arena, const Emulated *at, Frame *frame, int codes) noexcept nogil:
    """Begin the frame of a read that is due. Returns the code of the angle, or -1 without one."""
    cdef double *state = arena + at.state
    cdef double angle = arena[at.position] + arena[at.offset]
    cdef double code = floor((-angle if arena[at.invert] != 0.0 else angle) / TURN * codes + 0.5)
    cdef uint32_t identity = <uint32_t>arena[at.identity]
    if arena[TIME] + 1e-9 < state[0]:
        return -1
    state[0] = max(state[0] + 1.0 / arena[at.rate], arena[TIME] + 1e-9)
    code -= codes * floor(code / codes)
    if arena[at.stuck] == 0.0:
        state[1] = 0.0
    elif state[1] == 0.0:
        state[1], state[2] = 1.0, code
    if arena[at.wrong_address] > 0.0:
        identity = (identity & ~<uint32_t>0xFF) | (to_u32(arena[at.wrong_address]) & 0x7F)
    memset(frame, 0, sizeof(Frame))
    frame.id = answer_id(identity, 0)
    return -1 if arena[at.silent] != 0.0 else <int>(state[2] if state[1] != 0.0 else code) & (codes - 1)


cdef int as5600_answers_(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    cdef int magnet = <int>to_u32(arena[at.magnet])
    cdef int code
    if not isfinite(arena[at.position]):
        return -NOT_FINITE
    code = answer(arena, at, &frames[0], CODES_5600)
    if code < 0:
        return 0
    frames[0].length = 3
    frames[0].data[0] = 0 if magnet == NONE else 0x30 if magnet == WEAK else 0x28 if magnet == STRONG else 0x20
    frames[0].data[1], frames[0].data[2] = <uint8_t>(code >> 8), <uint8_t>(code & 0xFF)
    return 1


cdef inline uint8_t diagnostics_of(int magnet) noexcept nogil:
    return 3 if magnet == NONE else 9 if magnet == WEAK else 5 if magnet == STRONG else 1


cdef int as5048b_answers_(double *arena, const Emulated *at, const Emulated *sizes, Frame *frames) noexcept nogil:
    cdef int magnet = <int>to_u32(arena[at.magnet])
    cdef int code
    if not isfinite(arena[at.position]):
        return -NOT_FINITE
    code = answer(arena, at, &frames[0], CODES_5048)
    if code < 0:
        return 0
    frames[0].length = 5
    frames[0].data[0] = diagnostics_of(magnet)
    frames[0].data[1], frames[0].data[2] = 0x80, 0
    frames[0].data[3], frames[0].data[4] = <uint8_t>(code >> 6), <uint8_t>(code & 0x3F)
    return 1


cdef struct EmulatedSpi:
    Emulated emulated
    int32_t corrupt

EMULATED_SPI = items((<EmulatedSpi *>ITEMS)[0], "state[3]")


cdef inline void put_word(uint8_t *data, uint32_t word) noexcept nogil:
    data[0], data[1] = <uint8_t>(word >> 8 | (0x80 if odd(word) else 0)), <uint8_t>(word & 0xFF)


cdef int as504x_answers_(double *arena, const EmulatedSpi *at, const EmulatedSpi *sizes, Frame *frames) noexcept nogil:
    cdef int code
    if not isfinite(arena[at.emulated.position]):
        return -NOT_FINITE
    code = answer(arena, &at.emulated, &frames[0], CODES_5048)
    if code < 0:
        return 0
    frames[0].length = 6
    put_word(&frames[0].data[2], <uint32_t>code)
    put_word(&frames[0].data[4], <uint32_t>diagnostics_of(<int>to_u32(arena[at.emulated.magnet])) << 8 | 0x80)
    if arena[at.corrupt] != 0.0:
        frames[0].data[2] ^= 0x10
    return 1


as5600_decode = export_decode(<decode_t>as5600_decode_, ENCODER)
as5048b_decode = export_decode(<decode_t>as5048b_decode_, ENCODER)
as5600_answers = export_encode(<encode_t>as5600_answers_, EMULATED)
as5048b_answers = export_encode(<encode_t>as5048b_answers_, EMULATED)
as504x_decode = export_decode(<decode_t>as504x_decode_, SPI_ENCODER)
as504x_answers = export_encode(<encode_t>as504x_answers_, EMULATED_SPI)

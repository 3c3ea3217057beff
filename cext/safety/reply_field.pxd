"""Reply frames and their fields, described without a decoder: graph.ReplyField in native memory."""

from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t
from libc.string cimport memcmp, memcpy, memset

from cext.abi cimport EXTENDED, FRAME_BYTES, Frame

cdef enum:
    PATTERN_LIMIT = 4
    PREFIX_BYTES = 4

cdef struct Pattern:             # pattern of a frame
    uint32_t id                  # with the flag bits of struct can_frame
    uint32_t mask
    uint8_t prefix[PREFIX_BYTES]
    int length                   # bytes of the prefix

cdef struct Field:
    int first, bits              # counted from the first bit of the data
    bint signed, little_endian
    double low, step             # value of code 0 and of one code


cdef inline int load_patterns(Pattern *patterns, frames) except -1:
    """Fill PATTERN_LIMIT patterns and return their number.

    frames : (arbitration id, mask, is extended, first bytes); the id may have the flag bits
    """
    cdef bytes prefix
    if len(frames) > PATTERN_LIMIT:
        raise ValueError("at most %d kinds of frames are replies, not %d" % (PATTERN_LIMIT, len(frames)))
    for index, (identifier, mask, extended, first) in enumerate(frames):
        prefix = first
        if len(prefix) > PREFIX_BYTES:
            raise ValueError("at most %d first bytes identify a frame, not %d" % (PREFIX_BYTES, len(prefix)))
        patterns[index].id = <uint32_t>identifier | (<uint32_t>EXTENDED if extended else 0)
        patterns[index].mask = <uint32_t>mask | 0xE0000000u
        memcpy(patterns[index].prefix, <const char *>prefix, len(prefix))
        patterns[index].length = len(prefix)
    return len(frames)


cdef inline int load_field(Field *field, reply) except -1:
    """Fill a field. reply : graph.ReplyField or an object with its attributes"""
    if not (0 <= reply.first and 0 < reply.bits <= 32 and reply.first + reply.bits <= 8 * FRAME_BYTES):
        raise ValueError("no field of %r bits at bit %r" % (reply.bits, reply.first))
    if reply.little_endian and (reply.first % 8 or reply.bits % 8):
        raise ValueError("a little-endian field has whole bytes, not %r bits at bit %r" % (reply.bits, reply.first))
    field.first, field.bits, field.signed = reply.first, reply.bits, reply.signed
    field.little_endian = reply.little_endian
    field.low, field.step = reply.low, (reply.high - reply.low) / (2.0**reply.bits - 1.0)
    return 0


cdef inline int find_pattern(const Pattern *patterns, int count, const Frame *frame) noexcept nogil:
    """Return the index of the pattern that a frame matches, -1 for none."""
    cdef int index
    for index in range(count):
        if ((frame.id ^ patterns[index].id) & patterns[index].mask == 0 and frame.length >= patterns[index].length
                and memcmp(frame.data, patterns[index].prefix, patterns[index].length) == 0):
            return index
    return -1


cdef inline bint read_field(const Field *field, const Frame *frame, double *value) noexcept nogil:
    """Read a field of a frame. Returns False if the frame is too short for it."""
    cdef uint64_t code = 0
    cdef int last = field.first + field.bits                       # first bit after the field
    cdef int first = field.first // 8
    cdef int count = (last + 7) // 8 - first
    cdef int index
    if 8 * <int>frame.length < last:
        return False
    for index in range(count):
        code = code << 8 | frame.data[first + (count - 1 - index if field.little_endian else index)]
    code >>= (8 - last % 8) % 8
    code &= (<uint64_t>1 << field.bits) - 1
    if field.signed:
        code ^= <uint64_t>1 << (field.bits - 1)
    value[0] = field.low + code * field.step
    return True


cdef inline bint fill_frame(Frame *frame, uint32_t identifier, bytes data, int64_t now):
    """Fill a frame that arrived at `now`, in ns. Returns False if it has too many bytes.

    identifier : with the flag bits of struct can_frame
    """
    memset(frame, 0, sizeof(Frame))
    if len(data) > FRAME_BYTES:
        return False
    frame.id, frame.length, frame.time = identifier, <uint8_t>len(data), now
    memcpy(frame.data, <const char *>data, len(data))
    return True

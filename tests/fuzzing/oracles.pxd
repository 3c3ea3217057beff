"""What a parser must have found in a piece of a stream: slow ones, from the documents alone, that look at the piece as a whole.

A piece begins behind a gap, at the start, or where the line was gone, and ends in front of the next: nothing of one can complete another's.
Checksums are reckoned bit by bit and byte by byte, as they are defined.
"""

from libc.stdint cimport int64_t, uint8_t, uint32_t
from libc.string cimport memcmp

cdef enum: # protocols
    NONE, MIP, COBS, LINES, INSOLE, DATAGRAMS

cdef struct Protocol:
    int kind
    int counted                 # COBS, LINES: whether there is a counter
    int size                    # COBS: bytes of the fields; LINES: numbers with the counter; INSOLE: bytes of a frame
    int rows, columns, side     # INSOLE

cdef struct Found:
    int64_t received
    int64_t perhaps             # of these, some may be refused as well
    int64_t lost                # -1: nothing is said of it
    int64_t corrupt             # -1: the same
    int64_t next                # counter that is expected


cdef inline void counted(Found *found, int64_t number, int64_t modulus) noexcept nogil:
    found.received += 1
    if found.next >= 0 and found.lost >= 0:
        found.lost += (number - found.next + modulus) % modulus
    found.next = (number + 1) % modulus


cdef inline uint32_t ccitt(const uint8_t *data, int count) noexcept nogil:
    """CRC-16/CCITT-FALSE, a bit at a time: a division of polynomials."""
    cdef uint32_t rest = 0xFFFF
    cdef int i, bit
    for i in range(count):
        for bit in range(7, -1, -1):
            rest = (rest << 1) ^ (0x1021 if (rest >> 15 & 1) != (<uint32_t>data[i] >> bit & 1) else 0)
            rest &= 0xFFFF
    return rest


cdef inline bint fletcher_is_right(const uint8_t *packet, int size) noexcept nogil:
    cdef int one = 0
    cdef int two = 0
    cdef int i
    for i in range(size - 2):
        one = (one + packet[i]) % 256
        two = (two + one) % 256
    return packet[size - 2] == one and packet[size - 1] == two


cdef inline bint has_whole_fields(const uint8_t *packet) noexcept nogil:
    cdef int left = packet[3]
    cdef const uint8_t *field = packet + 4
    while left > 0:
        if field[0] < 2 or field[0] > left:
            return False
        left -= field[0]
        field += field[0]
    return True


cdef inline void find_mip(const uint8_t *data, int count, Found *found) noexcept nogil:
    cdef int at = 0
    cdef int size
    while at + 6 <= count:
        size = 6 + data[at + 3]
        if data[at] != 0x75 or data[at + 1] != 0x65 or at + size > count:
            at += 1
        elif not fletcher_is_right(data + at, size):
            found.corrupt += 1
            at += 1
        else:
            found.received += data[at + 2] >= 0x80 and size > 6 and has_whole_fields(data + at)
            at += size


cdef inline int destuffed(const uint8_t *data, int count, uint8_t *plain) noexcept nogil:
    """COBS by its definition: what follows a code, then the zero that it stands for. -1 where a code points beyond the end."""
    cdef int size = 0
    cdef int left = 0
    cdef bint owes_zero = False
    cdef int i
    for i in range(count):
        if left == 0:
            if owes_zero:
                plain[size] = 0
                size += 1
            left = data[i] - 1
            owes_zero = data[i] != 255
        else:
            plain[size] = data[i]
            size += 1
            left -= 1
    return size if left == 0 else -1


cdef inline void find_cobs(const Protocol *protocol, const uint8_t *data, int count, Found *found) noexcept nogil:
    cdef uint8_t[8192] plain
    cdef int begin = 0
    cdef int at, size, whole
    for at in range(count):
        if data[at] != 0:
            continue
        size = at - begin
        whole = protocol.counted + protocol.size + 2
        if size > 0:
            if (size < 256 and destuffed(data + begin, size, plain) == whole
                    and ccitt(plain, whole - 2) == (plain[whole - 2] | <uint32_t>plain[whole - 1] << 8)):
                if protocol.counted:
                    counted(found, plain[0], 256)
                else:
                    found.received += 1
            elif begin > 0:                         # of the first it is not known whether its beginning was heard
                found.corrupt += 1
        begin = at + 1


cdef inline bint is_one_of(uint8_t byte, const char *set) noexcept nogil:
    while set[0] != 0:
        if <uint8_t>set[0] == byte:
            return True
        set += 1
    return False


cdef inline int plain_number(const uint8_t *data, int count) noexcept nogil:
    """Bytes of a number as everybody writes it, 0 where there is none: sign, at most 15 digits, a point among them, an exponent of two."""
    cdef int at = 0
    cdef int digits = 0
    if at < count and is_one_of(data[at], "+-"):
        at += 1
    while at < count and (48 <= data[at] <= 57):
        at += 1
        digits += 1
    if at < count and data[at] == 46:
        at += 1
        while at < count and (48 <= data[at] <= 57):
            at += 1
            digits += 1
    return at if 0 < digits <= 15 else 0


cdef inline void find_line(const Protocol *protocol, const uint8_t *data, int count, Found *found) noexcept nogil:
    """One line. What has another number of commas, or a zero in it, is none; what has plain numbers between them is one."""
    cdef int commas = 0
    cdef int at = 0
    cdef int field, size
    if count > 1023:
        return
    while count > 0 and is_one_of(data[count - 1], "\r\t "):
        count -= 1
    if count == 0 or data[0] == 35:
        return
    for at in range(count):
        if data[at] == 0:
            return
        commas += data[at] == 44
    if commas != protocol.size - 1:
        return
    at = 0
    for field in range(protocol.size):
        size = plain_number(data + at, count - at)
        if size == 0 or (field < protocol.size - 1 and (at + size >= count or data[at + size] != 44)) or (
                field == protocol.size - 1 and at + size != count) or (field == 0 and protocol.counted and (size > 9 or data[at] == 45)):
            found.perhaps += 1
            found.received += 1
            return
        at += size + 1
    found.received += 1


cdef inline void find_lines(const Protocol *protocol, const uint8_t *data, int count, Found *found) noexcept nogil:
    """The first is of no use: a number without its first digits is another."""
    cdef int begin = -1
    cdef int at
    for at in range(count):
        if data[at] != 10:
            continue
        if begin >= 0:
            find_line(protocol, data + begin, at - begin, found)
        begin = at + 1


cdef inline void find_soles(const Protocol *protocol, const uint8_t *data, int count, Found *found) noexcept nogil:
    cdef int size = protocol.size
    cdef int at = 0
    while at + size <= count:
        if (memcmp(data + at, <const char *>b"SOLE\x01", 5) != 0 or data[at + 8] != protocol.rows or data[at + 9] != protocol.columns
                or ccitt(data + at, size - 2) != (data[at + size - 2] | <uint32_t>data[at + size - 1] << 8)):
            at += 1
            continue
        if data[at + 5] == protocol.side:
            counted(found, data[at + 6] | <int64_t>data[at + 7] << 8, 65536)
        at += size


cdef inline Found nothing_found(const Protocol *protocol) noexcept nogil:
    cdef Found found
    found.received = found.perhaps = 0
    found.lost = 0 if protocol.kind != MIP and protocol.kind != LINES else -1
    found.corrupt = 0 if protocol.kind == MIP or protocol.kind == COBS else -1
    found.next = -1
    return found


cdef inline void find(const Protocol *protocol, const uint8_t *data, int count, Found *found) noexcept nogil:
    if protocol.kind == MIP:
        find_mip(data, count, found)
    elif protocol.kind == COBS:
        find_cobs(protocol, data, count, found)
    elif protocol.kind == LINES:
        find_lines(protocol, data, count, found)
    elif protocol.kind == INSOLE or protocol.kind == DATAGRAMS:
        find_soles(protocol, data, count, found)

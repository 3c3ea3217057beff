"""A device's native decode, driven by libFuzzer inside of this Python process, and what must be true whatever it is offered.

The items of the device stand apart in an arena of their own, with poisoned doubles between them: who writes or reads beside one is caught.
What an input means:

    a stream    16 bytes of plan, a byte of flags, then what comes off the line. A byte of the plan: length of a chunk (6 bits), and what
                is in front of it: nothing, the begin of a read, a gap, or that the line was gone and is back
    frames      one after another: which identifier (7 bits) and whether time jumps before it, the length or 0x80 for the usual one, data

Behind either come good packets, and they have to be heard. A violation is told in words, and ends the process by abort.
"""

from libc.math cimport fabs, floor
from libc.stdint cimport int32_t, int64_t, uint8_t, uint32_t, uint64_t, uintptr_t
from libc.stdio cimport fprintf, stderr
from libc.stdlib cimport abort, calloc, malloc
from libc.string cimport memcmp, memcpy, memset

from cext.abi cimport FOREIGN, FRAME_BYTES, FRAMES_PER_DEVICE, MALFORMED, PRESSED, TAKEN, TIME, Frame, decode_t, encode_t, kernel_t
from cext.schedule.kernel_table import address
from graph.arena_layout import kernel_table
from cext.ring.newest_ring cimport GAP, START
from cext.lines.stream_frames cimport BACK, BYTES, LOST
from tests.fuzzing.oracles cimport COBS, DATAGRAMS, INSOLE, MIP, Found, Protocol, ccitt, find, nothing_found

cdef extern from "<sanitizer/asan_interface.h>" nogil:
    void __asan_poison_memory_region(const void *begin, size_t size)

cdef extern from *:
    """
    #include <stddef.h>
    #include <stdint.h>
    int LLVMFuzzerRunDriver(int *count, char ***words, int (*one)(const uint8_t *data, size_t size));
    """
    int LLVMFuzzerRunDriver(int *count, char ***words, int (*one)(const uint8_t *data, size_t size) noexcept nogil)

cdef enum:
    PLAN = 16                       # bytes of it
    STREAM_LIMIT = 4096                  # bytes of a stream and its replies
    APART = 8                       # doubles between two items
    IDENTIFIERS = 64

cdef enum: # flags of a stream, behind its plan
    JUMPS = 1                       # its times jump
    REPAIRED = 2                    # checksums are put right before it is offered

cdef enum: # what is in front of a chunk
    NOTHING, READ, MISSED, GONE

cdef enum: # inputs of a block
    NUMBERS = 1                     # anything, also NaN
    WHOLE = 2                       # finite whole numbers, of a bool 0 and 1
    TRUTHS = 3

# What blocks in front of a device may give it: each is converted to an integer somewhere
cdef double[16] ODD = [
    0.0, -0.0, 1.0, -1.0, 0.5, 1e30, -1e30, 1.7e308, -1.7e308, float("nan"), float("inf"), -float("inf"), 2147483648.0,
    -2147483649.0, 4294967296.0, 1e-320]

cdef struct Item:
    int slot, size
    bint is_output
    bint is_same                    # behind a good packet it is what the packet says
    int input                       # NUMBERS or WHOLE of an input, else 0
    double low, high                # of an output

cdef struct Piece:                  # of a stream
    int begin, length, before

cdef struct Word:                   # a frame
    uint32_t id
    uint8_t length
    uint8_t data[FRAME_BYTES]

cdef struct Target:
    bint is_stream
    bint is_emulated                # it notes what is told to all, and says that it is not its own
    Protocol protocol
    decode_t decode
    encode_t encode
    int32_t *decode_slots
    int32_t *decode_sizes
    int32_t *encode_slots
    int32_t *encode_sizes
    Item items[128]
    int count                       # of items
    int words                       # doubles of the arena
    double *arena
    double *fresh                   # as it is before anything was heard
    double *first                   # after the first of two equal inputs, or before a frame
    double *good                    # after the good packets alone
    int received, lost, corrupt     # slots of counters, -1: there is none
    uint32_t identifiers[IDENTIFIERS]
    uint8_t usual[IDENTIFIERS]      # length of each
    int identifier_count
    Word tail[64]
    int tails
    Piece ending[64]                # of a stream: what stands behind it,
    int endings
    uint8_t after[STREAM_LIMIT]          # in these bytes
    int after_size
    Frame *frame
    Frame *frames                   # that it encodes

cdef Target now
cdef uint8_t text[2 * STREAM_LIMIT]
cdef Piece pieces[2 * STREAM_LIMIT]
cdef int piece_count, text_size


cdef void violated(const char *what, int item=-1) noexcept nogil:
    fprintf(stderr, "\ntickwork: %s (item %d)\n", what, item)
    abort()


cdef void restore(const double *source) noexcept nogil:
    cdef int i
    for i in range(now.count):
        memcpy(now.arena + now.items[i].slot, source + now.items[i].slot, now.items[i].size * sizeof(double))


cdef void keep(double *target) noexcept nogil:
    cdef int i
    for i in range(now.count):
        memcpy(target + now.items[i].slot, now.arena + now.items[i].slot, now.items[i].size * sizeof(double))


cdef void must_equal(const double *other, bint only_outputs, bint only_same, const char *else_) noexcept nogil:
    cdef int i
    for i in range(now.count):
        if (now.items[i].is_output or not only_outputs) and (now.items[i].is_same or not only_same) and memcmp(
                now.arena + now.items[i].slot, other + now.items[i].slot, now.items[i].size * sizeof(double)) != 0:
            violated(else_, i)


cdef void must_be_in_range() noexcept nogil:
    """What the block has promised the compiler, who proves commands by it. NaN is let through: it is a fault at the actuator."""
    cdef int i, k
    cdef double value
    for i in range(now.count):
        if now.items[i].is_output:
            for k in range(now.items[i].size):
                value = now.arena[now.items[i].slot + k]
                if value < now.items[i].low or value > now.items[i].high:
                    violated("an output has left its range", i)


cdef int offer(const uint8_t *data, int length, uint32_t identifier, uint8_t flags, int64_t time, int rest) noexcept nogil:
    """rest : what stands in the frame behind its length"""
    cdef int answer
    memset(now.frame, 0, sizeof(Frame))
    memset(now.frame.data, rest, FRAME_BYTES)
    if length > 0:
        memcpy(now.frame.data, data, length)
    now.frame.id, now.frame.length, now.frame.flags, now.frame.time = identifier, <uint8_t>length, flags, time
    answer = now.decode(now.arena, now.decode_slots, now.decode_sizes, now.frame)
    if answer < MALFORMED or answer > PRESSED:
        violated("decode returned what is no answer")
    return answer


cdef void must_encode() noexcept nogil:
    cdef Frame *frames = now.frames
    cdef int count, i
    if now.encode == NULL:
        return
    now.arena[TIME] = 2.0
    memset(frames, 0, FRAMES_PER_DEVICE * sizeof(Frame))
    count = now.encode(now.arena, now.encode_slots, now.encode_sizes, frames)
    if count > FRAMES_PER_DEVICE:
        violated("encode filled too many frames")
    for i in range(count):
        if frames[i].length > FRAME_BYTES:
            violated("a frame is longer than a frame")


cdef void must_encode_any_input(const uint8_t *data, size_t length) noexcept nogil:
    """The inputs of the block are whatever the bytes select. Comes last: the arena is another one afterwards."""
    cdef Item *item
    cdef uint8_t byte
    cdef double value
    cdef size_t at = 0
    cdef int turn, i, k
    if now.encode == NULL or length == 0:
        return
    for turn in range(4):
        for i in range(now.count):
            item = &now.items[i]
            for k in range(item.size if item.input else 0):
                byte = data[at % length] + <uint8_t>(at // length)
                at += 1
                value = ODD[byte & 15] if byte < 192 else (byte - 224.0) * 0.37
                if item.input == WHOLE and not fabs(floor(value)) < 9e15:
                    value = byte
                now.arena[item.slot + k] = floor(value) if item.input == WHOLE else byte & 1 if item.input == TRUTHS else value
        must_encode()


# Streams

cdef void add_piece(int begin, int length, int before) noexcept nogil:
    pieces[piece_count].begin, pieces[piece_count].length, pieces[piece_count].before = begin, length, before
    globals_count(1)


cdef void globals_count(int more) noexcept nogil:
    global piece_count
    piece_count += more


cdef void play(int chunk, const uint8_t *jumps, int rest) noexcept nogil:
    """All pieces; chunk : bytes of a frame, 0 as the plan has them. jumps : the plan, where times jump"""
    cdef int64_t time = 1000000000
    cdef int index = 0
    cdef int at, size, before, end
    cdef uint8_t flags
    while index < piece_count:
        at, before = pieces[index].begin, pieces[index].before
        end = at + pieces[index].length
        index += 1
        while chunk != 0 and index < piece_count and pieces[index].before == NOTHING:      # cut anew
            end += pieces[index].length
            index += 1
        if before == GONE:
            offer(NULL, 0, LOST, 0, time, rest)
            offer(NULL, 0, BACK, 0, time, rest)
        flags = START if before == READ else GAP if before == MISSED else 0
        while True:
            size = min(end - at, chunk if chunk else FRAME_BYTES)
            if jumps != NULL:
                time += <int64_t>1 << (jumps[index % PLAN] & 31)
            offer(text + at, size, BYTES, flags, time, rest)
            at, flags = at + size, 0
            if at >= end:
                break


cdef bint parts(int before) noexcept nogil:
    return before == MISSED or before == GONE or (before == READ and now.protocol.kind == DATAGRAMS)


cdef Found sought() noexcept nogil:
    cdef Found found = nothing_found(&now.protocol)
    cdef int index, last
    cdef int first = 0
    for index in range(1, piece_count + 1):
        if index == piece_count or parts(pieces[index].before):
            last = pieces[index - 1].begin + pieces[index - 1].length
            find(&now.protocol, text + pieces[first].begin, last - pieces[first].begin, &found)
            first = index
    return found


cdef void repair() noexcept nogil:
    """Headers get the checksum, and a little more, that makes packets of what stands behind them."""
    cdef int at = 0
    cdef int size, i, one, two
    cdef uint32_t crc
    while at + 6 < text_size:
        if now.protocol.kind == MIP and text[at] == 0x75 and text[at + 1] == 0x65 and at + 6 + text[at + 3] <= text_size:
            size = 6 + text[at + 3]
            one = two = 0
            for i in range(size - 2):
                one = one + text[at + i] & 255
                two = two + one & 255
            text[at + size - 2], text[at + size - 1] = <uint8_t>one, <uint8_t>two
            at += size
        elif (now.protocol.kind == INSOLE or now.protocol.kind == DATAGRAMS) and text[at] == 83 and text[at + 1] == 79 and (
                at + now.protocol.size <= text_size):
            size = now.protocol.size
            memcpy(text + at, <const char *>b"SOLE\x01", 5)
            text[at + 8], text[at + 9] = <uint8_t>now.protocol.rows, <uint8_t>now.protocol.columns
            crc = ccitt(text + at, size - 2)
            text[at + size - 2], text[at + size - 1] = <uint8_t>crc, <uint8_t>(crc >> 8)
            at += size
        elif now.protocol.kind == COBS and text[at] == 0 and at + now.protocol.counted + now.protocol.size + 4 < text_size:
            size = now.protocol.counted + now.protocol.size + 2
            crc = ccitt(text + at + 2, size - 2)
            text[at + size], text[at + size + 1] = <uint8_t>crc, <uint8_t>(crc >> 8)
            two = at + 1                                    # stuffed in place, of less than 254 bytes
            text[at + size + 2] = 0
            for i in range(at + 2, at + size + 3):
                if text[i] == 0:
                    text[two] = <uint8_t>(i - two)
                    two = i
            at += size + 2
        else:
            at += 1


cdef int stream_input(const uint8_t *data, size_t length) noexcept nogil:
    global text_size, piece_count
    cdef Found found
    cdef uint8_t flags
    cdef int at = 0
    cdef int index = 0
    cdef int size
    if length < PLAN + 1 or length > STREAM_LIMIT:
        return 0
    flags = data[PLAN]
    text_size = <int>length - PLAN - 1
    memcpy(text, data + PLAN + 1, text_size)
    if flags & REPAIRED:
        repair()
    piece_count = 0
    while at < text_size:
        size = min(1 + (data[index % PLAN] & 63), text_size - at)
        add_piece(at, size, data[index % PLAN] >> 6)
        at += size
        index += 1
    for index in range(now.endings):
        add_piece(text_size + now.ending[index].begin, now.ending[index].length, now.ending[index].before)
    memcpy(text + text_size, now.after, now.after_size)
    text_size += now.after_size
    restore(now.fresh)
    play(0, data if flags & JUMPS else NULL, 0xA5)
    must_be_in_range()
    must_encode()
    if now.protocol.kind != 0:
        found = sought()
        if not found.received - found.perhaps <= now.arena[now.received] <= found.received:
            fprintf(stderr, "\n%g received, %ld of them there\n", now.arena[now.received], found.received)
            violated("another number of packets than there are good ones")
        if found.lost >= 0 and now.arena[now.lost] != found.lost:
            violated("another number of lost packets")
        if found.corrupt >= 0 and now.arena[now.corrupt] != found.corrupt:
            fprintf(stderr, "\n%g corrupt, %ld of them there\n", now.arena[now.corrupt], found.corrupt)
            violated("another number of corrupt packets")
    must_equal(now.good, True, True, "the good packet behind it all was not heard")
    if not flags & JUMPS:
        keep(now.first)
        restore(now.fresh)
        play(FRAME_BYTES if flags & 0x80 else 1 + (flags >> 2 & 31), NULL, 0x75)
        must_encode()
        must_equal(now.first, True, False, "it matters where the stream is cut")
    must_encode_any_input(data, length)
    return 0


# Frames

cdef uint64_t trace() noexcept nogil:
    """A number that all outputs together make."""
    cdef uint64_t found = 0xCBF29CE484222325u
    cdef uint64_t bits
    cdef int i, k
    for i in range(now.count):
        if now.items[i].is_output:
            for k in range(now.items[i].size):
                memcpy(&bits, now.arena + now.items[i].slot + k, sizeof(double))
                found = (found ^ bits) * 0x100000001B3u
    return found


cdef uint64_t play_frames(const uint8_t *data, size_t length, int rest, bint looks) noexcept nogil:
    """Returns a number that the outputs behind every frame make."""
    cdef uint64_t seen = 0
    cdef int64_t time = 1000000000
    cdef size_t at = 0
    cdef uint32_t identifier
    cdef int which, size, answer, i
    while at + 2 <= length:
        which = data[at] & 0x7F
        if data[at] & 0x80:
            time += <int64_t>1 << (data[at + 1] & 31)
        else:
            time += 1000000
        size = data[at + 1]
        at += 2
        if which < now.identifier_count:
            identifier = now.identifiers[which]
            if size & 0x80:
                size = now.usual[which]
        else:
            identifier = 0
            for i in range(4):
                if at < length:
                    identifier = identifier << 8 | data[at]
                    at += 1
        size = min(size & 0x7F, FRAME_BYTES, <int>(length - at))
        if looks:
            keep(now.first)
        answer = offer(data + at, size, identifier, 0, time, rest)
        if looks and not now.is_emulated and (answer == FOREIGN or answer == MALFORMED):
            must_equal(now.first, False, False, "a frame that was refused has changed something")
        if looks:
            must_be_in_range()
        seen = seen * 31 + trace()
        at += size
    for i in range(now.tails):
        answer = offer(now.tail[i].data, now.tail[i].length, now.tail[i].id, 0, time + 1000000 * (i + 1), rest)
    return seen


cdef int frames_input(const uint8_t *data, size_t length) noexcept nogil:
    cdef uint64_t seen
    if length > STREAM_LIMIT:
        return 0
    restore(now.fresh)
    seen = play_frames(data, length, 0xA5, True)
    must_be_in_range()
    must_encode()
    must_equal(now.good, True, True, "the good frame behind it all was not heard")
    keep(now.first)
    restore(now.fresh)
    if play_frames(data, length, 0x5A, False) != seen:
        violated("it matters what stands behind the end of a frame")
    must_encode()
    must_equal(now.first, True, False, "it matters what stands behind the end of a frame")
    must_encode_any_input(data, length)
    return 0


# What is driven

cdef int32_t *words_of(values) except NULL:
    cdef int32_t *words = <int32_t *>calloc(len(values) + 1, sizeof(int32_t))
    for number, value in enumerate(values):
        words[number] = value
    return words


def drive(words, device):
    """Fuzz one device with libFuzzer's command line; it ends the process by itself. device : tests.fuzzing.targets.Driven"""
    cdef Item *item
    cdef char **arguments
    cdef char **given
    cdef int count = len(words)
    cdef int slot = 8 + APART
    kept = [word.encode() for word in words]
    arguments = <char **>calloc(count + 1, sizeof(char *))
    for number, word in enumerate(kept):
        arguments[number] = word
    memset(&now, 0, sizeof(Target))
    now.is_stream, now.is_emulated = device.is_stream, device.is_emulated
    (now.protocol.kind, now.protocol.counted, now.protocol.size, now.protocol.rows, now.protocol.columns,
     now.protocol.side) = device.protocol
    now.decode = <decode_t><uintptr_t>address(device.decode, "decode")
    now.encode = <encode_t><uintptr_t>address(device.encode, "encode")
    places = {}
    now.items[0].slot, now.items[0].size = 0, 8                             # the clock
    for number, (name, values, low, high, is_output, is_same, kind) in enumerate(device.items):
        item = &now.items[number + 1]
        item.slot, item.size, item.low, item.high, item.is_output, item.is_same = slot, len(values), low, high, is_output, is_same
        item.input = kind
        places[name] = slot, len(values)
        slot += len(values) + APART
        for counter in ("received", "packets"):
            if name == counter:
                now.received = item.slot
        if name == "lost":
            now.lost = item.slot
        if name == "corrupt":
            now.corrupt = item.slot
    decode, encode = (kernel_table(device.block, kernel, places) for kernel in (device.decode, device.encode))
    now.decode_slots, now.decode_sizes = words_of(decode.slots), words_of(decode.sizes)
    now.encode_slots, now.encode_sizes = words_of(encode.slots), words_of(encode.sizes)
    now.count, now.words = len(device.items) + 1, slot
    now.arena, now.fresh = <double *>malloc(slot * sizeof(double)), <double *>calloc(slot, sizeof(double))
    now.first, now.good = <double *>calloc(slot, sizeof(double)), <double *>calloc(slot, sizeof(double))
    for number, value in enumerate(device.clock):
        now.fresh[number] = value
    for number, (name, values, *_) in enumerate(device.items):
        for place, value in enumerate(values):
            now.fresh[now.items[number + 1].slot + place] = value
    __asan_poison_memory_region(now.arena, slot * sizeof(double))
    for number in range(now.count):
        unpoison(now.arena + now.items[number].slot, now.items[number].size * sizeof(double))
    now.frame, now.frames = <Frame *>malloc(sizeof(Frame)), <Frame *>malloc(FRAMES_PER_DEVICE * sizeof(Frame))
    for number, (identifier, length) in enumerate(device.identifiers):
        now.identifiers[number], now.usual[number] = identifier, length
    now.identifier_count = len(device.identifiers)
    for number, (identifier, data) in enumerate(device.tail if not device.is_stream else ()):
        now.tail[number].id, now.tail[number].length = identifier, <uint8_t>len(data)
        for place, value in enumerate(data):
            now.tail[number].data[place] = value
        now.tails += 1
    for before, data in device.tail if device.is_stream else ():
        now.ending[now.endings].begin, now.ending[now.endings].length, now.ending[now.endings].before = now.after_size, len(data), before
        for value in data:
            now.after[now.after_size] = value
            now.after_size += 1
        now.endings += 1
    learn()
    given = arguments
    return LLVMFuzzerRunDriver(&count, &given, stream_input if now.is_stream else frames_input)


cdef extern from "<sanitizer/asan_interface.h>" nogil:
    void unpoison "__asan_unpoison_memory_region"(const void *begin, size_t size)


cdef void learn() noexcept nogil:
    """What the good packets alone say."""
    global text_size, piece_count
    restore(now.fresh)
    if now.is_stream:
        piece_count = 0
        text_size = now.after_size
        memcpy(text, now.after, text_size)
        for index in range(now.endings):
            add_piece(now.ending[index].begin, now.ending[index].length, now.ending[index].before)
        play(0, NULL, 0)
    else:
        play_frames(NULL, 0, 0, False)
    keep(now.good)

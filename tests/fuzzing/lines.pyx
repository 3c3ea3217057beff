"""What carries frames, driven by libFuzzer in this process: the reader of streams with its ring, and the receiver of CAN's datagrams.

    reads       an input is writes of so many bytes, each read at once, ticks that take so many frames, and begins of a run
    datagrams   an input is datagrams: a size, and the bytes

Each is compared with a list of what must come, kept beside it.
"""

from libc.stdint cimport int64_t, uint8_t, uint32_t
from libc.stdio cimport fprintf, stderr
from libc.stdlib cimport abort, calloc
from libc.string cimport memcmp, memcpy, memset
from posix.unistd cimport write

from cext.abi cimport ERROR_FRAME, FRAME_BYTES, Frame
from cext.ring.newest_ring cimport GAP, NEWEST, START
from cext.bus.socketcan cimport SocketCan
from cext.lines.stream cimport Stream
from cext.lines.stream_frames cimport BYTES
from cext.lines.streams cimport Streams

cdef extern from *:
    """
    #include <stddef.h>
    #include <stdint.h>
    int LLVMFuzzerRunDriver(int *count, char ***words, int (*one)(const uint8_t *data, size_t size));
    """
    int LLVMFuzzerRunDriver(int *count, char ***words, int (*one)(const uint8_t *data, size_t size) noexcept nogil)

cdef enum:
    PIECE_LIMIT = 16384                # pieces that wait

cdef struct Piece:
    int64_t begin
    int length
    bint first

cdef struct Kept:
    int sender
    int record
    Piece pieces[PIECE_LIMIT]          # that were read, the oldest first
    int64_t head, tail
    bint flexible

cdef Kept now
cdef Streams streams
cdef Stream stream
cdef SocketCan bus
cdef Frame *frames


cdef void violated(const char *what) noexcept nogil:
    fprintf(stderr, "\ntickwork: %s\n", what)
    abort()


cdef inline uint8_t byte_at(int64_t place) noexcept nogil:
    return <uint8_t>(place ^ place >> 8 ^ place >> 16)


cdef int64_t read_so_far = 0


cdef void bring(int size) noexcept nogil:
    """So many bytes onto the line, which are then read."""
    global read_so_far
    cdef uint8_t[4096] data
    cdef int at = 0
    cdef int i, length
    for i in range(size):
        data[i] = byte_at(read_so_far + i)
    if write(now.sender, data, size) != size:
        violated("the line took less")
    streams.take(stream.source)
    while at < size:
        length = min(FRAME_BYTES // now.record * now.record, size - at)
        now.pieces[now.head % PIECE_LIMIT].begin, now.pieces[now.head % PIECE_LIMIT].length = read_so_far + at, length
        now.pieces[now.head % PIECE_LIMIT].first = at == 0
        now.head += 1
        at += length
    read_so_far += size


cdef void tick(int capacity) noexcept nogil:
    cdef uint32_t skipped = <uint32_t>stream.source.ring.skipped
    cdef int count = stream.end.bus.receive(stream.end.bus.context, frames, capacity)
    cdef int64_t missed = <uint32_t>stream.source.ring.skipped - skipped
    cdef const Piece *piece
    cdef int index, i
    if count < 0 or count > capacity or (count == 0 and capacity > 0 and now.head > now.tail):
        violated("another number of frames than there is room for")
    if count > 0 and (missed > 0) != (frames[0].flags & GAP != 0):
        violated("a gap is not told, or one that is none")
    if missed > 0 and now.head - now.tail <= NEWEST:
        violated("frames were skipped though there was room")
    now.tail += missed
    for index in range(count):
        piece = &now.pieces[now.tail % PIECE_LIMIT]
        if frames[index].id != BYTES or frames[index].length != piece.length or (index > 0 and frames[index].flags & GAP):
            violated("a frame is not as long as what was read")
        if (frames[index].flags & START != 0) != piece.first:
            violated("the begin of a read is told where it is not")
        for i in range(piece.length):
            if frames[index].data[i] != byte_at(piece.begin + i):
                violated("other bytes than those that were read")
        now.tail += 1
    if now.tail > now.head:
        violated("more than was read")


cdef int reads_input(const uint8_t *data, size_t length) noexcept nogil:
    cdef size_t at = 0
    cdef int kind
    stream.end.bus.begin(stream.end.bus.context, 0)
    now.head = now.tail = 0
    while at + 2 <= length and at < 400:
        kind = data[at] & 3
        if kind < 2:
            bring(1 + (data[at] >> 2) * 16 + data[at + 1] % 16 + 2048 * kind)
        elif kind == 2:
            tick(data[at + 1] & 63)
        elif data[at + 1] < 16:
            stream.end.bus.begin(stream.end.bus.context, 0)
            now.tail = now.head
        at += 2
    while now.tail < now.head:
        tick(64)
    tick(64)
    return 0


cdef int datagrams_input(const uint8_t *data, size_t length) noexcept nogil:
    """Sixteen at most: those of CAN come out, and nothing else."""
    cdef uint8_t[96] datagram
    cdef uint8_t[16][96] good
    cdef int[16] sizes
    cdef size_t at = 0
    cdef int expected = 0
    cdef int wrong = 0
    cdef int sent = 0
    cdef int index, size, count
    bus.socket.state = bus.socket.worst = 0
    bus.end.bus.begin(bus.end.bus.context, 0)
    while at + 1 < length and sent < 16:
        size = 16 if data[at] & 0x80 else 72 if data[at] & 0x40 else data[at] % 90
        at += 1
        memset(datagram, 0, 96)
        memcpy(datagram, data + at, min(<size_t>size, length - at))
        at += min(<size_t>size, length - at)
        if size == 0:
            continue
        if write(now.sender, datagram, size) != size:
            violated("the line took less")
        sent += 1
        if (size == 16 and datagram[4] <= 8) or (size == 72 and now.flexible and datagram[4] <= 64):
            memcpy(good[expected], datagram, 96)
            sizes[expected] = size
            expected += 1
        else:
            wrong += 1
    count = bus.end.bus.receive(bus.end.bus.context, frames, 64)
    if count != expected or bus.socket.counts.corrupt != wrong:
        violated("another number of frames than there are good ones")
    for index in range(count):
        if memcmp(&frames[index].id, good[index], 4) != 0 or frames[index].length != good[index][4] or frames[index].time < 0 or (
                memcmp(frames[index].data, good[index] + 8, good[index][4]) != 0):
            violated("a frame is another than was sent")
    bus.end.bus.receive(bus.end.bus.context, frames, 64)                    # tells of a bus that is off, once
    return 0


def drive(words, kind, socket, sender, record=1):
    """Fuzz "reads" or "datagrams" with libFuzzer's command line; it ends the process by itself.

    socket : what is read; sender : descriptor of its other end; record : bytes that belong together, or whether there is CAN FD
    """
    global streams, stream, bus, frames
    cdef int count = len(words)
    cdef char **arguments = <char **>calloc(count + 1, sizeof(char *))
    kept = [word.encode() for word in words]
    for number, word in enumerate(kept):
        arguments[number] = word
    memset(&now, 0, sizeof(Kept))
    now.sender, now.record, now.flexible = sender, record, record > 1
    frames = <Frame *>calloc(64, sizeof(Frame))
    if kind == "reads":
        streams = Streams()
        stream = streams.add(socket.fileno(), "fuzzed", record=record)
    else:
        bus = SocketCan(socket, fd=record > 1)
    return LLVMFuzzerRunDriver(&count, &arguments, reads_input if kind == "reads" else datagrams_input)

# cython: freethreading_compatible=True
"""Encoder of rows and frames to MCAP message records, as runtime.record.storage.messages describes them.

A row is a copy of a template for each subsystem, with its doubles filled in. The frames of one bus drain and one bus
are one message, which a row, the next drain, an event or a flush ends.
"""

from libc.math cimport rint
from libc.stdint cimport int64_t, uint8_t, uint16_t, uint32_t, uint64_t
from libc.stdlib cimport free, realloc
from libc.string cimport memcpy, memset

from cpython.bytes cimport PyBytes_AS_STRING, PyBytes_FromStringAndSize

from cext.abi cimport ERROR_FRAME, EXTENDED, FRAME_BYTES, ID_MASK, REMOTE, Frame
from cext.bus.bits cimport ERROR_STATE, RATE_SWITCH, is_flexible
from cext.recording.ring_batch cimport Batch
from cext.memory.shared_state cimport FRAME, RECEIVED, ROW, Header

cdef enum:
    MESSAGE = 5                     # type of a message record
    HEAD_BYTES = 31                 # bytes in front of the data of a message record
    LENGTH_BYTES = 22               # bytes of it that its length covers
    BLOCK = 1 << 16                 # bytes of records, after which `encode` returns

cdef enum: # tags of Protobuf: number << 3 | wire type
    FIXED64_1 = 0x09
    FIXED64_2 = 0x11
    FIXED64_3 = 0x19
    FIXED32_2 = 0x15
    BYTES_2 = 0x12
    BOOL_3 = 0x18                   # 4 to 9 follow at a distance of 8
    BYTES_10 = 0x52
    FIXED32_11 = 0x5D

cdef struct Buffer:
    char *data
    size_t size
    size_t room


cdef char *grow(Buffer *buffer, size_t more) except NULL:
    """Return space for `more` bytes at the end of a buffer, which then includes it."""
    cdef size_t room = buffer.room
    cdef char *data
    if buffer.size + more > room:
        room = 2 * (buffer.size + more)
        data = <char *>realloc(buffer.data, room)
        if data == NULL:
            raise MemoryError
        buffer.data, buffer.room = data, room
    data = buffer.data + buffer.size
    buffer.size += more
    return data


cdef bytes taken(Buffer *buffer):
    content = PyBytes_FromStringAndSize(buffer.data, buffer.size)
    buffer.size = 0
    return content


cdef class Encoder:
    """Encoder of the messages of a recording.

    rate : Hz, of the ticks
    rows : [(channel, body of a message as bytes, [(position of a double in the body, its index in a row)], every)];
        only rows whose tick is a multiple of `every` have the message
    tick : channel of the end of a row
    buses : channel of each bus

    size : bytes of the encoded records
    row_count, frame_count : numbers of encoded rows and frames
    """

    cdef double rate
    cdef list templates
    cdef list fields                # for each template positions and columns, as bytes of uint32
    cdef list numbers
    cdef list periods               # for each template its period in ticks
    cdef list buses
    cdef int tick
    cdef Buffer out
    cdef Buffer *index              # by channel: log time and position in the chunk, in turn
    cdef Buffer *groups             # by bus: frames since the last row, drain, event or flush
    cdef int channels
    cdef int bus_count
    cdef uint32_t order             # number of the next frame since the last row or drain
    cdef bint grouped               # whether a group has a frame
    cdef int64_t group_time
    cdef int64_t drained
    cdef int64_t wall
    cdef uint32_t drain
    cdef readonly int64_t row_count
    cdef readonly int64_t frame_count

    def __cinit__(self, double rate, list rows, int tick, list buses):
        self.rate, self.tick, self.buses = rate, tick, buses
        self.templates = [body for _, body, _, _ in rows]
        self.numbers = [channel for channel, _, _, _ in rows]
        self.periods = [every for _, _, _, every in rows]
        self.fields = [
            b"".join(at.to_bytes(4, "little") + column.to_bytes(4, "little") for at, column in fields)
            for _, _, fields, _ in rows
        ]
        self.bus_count = len(buses)
        self.channels = 1 + max([tick] + self.numbers + buses)
        self.index = <Buffer *>realloc(NULL, self.channels * sizeof(Buffer))
        self.groups = <Buffer *>realloc(NULL, (len(buses) + 1) * sizeof(Buffer))
        if self.index == NULL or self.groups == NULL:
            raise MemoryError
        memset(self.index, 0, self.channels * sizeof(Buffer))
        memset(self.groups, 0, (len(buses) + 1) * sizeof(Buffer))

    def __dealloc__(self):
        cdef int place
        free(self.out.data)
        if self.index != NULL:
            for place in range(self.channels):
                free(self.index[place].data)
        if self.groups != NULL:
            for place in range(self.bus_count):
                free(self.groups[place].data)
        free(self.index)
        free(self.groups)

    @property
    def size(self):
        return self.out.size

    cdef char *begin(self, int channel, uint32_t sequence, int64_t log_time, size_t body, size_t base) except NULL:
        """Append the head of a message and return the space of its body."""
        cdef uint64_t place = base + self.out.size
        cdef char *head = grow(&self.out, HEAD_BYTES + body)
        cdef uint64_t length = LENGTH_BYTES + body
        cdef uint16_t number = <uint16_t>channel
        cdef char *entry = grow(&self.index[channel], 16)
        head[0] = MESSAGE
        memcpy(head + 1, &length, 8)
        memcpy(head + 9, &number, 2)
        memcpy(head + 11, &sequence, 4)
        memcpy(head + 15, &log_time, 8)
        memcpy(head + 23, &log_time, 8)
        memcpy(entry, &log_time, 8)
        memcpy(entry + 8, &place, 8)
        return head + HEAD_BYTES

    cdef int add_row(self, const double *row, int64_t zero, size_t base) except -1:
        cdef int64_t tick = <int64_t>row[0]
        cdef double time = row[0] / self.rate
        cdef int64_t at = zero + <int64_t>rint(time * 1e9)
        cdef uint32_t sequence = <uint32_t>tick
        cdef const uint32_t *fields
        cdef char *body
        cdef bytes template, places
        cdef Py_ssize_t place, count
        cdef int64_t every
        self.end_order(base)
        for number, template, places, every in zip(self.numbers, self.templates, self.fields, self.periods):
            if tick % every != 0:
                continue
            body = self.begin(number, sequence, at, len(template), base)
            memcpy(body, PyBytes_AS_STRING(template), len(template))
            fields = <const uint32_t *>PyBytes_AS_STRING(places)
            count = len(places) // 8
            for place in range(count):
                memcpy(body + fields[2 * place], &row[fields[2 * place + 1]], 8)
        body = self.begin(self.tick, sequence, at, 27, base)
        body[0], body[9], body[18] = FIXED64_1, FIXED64_2, FIXED64_3
        memcpy(body + 1, &tick, 8)
        memcpy(body + 10, &time, 8)
        memcpy(body + 19, &row[1], 8)
        self.row_count += 1
        return 0

    cdef int add_frame(self, const Frame *frame) except -1:
        """Add a frame to the group of its bus."""
        cdef int length = min(frame.length, <uint8_t>FRAME_BYTES)
        cdef uint32_t identifier = frame.id & ID_MASK
        cdef bint[7] flags
        cdef int place, count = 0
        cdef int size
        cdef char *out
        flags[0], flags[1], flags[2] = frame.id & EXTENDED != 0, frame.id & REMOTE != 0, frame.id & ERROR_FRAME != 0
        flags[3] = is_flexible(frame)
        flags[4], flags[5], flags[6] = frame.flags & RATE_SWITCH != 0, frame.flags & ERROR_STATE != 0, frame.sent != 0
        for place in range(7):
            count += flags[place]
        size = 9 + 5 + 2 * count + 2 + length + (5 if self.bus_count > 1 else 0)
        if not self.grouped:
            self.grouped = True
            self.group_time = self.drained if self.drain > 0 else frame.time
        out = grow(&self.groups[frame.bus], 2 + size)
        out[0], out[1], out[2] = BYTES_2, <char>size, FIXED64_1
        memcpy(out + 3, &frame.time, 8)
        out[11] = FIXED32_2
        memcpy(out + 12, &identifier, 4)
        out += 16
        for place in range(7):
            if flags[place]:
                out[0], out[1] = <char>(BOOL_3 + 8 * place), 1
                out += 2
        out[0], out[1] = BYTES_10, <char>length
        memcpy(out + 2, frame.data, length)
        if self.bus_count > 1:
            out += 2 + length
            out[0] = FIXED32_11
            memcpy(out + 1, &self.order, 4)
        self.order += 1
        self.frame_count += 1
        return 0

    cdef int add_frames(self, size_t base) except -1:
        """Append the messages of the frames since the last row, drain, event or flush."""
        cdef int bus
        cdef char *body
        cdef Buffer *group
        if not self.grouped:
            return 0
        for bus in range(self.bus_count):
            group = &self.groups[bus]
            if group.size > 0:
                body = self.begin(self.buses[bus], self.drain, self.wall + self.group_time, 9 + group.size, base)
                body[0] = FIXED64_1
                memcpy(body + 1, &self.drained, 8)
                memcpy(body + 9, group.data, group.size)
                group.size = 0
        self.grouped = False
        return 0

    cdef int end_order(self, size_t base) except -1:
        """Append the messages of the frames before a row or a drain, after which their order restarts."""
        self.add_frames(base)
        self.order = 0
        return 0

    def encode(self, Batch batch not None, Py_ssize_t start, size_t base, size_t limit, int64_t wall, int64_t first_tick):
        """Encode records of a batch from a position on. Returns the position of the first one that is left.

        It returns early when the records have 64 KiB, or reach `limit` bytes in the chunk.

        base : bytes of messages in the chunk, in front of the encoded ones
        wall : ns of the clock at the start of the run
        first_tick : ns from there to tick 0
        """
        cdef Header *header
        cdef char *payload
        self.wall = wall
        while start < batch.size:
            header = <Header *>(PyBytes_AS_STRING(batch.records) + start)
            payload = <char *>header + sizeof(Header)
            if header.kind == ROW:
                self.add_row(<double *>payload, wall + first_tick, base)
            elif header.kind == FRAME:
                if (<Frame *>payload).bus < self.bus_count:
                    self.add_frame(<Frame *>payload)
            elif header.kind == RECEIVED:
                self.end_order(base)
                memcpy(&self.drained, payload, 8)
                self.drain += 1
            start += sizeof(Header) + header.bytes
            if self.out.size >= BLOCK or base + self.out.size >= limit:
                break
        return start

    def end_group(self, size_t base):
        """Encode the frames since the last row, drain, event or flush. base : as for `encode`"""
        self.add_frames(base)

    def take(self) -> tuple[bytes, dict[int, bytes]]:
        """Return the encoded records, and {channel: (log time in ns, position in the chunk) as uint64}."""
        cdef int channel
        index = {channel: taken(&self.index[channel]) for channel in range(self.channels) if self.index[channel].size}
        return taken(&self.out), index

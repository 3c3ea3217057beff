# cython: freethreading_compatible=True
"""Batches of the ring for the recorder: many rows and frames without an object per record."""

from libc.math cimport isfinite
from libc.stdint cimport int64_t, uint32_t, uint64_t
from libc.string cimport memcpy

from cpython.bytes cimport PyBytes_AS_STRING, PyBytes_FromStringAndSize

from cext.abi cimport Frame
from cext.atomics cimport load_u64
from cext.bus.bits cimport bits_of
from cext.memory.shared_state cimport (
    FRAME, PADDING, RECEIVED, ROW, Header, SharedLayout, SharedState, damaged, read_header, record_at,
)

cdef enum:
    BATCH_SIZE = 1 << 18                # bytes


cdef class Batch:
    """Consecutive rows, frames and bus drains of the ring, in order.

    Batch(records)    from [(kind, payload in bytes)]

    Iteration yields (kind, payload). `rows` and `frames` are their numbers.
    """

    def __init__(self, records=()):
        cdef list parts = []
        for kind, payload in records:
            parts.append(int(kind).to_bytes(4, "little") + len(payload).to_bytes(4, "little") + payload)
        self.fill(b"".join(parts))

    cdef fill(self, bytes records):
        """Set the records, of which every header is checked: later they are only read."""
        cdef Py_ssize_t at = 0
        cdef Header *header
        self.records, self.size, self.rows, self.frames, self.newest_at = records, len(records), 0, 0, -1
        while at < self.size:
            header = <Header *>(PyBytes_AS_STRING(records) + at)
            if self.size - at < <Py_ssize_t>sizeof(Header) or self.size - at - <Py_ssize_t>sizeof(Header) < <Py_ssize_t>(
                    header.bytes) or header.bytes < least_size(header.kind):
                raise damaged(at)
            if header.kind == ROW:
                self.rows += 1
                self.newest_at = at
            self.frames += header.kind == FRAME
            at += sizeof(Header) + header.bytes

    def __iter__(self):
        cdef Py_ssize_t at = 0
        cdef Header *header
        while at < self.size:
            header = <Header *>(PyBytes_AS_STRING(self.records) + at)
            yield header.kind, self.records[at + <Py_ssize_t>sizeof(Header) : at + <Py_ssize_t>(sizeof(Header) + header.bytes)]
            at += sizeof(Header) + header.bytes

    def newest(self) -> tuple | None:
        """Return the newest row, a tuple of tick, lateness in s and signals; None without one."""
        cdef Header *header
        cdef double *row
        if self.newest_at < 0:
            return None
        header = <Header *>(PyBytes_AS_STRING(self.records) + self.newest_at)
        row = <double *>(<char *>header + sizeof(Header))
        return tuple([row[place] for place in range(header.bytes // 8)])

    def first_tick(self) -> int:
        """Return the tick of the first row, -1 without one."""
        cdef Py_ssize_t at = 0
        cdef Header *header
        while at < self.size:
            header = <Header *>(PyBytes_AS_STRING(self.records) + at)
            if header.kind == ROW:
                return <int64_t>(<double *>(<char *>header + sizeof(Header)))[0]
            at += sizeof(Header) + header.bytes
        return -1

    def table(self, double rate, list columns, list whole, int64_t every=1) -> list[list[float]]:
        """Return a list for each row whose tick is a multiple of `every`: time in s, tick, the values of columns.

        rate : Hz
        columns : indices of signals
        whole : for each column whether its finite values are ints
        """
        cdef Py_ssize_t at = 0, place, count = len(columns)
        cdef Header *header
        cdef double *row
        cdef double value
        cdef list table = [], cells
        while at < self.size:
            header = <Header *>(PyBytes_AS_STRING(self.records) + at)
            if header.kind == ROW:
                row = <double *>(<char *>header + sizeof(Header))
                at += sizeof(Header) + header.bytes
                if <int64_t>row[0] % every != 0:
                    continue
                cells = [row[0] / rate, <int64_t>row[0]]
                for place in range(count):
                    value = row[2 + <Py_ssize_t>columns[place]]
                    if whole[place] and isfinite(value):
                        cells.append(int(value))
                    else:
                        cells.append(value)
                table.append(cells)
            else:
                at += sizeof(Header) + header.bytes
        return table

    def add_traffic(self, list frames, list bits, list ratios):
        """Add the frames to the counts of each bus, and to `bits` how many bits of the nominal bitrate they last.

        ratios : nominal bitrate / data bitrate of each bus; empty: the bits are not counted
        """
        cdef Py_ssize_t at = 0
        cdef Header *header
        cdef Frame *frame
        if self.frames == 0:
            return
        while at < self.size:
            header = <Header *>(PyBytes_AS_STRING(self.records) + at)
            if header.kind == FRAME:
                frame = <Frame *>(<char *>header + sizeof(Header))
                frames[frame.bus] += 1
                if ratios:
                    bits[frame.bus] += bits_of(frame, ratios[frame.bus])
            at += sizeof(Header) + header.bytes


def read(SharedState shared, int64_t rows=1 << 62) -> list[Batch | tuple[int, bytes]]:
    """Return the records of the ring after the last read, up to `rows` rows and about 256 KiB.

    The result has batches, and (kind, payload) for each event and change, in order. The space of the records is kept
    until `release` of the shared state.
    """
    cdef SharedLayout *layout = shared.layout
    cdef uint64_t head = load_u64(&layout.head)
    cdef uint64_t place
    cdef Header header
    cdef list records = []
    cdef bytes content
    cdef Py_ssize_t size = 0, total = 0
    cdef char *out
    cdef Batch batch
    shared.cursor = max(shared.cursor, load_u64(&layout.tail))         # another reader has taken records
    while shared.cursor != head and rows > 0 and total < BATCH_SIZE:
        place, size = shared.cursor, 0
        while place != head and rows > 0 and size < BATCH_SIZE:    # the size of the batch
            if not read_header(layout, place, head, &header):
                raise damaged(place)
            if header.kind == ROW or header.kind == FRAME or header.kind == RECEIVED:
                size += sizeof(Header) + header.bytes
                rows -= header.kind == ROW
            elif header.kind != PADDING:
                break
            place += sizeof(Header) + header.bytes
        if size > 0:
            content = PyBytes_FromStringAndSize(NULL, size)
            out = PyBytes_AS_STRING(content)
            while shared.cursor != place:
                if not read_header(layout, shared.cursor, place, &header) or (header.kind != PADDING and size < <Py_ssize_t>(
                        sizeof(Header) + header.bytes)):
                    raise damaged(shared.cursor)
                if header.kind != PADDING:
                    memcpy(out, &header, sizeof(Header))
                    memcpy(out + sizeof(Header), <char *>record_at(layout, shared.cursor) + sizeof(Header), header.bytes)
                    out += sizeof(Header) + header.bytes
                    size -= sizeof(Header) + header.bytes
                    total += sizeof(Header) + header.bytes
                shared.cursor += sizeof(Header) + header.bytes
            batch = Batch.__new__(Batch)
            batch.fill(content)
            records.append(batch)
            continue
        shared.cursor = place                                        # behind a padding
        if shared.cursor != head:
            if not read_header(layout, shared.cursor, head, &header):
                raise damaged(shared.cursor)
            records.append((header.kind, (<char *>record_at(layout, shared.cursor) + sizeof(Header))[:header.bytes]))
            shared.cursor += sizeof(Header) + header.bytes
            total += sizeof(Header) + header.bytes
    return records


cdef inline uint32_t least_size(uint32_t kind) noexcept nogil:
    """Return the least number of bytes of a record."""
    return 16 if kind == ROW else sizeof(Frame) if kind == FRAME else sizeof(int64_t) if kind == RECEIVED else 0

"""An MCAP file that its recorder did not finish is finished in place: what stands in it tells all that the recorder
knew.

The file may end anywhere. Up to the last whole record it is looked through, a slice at a time; then what is torn is cut
off, and the end is written as it would have been: the last piece's indices, the heads of chunks, the summary. Whoever
is killed in between leaves a file that can be mended again: nothing whole is ever cut off or written over but what
follows from the rest, a piece that has become a chunk is read as the piece it was, and what stands behind the end of
the data does not count until all of it is there and right. What is damaged, not just torn, is left as it is.
"""

import io
import os
import zlib
from contextlib import contextmanager
from struct import Struct

from runtime.recording.files import AT_ONCE, WholeFile, claim
from runtime.recording.mcap_file import CHUNK, CHUNK_HEAD, HEAD, MESSAGE, McapFile
from runtime.recording.reader import DAMAGE, LIBRARY, MAGIC
from runtime.recording.records import (
    A_CHUNK,
    A_MESSAGE,
    AN_INDEX,
    ATTACHMENT,
    CHANNEL,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    HEADER,
    KINDS,
    PRIVATE,
    RECORD_LIMIT,
    SCHEMA,
    compressed,
    length_of,
    read,
    walk,
)

FOOTER_REST = Struct("<QQI")  # summary and its offsets begin, checksum
SLICE = 128 << 10  # bytes that are looked through at once


class MendingFailed(Exception):
    """The file is left as it is. The text says why, in one line."""


class Mending:
    """One file, which nobody else may be writing. MendingFailed, OSError"""

    def __init__(self, path):
        self.path = path
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        self.file = WholeFile(path, descriptor)
        self.stream = io.FileIO(descriptor, closefd=False)
        try:
            if not claim(descriptor):
                raise MendingFailed(f"{path} is still being recorded")
            self.size = os.fstat(descriptor).st_size
            self.whole = finished(self.stream, self.size)
        except BaseException:
            os.close(descriptor)
            raise
        self.writer = McapFile(self.file)
        self.good = 0  # up to here the file stays as it is
        self.awaited, self.indices = [], 0  # indices of the piece that are still to come, and where they begin
        self.claimed = None  # (bytes, checksum) of the chunk that the piece is already
        self.over = False  # the end of the data has come
        self.stream.seek(0)
        self.looking = not self.whole and self.stream.read(len(MAGIC)) == MAGIC
        self.records, self.at = walk(self.stream, len(MAGIC)), len(MAGIC)

    def look(self):
        """Look through the next slice. Returns whether there is more. OSError"""
        from mcap.exceptions import McapError

        until = self.at + SLICE
        while self.looking and self.at < until:
            at, kind, data = next(self.records, (self.at, None, b""))
            try:
                self.looking = kind is not None and self.take(at, kind, data)
            except (McapError, *DAMAGE):
                self.looking = False
            if self.looking:
                self.at = at + len(data)
        return self.looking

    def take(self, at, kind, data):
        """A record. False where it cannot stand there, and at the end."""
        writer, body = self.writer, data[HEAD.size :]
        if at == len(MAGIC):
            if kind != HEADER or read("Header", body).library != LIBRARY:
                return False
        elif kind == A_MESSAGE and writer.begun is not None and not self.awaited:
            _, _, channel, _, log_time, _ = MESSAGE.unpack_from(data)
            if channel not in writer.counts:
                return False
            writer.count(channel, log_time, data)
        elif kind == AN_INDEX and writer.begun is not None:
            return self.take_index(at, data)
        elif writer.begun is not None:
            return False
        elif kind in (PRIVATE, A_CHUNK) and len(data) == CHUNK_HEAD.size:
            _, _, _, _, size, checksum, _, again = CHUNK_HEAD.unpack(data)
            self.claimed = (size, checksum) if kind == A_CHUNK and again == size else None
            writer.begin_piece(at)
            return True  # without a message behind it a room is nothing
        elif kind == SCHEMA:
            writer.schemas.append(read("Schema", body))
        elif kind == CHANNEL:
            channel = read("Channel", body)
            writer.channels.append(channel)
            writer.counts[channel.id] = 0
        elif kind == ATTACHMENT:
            writer.attached(read("Attachment", body), at, len(data))
        else:
            self.over = kind == DATA_END
            return False
        self.good = at + len(data)
        return True

    def take_index(self, at, data):
        if not self.awaited:
            self.awaited, self.indices = list(self.writer.indices()), at
        if not self.awaited or data != self.awaited.pop(0):
            return False
        if not self.awaited:
            if self.claimed is not None and self.claimed[0] == self.writer.size:
                self.writer.checksum = self.claimed[1]  # if it is wrong, it shall be found wrong again
            self.writer.indexed(self.indices)
            self.good = at + len(data)
        return True

    def finish(self):
        """Look through the rest, and complete the file. Returns whether there was anything to do. MendingFailed,
        OSError; the file is closed.
        """
        try:
            if self.whole:
                return False
            while self.look():
                pass
            if self.good == 0:
                raise MendingFailed(
                    f"{self.path} was cut off before it began, or is something else: there is nothing to finish"
                )
            if not self.over and not torn(self.stream, self.at, self.size):
                raise MendingFailed(
                    f"{self.path} is damaged from byte {self.at} of {self.size} on: `convert` writes what stands "
                    "before into a new file"
                )
            if self.writer.begun is not None and not self.writer.size:
                self.writer.begun = None
            os.ftruncate(self.file.descriptor, self.good)
            os.lseek(self.file.descriptor, self.good, os.SEEK_SET)
            self.file.size = self.good
            self.writer.finish()
            return True
        finally:
            self.close()

    def close(self):
        self.looking = False
        self.file.close()


def finish(path, progress=lambda share: None):
    """Finish a file in place, whatever has become of its recorder; a finished one stays as it is. MendingFailed,
    OSError

    progress : called with the share that is done
    """
    mending = Mending(path)
    try:
        while mending.look():
            progress(mending.at / mending.size)
    except BaseException:
        mending.close()
        raise
    mending.finish()


class Backlog:
    """Files that recorders which have died could not finish: looked through while there is time, finished at the end.

    paths : of the files
    """

    def __init__(self, paths):
        self.paths = paths
        self.waiting, self.begun = list(paths), []
        self.problems = {}  # {path: line of text}

    def look(self):
        """A slice of it, which takes about a millisecond. Returns whether there is more."""
        if self.waiting:
            with self.told(self.waiting[0]):
                if self.look_through(self.waiting[0]):
                    return True
            del self.waiting[0]
        return bool(self.waiting)

    def look_through(self, path):
        if not os.path.getsize(path):  # its recorder died before it had begun
            return False
        if not self.begun or self.begun[-1].path != path:
            self.begun.append(Mending(path))
        return self.begun[-1].look()

    def finish(self):
        """Returns what a person shall know: lines of text."""
        while self.look():
            pass
        for mending in self.begun:
            with self.told(mending.path):
                mending.finish()
        return [*self.problems.values()]

    @contextmanager
    def told(self, path):
        try:
            yield
        except MendingFailed as error:
            self.problems[path] = str(error)
        except Exception as error:  # the recording goes on, whatever is the matter with a file of before
            self.problems[path] = f"{path} was not finished: {getattr(error, 'strerror', None) or repr(error)}"


def torn(stream, at, size):
    """Whether nothing but one record that is not whole stands from a byte on, or the zeros that a power cut leaves of
    it.
    """
    stream.seek(at)
    head = stream.read(HEAD.size)
    if not head.strip(b"\0"):
        return all(not piece.strip(b"\0") for piece in iter(lambda: stream.read(AT_ONCE), b""))
    if len(head) < HEAD.size:
        return head[0] in KINDS
    whole = length_of(head, 0)
    return head[0] in KINDS and whole < (RECORD_LIMIT if head[0] == ATTACHMENT else CHUNK) and at + whole > size


def finished(stream, size):
    """Whether a file is complete: its summary is whole, and each of the chunks that it tells of has its head."""
    end = HEAD.size + FOOTER_REST.size + len(MAGIC)
    if size < end:
        return False
    stream.seek(size - end)
    footer = stream.read(end)
    start, _, checksum = FOOTER_REST.unpack_from(footer, HEAD.size)
    if footer[:1] != bytes([FOOTER]) or not footer.endswith(MAGIC) or start > size:
        return False
    stream.seek(start)
    summary = b"".join(iter(lambda: stream.read(AT_ONCE), b""))[: size - start - len(MAGIC) - 4]
    if zlib.crc32(summary) != checksum:
        return False
    for _, kind, data in walk(io.BytesIO(summary), start):
        if kind == CHUNK_INDEX:
            index = read("ChunkIndex", data[HEAD.size :])
            stream.seek(index.chunk_start_offset)
            head = stream.read(CHUNK_HEAD.size)
            if len(head) < CHUNK_HEAD.size or head[0] != A_CHUNK:
                return False
            fields, size = CHUNK_HEAD.unpack(head), index.uncompressed_size
            # half a head has not got its last field
            if fields[1] != index.chunk_length - HEAD.size or fields[4 if compressed(head) else 7] != size:
                return False
    return True

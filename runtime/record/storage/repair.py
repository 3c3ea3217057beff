"""Repair of an MCAP file that its recorder did not finish: the file becomes complete in place.

The file can end anywhere. It is scanned up to the last complete record, a slice at a time; a zstd frame in which it
ends, up to its last complete block. Then the torn end is removed, and the end is written as the recorder would have
written it: the end of the zstd frame, the indices of the last chunk, the heads of chunks, the summary.

A repair that is killed leaves a file that can be repaired again: only the torn end is removed, and only bytes that
follow from the rest are overwritten. A file that is damaged, and not just torn, is not modified.
"""

import io
import os
import zlib
from collections.abc import Callable, Generator
from contextlib import contextmanager
from struct import Struct
from typing import Any

from runtime.record.storage.files import AT_ONCE, WholeFile, claim
from runtime.record.storage.mcap_file import (
    CHUNK,
    CHUNK_HEAD,
    CHUNK_HEADS,
    HEAD,
    MESSAGE,
    PLACE,
    ROOM,
    STREAM,
    ZSTD,
    McapFile,
    stamps_of,
)
from runtime.record.storage.records import (
    A_CHUNK,
    A_MESSAGE,
    AN_INDEX,
    ATTACHMENT,
    CHANNEL,
    CHUNK_INDEX,
    CHUNK_LIMIT,
    DAMAGE,
    DATA_END,
    FOOTER,
    HEADER,
    KINDS,
    LIBRARY,
    MAGIC,
    RECORD_LIMIT,
    SCHEMA,
    length_of,
    read,
    walk,
)
from runtime.record.storage.zstd_stream import END, decode, is_torn, raw_blocks

FOOTER_REST = Struct("<QQI")  # summary and its offsets begin, checksum
SLICE = 128 << 10  # bytes that are looked through at once


class RepairFailed(Exception):
    """The file is not modified. The text is the reason in one line."""


class Repair:
    """Repair of one file, which no other process writes.

    Raises RepairFailed and OSError, as `finish` does. `look` raises OSError.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        self.file = WholeFile(path, descriptor)
        self.stream = io.FileIO(descriptor, closefd=False)
        try:
            if not claim(descriptor):
                raise RepairFailed(f"{path} is still being recorded")
            self.size = os.fstat(descriptor).st_size
            self.whole = is_finished(self.stream, self.size)
        except BaseException:
            os.close(descriptor)
            raise
        self.writer = McapFile(self.file)
        self.good = 0  # bytes that stay as they are
        self.expected: dict[bytes, int] = {}  # {index: channel} still to come
        self.order: list[int] = []  # channels whose index was found
        self.indices = 0  # position of the first index
        self.claimed = None  # (bytes, checksum) of the messages in the head of the chunk
        self.stamps = []  # [(bytes, checksum) of the first messages of the chunk], the newest first, if they are known
        self.compression = ""  # of the chunk
        self.damaged = False  # whether complete blocks have a record that does not belong there, or a part of one
        self.ended = True  # whether the zstd frame of the chunk is complete
        self.tail = b""  # complete messages of the chunk, behind the blocks that stay
        self.heads: list[tuple[int, bytes]] = []  # (position, bytes) of chunks to write
        self.is_flushed = False  # whether the file was not finished, and has everything up to its last flush
        self.over = False  # whether the end of the data was reached
        self.stream.seek(0)
        self.looking = not self.whole and self.stream.read(len(MAGIC)) == MAGIC
        self.at = len(MAGIC)
        self.records = walk(self.stream, self.at)

    def look(self) -> bool:
        """Scan the next slice. Returns whether more follows."""
        from mcap.exceptions import McapError

        until = self.at + SLICE
        while self.looking and self.at < until:
            at, kind, data = next(self.records, (self.at, None, b""))
            try:
                end = self.take_frame(at) if kind is None else self.take(at, kind, data)
            except (McapError, *DAMAGE):
                end = None
            self.looking = end is not None and self.ended
            self.at = self.at if end is None else end
        return self.looking

    def take(self, at: int, kind: int, data: bytes) -> int | None:
        """Take a record. Returns where the next one begins, None if it is not valid here or is the last one."""
        writer, body, end = self.writer, data[HEAD.size :], at + len(data)
        if at == len(MAGIC):
            if kind != HEADER or read("Header", body).library != LIBRARY:
                return None
        elif kind == A_MESSAGE and writer.start is not None and not self.compression and not self.expected:
            if self.stamps and writer.size == self.stamps[0][0]:  # what follows was not flushed
                self.is_flushed = True
                return None
            self.count(data)
        elif kind == AN_INDEX and writer.start is not None:
            if not self.is_expected(at, data):
                return None
        elif writer.start is not None:
            return None
        elif kind in (ROOM, A_CHUNK) and len(data) == CHUNK_HEAD.size:
            _, _, _, _, size, checksum, _, _, again = CHUNK_HEAD.unpack(data)
            self.begin_chunk(at, "", (size, checksum) if kind == A_CHUNK and again == size else None)
            self.stamps = stamps_of(data, "")[0] if kind == ROOM else []
            return end  # a room without a message behind it is removed
        elif kind in (STREAM, A_CHUNK):
            return self.take_frame(at)
        elif kind == SCHEMA:
            writer.schemas.append(read("Schema", body))
        elif kind == CHANNEL:
            channel = read("Channel", body)
            writer.channels.append(channel)
            writer.counts[channel.id] = 0
        elif kind == ATTACHMENT:
            writer.index_attachment(read("Attachment", body), at, len(data))
        else:
            self.over = kind == DATA_END
            return None
        if not self.expected:
            self.good = end
        return end

    def begin_chunk(self, at: int, compression: str, claimed: tuple[int, int] | None) -> None:
        """Begin a chunk. claimed : (bytes, checksum) of its messages, if its head has them"""
        self.writer.begin_chunk(at)
        self.compression, self.claimed, self.stamps = compression, claimed, []
        self.writer.is_verified = True

    def count(self, data: bytes) -> None:
        """Take a message of the open chunk."""
        _, _, channel, _, log_time, _ = MESSAGE.unpack_from(data)
        self.writer.add(data, {channel: PLACE.pack(log_time, self.writer.size)})
        if (self.writer.size, self.writer.checksum) not in self.stamps and self.writer.size in dict(self.stamps):
            self.damaged = True
            raise ValueError("a wrong checksum")

    def is_message(self, record: bytes) -> bool:
        """Return whether a message record is of a channel of the file."""
        return len(record) >= MESSAGE.size and MESSAGE.unpack_from(record)[2] in self.writer.counts

    def take_frame(self, at: int) -> int | None:
        """Take a zstd chunk, or the part of it in which the file ends. Returns where that ends, None if it is invalid.

        The blocks up to the last one that ends with a complete message are kept. `ended` is then False if blocks are
        missing, and `tail` has the complete messages of the others.
        """
        form = CHUNK_HEADS[ZSTD]
        self.stream.seek(at)
        head = self.stream.read(form.size)
        if self.writer.start is not None or len(head) < form.size:
            return None
        kind, length, _, _, size, checksum, _, name, compressed_size = form.unpack(head)
        if kind not in (STREAM, A_CHUNK) or name != ZSTD.encode():
            return None
        known = kind == A_CHUNK and form.size - HEAD.size < length < CHUNK_LIMIT
        frame = self.stream.read(length - form.size + HEAD.size if known else CHUNK_LIMIT)
        content, ends, ended = decode(frame, CHUNK_LIMIT)
        complete, whole = {0}, 0
        self.begin_chunk(at, ZSTD, (size, checksum) if kind == A_CHUNK and compressed_size == len(frame) else None)
        self.stamps = stamps_of(head, ZSTD)[0] if kind == STREAM else []
        if self.stamps and len(content) > self.stamps[0][0]:  # the rest was not flushed
            content, ended, self.is_flushed = content[: self.stamps[0][0]], False, True
            ends = [entry for entry in ends if entry[1] <= len(content)]
        for place, message, record in walk(io.BytesIO(content), 0):
            if message != A_MESSAGE or not self.is_message(record):
                self.damaged = True
                return None
            whole = place + len(record)
            complete.add(whole)
        if ended and whole < len(content):
            self.damaged = True
            return None
        kept = max(entry for entry in ends if entry[1] in complete)
        self.tail = content[kept[1] : whole]
        for _, _, record in walk(io.BytesIO(content[:whole]), 0):
            self.count(record)
        self.ended = ended and kept == ends[-1]
        if self.writer.size:
            self.good = at + form.size + kept[0]
        end = at + form.size + ends[-1][0]
        self.stream.seek(end)
        self.records = walk(self.stream, end)
        return end

    def is_expected(self, at: int, data: bytes) -> bool:
        """Return whether a record is one of the indices of the open chunk, which ends with the last of them."""
        writer = self.writer
        if not self.expected:
            self.expected = dict(zip(writer.indices(), writer.index))
            self.indices, self.order = at, []
        channel = self.expected.pop(data, None)
        if channel is None:
            return False
        self.order.append(channel)
        if not self.expected:
            writer.index = {channel: writer.index[channel] for channel in self.order}
            self.end_chunk(self.indices)
        return True

    def end_chunk(self, end: int) -> None:
        """Close the chunk, whose indices begin at `end`."""
        checksum = None
        if self.claimed is not None and self.claimed[0] == self.writer.size:
            checksum = self.claimed[1]  # readers then still find a wrong one
        elif (self.writer.size, self.writer.checksum) not in self.stamps[:1]:
            self.writer.is_verified = False  # the file was cut within the chunk
        start = self.writer.start
        self.heads.append((start, self.writer.complete(end, self.compression, checksum)))

    def finish(self) -> bool:
        """Scan the rest, complete the file and close it. Returns whether it was incomplete.

        Raises RepairFailed and OSError.
        """
        try:
            if self.whole:
                return False
            while self.look():
                pass
            if self.good == 0:
                raise RepairFailed(
                    f"{self.path} was truncated before its first record, or is not a recording: it contains nothing "
                    "to repair"
                )
            if self.damaged or self.is_contradicted() or not (self.over or self.is_flushed or self.is_torn()):
                raise RepairFailed(
                    f"{self.path} is damaged from byte {self.at} of {self.size} on: `convert` writes the undamaged "
                    "parts into a new file"
                )
            self.complete()
            return True
        finally:
            self.close()

    def is_contradicted(self) -> bool:
        """Return whether the file has an end that the scan did not reach, or whose summary has other channels."""
        from mcap.exceptions import McapError

        if not self.over:
            self.stream.seek(max(self.size - len(MAGIC), 0))
            return self.stream.read() == MAGIC
        self.stream.seek(self.at)
        try:
            return any(
                kind == CHANNEL and read("Channel", data[HEAD.size :]) not in self.writer.channels
                for _, kind, data in walk(self.stream, self.at)
            )
        except (McapError, *DAMAGE):
            return False

    def is_torn(self) -> bool:
        """Return whether the rest of the file is one incomplete record or block, or zeros after a power cut."""
        if self.ended:
            return torn(self.stream, self.at, self.size)
        self.stream.seek(self.at)
        return is_torn(self.stream.read())

    def complete(self) -> None:
        """Replace what follows the last complete record by the end of a file."""
        writer, file = self.writer, self.file
        if not writer.size:
            writer.start = None
        elif self.tail:
            blocks = raw_blocks(self.tail)
            os.pwrite(file.descriptor, blocks, self.good)  # before the blocks that they replace are removed
            self.good += len(blocks)
        os.ftruncate(file.descriptor, self.good)
        os.lseek(file.descriptor, self.good, os.SEEK_SET)
        file.size = self.good
        if writer.start is not None:
            if not self.ended:
                file.write(END)
            end = file.tell()
            writer.write_indices()
            self.end_chunk(end)
        file.flush()
        for start, head in self.heads:
            os.pwrite(file.descriptor, head, start)
        writer.finish()

    def close(self) -> None:
        """Close the file."""
        self.looking = False
        self.file.close()


def finish(path: str, progress: Callable[[float], None] = lambda share: None) -> None:
    """Complete a file in place, if it is not complete. Raises RepairFailed and OSError.

    progress : called with the fraction that has been scanned
    """
    repair = Repair(path)
    try:
        while repair.look():
            progress(repair.at / repair.size)
    except BaseException:
        repair.close()
        raise
    repair.finish()


class Backlog:
    """Incomplete files of earlier parts: scanned while the recorder is idle, completed at the end of the run.

    paths : paths of the files
    """

    def __init__(self, paths: list[str]) -> None:
        self.paths = paths
        self.waiting = list(paths)
        self.repairs: list[Repair] = []
        self.problems: dict[str, str] = {}  # {path: line of text}

    def look(self) -> bool:
        """Scan the next slice, which takes up to 20 ms. Returns whether more follows."""
        if self.waiting:
            with self.report_failure(self.waiting[0]):
                if self.scan(self.waiting[0]):
                    return True
            del self.waiting[0]
        return bool(self.waiting)

    def scan(self, path: str) -> bool:
        """Scan the next slice of a file. Returns whether more follows."""
        if not os.path.getsize(path):  # its recorder died before it wrote anything
            return False
        if not self.repairs or self.repairs[-1].path != path:
            self.repairs.append(Repair(path))
        return self.repairs[-1].look()

    def finish(self) -> list[str]:
        """Complete all files. Returns problems as lines of text."""
        while self.look():
            pass
        for repair in self.repairs:
            with self.report_failure(repair.path):
                repair.finish()
        return [*self.problems.values()]

    @contextmanager
    def report_failure(self, path: str) -> Generator[None]:
        """Keep a failure as the problem of a file."""
        try:
            yield
        except RepairFailed as error:
            self.problems[path] = str(error)
        except Exception as error:  # the recording continues
            self.problems[path] = f"{path} was not completed: {getattr(error, 'strerror', None) or repr(error)}"


def torn(stream: Any, at: int, size: int) -> bool:
    """Return whether the rest of a file is one incomplete record, or zeros after a power cut. at : where it begins"""
    stream.seek(at)
    head = stream.read(CHUNK_HEADS[ZSTD].size)
    if not head.strip(b"\0"):
        return all(not piece.strip(b"\0") for piece in iter(lambda: stream.read(AT_ONCE), b""))
    if len(head) < HEAD.size:
        return head[0] in KINDS
    whole = length_of(head, 0)
    return head[0] in KINDS and whole < (RECORD_LIMIT if head[0] == ATTACHMENT else CHUNK) and at + whole > size


def is_finished(stream: Any, size: int) -> bool:
    """Return whether a file is complete: its summary is valid, and every chunk in it has its head."""
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
            form = CHUNK_HEADS.get(index.compression)
            head = stream.read(CHUNK_HEAD.size if form is None else form.size)
            if len(head) < CHUNK_HEAD.size or head[0] != A_CHUNK:
                return False
            if HEAD.unpack_from(head)[1] != index.chunk_length - HEAD.size:
                return False
            # the last field is missing in a partly written head
            if form is not None and (len(head) < form.size or form.unpack(head)[-1] != index.compressed_size):
                return False
            if form is not None and form.unpack(head)[2:4] != (index.message_start_time, index.message_end_time):
                return False
    return True

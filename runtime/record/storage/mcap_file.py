"""Writer of an MCAP file that can be read up to its last flush at every moment, and is indexed once it is finished.

    header, attachments, schemas, channels, ( chunk, message indices )*, attachments, end of data, summary, footer

A chunk begins with its length, which is not known until the chunk is complete. Space for its head is therefore reserved
by a record of a private type, which is replaced by the head in one write when the chunk and its indices are in the
file. Until then, it has the checksum of the messages up to the last flush, so that these are verified in a file that
was not finished, and that of OLDER_FLUSHES before, which the disk has after a power cut. A chunk that is full is
followed by the space for the next one: a file without it was truncated.

    ROOM     is followed by the messages as plain records, which every reader of MCAP finds
    STREAM   is followed by a zstd frame (runtime.record.storage.zstd_stream), whose blocks end at each flush. Its
             declared length exceeds that of any chunk, so that other readers take it for a truncated record

Chunks end at CHUNK bytes of messages, so that the bytes of a file depend only on its messages and, with zstd, on the
flushes. (MCAP specification, mcap.dev/spec)
"""

import os
import zlib
from array import array
from collections import deque
from collections.abc import Iterator
from struct import Struct
from typing import Any

from runtime.host.errors import BadInput
from runtime.record.storage.zstd_stream import BLOCK_LIMIT, Compressor

CHUNK = 1 << 20  # bytes of messages
OLDER_FLUSHES = 4  # which take 2 s in real time
ROOM, STREAM = 0x80, 0x81  # private types of records
STREAM_LENGTH = 64 << 20  # bytes, that the record declares
HEAD = Struct("<BQ")  # of a record: type, bytes that follow
ZSTD, LEVEL, LEVELS = "zstd", 3, range(1, 20)
# of a chunk: type, bytes that follow, first and last log time, bytes and CRC-32 of its messages, compression (length of
# its name, name), compressed bytes
CHUNK_HEADS = {"": Struct("<BQQQQII0sQ"), ZSTD: Struct("<BQQQQII4sQ")}
CHUNK_HEAD = CHUNK_HEADS[""]
MESSAGE = Struct("<BQHIQQ")  # type, bytes that follow, channel, sequence, log time, publish time
INDEX = Struct("<BQHI")  # type, bytes that follow, channel, bytes of the index
PLACE = Struct("=QQ")  # of a message in an index: log time, position in the chunk
MESSAGE_REST = MESSAGE.size - HEAD.size


class McapFile:
    """Writer of one MCAP file.

    file : runtime.record.storage.files.WholeFile
    compression : compression of the chunks: "zstd", "zstd:LEVEL" with a level from 1 to 19, or "none"
    """

    def __init__(self, file: Any, compression: str = ZSTD) -> None:
        from mcap.data_stream import RecordBuilder
        from mcap.opcode import Opcode
        from mcap.writer import MCAP0_MAGIC

        level = compression_level(compression)
        self.file, self.builder = file, RecordBuilder
        self.opcode, self.magic = Opcode, MCAP0_MAGIC
        self.compression, self.compressor = ("", None) if level is None else (ZSTD, Compressor(level))
        self.kind = int(Opcode.MESSAGE)
        self.schemas: list[Any] = []  # records of the mcap package, as are the next three
        self.channels: list[Any] = []
        self.attachments: list[Any] = []
        self.chunks: list[Any] = []
        self.counts: dict[int, int] = {}  # messages of each channel
        self.first = self.last = None  # log time of all messages, ns
        self.start: Any = None  # position of the open chunk
        self.size = 0  # bytes of messages in the open chunk
        self.waiting: list[bytes] = []  # messages that are not compressed yet
        self.waiting_size = 0  # their bytes
        self.stamps: deque[tuple[int, int]] = deque(maxlen=OLDER_FLUSHES + 1)  # of the last flushes, as in `reserved`
        self.is_verified = True  # whether the messages are those that were recorded, so that chunks have a checksum

    def begin(self, library: str) -> None:
        """Write the header. library : name of the program"""
        from mcap.records import Header

        self.file.write(self.magic)
        self.record(Header(profile="", library=library))

    def record(self, record: Any) -> int:
        """Write a record of the mcap package and return its size in bytes."""
        builder = self.builder()
        record.write(builder)
        return self.file.write(builder.end())

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Write an attachment."""
        from mcap.records import Attachment

        self.end_chunk()
        attachment = Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)
        self.index_attachment(attachment, self.file.tell(), self.record(attachment))

    def index_attachment(self, attachment: Any, offset: int, length: int) -> None:
        """Add an attachment to the summary. offset, length : offset and length of the record in the file, in bytes"""
        from mcap.records import AttachmentIndex

        self.attachments.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                create_time=attachment.create_time,
                log_time=attachment.log_time,
                data_size=len(attachment.data),
                name=attachment.name,
                media_type=attachment.media_type,
            )
        )

    def channel(self, topic: str, descriptor: bytes, name: str) -> int:
        """Write a channel of Protobuf messages and return its number.

        descriptor : serialised FileDescriptorSet
        name : name of the message in the descriptor
        """
        from mcap.records import Channel, Schema

        self.end_chunk()
        number = len(self.channels) + 1
        self.schemas.append(Schema(id=number, name=name, encoding="protobuf", data=descriptor))
        self.channels.append(
            Channel(id=number, topic=topic, message_encoding="protobuf", schema_id=number, metadata={})
        )
        self.record(self.schemas[-1])
        self.record(self.channels[-1])
        self.counts[number] = 0
        return number

    def message(self, channel: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0) -> None:
        """Write a message. log_time, publish_time : ns"""
        record = MESSAGE.pack(self.kind, MESSAGE_REST + len(data), channel, sequence, log_time, publish_time) + data
        self.messages(record, {channel: PLACE.pack(log_time, self.size)})

    def messages(self, data: bytes, index: dict[int, bytes]) -> None:
        """Write message records to the open chunk, and end it if it has CHUNK bytes.

        data : message records
        index : {channel: log time in ns and position in the chunk, in turn, as bytes of uint64}
        """
        if self.start is None:
            self.begin_chunk(self.file.tell())
            self.file.write(head_space(self.compression))
        self.add(data, index)
        if self.compressor is None:
            self.file.write(data)
        else:
            if self.waiting_size + len(data) > BLOCK_LIMIT:
                self.compress()
            self.waiting.append(data)
            self.waiting_size += len(data)
        if self.size >= CHUNK:
            self.end_chunk(is_followed=True)

    def begin_chunk(self, start: int) -> None:
        """Begin an empty chunk. start : position of its head in the file"""
        self.start = start
        self.index: dict[int, array[int]] = {}
        self.size, self.checksum = 0, 0
        self.stamps.clear()

    def add(self, data: bytes, index: dict[int, bytes]) -> None:
        """Add messages to the index of the open chunk. Arguments as for `messages`."""
        for channel, places in index.items():
            known = self.index.get(channel)
            if known is None:
                known = self.index[channel] = array("Q")
            known.frombytes(places)
            self.counts[channel] += len(places) // PLACE.size
        self.size += len(data)
        self.checksum = zlib.crc32(data, self.checksum)

    def compress(self) -> None:
        """Compress the waiting messages to a complete block."""
        if self.compressor is not None and self.waiting:
            data, self.waiting, self.waiting_size = b"".join(self.waiting), [], 0
            self.file.write(self.compressor.block(data))

    def flush(self) -> None:
        """Write all messages to the file, which then ends with a complete block, and their checksum. Raises OSError."""
        self.compress()
        self.write_checksum()

    def write_checksum(self) -> None:
        """Write what is complete to the file, then the checksum of the messages of the open chunk. Raises OSError."""
        self.file.flush()
        if self.start is not None and self.size:
            self.stamps.append((self.size, self.checksum))
            stored = self.file.tell() - self.start - CHUNK_HEADS[self.compression].size
            head = head_space(self.compression, self.stamps[-1], self.stamps[0], stored)
            os.pwrite(self.file.descriptor, head, self.start)

    def end_chunk(self, is_followed: bool = False) -> None:
        """End the open chunk, if any: write its indices, then its head. is_followed : by a chunk. Raises OSError."""
        if self.start is None:
            return
        start = self.start
        if not self.size:
            self.start = None
            self.file.take_back(head_space(self.compression))
            return
        if self.compressor is not None:
            self.compress()
            self.file.write(self.compressor.end())
        self.write_checksum()
        end = self.file.tell()
        self.write_indices()
        following = self.file.tell()
        if is_followed:
            self.file.write(head_space(self.compression))
        self.file.flush()
        os.pwrite(self.file.descriptor, self.complete(end), start)
        if is_followed:
            self.begin_chunk(following)

    def write_indices(self) -> None:
        """Write the message indices of the open chunk in the order of channels."""
        self.index = dict(sorted(self.index.items()))
        for index in self.indices():
            self.file.write(index)

    def indices(self) -> Iterator[bytes]:
        """Yield the message index of each channel of the open chunk, as bytes."""
        for channel, places in self.index.items():
            data = places.tobytes()
            yield INDEX.pack(self.opcode.MESSAGE_INDEX, INDEX.size - HEAD.size + len(data), channel, len(data)) + data

    def complete(self, end: int, compression: str | None = None, checksum: int | None = None) -> bytes:
        """Close the open chunk, add it to the summary and return its head as bytes.

        end : position in the file, where its indices begin
        compression, checksum : if they are not those of this writer and of the messages
        """
        from mcap.records import ChunkIndex

        compression = self.compression if compression is None else compression
        begins, ends = (
            min(min(places[::2]) for places in self.index.values()),
            max(max(places[::2]) for places in self.index.values()),
        )
        offsets: dict[int, int] = {}
        length = 0
        for channel, index in zip(self.index, self.indices()):
            offsets[channel] = end + length
            length += len(index)
        form, start, size = CHUNK_HEADS[compression], self.start, self.size
        self.start, self.size = None, 0
        self.chunks.append(
            ChunkIndex(
                chunk_start_offset=start,
                chunk_length=end - start,
                message_start_time=begins,
                message_end_time=ends,
                message_index_offsets=offsets,
                message_index_length=length,
                compression=compression,
                compressed_size=end - start - form.size,
                uncompressed_size=size,
            )
        )
        self.first = begins if self.first is None else min(self.first, begins)
        self.last = ends if self.last is None else max(self.last, ends)
        return form.pack(
            self.opcode.CHUNK,
            end - start - HEAD.size,
            begins,
            ends,
            size,
            (self.checksum if checksum is None else checksum) if self.is_verified else 0,
            len(compression),
            compression.encode(),
            end - start - form.size,
        )

    def finish(self) -> None:
        """End the open chunk and write the summary. Raises OSError."""
        from mcap.records import DataEnd

        self.end_chunk()
        self.record(DataEnd(data_section_crc=0))
        self.summarise()

    def summarise(self) -> None:
        """Write the summary, the footer and the end of the file."""
        from mcap.records import Footer, Statistics, SummaryOffset

        start = self.file.tell()
        opcode, summary = self.opcode, self.builder()
        statistics = Statistics(
            attachment_count=len(self.attachments),
            metadata_count=0,
            schema_count=len(self.schemas),
            channel_count=len(self.channels),
            chunk_count=len(self.chunks),
            message_count=sum(self.counts.values()),
            channel_message_counts=self.counts,
            message_start_time=self.first or 0,
            message_end_time=self.last or 0,
        )
        offsets: list[Any] = []
        for kind, records in (
            (opcode.SCHEMA, self.schemas),
            (opcode.CHANNEL, self.channels),
            (opcode.STATISTICS, [statistics]),
            (opcode.CHUNK_INDEX, self.chunks),
            (opcode.ATTACHMENT_INDEX, self.attachments),
        ):
            begun = summary.count
            for record in records:
                record.write(summary)
            if records:
                offsets.append(
                    SummaryOffset(group_opcode=kind, group_start=start + begun, group_length=summary.count - begun)
                )
        places = start + summary.count
        for offset in offsets:
            offset.write(summary)
        data = summary.end()
        head = HEAD.pack(opcode.FOOTER, 20) + start.to_bytes(8, "little") + places.to_bytes(8, "little")
        self.file.write(data)
        self.record(
            Footer(summary_start=start, summary_offset_start=places, summary_crc=zlib.crc32(head, zlib.crc32(data)))
        )
        self.file.write(self.magic)


def head_space(
    compression: str, newest: tuple[int, int] = (0, 0), older: tuple[int, int] = (0, 0), stored: int = 0
) -> bytes:
    """Return the record that reserves space for the head of a chunk.

    compression : "zstd" or ""
    newest, older : (bytes, CRC-32) of the first messages, up to the last flush and up to an older one
    stored : bytes that the newest ones have in the file
    """
    form = CHUNK_HEADS[compression]
    kind, length = (STREAM, STREAM_LENGTH) if compression else (ROOM, form.size)
    return form.pack(kind, length - HEAD.size, *older, *newest, len(compression), compression.encode(), stored)


def stamps_of(head: bytes | memoryview, compression: str) -> tuple[list[tuple[int, int]], int]:
    """Return ([(bytes, CRC-32) of the first messages], stored bytes of the first of these) of a reserved head.

    The newest is first. There is none in files of earlier versions.
    """
    _, _, *older, size, checksum, _, _, stored = CHUNK_HEADS[compression].unpack_from(head)
    return [stamp for stamp in ((size, checksum), tuple(older)) if stamp[0]], stored


def compression_level(text: str) -> int | None:
    """Return the level of zstd of a compression as text, None for "none". Raises BadInput."""
    name, _, level = text.partition(":")
    if text == "none":
        return None
    if name != ZSTD or (level and not (level.isdecimal() and int(level) in LEVELS)):
        raise BadInput(
            f"unknown compression {text!r}: use zstd, zstd:LEVEL with a level from {LEVELS[0]} to {LEVELS[-1]}, or none"
        )
    return int(level) if level else LEVEL

"""An MCAP file that is whole at every moment while it is written, and indexed for every reader once it is finished.

    header, attachments, schemas, channels, ( room, messages, message indices )*, attachments, end of data, summary,
    footer

Viewers find messages by an index of chunks, and a chunk says at its front how long it is. So room for that is left
before each piece, as a record of a private kind, which readers skip: until the end the messages stand there by
themselves, and a file that was cut off anywhere holds all that is complete before the cut. When the file is finished
each room becomes the head of a chunk, in one write each. Where pieces end follows from what is in them alone. (MCAP
specification, mcap.dev/spec)
"""

import os
import zlib
from array import array
from struct import Struct
from typing import Any

CHUNK = 256 << 10  # bytes of messages in a piece
PRIVATE = 0x80  # kinds of records from here on are anybody's
HEAD = Struct("<BQ")  # of a record: kind, bytes that follow
CHUNK_HEAD = Struct("<BQQQQIIQ")  # and of a chunk: begin, end, bytes, their checksum, no compression, bytes
MESSAGE = Struct("<BQHIQQ")  # kind, bytes that follow, channel, sequence, log time, publish time
INDEX = Struct("<BQHI")  # kind, bytes that follow, channel, bytes of the index
MESSAGE_REST = MESSAGE.size - HEAD.size


class McapFile:
    """file : runtime.recording.files.WholeFile"""

    def __init__(self, file):
        from mcap.data_stream import RecordBuilder
        from mcap.opcode import Opcode
        from mcap.writer import MCAP0_MAGIC

        self.file, self.builder, self.opcode, self.magic = file, RecordBuilder, Opcode, MCAP0_MAGIC
        self.kind = int(Opcode.MESSAGE)
        self.schemas, self.channels, self.attachments, self.chunks = [], [], [], []
        self.counts = {}  # messages of each channel
        self.first = self.last = None  # log time of all messages, ns
        self.begun: Any = None  # where the room of the piece that is being written stands

    def begin(self, library):
        """library : what writes it"""
        from mcap.records import Header

        self.file.write(self.magic)
        self.record(Header(profile="", library=library))

    def record(self, record):
        builder = self.builder()
        record.write(builder)
        return self.file.write(builder.end())

    def attach(self, name, media_type, data):
        from mcap.records import Attachment

        self.end_piece()
        attachment = Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)
        self.attached(attachment, self.file.tell(), self.record(attachment))

    def attached(self, attachment, offset, length):
        """Where an attachment stands in the file."""
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

    def channel(self, topic, descriptor, name):
        """The number of a new channel of Protobuf messages. descriptor : a serialised FileDescriptorSet; name : of the
        message in it
        """
        from mcap.records import Channel, Schema

        self.end_piece()
        number = len(self.channels) + 1
        self.schemas.append(Schema(id=number, name=name, encoding="protobuf", data=descriptor))
        self.channels.append(
            Channel(id=number, topic=topic, message_encoding="protobuf", schema_id=number, metadata={})
        )
        self.record(self.schemas[-1])
        self.record(self.channels[-1])
        self.counts[number] = 0
        return number

    def message(self, channel, log_time, data, publish_time, sequence=0):
        """log_time, publish_time : ns"""
        if self.begun is None:
            self.begin_piece(self.file.tell())
            self.file.write(HEAD.pack(PRIVATE, CHUNK_HEAD.size - HEAD.size) + bytes(CHUNK_HEAD.size - HEAD.size))
        piece = MESSAGE.pack(self.kind, MESSAGE_REST + len(data), channel, sequence, log_time, publish_time) + data
        self.file.write(piece)
        self.count(channel, log_time, piece)
        if self.size >= CHUNK:
            self.end_piece()

    def begin_piece(self, at):
        """at : of its room"""
        self.begun = at
        self.places, self.size, self.checksum = {}, 0, 0

    def count(self, channel, log_time, piece):
        """A message of the piece. piece : the record"""
        places = self.places.get(channel)
        if places is None:
            places = self.places[channel] = array("Q")
        places.append(log_time)
        places.append(self.size)
        self.size += len(piece)
        self.checksum = zlib.crc32(piece, self.checksum)
        self.counts[channel] += 1

    def end_piece(self):
        """Index the messages of a piece."""
        if self.begun is None:
            return
        at = self.file.tell()
        for index in self.indices():
            self.file.write(index)
        self.indexed(at)

    def indices(self):
        """Of the messages of the piece: a record a channel."""
        for channel, places in self.places.items():
            data = places.tobytes()
            yield INDEX.pack(self.opcode.MESSAGE_INDEX, INDEX.size - HEAD.size + len(data), channel, len(data)) + data

    def indexed(self, at):
        """The piece is over: keep what its chunk will be. at : where its indices begin"""
        from mcap.records import ChunkIndex

        begins, ends = (
            min(min(places[::2]) for places in self.places.values()),
            max(max(places[::2]) for places in self.places.values()),
        )
        offsets, length = {}, 0
        for channel, index in zip(self.places, self.indices()):
            offsets[channel] = at + length
            length += len(index)
        self.chunks.append(
            (
                self.checksum,
                ChunkIndex(
                    chunk_start_offset=self.begun,
                    chunk_length=CHUNK_HEAD.size + self.size,
                    message_start_time=begins,
                    message_end_time=ends,
                    message_index_offsets=offsets,
                    message_index_length=length,
                    compression="",
                    compressed_size=self.size,
                    uncompressed_size=self.size,
                ),
            )
        )
        self.first = begins if self.first is None else min(self.first, begins)
        self.last = ends if self.last is None else max(self.last, ends)
        self.begun = None

    def finish(self):
        """Make chunks of the pieces, and write the summary. OSError"""
        from mcap.records import DataEnd

        self.end_piece()
        self.file.flush()
        for checksum, index in self.chunks:
            size = index.uncompressed_size
            head = CHUNK_HEAD.pack(
                self.opcode.CHUNK,
                CHUNK_HEAD.size - HEAD.size + size,
                index.message_start_time,
                index.message_end_time,
                size,
                checksum,
                0,
                size,
            )
            os.pwrite(self.file.descriptor, head, index.chunk_start_offset)
        self.record(DataEnd(data_section_crc=0))
        self.summarise()

    def summarise(self):
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
        offsets = []
        for kind, records in (
            (opcode.SCHEMA, self.schemas),
            (opcode.CHANNEL, self.channels),
            (opcode.STATISTICS, [statistics]),
            (opcode.CHUNK_INDEX, [index for _, index in self.chunks]),
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

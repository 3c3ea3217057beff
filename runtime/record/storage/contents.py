"""Contents of a recording's file, and how a complete file lists them in its summary."""

from __future__ import annotations

import io
import os
import struct
import zlib
from dataclasses import dataclass, field
from typing import Any

from runtime.record.storage import messages
from runtime.record.storage.chunks import PLACE, Chunk
from runtime.record.storage.correction import corrected
from runtime.record.storage.json_text import parsed_json
from runtime.record.storage.mcap_file import CHUNK_HEAD, HEAD, INDEX
from runtime.record.storage.metadata import describes_signals
from runtime.record.storage.records import (
    ATTACHMENT_INDEX,
    CHANNEL,
    CHUNK_INDEX,
    DAMAGE,
    FOOTER,
    MAGIC,
    SCHEMA,
    STATISTICS,
    read,
    walk,
)

ATTACHMENTS = ("about.json", "diagram.json", "end.json")
FOOTER_FIELDS = struct.Struct("<QQI")


@dataclass
class Contents:
    """Contents of one file.

    about, end, diagram : attachments of these names; None if the file has none
    library : program that wrote the file
    topics : {channel: topic}
    schemas : {channel: (name of the message, serialised FileDescriptorSet)}
    attachments : [(position of the record, its size in bytes)]
    chunks : [Chunk], in order
    written : messages that the recorder has counted; None if that is unknown
    gaps : [(first byte, end)] of damaged bytes between the records
    broken : names of damaged attachments
    is_unfinished : whether its recorder was killed, and the file has everything up to the last flush
    finished, trouble : whether its recorder has written its end; if not, the problem with the file, in one line
    """

    about: Any = None
    end: Any = None
    diagram: Any = None
    library: str = ""
    topics: dict[int, str] = field(default_factory=dict)
    schemas: dict[int, tuple[str, bytes]] = field(default_factory=dict)
    attachments: list[tuple[int, int]] = field(default_factory=list)
    chunks: list[Chunk] = field(default_factory=list)
    written: int | None = None
    gaps: list[tuple[int, int]] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)
    is_unfinished: bool = False
    finished: bool = False
    trouble: str = ""

    def describe(self, channel: Any, schemas: dict[int, Any]) -> None:
        """Take a channel. schemas : {number: record} of the file"""
        schema = schemas.get(channel.schema_id)
        self.topics.setdefault(channel.id, channel.topic)
        self.schemas.setdefault(channel.id, ("", b"") if schema is None else (schema.name, schema.data))

    def number(self) -> None:
        """Take a channel whose record is damaged from the metadata: a recorder numbers channels in a fixed order."""
        if self.about is None or not describes_signals(self.about):
            return
        order = dict(enumerate(messages.topics(self.about), 1))
        differing = [number for number, topic in order.items() if self.topics.get(number) != topic]
        if len(differing) == 1:
            self.topics = order
            self.schemas.setdefault(differing[0], ("", b""))

    def attach(self, body: bytes) -> str:
        """Take an attachment and return its name. A damaged one, with more than one wrong byte, is not used.

        body : bytes after the head of its record

        Raises ValueError if it is not JSON, and BadInput if it is nested too deep.
        """
        mended = corrected(body)
        attachment = read("Attachment", body if mended is None else mended)
        if mended is None:
            self.broken.append(attachment.name)
        elif attachment.name in ATTACHMENTS:
            setattr(self, attachment.name.removesuffix(".json"), parsed_json(attachment.data))
        return attachment.name


def summarised(stream: Any, size: int) -> Contents | None:
    """Return the Contents of a complete file from its summary; None if the file has no valid one.

    stream : file, unbuffered
    size : size of the file, in bytes
    """
    from mcap.exceptions import McapError

    tail = HEAD.size + FOOTER_FIELDS.size + len(MAGIC)
    if size < len(MAGIC) + tail:
        return None
    footer = os.pread(stream.fileno(), tail, size - tail)
    start, _, checksum = FOOTER_FIELDS.unpack_from(footer, HEAD.size)
    if footer[0] != FOOTER or not footer.endswith(MAGIC) or not 0 < start <= size - tail:
        return None
    summary = os.pread(stream.fileno(), size - tail - start, start)
    if checksum == 0 or zlib.crc32(footer[: HEAD.size + 16], zlib.crc32(summary)) != checksum:
        return None
    contents, attachments, indices, schemas = Contents(finished=True), [], [], {}
    try:
        for _, kind, data in walk(io.BytesIO(summary), start):
            body = data[HEAD.size :]
            if kind == SCHEMA:
                schema = read("Schema", body)
                schemas[schema.id] = schema
            elif kind == CHANNEL:
                contents.describe(read("Channel", body), schemas)
            elif kind == CHUNK_INDEX:
                indices.append(read("ChunkIndex", body))
            elif kind == ATTACHMENT_INDEX:
                attachments.append(read("AttachmentIndex", body))
            elif kind == STATISTICS:
                contents.written = read("Statistics", body).message_count
        for entry in sorted(attachments, key=lambda entry: entry.offset):
            if entry.offset + entry.length > size:
                continue
            contents.attachments.append((entry.offset, entry.length))
            if entry.name in ATTACHMENTS:
                data = os.pread(stream.fileno(), entry.length, entry.offset)
                try:
                    contents.attach(data[HEAD.size :])
                except (McapError, *DAMAGE):
                    contents.broken.append(entry.name)
        at = len(MAGIC)
        for index in indices:
            chunk = chunk_of(index)
            if chunk is None or index.chunk_start_offset < at or chunk.end > start:
                return None
            contents.chunks.append(chunk)
            at = chunk.end
    except (McapError, *DAMAGE):
        return None
    if contents.written != sum(sum(chunk.counts.values()) for chunk in contents.chunks):  # some are not in chunks
        return None
    has_end = contents.end is not None or "end.json" in contents.broken
    return contents if contents.about is not None and has_end else None


def chunk_of(index: Any) -> Chunk | None:
    """Return the Chunk of a ChunkIndex; None if its fields contradict each other."""
    head = CHUNK_HEAD.size + len(index.compression)
    end = index.chunk_start_offset + index.chunk_length
    places = sorted((offset, channel) for channel, offset in index.message_index_offsets.items())
    if index.chunk_length != head + index.compressed_size or not places or places[0][0] != end:
        return None
    ends = [offset for offset, _ in places[1:]] + [end + index.message_index_length]
    counts = {}
    for (offset, channel), until in zip(places, ends):
        counts[channel], rest = divmod(until - offset - INDEX.size, PLACE.itemsize)
        if rest or counts[channel] < 1:
            return None
    return Chunk(
        index.chunk_start_offset,
        index.chunk_start_offset + head,
        index.compressed_size,
        index.compression,
        index.uncompressed_size,
        end + index.message_index_length,
        counts,
    )

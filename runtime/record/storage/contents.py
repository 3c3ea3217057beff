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
from runtime.record.storage.correction import correct_byte
from runtime.record.storage.json_text import parsed_json
from runtime.record.storage.mcap_file import CHUNK_HEAD, HEAD, INDEX
from runtime.record.storage.metadata import describes_signals
from runtime.record.storage.records import (
    ATTACHMENT,
    ATTACHMENT_INDEX,
    CHANNEL,
    CHUNK_INDEX,
    DAMAGE,
    DATA_END,
    FOOTER,
    HEADER,
    LIBRARY,
    MAGIC,
    METADATA,
    SCHEMA,
    STATISTICS,
    read,
    walk,
)

ATTACHMENTS = ("about.json", "diagram.json", "end.json")
FOOTER_FIELDS = struct.Struct("<QQI")
# of a recording, with its profile and library
OWN_HEADER = HEAD.pack(HEADER, 8 + len(LIBRARY)) + bytes(4) + struct.pack("<I", len(LIBRARY)) + LIBRARY.encode()


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
    damages : other damages that affect no tick, each as the end of a sentence
    is_unfinished : whether its recorder was killed, and the file has everything up to the last flush
    finished, trouble : whether its recorder has written its end; if not, the problem with the file, in one line
    """

    about: Any = None
    end: Any = None
    diagram: Any = None
    library: str = ""
    topics: dict[int, str] = field(default_factory=dict[int, str])
    schemas: dict[int, tuple[str, bytes]] = field(default_factory=dict[int, tuple[str, bytes]])
    attachments: list[tuple[int, int]] = field(default_factory=list[tuple[int, int]])
    chunks: list[Chunk] = field(default_factory=list["Chunk"])
    written: int | None = None
    gaps: list[tuple[int, int]] = field(default_factory=list[tuple[int, int]])
    broken: list[str] = field(default_factory=list[str])
    damages: list[str] = field(default_factory=list[str])
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
        mended = correct_byte(body)
        attachment = read("Attachment", body if mended is None else mended)
        if mended is None:
            self.broken.append(attachment.name)
        elif attachment.name in ATTACHMENTS:
            setattr(self, attachment.name.removesuffix(".json"), parsed_json(attachment.data))
        return attachment.name


def read_summary(stream: Any, size: int) -> Contents | None:
    """Return the Contents of a complete file from its summary; None if the file has no valid one.

    stream : file, unbuffered
    size : size of the file, in bytes
    """
    from mcap.exceptions import McapError

    found = summary_in(stream.fileno(), size)
    if found is None:
        return None
    start, summary = found
    contents = Contents(finished=True)
    attachments: list[Any] = []
    indices: list[Any] = []
    schemas: dict[int, Any] = {}
    copies = {OWN_HEADER} & {os.pread(stream.fileno(), len(OWN_HEADER), len(MAGIC))}  # of records without a checksum
    try:
        for _, kind, data in walk(io.BytesIO(summary), start):
            body = data[HEAD.size :]
            if kind in (SCHEMA, CHANNEL):
                copies.add(data)
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
            if os.pread(stream.fileno(), HEAD.size, entry.offset) != HEAD.pack(ATTACHMENT, entry.length - HEAD.size):
                contents.damages.append(differing(entry.offset, entry.offset + HEAD.size))
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
    if contents.about is None or not has_end:
        return None
    chunks = [(chunk.at, chunk.end) for chunk in contents.chunks]
    at = 0
    for begin, end in sorted([*chunks, *((place, place + length) for place, length in contents.attachments)]):
        contents.damages += unprotected_damages(os.pread(stream.fileno(), max(0, begin - at), at), at, copies)
        at = max(at, end)
    contents.damages += unprotected_damages(os.pread(stream.fileno(), start - at, at), at, copies)
    return contents


def summary_in(descriptor: int, size: int) -> tuple[int, bytes] | None:
    """Return (position, bytes) of the summary of a file; None without a summary with a valid checksum.

    size : of the file, in bytes
    """
    tail = HEAD.size + FOOTER_FIELDS.size + len(MAGIC)
    if size < len(MAGIC) + tail:
        return None
    footer = os.pread(descriptor, tail, size - tail)
    start, _, checksum = FOOTER_FIELDS.unpack_from(footer, HEAD.size)
    if footer[0] != FOOTER or not footer.endswith(MAGIC) or not 0 < start <= size - tail:
        return None
    summary = os.pread(descriptor, size - tail - start, start)
    if checksum == 0 or zlib.crc32(footer[: HEAD.size + 16], zlib.crc32(summary)) != checksum:
        return None
    return start, summary


def unprotected_damages(data: bytes, at: int, copies: set[bytes]) -> list[str]:
    """Return the damages, as in Contents, of records that have no checksum.

    data : records between the chunks and attachments of a complete file; its magic bytes and header, if `at` is 0
    at : position in the file
    copies : records of schemas and channels in the summary, whose checksum is valid, and OWN_HEADER in a recording
    """
    place = len(MAGIC) * (at == 0 and data.startswith(MAGIC))
    while place + HEAD.size <= len(data):
        kind, length = HEAD.unpack_from(data, place)
        record = data[place : place + HEAD.size + length]
        if len(record) < HEAD.size + length or not is_confirmed(kind, record, copies):
            break
        place += len(record)
    if place == len(data):
        return []
    return [differing(at + place, at + len(data))]


def differing(begin: int, end: int) -> str:
    """Return the damage of bytes that the summary of a file does not confirm. begin, end : of the bytes"""
    return f"is damaged: its bytes {begin} to {end - 1} are not those that its summary describes"


def is_confirmed(kind: int, record: bytes, copies: set[bytes]) -> bool:
    """Return whether a record that has no checksum is as a writer writes it. copies : as for `unconfirmed`"""
    if kind == HEADER:  # of another writer, it has another size
        return record == OWN_HEADER or len(record) != len(OWN_HEADER)
    if kind == DATA_END:
        return len(record) == HEAD.size + 4 and (record.endswith(bytes(4)) or OWN_HEADER not in copies)
    return kind == METADATA or record in copies


def chunk_of(index: Any) -> Chunk | None:
    """Return the Chunk of a ChunkIndex; None if its fields contradict each other."""
    head = CHUNK_HEAD.size + len(index.compression)
    end = index.chunk_start_offset + index.chunk_length
    places = sorted((offset, channel) for channel, offset in index.message_index_offsets.items())
    if index.chunk_length != head + index.compressed_size or not places or places[0][0] != end:
        return None
    ends = [offset for offset, _ in places[1:]] + [end + index.message_index_length]
    counts: dict[int, int] = {}
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

"""Scan of a recording's file, record by record: where its chunks are, whatever is damaged between them.

Chunks are skipped: runtime.record.storage.check checks them. After damaged bytes, the scan continues with the next
head of a record.
"""

import os
import re
import zlib
from collections.abc import Callable
from typing import Any

from runtime.host.errors import BadInput
from runtime.record.storage.chunks import (
    CHUNK_LIMIT,
    ROOMS,
    Chunk,
    ExpansionLimit,
    Messages,
    head_of,
    load,
    walk_messages,
)
from runtime.record.storage.chunks import STREAM as STREAM_OF_ZSTD
from runtime.record.storage.contents import OWN_HEADER, Contents, summary_in, unprotected_damages
from runtime.record.storage.json_text import DEPTH_LIMIT, TooDeep
from runtime.record.storage.mcap_file import (
    CHUNK_HEAD,
    CHUNK_HEADS,
    HEAD,
    INDEX,
    MESSAGE,
    ROOM,
    STREAM,
    ZSTD,
    stamps_of,
)
from runtime.record.storage.metadata import validate
from runtime.record.storage.records import (
    A_CHUNK,
    A_MESSAGE,
    AN_INDEX,
    ATTACHMENT,
    CHANNEL,
    COMPRESSION_AT,
    DAMAGE,
    DATA_END,
    FOOTER,
    HEADER,
    KINDS,
    LIBRARY,
    MAGIC,
    METADATA,
    RECORD_LIMIT,
    SCHEMA,
    STATISTICS,
    read,
)
from runtime.record.storage.zstd_stream import decode, is_torn

CUT = "is incomplete: it was truncated"
UNFINISHED = "is unfinished, and complete up to its last flush: its recorder was killed, or is still recording"
COMPLETED = "was completed later: its recorder was killed, or it was truncated"
WINDOW = 2 << 20  # bytes in which the end of messages without a chunk is searched
DATA = {SCHEMA, CHANNEL, ATTACHMENT, METADATA, DATA_END}  # kinds of records beside chunks and messages
SUMMARY = KINDS - {HEADER, FOOTER, ATTACHMENT, METADATA, DATA_END, ROOM, STREAM, A_MESSAGE, A_CHUNK, AN_INDEX}
PADDING = 64  # zeros at the end of a file, after a power cut; messages end with fewer
HEAD_LIMIT = 128  # bytes of the head of a chunk, and of what a record is recognised by
MAGIC_MATCHES = len(MAGIC) - 1  # bytes of the first ones of a file that are right
# begins of records: a chunk, a schema and a channel of a recorder, an attachment, the end of the data, a chunk without
# a head
HEADS = re.compile(
    rb"(?=\x06.{4}\0{4}.{16}.{4}\0{4}.{4}(?:\0{4}|\x04\0{3}zstd|\x03\0{3}lz4)"
    rb"|\x03.{4}\0{4}.{2}.\0{3}tickwork\."
    rb"|\x04.{3}\0{5}.{4}.\0{3}/"
    rb"|\x09.{4}\0{4}.{16}.\0{3}(?:about|diagram|end)\.json"
    rb"|\x0f\x04\0{7}.{4}\x03.{4}\0{4}.{2}.\0{3}tickwork\."
    rb"|"
    + b"|".join(
        re.escape(room[: HEAD.size]) + rb".{20}\0{4}.{4}" + re.escape(room[COMPRESSION_AT:-8]) + rb".{4}\0{4}"
        for room in ROOMS.values()
    )
    + rb")",
    re.DOTALL,
)


class Scan:
    """Scan of one file.

    stream : file, unbuffered
    size : size of the file, in bytes
    progress : called with the fraction that has been scanned

    contents : Contents

    Raises BadInput if the file is not a recording that can be read.
    """

    def __init__(self, stream: Any, size: int, progress: Callable[[float], None]) -> None:
        from mcap.exceptions import McapError

        self.path, self.descriptor, self.size = stream.name, stream.fileno(), size
        self.contents = Contents()
        self.expansion = ExpansionLimit(size)
        self.schemas: dict[int, Any] = {}  # {number: record}
        self.is_cut = False  # in a zstd frame
        self.is_unfinished = False  # whether the last chunk was not completed, and has all messages of its last flush
        self.is_damaged = False  # whether messages of a chunk without a head are not those of its checksum
        self.is_over = False  # whether the end of the data was reached
        begin = zip(self.bytes_at(0, len(MAGIC)), MAGIC)
        at = len(MAGIC) if sum(byte == right for byte, right in begin) >= MAGIC_MATCHES else 0
        first = at + self.length_of_header() if at else 0
        if unprotected_damages(self.bytes_at(0, first), 0, {OWN_HEADER}):
            self.contents.damages.append(f"is damaged in its first {first} bytes")
        known = at  # end of what is certain: a wrong length leads from a record to a wrong place
        while at and not self.contents.finished:
            progress(at / size)
            self.good = self.at = at
            try:
                following = self.record(at)
            except (McapError, *DAMAGE):
                following = None
            chunks = self.contents.chunks
            if chunks and chunks[-1].at == at:
                known = chunks[-1].begin + chunks[-1].length
            elif following is not None:
                known = at + 1
            if following is None:
                following = self.head_after(known)
                if following is None or self.is_over:
                    break
                if following > self.good:
                    self.contents.gaps.append((self.good, following))
                known = following + 1
            self.good = at = following
        self.good = at if at == 0 else self.good
        self.contents.number()
        self.contents.trouble = self.trouble()
        self.contents.finished = not self.contents.trouble and not self.contents.gaps

    def head_after(self, at: int) -> int | None:
        """Return the position of the next valid head of a record from a position on; None without one."""
        while at < self.size:
            window = self.bytes_at(at, WINDOW)
            for match in HEADS.finditer(window):
                if self.is_head(at + match.start()):
                    return at + match.start()
            if len(window) < WINDOW:
                return None
            at += len(window) - HEAD_LIMIT
        return None

    def is_head(self, at: int) -> bool:
        """Return whether a record begins at a position, and another one or the end of the file follows it."""
        raw = self.bytes_at(at, HEAD_LIMIT)
        kind, length = HEAD.unpack_from(raw)
        if kind in (ROOM, STREAM):
            return True
        end = at + HEAD.size + length
        if kind == A_CHUNK:
            try:
                _, _, size, _, stored = head_of(raw)
            except DAMAGE:
                return False
            if max(size, stored) > CHUNK_LIMIT:
                return False
            if end > self.size:
                return True
        return end == self.size or end < self.size and self.bytes_at(end, 1)[0] in KINDS

    def bytes_at(self, at: int, length: int) -> bytes:
        """Return the bytes at a position of the file; fewer at its end."""
        return os.pread(self.descriptor, length, at)

    def record(self, at: int) -> int | None:
        """Take the record at a position. Returns the position of the next one, or None at the end."""
        head = self.bytes_at(at, HEAD.size)
        if len(head) < HEAD.size:
            return None
        kind, length = HEAD.unpack(head)
        end = at + HEAD.size + length
        self.is_unfinished = False
        if kind == ROOM and length == CHUNK_HEAD.size - HEAD.size:
            return self.take_loose_messages(at, at + CHUNK_HEAD.size)
        if kind == STREAM:
            return self.stream(at)
        if kind == A_CHUNK:
            return self.chunk(at, end)
        if kind == A_MESSAGE and end <= self.size:
            return self.take_loose_messages(at, at)
        if end > self.size or not self.is_expected(kind, at, end):
            return None
        self.is_over |= kind == DATA_END
        if kind in (HEADER, ATTACHMENT, SCHEMA, CHANNEL, STATISTICS, FOOTER):
            self.take(kind, self.bytes_at(at + HEAD.size, length))
        if kind == ATTACHMENT:
            self.contents.attachments.append((at, end - at))  # one that can be read
        return end

    def is_expected(self, kind: int, at: int, end: int) -> bool:
        """Return whether a record of a kind can be at a position. end : end of the record"""
        if kind == FOOTER:
            return end + len(MAGIC) == self.size
        if kind == HEADER:
            return at == len(MAGIC)
        return kind in (SUMMARY if self.is_over else DATA)

    def take(self, kind: int, body: bytes) -> None:
        """Take a record that is not a message. body : bytes after its head"""
        contents = self.contents
        if kind == HEADER:
            contents.library = read("Header", body).library
        elif kind == ATTACHMENT:
            try:
                name = contents.attach(body)
            except TooDeep:
                name = read("Attachment", body).name
                raise BadInput(
                    f"{self.path} is damaged: its {name} is nested more than {DEPTH_LIMIT} levels deep"
                ) from None
            if name == "about.json" and contents.about is not None:
                validate(self.path, contents.about)
        elif kind == SCHEMA:
            schema = read("Schema", body)
            self.schemas.setdefault(schema.id, schema)
        elif kind == CHANNEL:
            channel = read("Channel", body)
            if not (self.is_over and channel.topic in contents.topics.values()):  # a copy, in a damaged summary
                contents.describe(channel, self.schemas)
        elif kind == STATISTICS:
            contents.written = read("Statistics", body).message_count
        else:
            contents.finished = True
            if summary_in(self.descriptor, self.size) is None and not self.has_no_checksum(body):
                contents.damages.append("is damaged: the checksum of its summary is wrong")

    def length_of_header(self) -> int:
        """Return the length of the first record, which another writer may have written; else that of a recording."""
        kind, length = HEAD.unpack(self.bytes_at(len(MAGIC), HEAD.size).ljust(HEAD.size, b"\0"))
        return HEAD.size + length if kind == HEADER and length < HEAD_LIMIT else len(OWN_HEADER)

    def has_no_checksum(self, footer: bytes) -> bool:
        """Return whether the summary was written without a checksum: by another writer, with a correct end."""
        end = self.bytes_at(self.size - len(MAGIC), len(MAGIC))
        return read("Footer", footer).summary_crc == 0 and end == MAGIC and self.contents.library != LIBRARY

    def chunk(self, at: int, end: int) -> int | None:
        """Take a chunk. end : end of its record. Returns as `record`"""
        head, compression, expanded, _, stored = head_of(self.bytes_at(at, HEAD_LIMIT))
        if end > self.size:
            if not compression:
                return self.take_loose_messages(at, at + CHUNK_HEAD.size)
            return self.stream(at) if compression == ZSTD else None
        counts, after = self.indices(end)
        following = self.bytes_at(after, HEAD.size)
        if len(following) < HEAD.size or after + HEAD.size + HEAD.unpack(following)[1] > self.size:
            counts = {}  # an index may be missing
        self.add(Chunk(at, at + head, stored, compression, expanded, after, counts))
        return after

    def stream(self, at: int) -> int | None:
        """Take the messages of a zstd chunk without a head or without its end, up to its last complete block.

        Returns as `record`.
        """
        head = self.bytes_at(at, CHUNK_HEADS[ZSTD].size)  # before the messages, of a file that is being recorded
        begin = at + len(head)
        frame = self.bytes_at(begin, CHUNK_LIMIT)
        limit = min(CHUNK_LIMIT, self.expansion.left)
        content, ends, ended = decode(frame, limit)
        if is_padding(frame[ends[-1][0] :]):  # zeros after a power cut, which may begin inside the last block
            content, ends, ended = decode(frame.rstrip(b"\0"), limit)
        self.expansion.left -= len(content)
        used, checksum = self.verified_part(head, content)
        ended &= used == len(content)
        end = begin + max(place for place, length in ends if length <= used)
        counts, after = self.indices(end) if ended else ({}, end)
        self.is_cut = not ended and is_torn(frame[ends[-1][0] :])
        if used:
            chunk = Chunk(at, begin, end - begin, STREAM_OF_ZSTD, used, after, counts, True, checksum)
            self.add(chunk, walk_messages(content[:used]))
        if not ended:
            self.good = end if used else at
        return after if ended else None

    def verified_part(self, head: bytes, content: Any) -> tuple[int, int | None]:
        """Return (bytes that are used, their checksum) of the messages of a chunk that was not completed.

        The checksum is None for a file of an earlier version, and one that was cut within the messages of the last
        flush: all are then used, as unverified ones.

        head : offset of the chunk's head in the file
        content : messages
        """
        is_room = head[:1] in (bytes([ROOM]), bytes([STREAM]))
        stamps, stored = stamps_of(head, ZSTD if head[0] == STREAM else "") if is_room else ([], 0)
        right = [stamp for stamp in stamps if stamp[0] <= len(content) and zlib.crc32(content[: stamp[0]]) == stamp[1]]
        is_empty = is_room and self.at + len(head) == self.size
        self.is_unfinished = right[:1] == stamps[:1] if stamps else is_empty
        if right and self.is_unfinished:
            return right[0]
        rest = self.bytes_at(self.at + len(head), stored) if stamps else b""
        if not stamps or len(rest) < stored or is_padding(rest[-PADDING:]):
            return len(content), None
        self.is_damaged = True
        return right[0] if right else (0, None)

    def take_loose_messages(self, at: int, begin: int) -> int | None:
        """Take messages that are not in a chunk, or in one that the end of the file cuts. Returns as `record`.

        at : of their chunk, if any
        begin : offset of the first message
        """
        window, limit = WINDOW, RECORD_LIMIT
        head = self.bytes_at(at, begin - at)
        while True:
            raw = self.bytes_at(begin, window)
            messages = walk_messages(raw, only_messages=True)
            torn = len(raw) - messages.end < MESSAGE.size or raw[messages.end] == A_MESSAGE
            if not torn or len(raw) < window or window > limit:
                break
            window *= 4
        if len(raw) < window and is_padding(raw[messages.end :]):  # it may begin inside the last message
            messages = walk_messages(raw.rstrip(b"\0"), only_messages=True)
        used, checksum = self.verified_part(head, raw[: messages.end])
        end = begin + used
        if not used:
            return begin if begin > at and not messages.end and not self.is_damaged else None
        counts, after = self.indices(end)
        self.add(Chunk(at, begin, used, "", used, after, counts, True, checksum), messages.until(used))
        if used < messages.end or self.is_unfinished and after == end:
            self.good = end
            return None
        return after

    def indices(self, at: int) -> tuple[dict[int, int], int]:
        """Return ({channel: number of messages}, position of their end) of the message indices at a position."""
        counts: dict[int, int] = {}
        while len(head := self.bytes_at(at, INDEX.size)) == INDEX.size:
            kind, length, channel, size = INDEX.unpack(head)
            if kind != AN_INDEX or length != INDEX.size - HEAD.size + size or at + HEAD.size + length > self.size:
                break
            counts[channel] = size // 16
            at += HEAD.size + length
        return counts, at

    def add(self, chunk: Chunk, messages: Messages | None = None) -> None:
        """Add a chunk, read if it may describe channels. messages : its messages, if they have been read"""
        contents = self.contents
        if messages is not None or not chunk.counts or not chunk.counts.keys() <= contents.topics.keys():
            try:
                if messages is None:
                    if chunk.compression:
                        self.expansion.admit(chunk.size)
                    messages = load(self.descriptor, chunk)
                for kind, body in messages.others:
                    self.take(kind, body)
            except DAMAGE:
                pass  # the check of chunks reports it
        contents.chunks.append(chunk)

    def trouble(self) -> str:
        """Return the problem with the file, in one line; "" without one. Gaps are not part of it."""
        contents, path = self.contents, self.path
        if not contents.finished:
            if self.is_unfinished:
                contents.is_unfinished = True
                return f"{path} {UNFINISHED}"
            if not self.is_damaged and (self.is_cut or self.is_torn()):
                return f"{path} {CUT}"
            if self.is_over:
                return f"{path} is damaged: its summary is not readable from byte {self.good} on; no tick is missing"
            if self.good < self.size:
                contents.gaps.append((self.good, self.size))
            return ""
        contents.is_unfinished = contents.end is None and not contents.broken
        return f"{path} {COMPLETED}" if contents.is_unfinished else ""

    def is_torn(self) -> bool:
        """Return whether the file ends in the record from which on it is not readable."""
        head = self.bytes_at(self.good, HEAD.size)
        kind, length = HEAD.unpack(head) if len(head) == HEAD.size else (HEADER, 0)
        return HEADER <= kind <= DATA_END and length < RECORD_LIMIT and self.good + HEAD.size + length >= self.size


def is_padding(data: bytes) -> bool:
    """Return whether the rest of a file is zeros, as a power cut leaves them."""
    return bool(data) and not data.strip(b"\0")

"""Scan of a recording's file, record by record, up to where it was cut off or is damaged.

Chunks are skipped, unless they are to be checked.
"""

import os
from collections import Counter
from collections.abc import Callable
from typing import Any

from runtime.base.errors import BadInput
from runtime.recording.check import Check
from runtime.recording.chunks import CHUNK_LIMIT, Chunk, ExpansionLimit, Messages, TooLarge, head_of, load, walked
from runtime.recording.chunks import STREAM as STREAM_OF_ZSTD
from runtime.recording.columns import Layout
from runtime.recording.contents import Contents
from runtime.recording.json_text import DEPTH_LIMIT, TooDeep
from runtime.recording.mcap_file import CHUNK_HEAD, CHUNK_HEADS, HEAD, INDEX, MESSAGE, ROOM, STREAM, ZSTD
from runtime.recording.metadata import validate
from runtime.recording.records import (
    A_CHUNK,
    A_MESSAGE,
    AN_INDEX,
    ATTACHMENT,
    CHANNEL,
    DAMAGE,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    RECORD_LIMIT,
    SCHEMA,
    STATISTICS,
    is_compressed,
    read,
)
from runtime.recording.zstd_stream import decode, is_torn

CUT = "is incomplete: it was truncated, or is still being recorded"
COMPLETED = "was truncated, and was completed later up to the cut"
WINDOW = 2 << 20  # bytes in which the end of messages without a chunk is searched
HEAD_LIMIT = 128  # bytes of the head of a chunk


class Scan:
    """Scan of one file.

    stream : file, unbuffered
    size : of the file, in bytes
    deep : whether every message is checked
    progress : called with the fraction that has been scanned

    contents : Contents, up to the first damage

    Raises BadInput if the file is not a recording that can be read.
    """

    def __init__(self, stream: Any, size: int, deep: bool, progress: Callable[[float], None]) -> None:
        from mcap.exceptions import McapError

        self.path, self.descriptor, self.size, self.deep = stream.name, stream.fileno(), size, deep
        self.contents = Contents()
        self.expansion, self.checker = ExpansionLimit(size), None
        self.counts = Counter()  # {channel: number of messages}
        self.schemas = {}  # {number: record}
        self.written = None  # messages that the recorder has counted
        self.unchecked = None  # position of a chunk with a wrong checksum
        self.is_cut = False  # in a zstd frame
        self.refused = ""  # why the rest of the file is not read
        at = len(MAGIC) if self.bytes_at(0, len(MAGIC)) == MAGIC else 0
        try:
            while at and not self.contents.finished:
                progress(at / size)
                self.good = at
                following = self.record(at)
                if following is None:
                    break
                at = following
        except (McapError, *DAMAGE) as error:
            self.refused = str(error) if isinstance(error, TooLarge) else ""
        self.good = at if at == 0 else self.good
        self.contents.trouble = self.trouble()
        self.contents.finished = not self.contents.trouble

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
        if kind == ROOM and length == CHUNK_HEAD.size - HEAD.size:
            return self.unchunked(at, at + CHUNK_HEAD.size)
        if kind == STREAM:
            return self.stream(at)
        if kind == A_CHUNK:
            return self.chunk(at, end)
        if kind == A_MESSAGE and end <= self.size:
            return self.unchunked(at, at)
        if end > self.size or kind == 0:
            return None
        if kind in (HEADER, ATTACHMENT, SCHEMA, CHANNEL, STATISTICS, FOOTER):
            self.take(kind, self.bytes_at(at + HEAD.size, length))
        if kind == ATTACHMENT:
            self.contents.attachments.append((at, end - at))  # one that can be read
        return end

    def take(self, kind: int, body: bytes) -> None:
        """Take a record that is not a message. body : bytes after its head"""
        contents = self.contents
        if kind == HEADER:
            contents.library = read("Header", body).library
        elif kind == ATTACHMENT:
            attachment = read("Attachment", body)
            try:
                contents.attach(attachment.name, attachment.data)
            except TooDeep:
                raise BadInput(
                    f"{self.path} is damaged: its {attachment.name} is nested more than {DEPTH_LIMIT} levels deep"
                ) from None
            if attachment.name == "about.json":
                validate(self.path, contents.about)
        elif kind == SCHEMA:
            schema = read("Schema", body)
            self.schemas[schema.id] = schema
        elif kind == CHANNEL:
            contents.describe(read("Channel", body), self.schemas)
        elif kind == STATISTICS:
            self.written = read("Statistics", body).message_count
        else:
            contents.finished = True

    def chunk(self, at: int, end: int) -> int | None:
        """Take a chunk. end : of its record. Returns as `record`"""
        raw = self.bytes_at(at, HEAD_LIMIT)
        compressed = not is_compressed(raw, "")
        if not compressed and end > self.size:
            return self.unchunked(at, at + CHUNK_HEAD.size)
        if end > self.size:
            return self.stream(at) if is_compressed(raw, ZSTD) else None
        head, compression, expanded, _, stored = head_of(raw)
        counts, after = self.indices(end)
        following = self.bytes_at(after, HEAD.size)
        if len(following) < HEAD.size or after + HEAD.size + HEAD.unpack(following)[1] > self.size:
            counts = {}  # an index may be missing
        chunk = Chunk(at, at + head, stored, compression, expanded, after, counts)
        try:
            self.add(chunk)
        except ValueError:
            if compressed:
                raise
            self.unchecked = at if self.unchecked is None else self.unchecked
            return self.unchunked(at, at + CHUNK_HEAD.size)
        return None if chunk.limit is not None else after

    def stream(self, at: int) -> int | None:
        """Take the messages of a zstd chunk without a head or without its end, up to its last complete block.

        Returns as `record`.
        """
        begin = at + CHUNK_HEADS[ZSTD].size
        frame = self.bytes_at(begin, CHUNK_LIMIT)
        content, ends, ended = decode(frame, min(CHUNK_LIMIT, self.expansion.left))
        self.expansion.left -= len(content)
        end = begin + ends[-1][0]
        counts, after = self.indices(end) if ended else ({}, end)
        self.is_cut = not ended and is_torn(frame[ends[-1][0] :])
        if content:
            self.add(
                Chunk(at, begin, end - begin, STREAM_OF_ZSTD, len(content), after, counts, headless=True),
                walked(content),
            )
        if not ended:
            self.good = end
        return after if ended else None

    def unchunked(self, at: int, begin: int) -> int | None:
        """Take messages that are not in a chunk, or in one with a wrong checksum. Returns as `record`.

        at : of their chunk, if any
        begin : of the first message
        """
        window, limit = WINDOW, RECORD_LIMIT
        while True:
            raw = self.bytes_at(begin, window)
            messages = walked(raw, only_messages=True)
            torn = len(raw) - messages.end < MESSAGE.size or raw[messages.end] == A_MESSAGE
            if not torn or len(raw) < window or window > limit:
                break
            window *= 4
        end = begin + messages.end
        if not messages.end:
            return begin if begin > at else None
        counts, after = self.indices(end)
        chunk = Chunk(at, begin, messages.end, "", messages.end, after, counts, headless=True)
        self.add(chunk, messages)
        return None if chunk.limit is not None else after

    def indices(self, at: int) -> tuple[dict[int, int], int]:
        """Return ({channel: number of messages}, position of their end) of the message indices at a position."""
        counts = {}
        while len(head := self.bytes_at(at, INDEX.size)) == INDEX.size:
            kind, length, channel, size = INDEX.unpack(head)
            if kind != AN_INDEX or at + HEAD.size + length > self.size:
                break
            counts[channel] = size // 16
            at += HEAD.size + length
        return counts, at

    def add(self, chunk: Chunk, messages: Messages | None = None) -> None:
        """Add a chunk, read if necessary. messages : its messages, if they have been read"""
        contents = self.contents
        if self.deep or messages is not None or not chunk.counts or not chunk.counts.keys() <= contents.topics.keys():
            if messages is None:
                if chunk.compression:
                    self.expansion.admit(chunk.size)
                messages = load(self.descriptor, chunk)
            for kind, body in messages.others:
                self.take(kind, body)
            if self.deep or chunk.headless:  # without a head there is no checksum
                chunk.limit = self.check(messages)
                messages = messages if chunk.limit is None else messages.until(chunk.limit)
            chunk.counts = {channel: len(offsets) for channel, offsets in messages.offsets.items()}
        if chunk.limit is not None:
            self.good = chunk.at if chunk.compression else chunk.begin + chunk.limit
        contents.chunks.append(chunk)
        self.counts.update(chunk.counts)

    def check(self, messages: Messages) -> int | None:
        """Return the position of the first damaged message of a chunk; None without one."""
        contents = self.contents
        if contents.about is None:
            raise ValueError("messages before the metadata")
        if self.checker is None or not self.deep or self.checker.layout.topics != contents.topics:
            self.checker = Check(Layout(self.path, contents.about, dict(contents.topics)), self.counts)
        return self.checker.first_damaged(messages)

    def trouble(self) -> str:
        """Return the problem with the file, in one line; "" without one."""
        contents, path = self.contents, self.path
        if not contents.finished:
            return f"{path} {self.refused or self.damage()}"
        if self.unchecked is not None:
            return f"{path} is damaged after byte {self.unchecked}: wrong checksum"
        count = sum(self.counts.values())
        if self.written not in (None, count):
            return f"{path} is damaged: {count} of its {self.written} messages are readable"
        return "" if contents.end is not None else f"{path} {COMPLETED}"

    def damage(self) -> str:
        """Return the problem with a file that is undamaged up to a byte, as the end of a sentence."""
        if self.is_cut:
            return CUT
        head = self.bytes_at(self.good, HEAD.size)
        kind, length = HEAD.unpack(head) if len(head) == HEAD.size else (HEADER, 0)
        if HEADER <= kind <= DATA_END and length < RECORD_LIMIT and self.good + HEAD.size + length >= self.size:
            return CUT
        return f"is damaged from byte {self.good} of {self.size} on and is read up to there"

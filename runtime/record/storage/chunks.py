"""Chunks of an MCAP file, and where their messages are.

A recording is untrusted: a few kilobytes can declare, and expand to, gigabytes. What a chunk and a file expand to has a
limit, whatever they declare, and an index is used only if it describes the records of its chunk.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from runtime.record.storage.mcap_file import CHUNK_HEAD, HEAD, INDEX, MESSAGE, MESSAGE_REST, ZSTD, head_space, stamps_of
from runtime.record.storage.records import A_CHUNK, A_MESSAGE, AN_INDEX, CHANNEL, CHUNK_LIMIT, SCHEMA
from runtime.record.storage.zstd_stream import decode

FILE_RATIO_LIMIT, FILE_LIMIT_MINIMUM = 100, 16 << 20  # all chunks of a file: times its size, and at least these bytes
ROOMS = {name: head_space(name) for name in ("", ZSTD)}  # what the head of a chunk replaces
STREAM = "zstd stream"  # compression of a chunk that was not completed, and may end anywhere
# bytes of a message record, as a NumPy dtype
MESSAGE_HEAD = [
    ("kind", "u1"),
    ("length", "<u8"),
    ("channel", "<u2"),
    ("sequence", "<u4"),
    ("log_time", "<i8"),
    ("publish_time", "<i8"),
]
BEGIN = np.dtype(MESSAGE_HEAD)
PLACE = np.dtype([("log_time", "<u8"), ("offset", "<u8")])  # of a message, in an index


class TooLarge(ValueError):
    """A chunk expands to more than is read. The text continues after the name of the file."""


class Stored(NamedTuple):
    """Stored bytes of a chunk, with the field names of mcap.records.Chunk."""

    compression: str
    data: Any
    uncompressed_size: int


@dataclass
class Chunk:
    """Place of a chunk in a file, or of messages that were not completed to one.

    at : position of its record
    begin, length : position and size of its messages as they are stored, in bytes
    compression : "", "zstd", "lz4", or STREAM
    size : size of its messages, in bytes
    end : position at which its message indices end
    counts : {channel: number of messages}
    headless : whether it has no head of a chunk
    checksum : checksum of the messages of a chunk without a head; None if the file has none
    is_unverified : whether the file has no checksum of its messages
    is_indexed : whether its message indices, and the times in its head, are undamaged; this and `is_unverified` are
        known after `load`
    limit : bytes of its messages that are undamaged; None for all
    trim : {channel: (number of its first messages, of its last messages) that are not used}, of incomplete rows beside
        a gap
    """

    at: int
    begin: int
    length: int
    compression: str
    size: int
    end: int
    counts: dict[int, int] = field(default_factory=dict[int, int])
    headless: bool = False
    checksum: int | None = None
    is_unverified: bool = False
    is_indexed: bool = True
    limit: int | None = None
    trim: dict[int, tuple[int, int]] = field(default_factory=dict[int, tuple[int, int]])


class Messages(NamedTuple):
    """Messages of a chunk.

    data : its records, as an array of bytes
    offsets : {channel: positions of its message records in `data`}
    end : bytes that could be read
    others : [(kind, bytes)] of its schemas and channels
    """

    data: np.ndarray
    offsets: dict[int, np.ndarray]
    end: int
    others: list[tuple[int, bytes]]

    def bodies(self, channel: int, kind: np.dtype) -> Any:
        """Return the contents of the messages of a channel as a structured array. Arguments, errors: see `records`"""
        return self.records(channel, kind)["body"]

    def records(self, channel: int, kind: np.dtype) -> Any:
        """Return the messages of a channel as a structured array: the fields of MESSAGE_HEAD and "body".

        kind : dtype of the content

        Raises ValueError if a message has another size.
        """
        record = np.dtype([*MESSAGE_HEAD, ("body", kind)])
        messages = take_records(self.data, self.offsets.get(channel, NONE), record)
        if np.any(messages["length"] != record.itemsize - HEAD.size):
            raise ValueError("a row of another size")
        return messages

    def in_order(self) -> Iterator[bytes]:
        """Yield the message records in the order of the file."""
        plain, head = self.data.tobytes(), HEAD.unpack_from
        for at in np.sort(np.concatenate([NONE, *self.offsets.values()])).tolist():
            yield plain[at : at + HEAD.size + head(plain, at)[1]]

    def until(self, limit: int) -> Messages:
        """Return the messages that begin before a position."""
        kept = {channel: offsets[offsets < limit] for channel, offsets in self.offsets.items()}
        return self._replace(offsets=kept)


NONE = np.zeros(0, dtype=np.int64)


def take_records(data: np.ndarray, offsets: np.ndarray, kind: np.dtype) -> Any:
    """Return the structures that begin at offsets of an array of bytes.

    kind : their dtype

    Raises ValueError if one is not inside the data.
    """
    if not len(offsets):
        return np.zeros(0, dtype=kind)
    if int(offsets.min()) < 0 or int(offsets.max()) + kind.itemsize > len(data):
        raise ValueError("a record longer than its chunk")
    # as void, which NumPy copies as a whole and not field by field
    places = len(data) - kind.itemsize + 1
    return np.ndarray(places, f"V{kind.itemsize}", data, strides=(1,))[offsets].view(kind)


def head_of(data: Any) -> tuple[int, str, int, int, int]:
    """Return (bytes of the head, compression, size and checksum of the messages, stored bytes) of a chunk's record.

    Raises ValueError.
    """
    if len(data) < CHUNK_HEAD.size:
        raise ValueError("an incomplete head")
    kind, length, _, _, size, checksum, name, *_ = CHUNK_HEAD.unpack_from(data)
    head = CHUNK_HEAD.size + name
    compression = bytes(data[CHUNK_HEAD.size - 8 : head - 8]).decode("ascii")
    stored = int.from_bytes(data[head - 8 : head], "little")
    if kind != A_CHUNK or length != head - HEAD.size + stored:
        raise ValueError("a damaged head")
    return head, compression, size, checksum, stored


def load(descriptor: int, chunk: Chunk) -> Messages:
    """Read the messages of a chunk. Several threads can do so at a time.

    descriptor : descriptor of the file

    Raises ValueError or LookupError if the chunk is damaged.
    """
    raw = memoryview(os.pread(descriptor, chunk.end - chunk.at, chunk.at))
    stored, indices = raw[chunk.begin - chunk.at :][: chunk.length], raw[chunk.begin - chunk.at + chunk.length :]
    room = {ROOMS[name][: HEAD.size]: name for name in ROOMS}.get(bytes(raw[: HEAD.size]))
    checksum = chunk.checksum
    if room is not None and not chunk.headless:  # a head that was not written, of a chunk that is in the summary
        checksum = next((crc for size, crc in stamps_of(raw, room)[0] if size == chunk.size), None)
    if chunk.compression == STREAM or room == ZSTD:
        plain = decode(bytes(stored), chunk.size).data
    elif chunk.headless or room == "":
        plain = stored
    else:
        head, compression, size, checksum, length = head_of(raw)
        if (chunk.at + head, length, compression, size) != (chunk.begin, chunk.length, chunk.compression, chunk.size):
            raise ValueError("a head that differs from the index")
        plain = expand(Stored(compression, stored, size))
    if len(plain) != chunk.size:
        raise ValueError(f"{len(plain)} bytes instead of {chunk.size}")
    chunk.is_unverified = not checksum
    if checksum and zlib.crc32(plain) != checksum:
        raise ValueError("a wrong checksum")
    data = np.frombuffer(plain, dtype=np.uint8)
    places = places_of(indices) if len(indices) else None
    offsets = None if places is None else offsets_of_indices(data, places)
    messages = Messages(data, offsets, len(data), []) if offsets is not None else walk_messages(plain)
    times = CHUNK_HEAD.unpack_from(raw)[2:4] if raw[0] == A_CHUNK else None
    chunk.is_indexed = not len(indices) or is_index(places, messages, times)
    if not (chunk.headless or messages.end == len(data)):
        raise ValueError("a record longer than its chunk")
    messages = messages if chunk.limit is None else messages.until(chunk.limit)
    for channel, (first, last) in chunk.trim.items():
        offsets = messages.offsets.get(channel, NONE)
        messages.offsets[channel] = offsets[first : len(offsets) - last]
    return messages


def places_of(indices: memoryview) -> dict[int, np.ndarray] | None:
    """Return {channel: array of PLACE} of message indices, or None if they are damaged.

    indices : bytes of the MessageIndex records
    """
    at = 0
    found: dict[int, np.ndarray] = {}
    while at + INDEX.size <= len(indices):
        kind, length, channel, size = INDEX.unpack_from(indices, at)
        at += INDEX.size
        if kind != AN_INDEX or length != INDEX.size - HEAD.size + size or size % PLACE.itemsize or channel in found:
            return None
        if at + size > len(indices):
            return None
        found[channel] = np.frombuffer(indices, PLACE, size // PLACE.itemsize, at)
        at += size
    return found if at == len(indices) else None


def offsets_of_indices(data: np.ndarray, places: dict[int, np.ndarray]) -> dict[int, np.ndarray] | None:
    """Return {channel: offsets} of message indices, or None if they do not describe exactly these records.

    data : array of bytes
    places : as in `places_of`
    """
    offsets_of = {channel: found["offset"].astype(np.int64) for channel, found in places.items()}
    if any(np.any(offsets[1:] <= offsets[:-1]) for offsets in offsets_of.values()):
        return None
    try:
        heads = take_records(data, np.concatenate([NONE, *offsets_of.values()]), BEGIN)
    except ValueError:
        return None
    channels = np.repeat(np.array([*offsets_of], dtype="<u2"), [len(offsets) for offsets in offsets_of.values()])
    if np.any(heads["kind"] != A_MESSAGE) or np.any(heads["channel"] != channels):
        return None
    total = int(heads["length"].astype(np.int64).sum()) + HEAD.size * len(heads)
    return offsets_of if total == len(data) else None


def is_index(places: dict[int, np.ndarray] | None, messages: Messages, times: tuple[int, int] | None) -> bool:
    """Return whether message indices have each message of a chunk at its place, with its time.

    times : first and last log time in the head of the chunk, which must be those of its messages; None without a head
    """
    if places is None or {channel for channel in places if len(places[channel])} != messages.offsets.keys():
        return False
    logged = [index["log_time"] for index in places.values() if len(index)]
    if times is not None and times != (min(map(np.min, logged), default=0), max(map(np.max, logged), default=0)):
        return False
    return all(
        np.array_equal(places[channel]["offset"], offsets)
        and np.array_equal(
            places[channel]["log_time"], take_records(messages.data, offsets, BEGIN)["log_time"].view("<u8")
        )
        for channel, offsets in messages.offsets.items()
    )


def walk_messages(plain: Any, only_messages: bool = False) -> Messages:
    """Return the Messages of bytes without an index, up to an incomplete record or one that is not valid in a chunk.

    only_messages : whether any other record ends them
    """
    offsets: dict[int, list[int]] = {}
    others: list[tuple[int, bytes]] = []
    at, size = 0, len(plain)
    head, message = HEAD.unpack_from, MESSAGE.unpack_from
    while at + HEAD.size <= size:
        kind, length = head(plain, at)
        end = at + HEAD.size + length
        if end > size or kind == A_CHUNK or (only_messages and kind != A_MESSAGE):
            break
        if kind == A_MESSAGE:
            if length < MESSAGE_REST:
                break
            channel = message(plain, at)[2]
            known = offsets.get(channel)
            if known is None:
                known = offsets[channel] = []
            known.append(at)
        elif kind in (SCHEMA, CHANNEL):
            others.append((kind, bytes(plain[at + HEAD.size : end])))
        at = end
    data = np.frombuffer(plain, dtype=np.uint8)
    return Messages(data, {key: np.array(places, dtype=np.int64) for key, places in offsets.items()}, at, others)


class ExpansionLimit:
    """Limit on the expanded size of the chunks of a file. size : size of the file, in bytes"""

    def __init__(self, size: int) -> None:
        self.left = self.limit = max(FILE_LIMIT_MINIMUM, FILE_RATIO_LIMIT * size)

    def admit(self, size: int) -> None:
        """Count a chunk that expands to `size` bytes. Raises TooLarge if it exceeds a limit."""
        if size > min(CHUNK_LIMIT, self.left):
            limit = (
                f"{CHUNK_LIMIT >> 20} MiB" if size > CHUNK_LIMIT else f"{self.limit >> 20} MiB for a file of this size"
            )
            raise TooLarge(f"has a compressed chunk of {size} bytes, above the limit of {limit}, which is not read")
        self.left -= size


def expand(chunk: Stored) -> Any:
    """Return the records of a chunk as bytes. Raises ValueError or LookupError if it is damaged."""
    size = chunk.uncompressed_size
    data = {"": bare, "zstd": zstd, "lz4": lz4}[chunk.compression](chunk.data, size + 1)
    if len(data) != size:
        raise ValueError(f"{len(data)} bytes instead of {size}")
    return data


def bare(data: Any, limit: int) -> Any:
    """Return data that is not compressed."""
    return data


def zstd(data: Any, limit: int) -> bytes:
    """Return at most `limit` bytes of the content of a zstd frame. Raises ValueError."""
    import zstandard

    try:
        return zstandard.ZstdDecompressor(max_window_size=CHUNK_LIMIT).stream_reader(data).read(limit)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from None


def lz4(data: Any, limit: int) -> bytes:
    """Return at most `limit` bytes of the content of an LZ4 frame. Raises ValueError."""
    frame = import_module("lz4.frame")
    try:
        return frame.LZ4FrameDecompressor().decompress(data, max_length=limit)
    except (RuntimeError, EOFError) as error:
        raise ValueError(str(error)) from None

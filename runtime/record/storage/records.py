"""The walk through the records of an MCAP file, which may end anywhere."""

import io
import struct
from collections.abc import Iterator
from typing import Any

from runtime.record.storage.files import AT_ONCE
from runtime.record.storage.mcap_file import CHUNK_HEAD, CHUNK_HEADS, HEAD, ROOM, STREAM

MAGIC = b"\x89MCAP0\r\n"
LIBRARY = "tickwork"  # in the header of a recording
# what a reader of garbage raises
DAMAGE = (EOFError, struct.error, ValueError, LookupError, TypeError, OverflowError, MemoryError)
CHUNK_LIMIT = 64 << 20  # bytes that a chunk may expand to
# kinds of records
HEADER, FOOTER, SCHEMA, CHANNEL, A_MESSAGE, A_CHUNK, AN_INDEX, CHUNK_INDEX, ATTACHMENT = range(1, 10)
ATTACHMENT_INDEX, STATISTICS, METADATA = 10, 11, 12
DATA_END = 15
KINDS = {*range(HEADER, DATA_END + 1), ROOM, STREAM}
RECORD_LIMIT = 64 << 20  # bytes: an attachment
COMPRESSION_AT = 37  # bytes into a chunk's record


def walk(stream: Any, at: int) -> Iterator[tuple[int, int, bytes]]:
    """Yield (position, kind, bytes) of every record, up to an incomplete one.

    The records of an uncompressed chunk follow its head; a compressed chunk is one record. Of a zstd chunk without a
    head (STREAM), only the reserved space is yielded, as the last record.

    stream : file, at the position `at`
    """
    window, place = b"", 0
    while True:
        while (size := length_of(window, place)) > (held := len(window) - place):
            more = stream.read(max(AT_ONCE, size - held)) if size <= RECORD_LIMIT else b""
            if not more:
                return
            window, place = window[place:] + more, 0
        yield at, window[place], window[place : place + size]
        if window[place] == STREAM:
            return
        at, place = at + size, place + size


def length_of(window: bytes, place: int) -> int:
    """Return the size of a record in bytes; of an uncompressed chunk only those of its head.

    HEAD.size for a record whose head is incomplete.
    """
    if len(window) - place < HEAD.size:
        return HEAD.size
    kind, length = HEAD.unpack_from(window, place)
    if kind == STREAM:
        return CHUNK_HEADS["zstd"].size
    plain = kind == A_CHUNK and not is_compressed_chunk(window[place : place + CHUNK_HEAD.size])
    return CHUNK_HEAD.size if plain else HEAD.size + length


def read(kind: str, body: bytes) -> Any:
    """Parse a record with the mcap package. kind : name of its class; body : bytes after its head

    Raises ValueError if it has more bytes.
    """
    from mcap import records
    from mcap.data_stream import ReadDataStream

    stream = ReadDataStream(io.BytesIO(body))
    record = getattr(records, kind).read(stream)
    if kind != "Attachment" and stream.count != len(body):  # the package does not read its checksum
        raise ValueError(f"a record of {len(body)} bytes, not {stream.count}")
    return record


def is_compressed(head: bytes, name: str) -> bool:
    """Return whether the head of a chunk has a compression. name : "zstd", "lz4" or "" for none"""
    return head[COMPRESSION_AT:].startswith(len(name).to_bytes(4, "little") + name.encode())


def is_compressed_chunk(head: bytes) -> bool:
    """Return whether a chunk is compressed. head : the first 49 bytes of its record"""
    return is_compressed(head, "lz4") or is_compressed(head, "zstd")

"""Compressed chunks of an MCAP file. The recorder writes none; `mcap compress` and other tools make them of its files.

A few kilobytes can declare, and expand to, gigabytes: what a chunk and a file expand to has a bound, whatever they
declare.
"""

import zlib
from io import BytesIO

from runtime.recording.mcap_file import CHUNK_HEADS, HEAD, STREAM, ZSTD
from runtime.recording.records import A_CHUNK, A_MESSAGE, CHANNEL, compressed, read, walk
from runtime.recording.zstd_stream import decode

LARGEST = 64 << 20  # bytes that a chunk may expand to
RATIO, LEAST = 100, 16 << 20  # all chunks of a file together: so many times its size, and at least so many bytes


class TooLarge(ValueError):
    """A chunk expands to more than is read. Its text goes on after the name of the file."""


class Expander:
    """size : bytes of the file"""

    def __init__(self, size):
        self.left = self.limit = max(LEAST, RATIO * size)

    def expand(self, chunk):
        """The records of an mcap.records.Chunk, as bytes that can be parsed. ValueError, LookupError or McapError where
        it is damaged; TooLarge
        """
        size = chunk.uncompressed_size
        if size > min(LARGEST, self.left):
            limit = (
                f"{LARGEST >> 20} MiB" if size > LARGEST else (f"{self.limit >> 20} MiB for all of a file of this size")
            )
            raise TooLarge(
                f"has a compressed chunk that declares {size} bytes, and {limit} is the limit: what "
                "stands before is read"
            )
        data = {"zstd": zstd, "lz4": lz4}[chunk.compression](chunk.data, size + 1)
        if len(data) != size:
            raise ValueError(f"{len(data)} bytes instead of {size}")
        if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            raise ValueError("a wrong checksum")
        for _ in parsed(data):
            pass
        self.left -= size
        return data


def unfinished(stream, at):
    """Return (records, position behind it or None) of a zstd chunk without a head or without its end.

    The records are those up to the last complete block; the position is None if the chunk has no end. Returns None for
    anything else.

    stream : file; at : where the chunk begins
    """
    stream.seek(at)
    form = CHUNK_HEADS[ZSTD]
    head = stream.read(form.size)
    if len(head) < form.size or (head[0] != STREAM and not (head[0] == A_CHUNK and compressed(head))):
        return None
    frame = stream.read(LARGEST)
    if head[0] == A_CHUNK and HEAD.size + HEAD.unpack_from(head)[1] <= form.size + len(frame):
        return None
    data, ends, ended = decode(frame, LARGEST)
    end = 0
    for place, _, record in walk(BytesIO(data), 0):
        end = place + len(record)
    return data[:end], at + form.size + ends[-1][0] if ended else None


def walk_all(stream, at):
    """Yield (position, kind, bytes) as `walk` does, including the messages of zstd chunks without head or end."""
    end = at
    while end is not None:
        stream.seek(end)
        for place, kind, data in walk(stream, end):
            if kind == STREAM:
                break
            yield place, kind, data
            end = place + len(data)
        rest = unfinished(stream, end)
        if rest is None:
            return
        place, (content, end) = end, rest
        for _, kind, data in walk(BytesIO(content), 0):
            yield place, kind, data


def parsed(data):
    """Yield the mcap.records.Channel and Message of the bytes of a chunk. Raises ValueError or McapError."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Message

    end = 0
    for at, kind, record in walk(BytesIO(data), 0):
        end, body = at + len(record), record[HEAD.size :]
        if kind == A_CHUNK:
            raise ValueError("a chunk inside a chunk")
        if kind == CHANNEL:
            yield read("Channel", body)
        elif kind == A_MESSAGE:
            yield Message.read(ReadDataStream(BytesIO(body)), len(body))
    if end != len(data):
        raise ValueError("a record longer than its chunk")


def zstd(data, most):
    """At most so many bytes of what a zstd frame expands to. ValueError"""
    import zstandard

    try:
        return zstandard.ZstdDecompressor(max_window_size=LARGEST).stream_reader(data).read(most)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from None


def lz4(data, most):
    """At most so many bytes of what an LZ4 frame expands to. ValueError"""
    import lz4.frame

    try:
        return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most)
    except (RuntimeError, EOFError) as error:
        raise ValueError(str(error)) from None

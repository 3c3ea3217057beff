"""Compressed chunks of an MCAP file. The recorder writes none; `mcap compress` and other tools make them of its files.

A few kilobytes can declare, and expand to, gigabytes: what a chunk and a file expand to has a bound, whatever they
declare.
"""

import zlib
from io import BytesIO

from runtime.recording.mcap_file import HEAD
from runtime.recording.records import A_CHUNK, A_MESSAGE, CHANNEL, read, walk

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

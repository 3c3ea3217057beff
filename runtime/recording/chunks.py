"""Compressed chunks of an MCAP file. The recorder writes none; `mcap compress` and other tools make them of its files.

A few kilobytes can declare, and expand to, gigabytes: what a chunk and a file expand to has a bound, whatever they
declare.
"""

import zlib
from io import BytesIO

LARGEST = 64 << 20  # bytes that a chunk may expand to
RATIO, LEAST = 100, 16 << 20  # all chunks of a file together: so many times its size, and at least so many bytes
NAMES = (b"\3\0\0\0lz4", b"\4\0\0\0zstd")  # compressions, as the head of a chunk has them
NAME_AT = 37  # bytes into a chunk's record


class TooLarge(ValueError):
    """A chunk expands to more than is read. Its text goes on after the name of the file."""


def compressed(head):
    """Whether a chunk is compressed. head : the first 49 bytes of its record"""
    return head[NAME_AT:].startswith(NAMES)


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
    """mcap.records.Channel and Message of the bytes of a chunk. ValueError, McapError"""
    from mcap.data_stream import ReadDataStream
    from mcap.opcode import Opcode
    from mcap.records import Channel, Message

    stream = ReadDataStream(BytesIO(data))
    while stream.count < len(data):
        kind, length = stream.read1(), stream.read8()
        if length > len(data) - stream.count:
            raise ValueError("a record longer than its chunk")
        if kind == Opcode.CHANNEL:
            yield Channel.read(stream)
        elif kind == Opcode.MESSAGE:
            yield Message.read(stream, length)
        else:
            stream.read(length)


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

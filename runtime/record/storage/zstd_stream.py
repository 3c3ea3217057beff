"""zstd frames that are written in blocks, so that an unfinished one decodes up to its last complete block.

Every flush ends a block. An empty last block ends the frame: a frame without it becomes complete by appending it.
(RFC 8878)
"""

from typing import Any, NamedTuple

WINDOW_LOG = 20  # of the bytes that a block can refer to: 1 MiB
WINDOW_LIMIT = 64 << 20  # bytes, of frames of other writers
BLOCK_LIMIT = 128 << 10  # bytes of content in a block
BLOCK_HEAD = 3  # bytes
RAW, RLE, COMPRESSED = range(3)  # types of blocks
CHECKSUM_FLAG, CHECKSUM = 4, 4  # in the descriptor of a frame; bytes
END = b"\1\0\0"  # an empty last block


class Compressor:
    """Compressor of one zstd frame. level : compression level of zstd"""

    def __init__(self, level: int) -> None:
        from zstandard import ZstdCompressionParameters, ZstdCompressor

        parameters = ZstdCompressionParameters.from_level(  # pyright: ignore[reportUnknownMemberType] it states no types
            level, window_log=WINDOW_LOG, write_content_size=False, write_checksum=False
        )
        self._compressor = ZstdCompressor(compression_params=parameters)
        self._frame: Any = self._compressor.compressobj()

    def block(self, data: bytes) -> bytes:
        """Return the bytes of a block, or of several if it has more than BLOCK_LIMIT bytes."""
        from zstandard import COMPRESSOBJ_FLUSH_BLOCK

        return self._frame.compress(data) + self._frame.flush(COMPRESSOBJ_FLUSH_BLOCK)

    def end(self) -> bytes:
        """Return the end of the frame. The next block begins another one."""
        data = self._frame.flush()
        self._frame = self._compressor.compressobj()
        return data


def raw_blocks(data: bytes) -> bytes:
    """Return data as blocks that are not compressed and do not end the frame."""
    pieces = (data[at : at + BLOCK_LIMIT] for at in range(0, len(data), BLOCK_LIMIT))
    return b"".join((RAW << 1 | len(piece) << 3).to_bytes(BLOCK_HEAD, "little") + piece for piece in pieces)


def is_torn(data: bytes) -> bool:
    """Return whether the rest of a file begins with an incomplete block, or one whose end is zeros after a power cut.

    data : bytes from the end of the last valid block to the end of the file
    """
    size = BLOCK_HEAD + (int.from_bytes(data[:BLOCK_HEAD], "little") >> 3)
    return len(data.rstrip(b"\0")) < size


class Decoded(NamedTuple):
    """Content of a zstd frame.

    data : bytes
    ends : [(end of a complete block in the frame, end of its content)], in bytes; the first is that of the head
    ended : whether the frame is complete
    """

    data: bytes
    ends: list[tuple[int, int]]
    ended: bool


def decode(frame: bytes, limit: int) -> Decoded:
    """Decode a zstd frame as far as its blocks are complete and valid.

    limit : bytes of content, after which decoding ends
    """
    from zstandard import ZstdDecompressor, ZstdError, frame_header_size

    content, ends = bytearray(), [(0, 0)]
    try:
        at = frame_header_size(frame)
        decoder = ZstdDecompressor(max_window_size=WINDOW_LIMIT).decompressobj()
        decoder.decompress(frame[:at])
        ends[0] = (at, 0)
        while at + BLOCK_HEAD <= len(frame) and len(content) <= limit:
            head = int.from_bytes(frame[at : at + BLOCK_HEAD], "little")
            last, kind, size = head & 1, head >> 1 & 3, head >> 3
            end = at + BLOCK_HEAD + (1 if kind == RLE else size)
            if end > len(frame) or kind > COMPRESSED or (size == 0 and not last):  # zeros, as a power cut leaves them
                break
            content += decoder.decompress(frame[at:end])
            ends.append((end, len(content)))
            at = end
            if last:
                if frame[4] & CHECKSUM_FLAG:
                    ends[-1] = (end + CHECKSUM, len(content))
                return Decoded(bytes(content), ends, True)
    except ZstdError:
        pass
    return Decoded(bytes(content), ends, False)

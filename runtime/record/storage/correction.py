"""Correction of one wrong byte of a record that ends with its CRC-32."""

import zlib

CHECKSUM = 4  # bytes


def correct_byte(data: bytes) -> bytes | None:
    """Return the bytes of a record with a valid checksum, after the correction of one byte if necessary.

    data : bytes whose last four are the CRC-32 of the others, or 0 for none

    Returns None if more than one byte is wrong. A difference of CRC-32 that one byte causes depends only on its
    error and its distance from the end, so that it is searched backwards from the end in one pass.
    """
    content, stored = data[:-CHECKSUM], int.from_bytes(data[-CHECKSUM:], "little")
    difference = zlib.crc32(content) ^ stored
    if stored == 0 or difference == 0:
        return data
    own = difference.to_bytes(CHECKSUM, "little")
    if sum(map(bool, own)) == 1:  # the wrong byte is in the checksum
        return content + zlib.crc32(content).to_bytes(CHECKSUM, "little")
    table = [zlib.crc32(bytes([byte])) ^ zlib.crc32(b"\0") for byte in range(256)]
    errors, by_end = {entry: byte for byte, entry in enumerate(table) if byte}, {entry >> 24: entry for entry in table}
    indices = {entry: byte for byte, entry in enumerate(table)}
    found: list[tuple[int, int]] = []
    for at in reversed(range(len(content))):
        if difference in errors:
            found.append((at, errors[difference]))
        entry = by_end[difference >> 24]
        difference = (difference ^ entry) << 8 & 0xFFFFFFFF | indices[entry]
    if len(found) != 1:
        return None
    at, error = found[0]
    return data[:at] + bytes([data[at] ^ error]) + data[at + 1 :]

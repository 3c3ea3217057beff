"""MIP in Python: construction and parsing of single packets, for the set-up and the tools.

A run reads them natively (cext/kernels/devices/microstrain/mip.pyx).
"""

import struct

from blocks.imus.microstrain.descriptors import field_of

SYNC = b"\x75\x65"
BASE, COMMAND_3DM, COMMAND_FILTER = 0x01, 0x0C, 0x0D  # sets of commands
PING, IDLE, INFO, DESCRIPTORS, RESUME, MORE_DESCRIPTORS, ACKNOWLEDGE = 0x01, 0x02, 0x03, 0x04, 0x06, 0x07, 0xF1
WRITE, READ = 1, 2


def fletcher(data: bytes) -> bytes:
    """Return the two bytes of the Fletcher checksum of a packet."""
    one = two = 0
    for byte in data:
        one = one + byte & 0xFF
        two = two + one & 0xFF
    return bytes((one, two))


def packet(descriptor_set: int, *fields: tuple[int, bytes]) -> bytes:
    """fields : (descriptor, data)"""
    payload = b"".join(bytes((len(data) + 2, descriptor)) + data for descriptor, data in fields)
    head = SYNC + bytes((descriptor_set, len(payload))) + payload
    return head + fletcher(head)


def fields(packet: bytes) -> list[tuple[int, bytes]]:
    """Return (descriptor, data) of each field; [] for a packet with inconsistent lengths."""
    found: list[tuple[int, bytes]] = []
    at, end = 4, 4 + packet[3]
    while at < end:
        length = packet[at]
        if length < 2 or at + length > end:
            return []
        found.append((packet[at + 1], packet[at + 2 : at + length]))
        at += length
    return found


def split(data: bytes) -> tuple[list[bytes], bytes, int]:
    """Return (valid packets, remaining bytes, which may begin another packet, number of corrupt packets)."""
    found: list[bytes] = []
    at, corrupt = 0, 0
    while True:
        begin = data.find(SYNC[:1], at)
        if begin < 0:
            return found, b"", corrupt
        at = begin
        if data[at : at + 2] not in (SYNC, SYNC[:1]):
            at += 1
            continue
        if len(data) < at + 4 or len(data) < at + 6 + data[at + 3]:
            return found, data[at:], corrupt
        whole = data[at : at + 6 + data[at + 3]]
        if fletcher(whole[:-2]) == whole[-2:]:
            found.append(whole)
            at += len(whole)
        else:
            corrupt += 1
            at += 1


def decode(packet: bytes) -> dict[str, list[float]]:
    """Return {name: list of values in SI} of a data packet, with the names of blocks.imus.microstrain.descriptors."""
    found: dict[str, list[float]] = {}
    for descriptor, data in fields(packet):
        field = field_of(packet[2], descriptor)
        values = field.decode(data) if field is not None else None
        if field is not None and values is not None:
            found[field.name] = values
    return found


def command(descriptor_set: int, descriptor: int, form: str = "", *values: float) -> bytes:
    """Return a packet with one command. form : format of its values, as for struct"""
    return packet(descriptor_set, (descriptor, struct.pack(">" + form, *values)))

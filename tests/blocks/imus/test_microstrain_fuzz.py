"""MIP's native parser against anything that may come off a line: no crash, no wrong checksum believed, every good
packet after garbage found.
"""

import random

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from blocks.imus.microstrain import mip
from tests.blocks.imus.hearing import Hearing

FLUSH = bytes(300)  # more than the longest packet: whatever a false header waits for has come


def numbered(number):
    """A valid packet that contains its number."""
    return mip.packet(0x80, (0xD1, number.to_bytes(4, "big")), (0x05, bytes(12)))


def spoilt(draw, packet):
    """With one bit turned: Fletcher's sums find every one."""
    bit = draw(st.integers(0, 8 * len(packet) - 1))
    return packet[: bit // 8] + bytes([packet[bit // 8] ^ 1 << bit % 8]) + packet[bit // 8 + 1 :]


HEADERS = st.binary(min_size=0, max_size=3).map(lambda rest: mip.SYNC + rest)
GARBAGE = st.one_of(st.binary(max_size=40), HEADERS, st.just(b"\x75"), st.just(b"\x75\x75\x65"))


@st.composite
def streams(draw):
    """(bytes, numbers of the good packets in them)"""
    parts, good = [], []
    for number in range(draw(st.integers(1, 12))):
        packet = numbered(number)
        kind = draw(st.sampled_from(("good", "good", "garbage", "spoilt", "cut")))
        if kind == "good":
            good.append(number)
            parts.append(packet)
        elif kind == "garbage":
            parts.append(draw(GARBAGE))
        elif kind == "spoilt":
            parts.append(spoilt(draw, packet))
        else:
            parts.append(packet[: draw(st.integers(0, len(packet) - 1))])
    return b"".join(parts), good


def whole(data):
    """Places of `data` at which something begins whose checksum is right, looked for by brute force, and how long it
    is.
    """
    found = {}
    for at in range(len(data) - 5):
        if data[at : at + 2] == mip.SYNC and at + 6 + data[at + 3] <= len(data):
            packet = data[at : at + 6 + data[at + 3]]
            if mip.fletcher(packet[:-2]) == packet[-2:]:
                found[at] = len(packet)
    return found


@given(streams(), st.integers(1, 64))
@example((mip.SYNC + b"\x80\xff" + numbered(1), [1]), 64)
def test_every_valid_packet_is_parsed_and_no_invalid_one_accepted(stream, chunk):
    data, good = stream
    sensor = Hearing(channels=("gyro", "ticks"))
    sensor.feed(data + FLUSH, chunk)
    packets, _, corrupt = mip.split(data + FLUSH)
    places = whole(data + FLUSH)
    wanted = [packet for packet in packets if packet[2] >= 0x80 and packet[3] and mip.fields(packet)]
    assert sensor["packets"] == len(wanted) and sensor["corrupt"] == corrupt
    assert len(packets) <= len(places)
    numbers = [int.from_bytes(mip.fields(packet)[0][1], "big") for packet in wanted if mip.fields(packet)[0][0] == 0xD1]
    if len(places) == len(good):  # no garbage that is a packet by accident
        assert numbers == good
    if numbers:
        assert sensor["ticks"] == numbers[-1]


@given(st.binary(max_size=2000), st.integers(1, 64))
def test_parser_resynchronises_after_noise(noise, chunk):
    sensor = Hearing(channels=("gyro", "ticks"))
    sensor.feed(noise, chunk)
    sensor.feed(FLUSH + numbered(7))
    assert sensor["ticks"] == 7.0


@given(
    st.lists(st.tuples(st.integers(0, 255), st.binary(max_size=40)), max_size=6),
    st.sampled_from((0x80, 0x82, 0xA0, 0xFF)),
)
def test_fields_of_any_length_are_parsed(fields, descriptor_set):
    """Right checksums around anything: known descriptors with too few bytes, unknown ones, none."""
    payload = b"".join(bytes((len(data) + 2, descriptor)) + data for descriptor, data in fields)
    head = mip.SYNC + bytes((descriptor_set, len(payload))) + payload
    sensor = Hearing(channels=("accel", "quaternion", "euler", "pressure", "filter_status"))
    sensor.feed(head + mip.fletcher(head))
    assert sensor["packets"] == bool(payload) and sensor["corrupt"] == 0


@pytest.mark.soak
def test_a_million_corrupted_streams_are_parsed_safely():
    """One parser receives all of them, as in a run, and must find the next valid packet after each."""
    chance = random.Random(7)
    sensor = Hearing(channels=("gyro", "ticks"))
    heard = 0
    for number in range(1_000_000):
        data = bytearray(numbered(number & 0xFFFF) * chance.randint(1, 3))
        for _ in range(chance.randint(1, 4)):
            at = chance.randrange(len(data))
            kind = chance.randrange(4)
            if kind == 0:
                data[at] ^= 1 << chance.randrange(8)
            elif kind == 1:
                del data[at : at + chance.randint(1, 40)]
            elif kind == 2:
                data[at:at] = chance.randbytes(chance.randint(1, 20))
            else:
                data[at:at] = mip.SYNC + chance.randbytes(2)
            if not data:
                data = bytearray(b"\x75")
        stream = bytes(data) + FLUSH
        sensor.feed(stream, chance.randint(1, 64))
        heard += sum(1 for packet in mip.split(stream)[0] if packet[2] >= 0x80 and packet[3] and mip.fields(packet))
        sensor.feed(numbered(number))
        heard += 1
        assert sensor["packets"] == heard and sensor["ticks"] == number, (number, stream.hex())

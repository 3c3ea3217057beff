"""Messages of ROS 2, as rosbags decodes and encodes them, and the type hashes of the packages of ROS 2 Kilted."""

import itertools

import numpy as np
import pytest

from runtime.host.ros2_messages import (
    DEFINITIONS,
    DIAGNOSTICS,
    IMU,
    JOINT_STATE,
    NUMBERS,
    Template,
    decode,
    encode,
    type_hash,
)
from tests.optional import Library

typesys = Library("rosbags.typesys")

HASHES = {  # in share/PACKAGE/msg/NAME.json of ROS 2 Kilted
    JOINT_STATE: "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    IMU: "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    DIAGNOSTICS: "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    NUMBERS: "RIHS01_1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f",
}
STAMP = (1_795_857_211, 422_772_769)
NINE = tuple(0.1 * number for number in range(9))
MESSAGES = {
    JOINT_STATE: ((STAMP, "base"), ("left_knee", "hip"), (1.5, -2.5), (), (0.25, float("inf"))),
    IMU: ((STAMP, ""), (0.1, 0.2, 0.3, 0.9), NINE, (1.0, 2.0, 3.0), NINE, (0.0, 0.0, 9.8), (-1.0,) + NINE[1:]),
    DIAGNOSTICS: ((STAMP, "x"), ((2, "knee", "Größe", "vm", (("age", "0.1"), ("", ""))), (0, "", "", "", ()))),
    NUMBERS: (((("rows", 2, 3), ("", 0, 0)), 5), (1e-300, -4.0, 7.0)),
}


def plain(value):
    """A message of rosbags as tuples, in the order of its fields."""
    if isinstance(value, np.ndarray):
        return tuple(value.tolist())
    if isinstance(value, list):
        return tuple(map(plain, value))
    fields = [name for name in getattr(value, "__dataclass_fields__", ()) if name.islower() and name != "__msgtype__"]
    return tuple(plain(getattr(value, name)) for name in fields) if fields else value


def made(store, kind, message):
    """The same message of rosbags."""
    values = []
    for each, (_, described) in zip(message, store.fielddefs[kind][1]):
        array, element = described[0] in (3, 4), described[1][0] if described[0] in (3, 4) else described
        if element[0] == 2:  # a message
            value = [made(store, element[1], part) for part in each] if array else made(store, element[1], each)
        elif array and element[1][0] != "string":
            value = np.array(each, element[1][0])
        else:
            value = list(each) if array else each
        values.append(value)
    return store.types[kind](*values)


def test_type_hashes_are_those_of_ros_2():
    assert {kind: type_hash(kind) for kind in HASHES} == HASHES
    for name in ("ROS2_HUMBLE", "ROS2_JAZZY", "ROS2_KILTED"):
        store = typesys.get_typestore(getattr(typesys.Stores, name))
        assert {kind: type_hash(kind) for kind in DEFINITIONS} == {
            kind: store.hash_rihs01(kind) for kind in DEFINITIONS
        }


@pytest.mark.parametrize("kind", MESSAGES)
def test_messages_are_decoded_and_encoded_by_rosbags(kind):
    store, message = typesys.get_typestore(typesys.Stores.ROS2_KILTED), MESSAGES[kind]
    data = encode(kind, message)
    assert plain(store.deserialize_cdr(data, kind)) == message
    for little in (True, False):
        theirs = bytes(store.serialize_cdr(made(store, kind, message), kind, little_endian=little))
        assert decode(kind, theirs) == message
        assert data[4:] == theirs[4:][: len(data) - 4] or not little
    for length in range(len(data)):
        with pytest.raises(ValueError):
            decode(kind, data[:length])


def numbers(message):
    """All numbers of a message, in order."""
    if isinstance(message, tuple):
        return [number for part in message for number in numbers(part)]
    return [] if isinstance(message, str) else [message]


def others(message, count):
    """The same message with other numbers."""
    if isinstance(message, tuple):
        return tuple(others(part, count) for part in message)
    return message if isinstance(message, str) else next(count)


@pytest.mark.parametrize("kind", MESSAGES)
def test_a_template_encodes_other_numbers_between_the_same_strings(kind):
    template = Template(kind, MESSAGES[kind])
    for first in (1, 100):
        message = others(MESSAGES[kind], itertools.count(first))
        assert template.encode(numbers(message)) == encode(kind, message)


def test_an_invalid_message_is_an_error():
    with pytest.raises(ValueError, match="not plain CDR"):
        decode(NUMBERS, b"\x00\x07\x00\x00" + bytes(12))
    with pytest.raises(ValueError, match="too short"):
        decode(NUMBERS, b"\x00\x01\x00\x00" + b"\xff" * 16)
    with pytest.raises(ValueError, match="too short"):
        decode(NUMBERS, b"\x00\x01\x00\x00" + bytes(8) + b"\xff\xff\xff\x7f" + bytes(4))

"""Messages of ROS 2: definitions, type hashes, and the encoding CDR, without ROS.

A message is a tuple of its fields in the order of the definition; a field that is a message is a tuple, an array a
sequence. The hash of a type is that of REP 2011 (RIHS01), which rmw_zenoh compares.
"""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Sequence
from functools import cache
from struct import Struct, calcsize
from typing import Any

JOINT_STATE, IMU = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu"
DIAGNOSTICS, NUMBERS = "diagnostic_msgs/msg/DiagnosticArray", "std_msgs/msg/Float64MultiArray"

DEFINITIONS = {  # of ROS 2 Humble to Kilted
    "builtin_interfaces/msg/Time": "int32 sec, uint32 nanosec",
    "std_msgs/msg/Header": "builtin_interfaces/msg/Time stamp, string frame_id",
    "geometry_msgs/msg/Vector3": "float64 x, float64 y, float64 z",
    "geometry_msgs/msg/Quaternion": "float64 x, float64 y, float64 z, float64 w",
    JOINT_STATE: "std_msgs/msg/Header header, string[] name, float64[] position, float64[] velocity, float64[] effort",
    IMU: "std_msgs/msg/Header header, geometry_msgs/msg/Quaternion orientation, float64[9] orientation_covariance, "
    "geometry_msgs/msg/Vector3 angular_velocity, float64[9] angular_velocity_covariance, "
    "geometry_msgs/msg/Vector3 linear_acceleration, float64[9] linear_acceleration_covariance",
    "diagnostic_msgs/msg/KeyValue": "string key, string value",
    "diagnostic_msgs/msg/DiagnosticStatus": "byte level, string name, string message, string hardware_id, "
    "diagnostic_msgs/msg/KeyValue[] values",
    DIAGNOSTICS: "std_msgs/msg/Header header, diagnostic_msgs/msg/DiagnosticStatus[] status",
    "std_msgs/msg/MultiArrayDimension": "string label, uint32 size, uint32 stride",
    "std_msgs/msg/MultiArrayLayout": "std_msgs/msg/MultiArrayDimension[] dim, uint32 data_offset",
    NUMBERS: "std_msgs/msg/MultiArrayLayout layout, float64[] data",
}
PRIMITIVES: dict[str, str] = {"byte": "B", "int32": "i", "uint32": "I", "float64": "d"}  # type: format of struct
TYPE_IDS = {"int32": 6, "uint32": 7, "float64": 11, "byte": 16, "string": 17}  # of type_description_interfaces
NESTED, ARRAY, SEQUENCE = 1, 48, 144  # ID of a message, and what arrays add to that of their elements
Places = list[tuple[int, str, int]]  # offset, format of struct, number of numbers
HEADER = b"\x00\x01\x00\x00"  # CDR, least significant byte first


@cache
def fields(kind: str) -> list[tuple[str, str, int | None]]:
    """Return (name, type of its elements, length) of each field. The length is 1, that of an array, or None."""
    found: list[tuple[str, str, int | None]] = []
    for text in DEFINITIONS[kind].split(", "):
        described, name = text.split()
        element, bracket, length = described.partition("[")
        found.append((name, element, int(length.rstrip("]") or 0) or None if bracket else 1))
    return found


def described(kind: str) -> dict[str, Any]:
    """Return the type description of a message, without those of its fields."""
    listed: list[dict[str, Any]] = []
    for name, element, length in fields(kind):
        number = TYPE_IDS.get(element, NESTED) + (SEQUENCE if length is None else ARRAY if length > 1 else 0)
        nested = "" if element in TYPE_IDS else element
        what = {"type_id": number, "capacity": length if length and length > 1 else 0, "string_capacity": 0}
        listed.append({"name": name, "type": {**what, "nested_type_name": nested}})
    return {"type_name": kind, "fields": listed}


def nested(kind: str) -> set[str]:
    """Return the messages of which a message consists."""
    direct = {element for _, element, _ in fields(kind) if element in DEFINITIONS}
    return direct.union(*map(nested, direct))


@cache
def type_hash(kind: str) -> str:
    """Return the hash of a message type, such as RIHS01_a13ee3a3... (REP 2011)."""
    others = [described(each) for each in sorted(nested(kind))]
    whole = {"type_description": described(kind), "referenced_type_descriptions": others}
    return "RIHS01_" + hashlib.sha256(json.dumps(whole).encode()).hexdigest()


def encode(kind: str, message: Sequence[Any]) -> bytes:
    """Return a message as CDR."""
    data = bytearray()
    put(data, kind, message)
    return HEADER + bytes(data)


def put(data: bytearray, kind: str, value: Any, places: Places | None = None) -> None:
    """Append a value of a type. places : takes the place of each number, besides the lengths of strings and arrays"""
    if kind == "string":
        text = value.encode() + b"\0"
        pack(data, "I", (len(text),))
        data += text
    elif kind in PRIMITIVES:
        pack(data, PRIMITIVES[kind], (value,), places)
    else:
        for (_, element, length), part in zip(fields(kind), value):
            if length == 1:
                put(data, element, part, places)
                continue
            if length is None:
                pack(data, "I", (len(part),))
            if element in PRIMITIVES:
                pack(data, PRIMITIVES[element], part, places)
            else:
                for each in part:
                    put(data, element, each, places)


def pack(data: bytearray, form: str, values: Sequence[float], places: Places | None = None) -> None:
    """Append numbers, aligned to their size."""
    if values:
        data += bytes(-len(data) % calcsize(form))
        if places is not None:
            places.append((len(data), f"{len(values)}{form}", len(values)))
        data += struct.pack(f"<{len(values)}{form}", *values)


class Template:
    """Encoder of messages that differ in their numbers alone: it costs a tenth of `encode`.

    kind, message : type, and one such message
    """

    def __init__(self, kind: str, message: Sequence[Any]) -> None:
        body = bytearray()
        places: Places = []
        put(body, kind, message, places)
        self.data, count = bytearray(HEADER + body), 0
        self.runs: list[tuple[Struct, int, int, int]] = []  # adjacent numbers: format, offset, first and last of them
        for at, form, numbers in places:
            offset, first = at + len(HEADER), count
            if self.runs and self.runs[-1][0].size + self.runs[-1][1] == offset:
                before, offset, first, _ = self.runs.pop()
                form = before.format + form
            else:
                form = "<" + form
            count += numbers
            self.runs.append((Struct(form), offset, first, count))

    def encode(self, numbers: Sequence[float]) -> bytes:
        """Return a message as CDR. numbers : all numbers of its fields, in the order of the definition"""
        for form, offset, first, last in self.runs:
            form.pack_into(self.data, offset, *numbers[first:last])
        return bytes(self.data)


class Decoder:
    """Decoder of one message in CDR. data : bytes with the header"""

    def __init__(self, data: bytes) -> None:
        self.order = {b"\x00\x00": ">", b"\x00\x01": "<"}.get(data[:2], "")
        if not self.order or len(data) < 4:
            raise ValueError("the message is not plain CDR")
        self.data, self.at = data[4:], 0

    def message(self, kind: str) -> tuple[Any, ...]:
        """Return the fields of a message. Raises ValueError."""
        return tuple(self.field(element, length) for _, element, length in fields(kind))

    def field(self, kind: str, length: int | None) -> Any:
        """Return the value of a field. length : 1, that of an array, or None"""
        if length == 1:
            return self.value(kind)
        count = self.numbers("I", 1)[0] if length is None else length
        if kind in PRIMITIVES:
            return self.numbers(PRIMITIVES[kind], count)
        return tuple(self.value(kind) for _ in range(count))

    def value(self, kind: str) -> Any:
        """Return one value of a type."""
        if kind in PRIMITIVES:
            return self.numbers(PRIMITIVES[kind], 1)[0]
        if kind != "string":
            return self.message(kind)
        text = self.taken(self.numbers("I", 1)[0])
        return text[:-1].decode(errors="replace")

    def numbers(self, form: str, count: int) -> tuple[Any, ...]:
        """Return numbers, which are aligned to their size."""
        size = calcsize(form)
        self.at += -self.at % size if count else 0
        return struct.unpack(f"{self.order}{count}{form}", self.taken(count * size))

    def taken(self, count: int) -> bytes:
        """Return the next bytes. Raises ValueError if there are fewer."""
        if self.at + count > len(self.data):
            raise ValueError("the message is too short")
        self.at += count
        return self.data[self.at - count : self.at]


def decode(kind: str, data: bytes) -> tuple[Any, ...]:
    """Return a message from CDR. Raises ValueError if it is not one of this type."""
    return Decoder(data).message(kind)

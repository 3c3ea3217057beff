"""Protobuf messages of the flight log: schemas of rows, ticks, CAN frames and events, and their encoding.

A row consists of one message per subsystem, which contains a message per block with a double per signal, `repeated` for
the elements of an array. Every such message has a fixed size, so that its prefix bytes and doubles are a template.
Signals that are recorded at every n-th tick are a message of their own, which only rows of these ticks have.

The frames of one bus drain and one bus are one message CanFrames: the time of the drain, then every frame received in
it or sent after it, until the next drain or row. Recordings of format 1 have one message CanFrame per frame.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from struct import Struct
from typing import Any

from runtime.host.unique_name import unique

PACKAGE = "tickwork"
# topics besides those of subsystems
ROW_END, EVENTS, BUS = f"/{PACKAGE}/tick", f"/{PACKAGE}/events", f"/{PACKAGE}/can/"
DOUBLE, FIXED32, SFIXED64, BOOL, STRING, BYTES, MESSAGE = 1, 7, 16, 8, 9, 12, 11  # FieldDescriptorProto.Type
OPTIONAL, REPEATED = 1, 3  # FieldDescriptorProto.Label
WIRE_FIXED64, WIRE_LENGTH, WIRE_FIXED32, WIRE_VARINT = 1, 2, 5, 0

OWN = ("Tick", "CanFrames", "Event", "CanFrame")  # names that messages of subsystems do not use
TICK = (("tick", SFIXED64), ("time", DOUBLE), ("lateness", DOUBLE))
FLAGS = ("extended", "remote", "error", "fd", "rate_switch", "error_state", "sent")
FRAME_V1 = (("id", FIXED32), *((word, BOOL) for word in FLAGS), ("data", BYTES))  # of format 1
# time: ns since the start of the run; order: among the frames of all buses since the last row or drain, with two buses
# or more
FRAME = (("time", SFIXED64), ("id", FIXED32), *((word, BOOL) for word in FLAGS), ("data", BYTES), ("order", FIXED32))
DRAINED, FRAMES = 1, 2  # fields of CanFrames: ns since the start of the run; the frames
EVENT = (("event", STRING), ("tick", SFIXED64), ("json", STRING))
TICK_BYTES = Struct("<BqBdBd")
# as a NumPy dtype
TICK_ROW = [("a", "u1"), ("tick", "<i8"), ("b", "u1"), ("time", "<f8"), ("c", "u1"), ("lateness", "<f8")]


def varint(value: int) -> bytes:
    """Return a non-negative integer as the bytes of a Protobuf varint."""
    data = bytearray()
    while value > 127:
        data.append(value & 127 | 128)
        value >>= 7
    return bytes([*data, value])


def tag(number: int, wire: int) -> bytes:
    """Return the bytes before a field. wire : WIRE_FIXED64, WIRE_LENGTH, WIRE_FIXED32 or WIRE_VARINT"""
    return varint(number << 3 | wire)


def tick(number: int, time: float, lateness: float) -> bytes:
    """Return a message Tick. time, lateness : s"""
    return TICK_BYTES.pack(1 << 3 | WIRE_FIXED64, number, 2 << 3 | WIRE_FIXED64, time, 3 << 3 | WIRE_FIXED64, lateness)


def fixed64(number: int, value: int) -> bytes:
    """Return a field sfixed64."""
    return tag(number, WIRE_FIXED64) + value.to_bytes(8, "little", signed=True)


def frame(time: int, identifier: int, flags: Iterable[bool], data: bytes, order: int | None = None) -> bytes:
    """Return a message CanFrame.

    time : ns since the start of the run
    flags : a bool for each of FLAGS
    order : as in FRAME; None with one bus
    """
    fields = [fixed64(1, time), tag(2, WIRE_FIXED32), identifier.to_bytes(4, "little")]
    fields += [tag(number, WIRE_VARINT) + b"\1" for number, flag in enumerate(flags, 3) if flag]
    fields += [tag(len(FRAME) - 1, WIRE_LENGTH), varint(len(data)), data]
    if order is not None:
        fields += [tag(len(FRAME), WIRE_FIXED32), order.to_bytes(4, "little")]
    return b"".join(fields)


def frames(drained: int, group: Iterable[bytes]) -> bytes:
    """Return a message CanFrames. drained : ns since the start of the run; group : messages CanFrame"""
    head = tag(FRAMES, WIRE_LENGTH)
    return fixed64(DRAINED, drained) + b"".join(head + varint(len(item)) + item for item in group)


def split_frames(data: bytes) -> tuple[int, list[bytes]]:
    """Return (ns of the drain since the start of the run, [message CanFrame]) of a message CanFrames."""
    drained, at = 0, 0
    group: list[bytes] = []
    while at < len(data):
        number, at = data[at] >> 3, at + 1
        if number == DRAINED:
            drained, at = int.from_bytes(data[at : at + 8], "little", signed=True), at + 8
        else:
            end = at + 1 + data[at]  # a frame has fewer than 128 bytes
            group.append(data[at + 1 : end])
            at = end
    return drained, group


def event(kind: str, at: int, text: str) -> bytes:
    """Return a message Event. kind : its name; at : tick; text : JSON"""
    name, content = kind.encode(), text.encode()
    return b"".join(
        (
            tag(1, WIRE_LENGTH),
            varint(len(name)),
            name,
            tag(2, WIRE_FIXED64),
            at.to_bytes(8, "little", signed=True),
            tag(3, WIRE_LENGTH),
            varint(len(content)),
            content,
        )
    )


def read(fields: Any, data: Any) -> dict[str, Any]:
    """Return {name: value} of a flat message without repeated fields. fields : as in FRAME"""
    found: dict[str, Any] = {}
    at = 0
    while at < len(data):
        number, wire = data[at] >> 3, data[at] & 7
        name, kind = fields[number - 1]
        at += 1
        if wire == WIRE_FIXED64:
            found[name], at = int.from_bytes(data[at : at + 8], "little", signed=True), at + 8
        elif wire == WIRE_FIXED32:
            found[name], at = int.from_bytes(data[at : at + 4], "little"), at + 4
        else:
            value = shift = 0
            while data[at] & 128:
                value, shift, at = value | (data[at] & 127) << shift, shift + 7, at + 1
            value, at = value | data[at] << shift, at + 1
            if wire == WIRE_LENGTH:
                value, at = bytes(data[at : at + value]), at + value
                value = value.decode() if kind == STRING else value
            found[name] = value
    return found


class Subsystem:
    """Message of one subsystem.

    topic : "/left", or "/" and the diagram's name for blocks in none
    columns : indices of its signals among those of a row
    messages : Names of other messages, since viewers identify a message by its name
    every : ticks from one message to the next; they are multiples of it
    """

    def __init__(self, topic: str, columns: Sequence[tuple[int, str]], messages: "Names", every: int = 1) -> None:
        self.topic, self.every = topic, every
        self.name = messages.free(topic.strip("/").replace("/", "_"))
        self.columns = [index for index, _ in columns]
        self.blocks: list[tuple[str, list[tuple[str, int]]]] = []  # (message name, [(field name, elements)])
        names = Names()
        for block, own in groupby(columns, key=lambda column: split(column[1])[1]):
            fields = Names()
            signals = [
                (fields.free(signal), len(list(run)))
                for signal, run in groupby(own, key=lambda column: split(column[1])[2])
            ]
            self.blocks.append((names.free(block or "signals", message), signals))
        pieces: list[bytes] = []  # the bytes in front of every value
        for number, (_, signals) in enumerate(self.blocks, 1):
            inside = [
                (tag(place, WIRE_FIXED64), 1) if size == 1 else (tag(place, WIRE_LENGTH) + varint(8 * size), size)
                for place, (_, size) in enumerate(signals, 1)
            ]
            head = tag(number, WIRE_LENGTH) + varint(sum(len(text) + 8 * size for text, size in inside))
            for text, size in inside:
                pieces += [head + text, *[b""] * (size - 1)]
                head = b""
        self._items: list[Any] = [item for text in pieces for item in (text, 0.0)]
        self._pack = Struct("<" + "".join(f"{len(text)}sd" for text in pieces)).pack

    def encode(self, values: Iterable[float]) -> bytes:
        """Return the message as bytes. values : values in the order of `columns`"""
        self._items[1::2] = values
        return self._pack(*self._items)

    def template(self) -> tuple[bytes, list[tuple[int, int]]]:
        """Return (message without its values as bytes, [(position of a value in it, index of its signal)])."""
        body = bytearray()
        places: list[tuple[int, int]] = []
        for column, text in zip(self.columns, self._items[::2]):
            body += text
            places.append((len(body), column))
            body += bytes(8)
        return bytes(body), places

    def dtype(self) -> Any:
        """Return the NumPy dtype of the message: a field for each value, named by the index of its signal."""
        import numpy as np

        names: list[str] = []
        offsets: list[int] = []
        at = 0
        for place, text in zip(self.columns, self._items[::2]):
            at += len(text)
            names.append(str(place))
            offsets.append(at)
            at += 8
        return np.dtype({"names": names, "formats": ["<f8"] * len(names), "offsets": offsets, "itemsize": at})

    def descriptor(self) -> tuple[bytes, str]:
        """Return (serialised FileDescriptorSet, name of the message in it)."""
        outer = [(field, MESSAGE, OPTIONAL, f"{self.name}.{message(field)}") for field, _ in self.blocks]
        nested = {
            message(field): [(signal, DOUBLE, REPEATED if size > 1 else OPTIONAL, "") for signal, size in signals]
            for field, signals in self.blocks
        }
        return descriptor(self.name, outer, nested)


def subsystems(name: str, signals: Iterable[dict[str, Any]]) -> list[Subsystem]:
    """Return the Subsystems of the signals of a row, in order of their first signal.

    A subsystem whose signals have different periods has one for each: "/left", then "/left_every_4".

    name : name of the diagram
    signals : [{"path", "every" in ticks (default: 1)}], in the order of the row
    """
    grouped: dict[str, dict[int, list[tuple[int, str]]]] = {}
    for index, signal in enumerate(signals):
        periods = grouped.setdefault(split(signal["path"])[0] or name, {})
        periods.setdefault(signal.get("every", 1), []).append((index, signal["path"]))
    taken, topics = Names(OWN), {topic_of(folder) for folder in grouped}
    made: list[Subsystem] = []
    for folder, periods in grouped.items():
        for every, own in sorted(periods.items()):
            topic = topic_of(folder)
            if every > min(periods):
                topic = str(unique(f"{topic}_every_{every}", topics.__contains__))
                topics.add(topic)
            made.append(Subsystem(topic, sorted(own, key=lambda column: split(column[1])[1]), taken, every))
    return made


def topics(about: dict[str, Any]) -> list[str]:
    """Return the topics of a recording in the order of its channels. about : its metadata"""
    buses = [BUS + bus for bus in about["buses"]]
    return [*(part.topic for part in subsystems(about["name"], about["signals"])), ROW_END, *buses, EVENTS]


def topic_of(folder: str) -> str:
    """Return the topic of a subsystem, which differs from the recorder's own topics."""
    return f"/{folder}_" if folder.split("/")[0].rstrip("_") == PACKAGE else f"/{folder}"


def split(path: str) -> tuple[str, str, str]:
    """Return ("left", "shank_imu", "gyro") of "left/shank_imu.gyro[1]"; the block is "" for a path without a port."""
    folder, _, rest = path.rpartition("/")
    block, _, signal = re.sub(r"(\[\d+(, ?\d+)*\])+$", "", rest).rpartition(".")
    return folder, block, signal


class Names:
    """Unique names that Protobuf accepts. taken : names that are not available"""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self.taken = set(taken)

    def free(self, text: str, beside: Callable[[str], str] = lambda name: name) -> str:
        """Return an unused name similar to a text, and take it.

        beside : function of the name, whose result must also be unused, and is taken: fields and nested messages share
            a name space
        """
        name = unique(identifier(text), lambda candidate: bool({candidate, beside(candidate)} & self.taken))
        self.taken |= {name, beside(name)}
        return name


def identifier(text: str) -> str:
    """Return a text as an identifier of Protobuf."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return name if re.match("[A-Za-z]", name) else f"x{name}"


def message(field: str) -> str:
    """Return the name of the nested message type of a field, which must differ from that of the field."""
    return f"{field}_t"


def simple(name: str, fields: Iterable[tuple[str, int]]) -> tuple[bytes, str]:
    """Return (serialised FileDescriptorSet, name) of a flat message. fields : as in TICK"""
    return descriptor(name, [(field, kind, OPTIONAL, "") for field, kind in fields], {})


def frames_descriptor() -> tuple[bytes, str]:
    """Return (serialised FileDescriptorSet, name) of the message CanFrames."""
    fields = [("drained", SFIXED64, OPTIONAL, ""), ("frames", MESSAGE, REPEATED, "CanFrames.Frame")]
    return descriptor("CanFrames", fields, {"Frame": [(field, kind, OPTIONAL, "") for field, kind in FRAME]})


def descriptor(name: str, fields: Any, nested: dict[str, Any]) -> tuple[bytes, str]:
    """Return (serialised FileDescriptorSet, name) of a message.

    fields : [(name, FieldDescriptorProto.Type, label, name of the message type or "")]
    nested : {name of a nested message: its fields}
    """
    from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto, FileDescriptorSet

    def describe(into: DescriptorProto, fields: Any) -> None:
        for number, (field, kind, label, of) in enumerate(fields, 1):
            into.field.add(
                name=field, number=number, type=kind, label=label, type_name=f".{PACKAGE}.{of}" if of else None
            )

    outer = DescriptorProto(name=name)
    describe(outer, fields)
    for inner, inner_fields in nested.items():
        describe(outer.nested_type.add(name=inner), inner_fields)
    file = FileDescriptorProto(name=f"{PACKAGE}/{name}.proto", package=PACKAGE, syntax="proto3", message_type=[outer])
    return FileDescriptorSet(file=[file]).SerializeToString(), f"{PACKAGE}.{name}"

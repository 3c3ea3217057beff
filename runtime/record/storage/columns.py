"""Rows, frames and events of the messages of a chunk, as NumPy arrays."""

from typing import Any

import numpy as np

from runtime.host.errors import BadInput
from runtime.record.storage import messages
from runtime.record.storage.batches import FRAME
from runtime.record.storage.chunks import MESSAGE_HEAD, NONE, Messages, take_records
from runtime.record.storage.format import FD_FLAGS, ID_FLAGS
from runtime.record.storage.json_text import parsed_json
from runtime.record.storage.mcap_file import HEAD, MESSAGE

HEADS = np.dtype(MESSAGE_HEAD)
TICK = np.dtype(messages.TICK_ROW)
DATA_LIMIT = 64  # bytes of a frame
DRAINED_TAG = messages.DRAINED << 3 | messages.WIRE_FIXED64  # in front of the time of a drain, in a message CanFrames
FRAME_TAG = messages.FRAMES << 3 | messages.WIRE_LENGTH  # in front of a frame


class Damaged(ValueError):
    """An invalid message. offset : its position in the chunk"""

    def __init__(self, offset: int) -> None:
        super().__init__(f"a damaged message at byte {offset} of its chunk")
        self.offset = int(offset)


class Layout:
    """Channels of a recording, by what their messages contain.

    path : file named in errors
    about : metadata of the recording
    topics : {channel: topic}

    rows : {channel: dtype of a message}, of the subsystems and of the tick
    subsystems : {channel: Subsystem}
    tick, events : channels; None if the file has none
    buses : {channel: index of the bus}

    Raises BadInput if the channels are not those of the signals.
    """

    def __init__(self, path: Any, about: Any, topics: dict[int, str]) -> None:
        channels = {topic: channel for channel, topic in topics.items()}
        self.path, self.topics = path, topics
        self.tick: Any = channels.get(messages.ROW_END)
        self.events: Any = channels.get(messages.EVENTS)
        self.decode = frames_of_format_1 if about["format"] == "1" else frames_of_format_2
        self.buses = {
            channels[messages.BUS + bus]: index
            for index, bus in enumerate(about["buses"])
            if messages.BUS + bus in channels
        }
        self.subsystems: dict[int, messages.Subsystem] = {}
        self.rows: dict[int, np.dtype[Any]] = {}
        if self.tick is None:
            return
        self.rows[self.tick] = TICK
        for subsystem in messages.subsystems(about["name"], about["signals"]):
            if subsystem.topic not in channels:
                raise self.mismatch()
            channel = channels[subsystem.topic]
            self.subsystems[channel], self.rows[channel] = subsystem, subsystem.dtype()

    @property
    def complete(self) -> list[int]:
        """Channels of `rows` with a message in every row."""
        return [channel for channel in self.rows if channel == self.tick or self.subsystems[channel].every == 1]

    def mismatch(self) -> BadInput:
        """Return the error of a file whose channels are not those of its signals."""
        return BadInput(f"{self.path} is damaged: its rows do not match the signals in its about.json")

    def frames(self, chunk: Messages, began: int, rows: int) -> Any:
        """Return the frames of a chunk as an array of FRAME, in order. Raises Damaged.

        began : time at which the run started, in ns of the file
        rows : rows that were complete before the chunk
        """
        parts: list[np.ndarray] = []
        places: list[np.ndarray] = []
        order: list[np.ndarray] = []
        ticks = chunk.offsets.get(self.tick, NONE)
        for channel, bus in self.buses.items():
            offsets = chunk.offsets.get(channel, NONE)
            if len(offsets):
                part, of_messages, in_group = self.decode(chunk.data, offsets, began)
                part["bus"] = bus
                part["row"] = rows + np.searchsorted(ticks, of_messages)
                parts.append(part)
                places.append(of_messages)
                order.append(in_group)
        if len(parts) < 2:
            return parts[0] if parts else np.zeros(0, dtype=FRAME)
        frames = np.concatenate(parts)
        groups = self.groups(chunk, frames, np.concatenate(places))
        return frames[np.lexsort((np.concatenate(order), groups))]

    def groups(self, chunk: Messages, frames: Any, places: np.ndarray) -> np.ndarray:
        """Return for each frame the number of its group: messages of several buses whose frames have one order.

        places : offset of the message of each frame
        """
        messages_at, first, of_frame = np.unique(places, return_index=True, return_inverse=True)
        events = np.searchsorted(chunk.offsets.get(self.events, NONE), messages_at)
        bus, drain, row = (frames[name][first] for name in ("bus", "drain", "row"))
        begins = np.ones(len(first), dtype=np.int64)
        begins[1:] = bus[1:] <= bus[:-1]
        for values in (drain, row, events):
            begins[1:] |= values[1:] != values[:-1]
        return np.cumsum(begins)[of_frame]

    def events_of(self, chunk: Messages) -> list[dict[str, Any]]:
        """Return the events of a chunk. Raises Damaged."""
        events: list[Any] = []
        for offset in chunk.offsets.get(self.events, NONE).tolist():
            length = HEAD.unpack_from(chunk.data.data, offset)[1]
            body = chunk.data[offset + MESSAGE.size : offset + HEAD.size + length].tobytes()
            try:
                event = parsed_json(messages.read(messages.EVENT, body)["json"])
                events.append(event if isinstance(event["event"], str) else None)
            except (ValueError, LookupError, TypeError):
                raise Damaged(offset) from None
        return events


def frames_of_format_1(data: np.ndarray, offsets: np.ndarray, began: int) -> tuple[Any, np.ndarray, np.ndarray]:
    """Decode messages with one frame each.

    data : content of the chunk, as an array of bytes
    offsets : offsets of the message records
    began : time at which the run started, in ns of the file

    Returns (array of FRAME, offset of the message of each, number that orders those of all buses). Raises Damaged.
    """
    heads = take_records(data, offsets, HEADS)
    ends = offsets + HEAD.size + heads["length"].astype(np.int64)
    made, _ = decoded(data, offsets, offsets + MESSAGE.size, ends, messages.FRAME_V1)
    made["time"], made["drain"] = heads["log_time"] - began, heads["sequence"]
    made["drained"] = heads["publish_time"] - began
    return made, offsets, offsets


def frames_of_format_2(data: np.ndarray, offsets: np.ndarray, began: int) -> tuple[Any, np.ndarray, np.ndarray]:
    """Decode messages with the frames of one bus drain each. Arguments and result as in frames_of_format_1."""
    heads = take_records(data, offsets, HEADS)
    ends = offsets + HEAD.size + heads["length"].astype(np.int64)
    at = offsets + MESSAGE.size
    wrong = data.take(at, mode="clip") != DRAINED_TAG
    drained = data.take(at[:, None] + np.arange(1, 9), mode="clip").view("<i8")[:, 0]
    at = at + 9
    begins: list[np.ndarray] = []  # of the frames that have the same place in their messages
    items: list[np.ndarray] = []
    numbers: list[np.ndarray] = []
    message, open_messages = np.arange(len(offsets)), at < ends
    while open_messages.any():
        message, at, ends = message[open_messages], at[open_messages], ends[open_messages]
        tags, lengths = data.take(at, mode="clip"), data.take(at + 1, mode="clip").astype(np.int64)
        wrong[message[(tags != FRAME_TAG) | (lengths > 127)]] = True
        begins.append(at + 2)
        items.append(message)
        numbers.append(np.full(len(message), len(numbers)))
        at = at + 2 + lengths
        wrong[message[at > ends]] = True
        open_messages = (at < ends) & ~wrong[message]
    if wrong.any():
        raise Damaged(offsets[int(np.argmax(wrong))])
    item = np.concatenate([NONE, *items])
    begin, number = np.concatenate([NONE, *begins]), np.concatenate([NONE, *numbers])
    sorting = np.lexsort((number, item))
    item, begin, number = item[sorting], begin[sorting], number[sorting]
    end = begin + data.take(begin - 1, mode="clip")
    made, others = decoded(data, offsets[item], begin, end, messages.FRAME)
    made["drained"], made["drain"] = drained[item], heads["sequence"][item]
    order = others["order"]
    return made, offsets[item], np.where(order < 0, number, order)


def decoded(
    data: np.ndarray, offsets: np.ndarray, at: np.ndarray, ends: np.ndarray, fields: Any
) -> tuple[Any, dict[str, np.ndarray]]:
    """Decode messages CanFrame.

    data : array of bytes
    offsets : offset of each message record, for errors
    at, ends : where each begins and ends
    fields : as in runtime.record.storage.messages

    Returns (array of FRAME, {name: values} of the other numbers, -1 where there is none). Raises Damaged.
    """
    made = np.zeros(len(at), dtype=FRAME)
    others: dict[str, np.ndarray] = {}
    start, length = at, np.zeros(len(at), dtype=np.int64)
    for number, (name, kind) in enumerate(fields, 1):
        if kind == messages.BYTES:
            present = data.take(at, mode="clip") == (number << 3 | messages.WIRE_LENGTH)
            start, length = at + 2, np.where(present, data.take(at + 1, mode="clip"), 0).astype(np.int64)
            at = at + np.where(present, 2 + length, 0)
        elif kind == messages.BOOL:
            present = (data.take(at, mode="clip") == (number << 3 | messages.WIRE_VARINT)) & (at < ends)
            flag(made, name, present & (data.take(at + 1, mode="clip") != 0))
            at = at + 2 * present
        else:
            size, wire = (4, messages.WIRE_FIXED32) if kind == messages.FIXED32 else (8, messages.WIRE_FIXED64)
            present = (data.take(at, mode="clip") == (number << 3 | wire)) & (at < ends)
            field = data.take(at[:, None] + np.arange(1, 1 + size), mode="clip")
            values = field.view(f"<{'u' if size == 4 else 'i'}{size}")[:, 0].astype(np.int64)
            if name == "id":
                made["id"] |= np.where(present, values, 0).astype(np.uint32)
            elif name == "time":
                made["time"] = np.where(present, values, 0)
            else:
                others[name] = np.where(present, values, -1)
            at = at + np.where(present, 1 + size, 0)
    wrong = (at != ends) | (length > DATA_LIMIT)
    if wrong.any():
        raise Damaged(offsets[int(np.argmax(wrong))])
    width = int(length.max(initial=0))
    content = np.zeros((len(made), DATA_LIMIT), dtype=np.uint8)
    places = np.arange(width)
    content[:, :width] = np.where(
        places < length[:, None], data.take(start[:, None] + places, mode="clip"), np.uint8(0)
    )
    made["length"], made["data"] = length, content.view("V64")[:, 0]
    return made, others


def flag(made: Any, name: str, values: np.ndarray) -> None:
    """Set a flag of frames.

    made : array of FRAME
    values : values of the flag in each frame
    """
    if name in ID_FLAGS:
        made["id"] |= np.where(values, np.uint32(ID_FLAGS[name]), np.uint32(0))
    elif name in FD_FLAGS:
        made["flags"] |= np.where(values, np.uint8(FD_FLAGS[name]), np.uint8(0))
    else:
        made[name] = values

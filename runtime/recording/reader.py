"""The records of a recording's file, as far as they are good.

A file that was cut off, or damaged, is read up to there. What is no recording is refused with a line that says what it
is instead.
"""

import difflib
import json
import os
import re
import struct
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

from runtime.base.errors import BadInput
from runtime.base.optional_dependencies import need
from runtime.recording import messages
from runtime.recording.chunks import Expander, TooLarge, parsed, unfinished
from runtime.recording.format import Frame
from runtime.recording.mcap_file import CHUNK_HEAD, HEAD
from runtime.recording.records import A_CHUNK, DATA_END, HEADER, RECORD_LIMIT, compressed

FORMATS = ("1", "2")
SPLITTING = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029]")  # in a name: what would begin another line on a terminal
DEEPEST = 64  # levels of lists and objects in JSON
ATTACHMENTS, LIBRARY = ("about.json", "diagram.json", "end.json"), "tickwork"
MAGIC = b"\x89MCAP0\r\n"
LOOK = 4096  # records between two looks at how far the reading is
MENDED = "was cut off, and what there is of it was completed later"
# what garbage makes of a reader
DAMAGE = (EOFError, struct.error, ValueError, LookupError, TypeError, OverflowError, MemoryError)


@dataclass(frozen=True)
class Recorded:
    """A CAN frame.

    time : ns since the run's begin
    drain : which drain of the buses, counted from 1, found it there, or came before it was sent; 0 before the first
    drained : ns since the run's begin, when that was
    row : how many rows were complete before it
    payload : bytes of a struct Frame
    """

    time: int
    bus: str
    sent: bool
    drain: int
    drained: int
    row: int
    payload: bytes


class Reader:
    """The records of a file, sorted by what they are.

    about, end, diagram : the attachments of these names; None where the file has not got one
    messages : {topic: [bytes]}
    seams : where other parts go on, as runtime.recording.parts has joined them
    began : ns of the wall clock; in virtual time the file's times begin at 0
    finished, trouble : whether its recorder has written its end; if not, what is the matter, in a line
    """

    def __init__(self, path, progress):
        self.about: Any = None
        self.end: Any = None
        self.diagram: Any = None
        self.events, self.frames, self.seams = [], [], []
        self.group = []  # frames since the last row: [(order, Recorded)]
        self.began = 0
        self.messages, self.topics, self.sizes = {messages.ROW_END: []}, {}, {}
        self.finished, self.trouble, self.library = False, "", ""
        need("mcap.stream_reader", "reading a recording")
        self.spoilt = None  # where a chunk begins whose checksum is wrong
        self.count, self.written = 0, None  # messages: those that were read, those that the recorder has counted
        self.refused = ""  # why the file is not read any further, in words
        try:
            with open(path, "rb") as stream:
                size = os.fstat(stream.fileno()).st_size
                self.expander = Expander(size)
                good = self.read(stream, lambda: progress(stream.tell() / max(1, size)))
                self.end_group()
                if not self.finished:
                    self.trouble = f"{path} {self.refused or matter(stream, good, size)}"
                elif self.spoilt is not None:
                    self.finished, self.trouble = (
                        False,
                        (f"{path} is damaged somewhere behind byte {self.spoilt}: a checksum is wrong"),
                    )
                elif self.written not in (None, self.count):
                    self.finished, self.trouble = (
                        False,
                        (f"{path} is damaged: {self.count} of its {self.written} messages can be read"),
                    )
                elif self.end is None:
                    self.finished, self.trouble = False, f"{path} {MENDED}"
        except FileNotFoundError:
            raise BadInput(f"{path}: No such file or directory{nearby(path)}") from None
        except IsADirectoryError:
            raise BadInput(f"{path} is a folder: name the recordings in it, as in {path / '*.mcap'}") from None
        except OSError as error:
            raise BadInput(f"{path}: {error.strerror}") from None
        if self.about is None:
            raise BadInput(f"{path} {self.refused or self.what_else(path, size)}")
        if isinstance(self.about, dict) and self.about.get("format") not in FORMATS:
            raise BadInput(
                f"{path} has format {self.about.get('format')!r}, and this Tickwork reads "
                f"{', '.join(FORMATS)}: "
                "pip install --upgrade tickwork"
            )
        if not sound(self.about):
            raise BadInput(f"{path} is damaged: its about.json does not say which signals it has")

    def read(self, stream, look):
        """Returns how many bytes are good.

        Messages stand one behind the other in a chunk, and are read so where it is torn or its checksum is wrong. A
        compressed one is read whole.
        """
        from mcap.exceptions import McapError

        start = 0
        while True:
            self.at = self.before = start
            self.taking = False
            stream.seek(start)
            try:
                self.read_from(stream, look)
                return self.at
            except (McapError, *DAMAGE) as error:
                bad = self.before if self.taking else self.at
                self.refused = str(error) if isinstance(error, TooLarge) else ""
            if not self.taking and (rest := unfinished(stream, bad)) is not None:
                data, end = rest
                if not self.take_unfinished(data) or end is None:
                    return bad
                start = end
                continue
            stream.seek(bad)
            head = stream.read(CHUNK_HEAD.size)
            if self.taking or head[:1] != bytes([A_CHUNK]) or compressed(head):
                return bad
            self.spoilt = bad if self.spoilt is None else self.spoilt
            start = bad + CHUNK_HEAD.size

    def read_from(self, stream, look):
        """Records up to the end. `before`, `at`: where the newest begins and ends; `taking`: it could be read, and is
        being understood
        """
        from mcap.records import Attachment, Channel, Footer, Header, Message, Statistics

        for number, record in enumerate(self.records(stream)):
            if stream.tell() != self.at:
                self.before, self.at = self.at, stream.tell()
            if number % LOOK == 0:
                look()
            self.taking = True
            if isinstance(record, Message):
                self.take(record)
                self.count += 1
            elif isinstance(record, Attachment) and record.name in ATTACHMENTS:
                try:
                    setattr(self, record.name.removesuffix(".json"), parsed_json(record.data))
                except TooDeep:
                    raise BadInput(
                        f"{stream.name} is damaged: its {record.name} is nested more than {DEEPEST} levels deep"
                    ) from None
            elif isinstance(record, Channel):
                self.topics[record.id] = record.topic
                self.messages.setdefault(record.topic, [])
            elif isinstance(record, Header):
                self.library = record.library
            elif isinstance(record, Statistics):
                self.written = record.message_count
            elif isinstance(record, Footer):
                self.finished = True
            self.taking = False

    def take_unfinished(self, data):
        """Take the messages of a chunk without a head. Returns whether all are valid."""
        from mcap.exceptions import McapError

        try:
            for record in parsed(data):
                self.take(record)
                self.count += 1
        except (McapError, *DAMAGE):
            return False
        return True

    def records(self, stream):
        """Records of the file from `at` on, those of a chunk in its place."""
        from mcap.records import Chunk
        from mcap.stream_reader import StreamReader, breakup_chunk

        size = os.fstat(stream.fileno()).st_size
        for record in StreamReader(
            stream, self.at > 0, emit_chunks=True, validate_crcs=True, record_size_limit=size
        ).records:
            if not isinstance(record, Chunk):
                yield record
            elif record.compression:
                yield from parsed(self.expander.expand(record))
            else:
                yield from breakup_chunk(record, validate_crc=True)

    def what_else(self, path, size):
        """What a file is that is no recording."""
        with open(path, "rb") as stream:
            mcap = stream.read(len(MAGIC)) == MAGIC
        if size == 0 or mcap and self.library == LIBRARY:
            return "was cut off before its first tick: there is nothing in it"
        if mcap:
            return (
                f"is an MCAP file of something else ({self.library or 'it does not say what'}): only recordings "
                "of Tickwork are read"
            )
        beside = path.parent / f"{path.stem}.mcap"
        cure = f"{beside} is" if beside != path and beside.exists() else "name the .mcap file of the run"
        return f"is no recording of Tickwork: {cure}"

    def take(self, record):
        topic = self.topics[record.channel_id]
        if topic.startswith(messages.BUS):
            bus = topic.removeprefix(messages.BUS)
            if self.about["format"] == "1":
                self.frames.append(self.frame(bus, record))
            else:
                self.group.extend(self.frames_of(bus, record))
            return
        self.end_group()
        if topic == messages.EVENTS:
            self.take_event(record)
        else:
            if len(record.data) != self.sizes.setdefault(topic, len(record.data)):
                raise ValueError("a row of another size")
            self.messages[topic].append(record.data)
            if topic == messages.ROW_END:
                rows = len(self.messages[topic])
                for part in self.sizes:
                    if len(self.messages[part]) != rows:
                        self.messages[topic].pop()
                        raise ValueError("a row that lacks something, or has too much")

    def end_group(self):
        """Sort the frames of all buses since the last row."""
        self.frames += [frame for _, frame in sorted(self.group, key=itemgetter(0))]
        self.group = []

    def take_event(self, record):
        event = parsed_json(messages.read(messages.EVENT, record.data)["json"])
        self.events.append(event)
        if event["event"] == "begin":
            self.began = event["wall"]

    def frame(self, bus, record):
        """Return the Recorded of a message of format 1."""
        fields = messages.read(messages.FRAME_V1, record.data)
        return self.recorded(
            bus, record.log_time - self.began, record.sequence, record.publish_time - self.began, fields
        )

    def frames_of(self, bus, record):
        """Return [(order among the frames of all buses, Recorded)] of a message CanFrames."""
        drained, group = messages.split_frames(record.data)
        frames = [messages.read(messages.FRAME, data) for data in group]
        return [
            (
                (record.sequence, fields.get("order", place)),
                self.recorded(bus, fields["time"], record.sequence, drained, fields),
            )
            for place, fields in enumerate(frames)
        ]

    def recorded(self, bus, time, drain, drained, fields):
        truths = (bool(fields.get(name)) for name in messages.FLAGS)
        values: list[Any] = [time, fields["id"], *truths, self.about["buses"].index(bus), fields.get("data", b"")]
        frame = Frame(*values)
        rows = len(self.messages[messages.ROW_END])
        return Recorded(time, bus, frame.sent, drain, drained, rows, frame.pack())


class TooDeep(ValueError):
    """JSON is nested deeper than any that a recorder writes."""


def parsed_json(text):
    """What a JSON text holds. ValueError; TooDeep, so that whoever goes through it later can do so to the bottom"""
    try:
        found = json.loads(text)
    except RecursionError:
        raise TooDeep from None
    layer = [found]
    for _ in range(DEEPEST + 1):
        layer = [
            item
            for held in layer
            if isinstance(held, (dict, list))
            for item in (held.values() if isinstance(held, dict) else held)
        ]
        if not layer:
            return found
    raise TooDeep


def sound(about):
    """Whether all is there that tells what the messages mean."""
    try:
        said = [
            about["name"],
            *about["buses"],
            *(signal[word] for signal in about["signals"] for word in ("path", "unit", "dtype")),
        ]
        return (
            all(isinstance(word, str) and not SPLITTING.search(word) for word in said)
            and about["rate"] > 0
            and isinstance(about["metadata"], dict)
        )
    except (LookupError, TypeError):
        return False


def matter(stream, good, size):
    """What is the matter with a file that is good up to a byte, in words."""
    stream.seek(good)
    head = stream.read(HEAD.size)
    kind, length = HEAD.unpack(head) if len(head) == HEAD.size else (HEADER, 0)
    if HEADER <= kind <= DATA_END and length < RECORD_LIMIT and good + HEAD.size + length >= size:
        return "is not complete: it was cut off, or is still being recorded"
    return f"is damaged from byte {good} of {size} on: what stands before is read"


def nearby(path):
    """What the person may have meant, in words."""
    try:
        names = sorted(name for name in os.listdir(path.parent) if name.endswith(".mcap"))
    except OSError:
        return ""
    close = difflib.get_close_matches(path.name, names, n=1)
    return f": did you mean {path.parent / close[0]}?" if close else ""

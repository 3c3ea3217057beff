"""MCAP export: the parts of a recording, complete or not, as one file with an index.

A complete recording in one compressed file is copied byte for byte, any other message by message.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable

from runtime.record.analysis.trial import Trial
from runtime.record.storage import messages
from runtime.record.storage.files import WholeFile
from runtime.record.storage.mcap_file import MESSAGE, ZSTD, McapFile
from runtime.record.storage.parts import Recording
from runtime.record.storage.reader import Reader
from runtime.record.storage.records import LIBRARY

EXTENSIONS = {"mcap": "mcap"}


def check(trial: Trial, kind: str) -> None:
    """Accept every recording. Arguments are not used"""


def write(trial: Trial, path: str, progress: Callable[[float], None]) -> None:
    """Write the file.

    path : path of the file, which is overwritten
    progress : called with the fraction that is done
    """
    [reader, *rest] = trial.file.readers
    if not rest and not trial.trouble and reader.about == trial.about and is_compressed(reader):
        with open(reader.path, "rb") as source, open(path, "wb") as copy:
            shutil.copyfileobj(source, copy, 1 << 20)
            copy.flush()
            os.fsync(copy.fileno())
        return
    file = WholeFile(path, os.open(path, os.O_WRONLY | os.O_CLOEXEC))
    try:
        copy = Copy(trial.file, file)
        for number in range(len(trial.parts)):
            copy.part(number, lambda share: progress((number + share) / len(trial.parts)))
        copy.writer.finish()
    finally:
        file.close()


def is_compressed(reader: Reader) -> bool:
    """Return whether every chunk of a file is compressed as the recorder does."""
    return all(chunk.compression == ZSTD for chunk in reader.contents.chunks)


class Copy:
    """Copy of the files of a recording into one file.

    recording : runtime.record.storage.parts.Recording
    file : runtime.record.storage.files.WholeFile
    """

    def __init__(self, recording: Recording, file: WholeFile) -> None:
        self.recording, self.writer = recording, McapFile(file)
        self.writer.begin(LIBRARY)
        self.numbers: dict[str, int] = {}  # {topic: number of its channel}
        self.began = 0  # ns of the wall clock at the start of the run

    def part(self, number: int, progress: Callable[[float], None]) -> None:
        """Copy one file. progress : called with the fraction of it that is done"""
        reader, seams = self.recording.readers[number], self.recording.seams
        self.seam, self.following = (
            seams[number - 1] if number else None,
            seams[number] if number < len(seams) else None,
        )
        self.rows = self.seam.rows if self.seam else 0
        contents, chunks = reader.contents, reader.contents.chunks
        begin = chunks[0].at if chunks else reader.size
        self.attachments(reader, [place for place in contents.attachments if place[0] < begin])
        for channel, topic in contents.topics.items():
            if topic not in self.numbers:
                name, descriptor = contents.schemas[channel]
                self.numbers[topic] = self.writer.channel(topic, descriptor, name)
        for done, messages_read in enumerate(reader.ahead(lambda _, messages: messages, range(len(chunks)))):
            if self.writer.is_verified == chunks[done].is_unverified:
                self.writer.end_chunk()
                self.writer.is_verified = not chunks[done].is_unverified
            for data in messages_read.in_order():
                topic = contents.topics.get(MESSAGE.unpack_from(data)[2])
                if topic is not None:
                    self.message(topic, data)
            self.writer.file.flush()
            progress(done / len(chunks))
        self.attachments(reader, [place for place in contents.attachments if place[0] >= begin])

    def attachments(self, reader: Reader, places: list[tuple[int, int]]) -> None:
        """Copy attachments: the metadata from the first part, the end from the last. places : as in Contents"""
        for attachment in reader.attachments(places):
            if self.seam and attachment.name != "end.json" or self.following and attachment.name == "end.json":
                continue
            data, about = attachment.data, self.recording.about
            if attachment.name == "about.json" and json.loads(data) != about:  # its first part was empty
                data = json.dumps(about, ensure_ascii=False).encode()
            self.writer.attach(attachment.name, attachment.media_type, data)

    def join_frames(self, body: bytes, drain: int) -> bytes | None:
        """Return a message CanFrames with the frames before the next part, None without any.

        drain : drain of the part; the time of drain 0 is that of the last drain in the previous part
        """
        drained, group = messages.split_frames(body)
        if self.following and self.following.since is not None:
            until = self.following.since - self.began
            group = [data for data in group if messages.read(messages.FRAME, data)["time"] < until]
        if self.seam and not drain:
            drained = self.seam.drained - self.began
        return messages.frames(drained, group) if group else None

    def message(self, topic: str, data: bytes) -> None:
        """Copy a message if it counts; the number of its drain continues from the previous part."""
        _, _, _, sequence, log_time, publish_time = MESSAGE.unpack_from(data)
        body, limit = data[MESSAGE.size :], self.following.rows if self.following else None
        if topic.startswith(messages.BUS):
            if self.following and self.rows > self.following.rows:
                return
            if self.recording.about["format"] == "1":
                if self.following and self.following.since is not None and log_time >= self.following.since:
                    return
                publish_time = publish_time if sequence or not self.seam else self.seam.drained
            elif self.seam or self.following:
                body = self.join_frames(body, sequence)
                if body is None:
                    return
            sequence += self.seam.drains if self.seam else 0
        elif topic == messages.EVENTS:
            event = json.loads(messages.read(messages.EVENT, body)["json"])
            self.began = event.get("wall", self.began)
            if self.seam and event["event"] == "begin":
                return
        else:
            over = limit is not None and self.rows >= limit
            self.rows += topic == messages.ROW_END
            if over:
                return
        self.writer.message(self.numbers[topic], log_time, body, publish_time, sequence)

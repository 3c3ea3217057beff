"""MCAP export: the parts of a recording, complete or not, as one file with an index.

Every message is copied unchanged. A complete, undamaged recording is copied byte for byte.
"""

import io
import json
import os

from runtime.recording import messages
from runtime.recording.chunks import Expander, walk_all
from runtime.recording.files import WholeFile
from runtime.recording.mcap_file import HEAD, MESSAGE, McapFile
from runtime.recording.records import (
    A_CHUNK,
    A_MESSAGE,
    ATTACHMENT,
    CHANNEL,
    DAMAGE,
    DATA_END,
    LIBRARY,
    MAGIC,
    SCHEMA,
    compressed,
    read,
    walk,
)

FLUSH = 1 << 20  # bytes buffered in memory


def check(trial, kind):
    pass


def write(trial, path, progress):
    file = WholeFile(path, os.open(path, os.O_WRONLY | os.O_CLOEXEC))
    try:
        copy = Copy(trial, file)
        for number in range(len(trial.parts)):
            copy.part(number, lambda share: progress((number + share) / len(trial.parts)))
        copy.writer.finish()
    finally:
        file.close()


class Copy:
    """Copy of the files of a Trial into one McapFile."""

    def __init__(self, trial, file):
        self.trial, self.writer = trial, McapFile(file)
        self.writer.begin(LIBRARY)
        self.numbers = {}  # {topic: number of its channel}
        self.began = 0  # ns of the wall clock at the start of the run

    def part(self, number, progress):
        from mcap.exceptions import McapError

        path, seams = self.trial.parts[number], self.trial.seams
        self.seam, self.following = (
            seams[number - 1] if number else None,
            seams[number] if number < len(seams) else None,
        )
        self.rows = self.seam.rows if self.seam else 0
        schemas, topics = {}, {}  # of the part: {number: ...}
        size = path.stat().st_size
        self.expander = Expander(size)
        with open(path, "rb", buffering=0) as stream:
            for at, kind, data in walk_all(stream, len(MAGIC)):
                try:
                    self.record(kind, data, schemas, topics)
                except (McapError, *DAMAGE):  # the reader has reported it
                    return
                if kind == DATA_END:
                    return
                if self.writer.file.waiting > FLUSH:
                    self.writer.file.flush()
                    progress(at / size)

    def record(self, kind, data, schemas, topics):
        body = data[HEAD.size :]
        if kind == A_CHUNK and compressed(data):
            for _, inside, record in walk(io.BytesIO(self.expander.expand(read("Chunk", body))), 0):
                if inside in (SCHEMA, CHANNEL, A_MESSAGE):
                    self.record(inside, record, schemas, topics)
        elif kind == A_MESSAGE:
            self.message(topics[MESSAGE.unpack_from(data)[2]], data)
        elif kind == SCHEMA:
            schema = read("Schema", body)
            schemas[schema.id] = schema
        elif kind == CHANNEL:
            channel = read("Channel", body)
            topics[channel.id] = channel.topic
            if channel.topic not in self.numbers:
                schema = schemas[channel.schema_id]
                self.numbers[channel.topic] = self.writer.channel(channel.topic, schema.data, schema.name)
        elif kind == ATTACHMENT:
            self.attachment(read("Attachment", body))

    def attachment(self, attachment):
        """Copy an attachment: the metadata from the first part, the end from the last."""
        if self.seam and attachment.name != "end.json" or self.following and attachment.name == "end.json":
            return
        data = attachment.data
        if attachment.name == "about.json" and json.loads(data) != self.trial.about:  # its first part was empty
            data = json.dumps(self.trial.about, ensure_ascii=False).encode()
        self.writer.attach(attachment.name, attachment.media_type, data)

    def joined(self, body, drain):
        """Return a message CanFrames with the frames before the next part, None without any.

        drain : of the part; the time of drain 0 is that of the last drain in the previous part
        """
        drained, group = messages.split_frames(body)
        if self.following and self.following.since is not None:
            until = self.following.since - self.began
            group = [data for data in group if messages.read(messages.FRAME, data)["time"] < until]
        if self.seam and not drain:
            drained = self.seam.drained - self.began
        return messages.frames(drained, group) if group else None

    def message(self, topic, data):
        """Copy a message if it counts; the number of its drain continues from the previous part."""
        _, _, _, sequence, log_time, publish_time = MESSAGE.unpack_from(data)
        body, limit = data[MESSAGE.size :], self.following.rows if self.following else None
        if topic.startswith(messages.BUS):
            if self.following and self.rows > self.following.rows:
                return
            if self.trial.about["format"] == "1":
                if self.following and self.following.since is not None and log_time >= self.following.since:
                    return
                publish_time = publish_time if sequence or not self.seam else self.seam.drained
            elif self.seam or self.following:
                body = self.joined(body, sequence)
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

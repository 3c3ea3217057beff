"""What a recorder that has died had not handed over: it stands in the flight logs of the parts that were left."""

import json
import os

import numpy as np

from runtime.recorder.mcap_file import HEAD, MESSAGE
from runtime.recorder.mcap_mending import A_MESSAGE, ATTACHMENT, CHANNEL, read, walk
from runtime.recordings import messages
from runtime.recordings.reader import MAGIC

MOST = 5000                     # rows at once


def orders(paths, columns, after):
    """In order, a dict for each event, and arrays (rows, 2 + columns) of tick, time and values for what is behind tick `after`.

    paths : of flight logs, of which nothing but the last record may be torn
    columns : places in the row
    after : None for all
    """
    for path in paths:
        if not os.path.getsize(path):           # its recorder died before it had begun
            continue
        log = Log(columns)
        with open(path, "rb") as stream:
            stream.seek(len(MAGIC))
            for _, kind, data in walk(stream, len(MAGIC)):
                event = log.take(kind, data, after)
                if event is not None and event["event"] != "begin":
                    yield from log.rows()
                    yield event
                if len(log.kept) >= MOST:
                    yield from log.rows()
        yield from log.rows()


class Log:
    """One flight log, record by record. kept : of each row that was not given out, its messages"""

    def __init__(self, columns):
        self.columns, self.topics, self.subsystems = columns, {}, []
        self.row, self.kept = {}, []

    def take(self, kind, data, after):
        """A record. Returns the event that it is, or None."""
        if kind == A_MESSAGE:
            topic, body = self.topics.get(MESSAGE.unpack_from(data)[2], messages.BUS), data[MESSAGE.size:]
            if topic == messages.EVENTS:
                return json.loads(messages.read(messages.EVENT, body)["json"])
            if not topic.startswith(messages.BUS):
                self.row[topic] = body
            if topic == messages.ROW_END:
                if after is None or messages.read(messages.TICK, body)["tick"] > after:
                    self.kept.append(self.row)
                self.row = {}
        elif kind == CHANNEL:
            channel = read("Channel", data[HEAD.size:])
            self.topics[channel.id] = channel.topic
        elif kind == ATTACHMENT:
            attachment = read("Attachment", data[HEAD.size:])
            if attachment.name == "about.json":
                about = json.loads(attachment.data)
                self.subsystems = messages.subsystems(about["name"], [(place, signal["path"]) for place, signal in enumerate(about["signals"])])
        return None

    def rows(self):
        """What is kept, if there is anything."""
        if not self.kept:
            return
        width = sum(len(subsystem.columns) for subsystem in self.subsystems)
        values = np.empty((len(self.kept), 2 + width))
        ticks = np.frombuffer(b"".join(row[messages.ROW_END] for row in self.kept), dtype=messages.TICK_ROW)
        values[:, 0], values[:, 1] = ticks["tick"], ticks["time"]
        for subsystem in self.subsystems:
            subsystem.fill(values[:, 2:], [row[subsystem.topic] for row in self.kept])
        self.kept = []
        yield values[:, [0, 1, *(2 + place for place in self.columns)]]

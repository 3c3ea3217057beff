"""The flight log: one MCAP file with everything of a run, for PlotJuggler, Foxglove, Rerun and replays.

    /left, /right, ...      one message per subsystem and tick, with its recorded signals as doubles
    /tickwork/tick          last message of a tick: number, time and lateness in s
    /tickwork/can/legs, ... every CAN frame, received or sent, in the order in which the control process handled
                            them; `sequence` is the number of the bus drain that returned or preceded it,
                            `publish_time` the time of that drain
    /tickwork/events        other events: the start by both clocks, live changes, marks, the end

Times in ns are the wall clock at the start of the run plus the monotonic clock since; in virtual time they begin at 0.
Records are written as they arrive, so a truncated file contains all complete records before the cut. The attachments
`diagram.json` and `about.json` precede the first tick, and `end.json` follows the last.
"""

import json
import os

from runtime.recorder.service import Service
from runtime.recording import messages
from runtime.recording.files import WholeFile, claim, create
from runtime.recording.format import Frame
from runtime.recording.mcap_file import McapFile
from runtime.recording.reader import LIBRARY

FORMAT_VERSION = "1"
JSON_MEDIA_TYPE = "application/json"


class FlightLog(Service):
    """The flight log of a recording."""

    title = "flight log"

    @property
    def unfinished(self):
        return self.file.path

    def open(self):
        self.file = WholeFile(*create(os.path.join(self.plan["folder"], self.plan["stem"]), ".mcap"))
        claim(self.file.descriptor)
        self.files[self.file.path] = ""
        self.rows = self.frames = 0
        self.drain = self.drained = 0  # number of bus drains, ns of the last one
        self.heads = {}  # first bytes of a frame's message, and its channel
        self.writer: McapFile | None = None
        self.begun, self.began = False, 0

    def begin(self, about):
        """Import the writer and write the attachments and channels. about : dict"""
        self.writer = writer = McapFile(self.file)
        self.write = writer.message
        writer.begin(LIBRARY)
        if self.plan.get("diagram_json"):
            writer.attach("diagram.json", JSON_MEDIA_TYPE, self.plan["diagram_json"].encode())
        writer.attach(
            "about.json",
            JSON_MEDIA_TYPE,
            json.dumps(
                {**about, "format": FORMAT_VERSION, "signals": self.plan["signals"]}, ensure_ascii=False
            ).encode(),
        )
        self.subsystems = [
            (subsystem, writer.channel(subsystem.topic, *subsystem.descriptor()))
            for subsystem in messages.subsystems(
                self.plan["name"], [(place, signal["path"]) for place, signal in enumerate(self.plan["signals"])]
            )
        ]
        own_tick, own_frame, own_event = messages.OWN
        self.tick = writer.channel(messages.ROW_END, *messages.simple(own_tick, messages.TICK))
        self.buses = [
            writer.channel(messages.BUS + bus, *messages.simple(own_frame, messages.FRAME))
            for bus in self.plan["buses"]
        ]
        self.events = writer.channel(messages.EVENTS, *messages.simple(own_event, messages.EVENT))

    def wall(self, time):
        """Convert ns since the start of the run to ns in the file."""
        if not self.begun:
            self.begun = True
            if not self.plan["virtual"]:
                assert self.page is not None
                self.began = self.page.wall
                self.event({"event": "begin", "tick": -1, "wall": self.page.wall, "monotonic": self.page.began})
        return self.began + time

    def every_signal(self, tick, time, lateness, values):
        assert self.page is not None
        at = self.wall(self.page.first_tick + round(time * 1e9))
        write = self.write
        for subsystem, channel in self.subsystems:
            write(channel, at, subsystem.encode([values[place] for place in subsystem.columns]), at, tick)
        write(self.tick, at, messages.tick(tick, time, lateness), at, tick)
        self.rows += 1

    def received(self, payload):
        """Take the time of a bus drain, in ns since the start of the run. The frames received then follow."""
        self.drain += 1
        self.drained = int.from_bytes(payload, "little", signed=True)

    def frame(self, payload):
        key = payload[8:16]
        head = self.heads.get(key)
        if head is None:
            head = self.heads[key] = self.frame_head(payload)
        channel, begin, length = head
        at = self.wall(int.from_bytes(payload[:8], "little", signed=True))
        self.write(channel, at, begin + payload[16 : 16 + length], self.wall(self.drained), self.drain)
        self.frames += 1

    def frame_head(self, payload):
        frame = Frame.unpack(payload)
        length = len(frame.data)
        return self.buses[frame.bus], messages.frame_head(frame.id, frame.truths) + messages.varint(length), length

    def event(self, event):
        assert self.page is not None
        at = self.wall(self.page.first_tick + round(max(0, event.get("tick", 0)) / self.plan["rate"] * 1e9))
        self.write(self.events, at, messages.event(event["event"], event.get("tick", -1), json.dumps(event)), at)

    def flush(self):
        self.file.flush()

    def end(self, report):
        """Write end.json and the summary of the file."""
        if self.writer is not None:
            self.writer.attach("end.json", JSON_MEDIA_TYPE, json.dumps(report).encode())
            self.writer.finish()

    def close(self):
        self.file.close()
        self.files[self.file.path] = f"{self.rows} ticks of {len(self.plan['signals'])} signals, {self.frames} frames"
        return {"file": self.file.path, "rows": self.rows, "frames": self.frames, "bytes": self.file.size}

"""The flight log: one MCAP file with everything of a run, for PlotJuggler, Foxglove, Rerun and replays.

    /left, /right, ...      one message per subsystem and tick, with its recorded signals as doubles
    /tickwork/tick          last message of a tick: number, time and lateness in s
    /tickwork/can/legs, ... one message per bus drain and bus, with the frames received in it and those sent after it,
                            in the order in which the control process handled them; `sequence` is the number of the
                            drain. A row or an event ends the message; frames that follow are in another one
    /tickwork/events        other events: the start by both clocks, live changes, marks, the end

Times in ns are the wall clock at the start of the run plus the monotonic clock since; in virtual time they begin at 0.
Messages are in the order of the ring, in compressed chunks (runtime.recording.mcap_file): a truncated file contains all
that was flushed before the cut. The attachments `diagram.json` and `about.json` precede the first tick, and `end.json`
follows the last.
"""

import json
import os

from runtime.recorder.service import Service
from runtime.recording import messages
from runtime.recording.files import WholeFile, claim, create
from runtime.recording.format import Frame
from runtime.recording.mcap_file import ZSTD, McapFile
from runtime.recording.reader import LIBRARY

FORMAT_VERSION = "2"
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
        self.group, self.order = {}, 0  # frames since the last drain, row or event: {bus: messages}; how many
        self.group_time = 0  # ns since the start of the run
        self.writer: McapFile | None = None
        self.begun, self.began = False, 0

    def begin(self, about):
        """Import the writer and write the attachments and channels. about : dict"""
        self.writer = writer = McapFile(self.file, self.plan.get("compression", ZSTD))
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
        own_tick, _, own_event, _ = messages.OWN
        self.tick = writer.channel(messages.ROW_END, *messages.simple(own_tick, messages.TICK))
        self.buses = [writer.channel(messages.BUS + bus, *messages.frames_descriptor()) for bus in self.plan["buses"]]
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
        self.end_group()
        at = self.wall(self.page.first_tick + round(time * 1e9))
        write = self.write
        for subsystem, channel in self.subsystems:
            write(channel, at, subsystem.encode([values[place] for place in subsystem.columns]), at, tick)
        write(self.tick, at, messages.tick(tick, time, lateness), at, tick)
        self.rows += 1

    def received(self, payload):
        """Take the time of a bus drain, in ns since the start of the run. The frames received then follow."""
        self.end_group()
        self.drain += 1
        self.drained = int.from_bytes(payload, "little", signed=True)

    def frame(self, payload):
        frame = Frame.unpack(payload)
        if not self.order:
            self.group_time = self.drained if self.drain else frame.time
        order = self.order if len(self.buses) > 1 else None
        self.group.setdefault(frame.bus, []).append(
            messages.frame(frame.time, frame.id, frame.truths, frame.data, order)
        )
        self.order += 1
        self.frames += 1

    def end_group(self):
        """Write the frames since the last drain, row or event."""
        group, self.group, self.order = self.group, {}, 0
        for bus in sorted(group):
            at = self.wall(self.group_time)
            self.write(self.buses[bus], at, messages.frames(self.drained, group[bus]), at, self.drain)

    def event(self, event):
        assert self.page is not None
        self.end_group()
        at = self.wall(self.page.first_tick + round(max(0, event.get("tick", 0)) / self.plan["rate"] * 1e9))
        self.write(self.events, at, messages.event(event["event"], event.get("tick", -1), json.dumps(event)), at)

    def flush(self):
        if self.writer is None:
            self.file.flush()
        else:
            self.end_group()
            self.writer.flush()

    def end(self, report):
        """Write end.json and the summary of the file."""
        if self.writer is not None:
            self.end_group()
            self.writer.attach("end.json", JSON_MEDIA_TYPE, json.dumps(report).encode())
            self.writer.finish()

    def close(self):
        self.file.close()
        self.files[self.file.path] = f"{self.rows} ticks of {len(self.plan['signals'])} signals, {self.frames} frames"
        return {"file": self.file.path, "rows": self.rows, "frames": self.frames, "bytes": self.file.size}

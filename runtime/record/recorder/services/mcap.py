"""The flight log: one MCAP file with everything of a run, for PlotJuggler, Foxglove, Rerun and replays.

    /left, /right, ...      one message per subsystem and tick, with its recorded signals as doubles
    /left_every_4, ...      the same, at every fourth tick: signals that are recorded at a lower rate
    /tickwork/tick          last message of a tick: number, time and lateness in s
    /tickwork/can/legs, ... one message per bus drain and bus, with the frames received in it and those sent after it,
                            in the order in which the control process handled them; `sequence` is the number of the
                            drain. A row, an event or a flush ends the message; frames that follow are in another
    /tickwork/events        other events: the start by both clocks, live changes, marks, the end

Times in ns are the wall clock at the start of the run plus the monotonic clock since; in virtual time they begin at 0.
Messages are in the order of the ring, in compressed chunks (runtime.record.storage.mcap_file): a truncated file
contains all that was flushed before the cut. The attachments `diagram.json` and `about.json` precede the first tick,
and `end.json` follows the last.
"""

import json
from typing import Any

from cext.recording.mcap_encoder import Encoder
from runtime.host.console.styles import count
from runtime.record.recorder.service import Service
from runtime.record.storage import messages
from runtime.record.storage.files import WholeFile, claim, create
from runtime.record.storage.mcap_file import CHUNK, ZSTD, McapFile
from runtime.record.storage.records import LIBRARY

ROW_HEAD = 2  # numbers before the signals of a row
JSON_MEDIA_TYPE = "application/json"


def version(signals: list[dict[str, Any]]) -> str:
    """Return the format of a recording: "3" if signals have periods, which readers of format "2" do not expect."""
    return "3" if any(signal.get("every", 1) > 1 for signal in signals) else "2"


class FlightLog(Service):
    """The flight log of a recording."""

    title = "flight log"

    @property
    def unfinished(self) -> str:
        return self.file.path

    def open(self) -> None:
        self.file = WholeFile(*create(self.stem, ".mcap"), self.durable)
        claim(self.file.descriptor)
        self.files[self.file.path] = ""
        self.writer: Any = None
        self.encoder: Any = None
        self.begun, self.began = False, 0

    def begin(self, about: dict[str, Any]) -> None:
        """Import the writer and write the attachments and channels. about : dict"""
        self.writer = writer = McapFile(self.file, self.plan.get("compression", ZSTD))
        writer.begin(LIBRARY)
        if diagram := self.plan.get("diagram_json"):
            writer.attach("diagram.json", JSON_MEDIA_TYPE, diagram.encode())
        writer.attach(
            "about.json",
            JSON_MEDIA_TYPE,
            json.dumps(
                {**about, "format": version(self.plan["signals"]), "signals": self.plan["signals"]}, ensure_ascii=False
            ).encode(),
        )
        templates = []
        for subsystem in messages.subsystems(self.plan["name"], self.plan["signals"]):
            body, places = subsystem.template()
            channel = writer.channel(subsystem.topic, *subsystem.descriptor())
            places = [(place, ROW_HEAD + column) for place, column in places]
            templates.append((channel, body, places, subsystem.every))
        own_tick, _, own_event, _ = messages.OWN
        tick = writer.channel(messages.ROW_END, *messages.simple(own_tick, messages.TICK))
        buses = [writer.channel(messages.BUS + bus, *messages.frames_descriptor()) for bus in self.plan["buses"]]
        self.events = writer.channel(messages.EVENTS, *messages.simple(own_event, messages.EVENT))
        self.encoder = Encoder(float(self.plan["rate"]), templates, tick, buses)

    def begin_run(self) -> None:
        """Read the clock at the start of the run and write it as the first event. In virtual time it is 0."""
        if not self.begun:
            self.begun = True
            if not self.plan["virtual"]:
                assert self.shared is not None
                self.began = self.shared.wall
                self.event({"event": "begin", "tick": -1, "wall": self.shared.wall, "monotonic": self.shared.began})

    def records(self, batch: Any) -> None:
        assert self.shared is not None and self.writer is not None
        self.begin_run()
        at, first_tick = 0, self.shared.first_tick
        while at < batch.size:
            at = self.encoder.encode(batch, at, self.writer.size, CHUNK, self.began, first_tick)
            if at < batch.size:
                self.write_encoded()

    def write_encoded(self) -> None:
        """Pass the encoded messages to the file."""
        if self.encoder.size:
            self.writer.messages(*self.encoder.take())

    def end_group(self) -> None:
        """Encode the frames since the last row or drain, and pass all messages to the file."""
        self.encoder.end_group(self.writer.size)
        self.write_encoded()

    def event(self, event: dict[str, Any]) -> None:
        assert self.shared is not None and self.writer is not None
        self.begin_run()
        self.end_group()
        at = self.began + self.shared.first_tick + round(max(0, event.get("tick", 0)) / self.plan["rate"] * 1e9)
        data = messages.event(event["event"], event.get("tick", -1), json.dumps(event))
        self.writer.message(self.events, at, data, at)

    def flush(self) -> None:
        if self.writer is None:
            self.file.flush()
        else:
            self.end_group()
            self.writer.flush()

    def end(self, report: dict[str, Any]) -> None:
        """Write end.json and the summary of the file."""
        if self.writer is not None:
            self.end_group()
            self.writer.attach("end.json", JSON_MEDIA_TYPE, json.dumps(report).encode())
            self.writer.finish()

    def close(self) -> dict[str, Any]:
        self.file.close()
        rows, frames = (0, 0) if self.encoder is None else (self.encoder.row_count, self.encoder.frame_count)
        self.files[self.file.path] = (
            f"{count(rows, 'tick')} of {count(len(self.plan['signals']), 'signal')}, {count(frames, 'frame')}"
        )
        return {"file": self.file.path, "rows": rows, "frames": frames, "bytes": self.file.size}


SERVICE = FlightLog

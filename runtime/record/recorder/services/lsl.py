"""Lab Streaming Layer: a stream with the signals, and one with the events, as LabRecorder writes them to an XDF file.

The time stamp of a sample is the grid time of its tick, on CLOCK_MONOTONIC, which is the clock of LSL.
"""

from __future__ import annotations

import socket
import time
from array import array
from typing import Any

from runtime.host.liblsl import Outlet
from runtime.record.recorder.service import Service
from runtime.record.storage.changes import event_text
from runtime.robot.loading.signal_selection import select

SIGNALS, MARKERS = "Signals", "Markers"  # content types; XDF tools take a stream of type Markers as events
LINGER = 0.1  # s, in which receivers get the last samples


class LslSender(Service):
    """Serves blocks.sinks.Lsl."""

    def open(self) -> None:
        parameters, columns = self.sink["parameters"], self.sink["columns"]
        self.places = select(columns, parameters["signals"])
        self.decimation, self.last = parameters["decimation"], None  # last : newest tick over the decimation
        name = parameters["stream"] or self.plan["name"]
        source = f"tickwork {socket.gethostname()} {name}"
        about = [("manufacturer", "Tickwork"), ("model", self.plan["name"]), ("recording", self.plan["stem"])]
        channels = [(columns[place]["path"], columns[place]["unit"]) for place in self.places]
        rate = self.plan["rate"] / self.decimation
        self.signals = Outlet(name, SIGNALS, source, channels, rate, about=about)
        self.markers = Outlet(f"{name} events", MARKERS, f"{source} events", [("event", "")], texts=True, about=about)
        self.values, self.stamps = array("d"), array("d")  # of the samples that are sent next
        self.sent = 0

    def began(self) -> float:
        """Return the time of tick 0 in s of CLOCK_MONOTONIC. Valid once a row has been taken."""
        return time.monotonic() if self.shared is None else (self.shared.began + self.shared.first_tick) * 1e-9

    def records(self, batch: Any) -> None:
        super().records(batch)
        if self.stamps:
            self.signals.push(self.values.tobytes(), self.stamps.tobytes())
            self.sent += len(self.stamps)
            self.values, self.stamps = array("d"), array("d")

    def row(self, tick: int, time: float, values: list[float]) -> None:
        if tick // self.decimation == self.last:
            return
        self.last = tick // self.decimation
        self.stamps.append(self.began() + time)
        self.values.extend([values[place] for place in self.places])

    def event(self, event: dict[str, Any]) -> None:
        text, tick = event_text(event), event.get("tick")
        if text:
            stamp = time.monotonic()
            if tick is not None and self.last is not None:
                stamp = self.began() + tick / self.plan["rate"]
            self.markers.push_text(text, stamp)

    def close(self) -> dict[str, Any]:
        if self.signals.has_receivers or self.markers.has_receivers:
            time.sleep(LINGER)
        self.signals.close()
        self.markers.close()
        return {"samples": self.sent}


SERVICE = LslSender

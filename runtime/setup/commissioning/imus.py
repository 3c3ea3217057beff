"""Inertial sensors on serial lines: those that respond, and one or more shown live, with synchronisation inputs."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from blocks.families import families
from blocks.gpio import SyncIn
from graph import Diagram, StreamDevice
from runtime.host.errors import BadInput
from runtime.robot.rig.dialogue_line import Seen
from runtime.robot.rig.streams import StreamLines
from runtime.setup.commissioning.watched import WatchedBlocks

if TYPE_CHECKING:
    from runtime.setup.commissioning.watched import Fed

POLL_INTERVAL = 0.0005  # s between two polls
SYNC_OUTPUTS = ("on", "rises", "falls")


@dataclass(frozen=True)
class Found:
    """Sensor that responds on a serial port."""

    family: str
    port: str
    serial: str
    model: str
    firmware: str
    options: str
    block: type[StreamDevice]


def look(baudrate: int = 115200) -> tuple[list[Found], list[str]]:
    """Return (Found of every sensor that responds, errors of ports that could not be queried)."""
    names = {kind: family.name for family in families() for kind in family.sensors}
    seen = Seen(names).look(baudrate)
    sensors = []
    for path, sensor in sorted(seen.open.items()):
        about = sensor.about
        sensors.append(
            Found(names[sensor.kind], path, about.serial, about.model, about.firmware, about.options, sensor.kind)
        )
    seen.close()
    return sensors, [str(problem) for problem in seen.problems]


def text(sensors: Sequence[Found]) -> list[str]:
    """Return the lines of the report. sensors : as returned by `look`"""
    return [
        f"port {each.port}  {each.family} {each.model}  serial {each.serial}, firmware {each.firmware}, {each.options}"
        for each in sensors
    ]


def plain(sensor: Found) -> dict[str, str]:
    """Return a sensor as a dict for JSON."""
    row = asdict(sensor)
    return {name: value for name, value in row.items() if name != "block"}


def sync_input(place: str) -> SyncIn:
    """Return the block of a synchronisation input. place : PIN or CHIP:PIN; the chip by default is /dev/gpiochip0"""
    chip, _, pin = place.rpartition(":")
    return SyncIn(chip=chip or SyncIn.parameters["chip"].default, pin=pin, name="sync_" + re.sub(r"\W", "_", pin))


class WatchedImus(WatchedBlocks):
    """Inertial sensors on serial lines, shown together.

    serials : last digits of each serial number; empty for every sensor that responds
    channels : names of the channels to stream
    rate : Hz
    sync : GPIO inputs whose level and number of edges are shown beside the samples, as PIN or CHIP:PIN

    Raises BadInput if a sensor does not respond, or an input cannot be opened.
    """

    shown = ("accel", "gyro", "euler", "temperature", "on", "rises")

    def __init__(
        self,
        serials: Sequence[str],
        channels: Sequence[str],
        rate: float,
        attitude: str = "filter",
        sync: Sequence[str] = (),
    ) -> None:
        known = [kind for family in families() for kind in family.sensors]
        seen = look()[0] if len(known) > 1 or not serials else []
        serials = serials or [sensor.serial for sensor in seen]
        if not serials:
            names = " or ".join(kind.sensor for kind in known)
            raise BadInput(f"no {names} responds on any port; the command `doctor` checks the ports")
        with Diagram("stream", rate=rate) as diagram:
            blocks = [
                next((sensor.block for sensor in seen if sensor.serial.endswith(serial)), known[0])(
                    serial=serial,
                    channels=channels,
                    rate=rate,
                    attitude=attitude,
                    name=f"imu_{serial.replace('.', '_')}",
                )
                for serial in serials
            ]
            blocks += [sync_input(place) for place in sync]
        outputs = (*channels, *("euler",) * ("quaternion" in channels), *SYNC_OUTPUTS * bool(sync))
        super().__init__(diagram, lambda block: [name for name in block.outputs if name in outputs])
        self.imus = [fed for fed in self.fed if not isinstance(fed.block, SyncIn)]
        self.lines = StreamLines(blocks)
        if self.lines.problems:
            self.lines.close()
            raise BadInput("\n".join(map(str, self.lines.problems)))
        self.lines.start(0)
        for block in blocks:
            self.lines.lines[block.bus][1].begin(time.monotonic_ns())

    def ask(self, timeout: float) -> dict[str, list[float]] | None:
        """Return {path of a port: its values} after a new sample, or None after `timeout` s without one."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            if any([self.drain(fed) for fed in self.fed]) and all(
                self.values_of(fed, "packets")[0] for fed in self.imus
            ):
                return self.answer()
            time.sleep(POLL_INTERVAL)
        return None

    def drain(self, fed: Fed) -> bool:
        """Decode the bytes that a device has sent. Returns whether they completed a packet of a sensor."""
        before = self.values_of(fed, "packets") if fed in self.imus else None
        for kind, _, data, when in self.lines.lines[fed.block.bus][1].end.receive():
            self.feed(fed, data, when, kind)
        return before is not None and self.values_of(fed, "packets") != before

    def summary(self) -> list[str]:
        """Return the lines shown at the end: one per device."""
        return [
            f"{fed.block.path}: {self.values_of(fed, 'rises')[0]:g} rising and {self.values_of(fed, 'falls')[0]:g} "
            f"falling edges"
            for fed in self.fed
            if fed not in self.imus
        ] + [
            f"{fed.block.path}: {self.values_of(fed, 'packets')[0]:g} packets, "
            f"{self.values_of(fed, 'corrupt')[0]:g} corrupt, "
            f"{self.values_of(fed, 'lost')[0]:g} samples lost, {self.values_of(fed, 'measured_rate')[0]:.1f} Hz"
            for fed in self.imus
        ]

    def close(self) -> None:
        """Close the serial ports."""
        self.lines.close()

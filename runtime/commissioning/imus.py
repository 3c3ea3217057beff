"""Inertial sensors on serial lines: those that respond, and one or more shown live."""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from blocks.families import families
from graph import Diagram
from runtime.base.errors import BadInput
from runtime.commissioning.watched import WatchedBlocks
from runtime.rig.dialogue_line import Seen
from runtime.rig.streams import StreamLines

POLL_INTERVAL = 0.0005  # s between two polls


@dataclass(frozen=True)
class Found:
    """Sensor that responds on a serial port."""

    family: str
    port: str
    serial: str
    model: str
    firmware: str
    options: str
    block: type


def look(baudrate: int = 115200) -> tuple[list[Any], list[Any]]:
    """Return (Found of every sensor that responds, errors of ports that could not be queried)."""
    names = {kind: family.name for family in families() for kind in family.sensors}
    seen = Seen(names).look(baudrate)
    found = []
    for path, sensor in sorted(seen.open.items()):
        about = sensor.about
        found.append(
            Found(names[sensor.kind], path, about.serial, about.model, about.firmware, about.options, sensor.kind)
        )
    seen.close()
    return found, [str(trouble) for trouble in seen.troubles]


def text(found: Sequence[Any]) -> list[Any]:
    """Return the lines of the report."""
    return [
        f"port {each.port}  {each.family} {each.model}  serial {each.serial}, firmware {each.firmware}, {each.options}"
        for each in found
    ]


def plain(found):
    row = asdict(found)
    return {name: value for name, value in row.items() if name != "block"}


class WatchedImus(WatchedBlocks):
    """Inertial sensors on serial lines, shown together.

    serials : last digits of each serial number; empty for every sensor that responds
    channels : names of the channels to stream
    rate : Hz

    Raises BadInput if a sensor does not respond.
    """

    shown = ("accel", "gyro", "euler", "temperature")

    def __init__(self, serials, channels, rate, attitude: str = "filter") -> None:
        known = [kind for family in families() for kind in family.sensors]
        seen = look()[0] if len(known) > 1 or not serials else []
        serials = serials or [found.serial for found in seen]
        if not serials:
            names = " or ".join(kind.sensor for kind in known)
            raise BadInput(f"no {names} responds on any port; the command `doctor` checks the ports")
        with Diagram("stream", rate=rate) as diagram:
            blocks = [
                next((found.block for found in seen if found.serial.endswith(serial)), known[0])(
                    serial=serial,
                    channels=channels,
                    rate=rate,
                    attitude=attitude,
                    name=f"imu_{serial.replace('.', '_')}",
                )
                for serial in serials
            ]
        outputs = (*channels, *("euler",) * ("quaternion" in channels))
        super().__init__(diagram, lambda block: [name for name in block.outputs if name in outputs])
        self.lines = StreamLines(blocks)
        if self.lines.troubles:
            self.lines.close()
            raise BadInput("\n".join(map(str, self.lines.troubles)))
        self.lines.start(0)
        for block in blocks:
            self.lines.lines[block.bus][1].begin(time.monotonic_ns())

    def ask(self, timeout):
        """Return {path of a port: its values} after a new sample, or None after `timeout` s without one."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            if any([self.drain(fed) for fed in self.fed]) and all(
                self.values_of(fed, "packets")[0] for fed in self.fed
            ):
                return self.answer()
            time.sleep(POLL_INTERVAL)
        return None

    def drain(self, fed):
        before = self.values_of(fed, "packets")
        for kind, _, data, when in self.lines.lines[fed.block.bus][1].end.receive():
            self.feed(fed, data, when, kind)
        return self.values_of(fed, "packets") != before

    def summary(self):
        """Return the lines shown at the end: one per sensor."""
        return [
            f"{fed.block.path}: {self.values_of(fed, 'packets')[0]:g} packets, "
            f"{self.values_of(fed, 'corrupt')[0]:g} corrupt, "
            f"{self.values_of(fed, 'lost')[0]:g} samples lost, {self.values_of(fed, 'measured_rate')[0]:.1f} Hz"
            for fed in self.fed
        ]

    def close(self) -> None:
        self.lines.close()

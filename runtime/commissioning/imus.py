"""Inertial sensors on serial lines: which there are, and one or more watched live."""

import time
from dataclasses import asdict, dataclass

from blocks.imus import MicroStrain
from graph import Diagram
from runtime.base.errors import BadInput
from runtime.commissioning.watched import WatchedBlocks
from runtime.rig.microstrain import Seen
from runtime.rig.streams import StreamLines

REST = 0.0005  # s between looks


@dataclass(frozen=True)
class Found:
    """A sensor that has answered."""

    family: str
    port: str
    serial: str
    model: str
    firmware: str
    options: str


def look(baudrate=115200):
    """(Found of every sensor that answers, lines on ports that could not be asked)"""
    seen = Seen().look(baudrate)
    found = [
        Found("MicroStrain", path, about.serial, about.model, about.firmware, about.options)
        for path, (_, about) in sorted(seen.open.items())
    ]
    seen.close()
    return found, [str(trouble) for trouble in seen.troubles]


def text(found):
    """Lines for a person."""
    return [
        f"port {each.port}  {each.family} {each.model}  serial {each.serial}, firmware {each.firmware}, {each.options}"
        for each in found
    ]


def plain(found):
    return asdict(found)


class WatchedImus(WatchedBlocks):
    """Sensors that are watched together. BadInput where one is not there.

    serials : last digits of each; none: every one that answers
    channels : what they are asked for; rate in Hz
    """

    shown = ("accel", "gyro", "euler", "temperature")

    def __init__(self, serials, channels, rate, attitude="filter"):
        serials = serials or [found.serial for found in look()[0]]
        if not serials:
            raise BadInput("no MicroStrain sensor answers on any port; the command `doctor` looks at ports")
        with Diagram("stream", rate=rate) as diagram:
            blocks = [
                MicroStrain(
                    serial=serial,
                    channels=channels,
                    rate=rate,
                    attitude=attitude,
                    name=f"imu_{serial.replace('.', '_')}",
                )
                for serial in serials
            ]
        wanted = (*channels, *("euler",) * ("quaternion" in channels))
        super().__init__(diagram, lambda block: [name for name in block.outputs if name in wanted])
        self.lines = StreamLines(blocks)
        if self.lines.troubles:
            self.lines.close()
            raise BadInput("\n".join(map(str, self.lines.troubles)))
        self.lines.start(0)
        for block in blocks:
            self.lines.lines[block.bus][1].begin(time.monotonic_ns())

    def ask(self, patience):
        """{path of a port: its values} once something new has come, None if nothing has in time."""
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline:
            if any([self.drain(fed) for fed in self.fed]) and all(self.told(fed, "packets")[0] for fed in self.fed):
                return self.answer()
            time.sleep(REST)
        return None

    def drain(self, fed):
        before = self.told(fed, "packets")
        for kind, _, data, when in self.lines.lines[fed.block.bus][1].end.receive():
            self.feed(fed, data, when, kind)
        return self.told(fed, "packets") != before

    def summary(self):
        """Lines at the end."""
        return [
            f"{fed.block.path}: {self.told(fed, 'packets')[0]:g} packets, {self.told(fed, 'corrupt')[0]:g} corrupt, "
            f"{self.told(fed, 'lost')[0]:g} samples lost, {self.told(fed, 'measured_rate')[0]:.1f} Hz"
            for fed in self.fed
        ]

    def close(self):
        self.lines.close()

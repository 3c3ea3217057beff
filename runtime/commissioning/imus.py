"""Inertial sensors on serial lines: those that respond, and one or more shown live."""

import time
from dataclasses import asdict, dataclass

from blocks.families import families
from graph import Diagram
from runtime.base.errors import BadInput
from runtime.commissioning.watched import WatchedBlocks
from runtime.rig.dialogue_line import Seen
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
    block: type


def look(baudrate=115200):
    """Return (Found of every sensor that answers, lines on ports that could not be asked)."""
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


def text(found):
    """Return the lines of the report."""
    return [
        f"port {each.port}  {each.family} {each.model}  serial {each.serial}, firmware {each.firmware}, {each.options}"
        for each in found
    ]


def plain(found):
    row = asdict(found)
    return {name: value for name, value in row.items() if name != "block"}


class WatchedImus(WatchedBlocks):
    """Sensors that are watched together. BadInput where one is not there.

    serials : last digits of each; none: every one that answers
    channels : what they are asked for; rate in Hz
    """

    shown = ("accel", "gyro", "euler", "temperature")

    def __init__(self, serials, channels, rate, attitude="filter"):
        known = [kind for family in families() for kind in family.sensors]
        seen = look()[0] if len(known) > 1 or not serials else []
        serials = serials or [found.serial for found in seen]
        if not serials:
            names = " or ".join(kind.sensor for kind in known)
            raise BadInput(f"no {names} answers on any port; the command `doctor` looks at ports")
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

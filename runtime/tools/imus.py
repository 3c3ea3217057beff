"""Inertial sensors on serial lines: which there are, and one or more watched live."""

import time
from dataclasses import asdict, dataclass

from blocks.imus import MicroStrain
from cext.handover import feed
from graph import Diagram
from runtime.errors import BadInput
from runtime.rig.microstrain import Seen
from runtime.rig.streams import StreamLines
from runtime.tools.streaming import column

SHOWN = ("accel", "gyro", "euler", "temperature")
REST = 0.0005                   # s between looks


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
        Found("MicroStrain", path, about.serial, about.model, about.firmware, about.options) for path, (_, about) in sorted(seen.open.items())]
    seen.close()
    return found, [str(trouble) for trouble in seen.troubles]


def text(found):
    """Lines for a person."""
    return [f"port {each.port}  {each.family} {each.model}  serial {each.serial}, firmware {each.firmware}, {each.options}" for each in found]


def plain(found):
    return asdict(found)


class WatchedImus:
    """Sensors that are watched together. BadInput where one is not there.

    serials : last digits of each; none: every one that answers
    channels : what they are asked for; rate in Hz
    """

    def __init__(self, serials, channels, rate, attitude="filter"):
        serials = serials or [found.serial for found in look()[0]]
        if not serials:
            raise BadInput("no MicroStrain sensor answers on any port; the command `doctor` looks at ports")
        with Diagram("stream", rate=rate):
            self.blocks = [MicroStrain(serial=serial, channels=channels, rate=rate, attitude=attitude, name=f"imu_{serial.replace('.', '_')}")
                           for serial in serials]
        self.lines = StreamLines(self.blocks)
        if self.lines.troubles:
            self.lines.close()
            raise BadInput("\n".join(map(str, self.lines.troubles)))
        self.channels = [name for name in self.blocks[0].outputs if name in (*channels, *("euler",) * ("quaternion" in channels))]
        for block in self.blocks:
            block.scratch.build({"tare": False})
        self.lines.start(0)
        for block in self.blocks:
            self.lines.lines[block.bus][1].begin(time.monotonic_ns())

    def told(self, block, name):
        slot = block.scratch.slots_of[name]
        shape = block.outputs[name].shape
        return block.scratch.arena[slot : slot + (shape[0] if shape else 1)].tolist()

    def ask(self, patience):
        """{path of a port: its values} once something new has come, None if nothing has in time."""
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline:
            if any([self.drain(block) for block in self.blocks]) and all(self.told(block, "packets")[0] for block in self.blocks):
                return {f"{block.path}.{name}": self.told(block, name) for block in self.blocks for name in self.channels}
            time.sleep(REST)
        return None

    def drain(self, block):
        before = self.told(block, "packets")
        for kind, _, data, when in self.lines.lines[block.bus][1].end.receive():
            feed(block.decode, block.scratch.arena, block.scratch.table, data, 64, when, kind)
        return self.told(block, "packets") != before

    def columns(self, name):
        found = []
        for block in self.blocks:
            for channel in self.channels:
                port = block.outputs[channel]
                places = [f"[{index}]" for index in range(port.shape[0])] if port.shape else [""]
                found += [column(f"{block.path}.{channel}{place}", port.unit) for place in places]
        return found

    def row(self, answer):
        return [value for values in answer.values() for value in values]

    def line(self, answer):
        words = []
        for block in self.blocks:
            if len(self.blocks) > 1:
                words.append(block.path)
            for channel in self.channels:
                if channel in SHOWN or len(self.channels) <= len(SHOWN):
                    values = " ".join(f"{value:8.3f}" for value in answer[f"{block.path}.{channel}"])
                    words.append(f"{channel} {values} {block.outputs[channel].unit}")
        return "  ".join(words)

    def summary(self):
        """Lines at the end."""
        return [
            f"{block.path}: {self.told(block, 'packets')[0]:g} packets, {self.told(block, 'corrupt')[0]:g} corrupt, "
            f"{self.told(block, 'lost')[0]:g} samples lost, {self.told(block, 'measured_rate')[0]:.1f} Hz" for block in self.blocks]

    def close(self):
        self.lines.close()

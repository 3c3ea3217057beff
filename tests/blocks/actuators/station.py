"""The other end of a bus, and a controller that sends scripted frames tick by tick."""

from blocks.mathematics import Gain
from graph import Block, Interval, Output, Param


class Station(Block):
    """A third party on the bus: at each tick it records received frames and sends `script[tick]`, a list of
    (identifier, data).

    `end` is given before the run; `heard` is a list of (tick, identifier, is extended, data).
    """

    def configure(self):
        self.script, self.heard, self.end = {}, [], None

    def step(self, tick):
        self.heard += [(tick, *frame[:3]) for frame in self.end.receive()]
        for identifier, data in self.script.get(tick, ()):
            self.end.send(identifier, data, time=round(tick * self.dt * 1e9))


class Script(Block):
    """Commands by tick: `commands[tick]`, a dict; zero for missing entries."""

    position = Output("rad")
    velocity = Output("rad/s")
    torque = Output("N·m")
    stiffness = Output("N·m/rad")
    damping = Output("N·m·s/rad")

    def configure(self):
        self.commands = {}

    def step(self, tick):
        now = self.commands.get(tick, {})
        return [now.get(name, 0.0) for name in self.outputs]


class Promise(Gain):
    """Hands its input on and promises, truly or not, that it stays between `low` and `high`."""

    low = Param(0.0, "any", "promised bound", fixed=True, kernel=False)
    high = Param(0.0, "any", "promised bound", fixed=True, kernel=False)

    def output_range(self, u):
        return Interval(self.low, self.high)


def wire(drive, script):
    """Every command of a drive from a script, which promises to stay inside the drive's limits, and may lie."""
    limits = drive.command_limits()
    drive(
        **{
            f"{name}_command": Promise(low=limits[f"{name}_command"].low, high=limits[f"{name}_command"].high)(
                getattr(script, name)
            )
            for name in script.outputs
        }
    )

"""The other end of a bus, and a controller that says exactly what it is told, tick by tick."""

from graph import Block, Interval, Output


class Station(Block):
    """A third party on the bus: at each tick it notes what it has heard, and sends `script[tick]`, a list of (identifier, data).

    `end` is given before the run; `heard` is a list of (tick, identifier, is extended, data).
    """

    def configure(self):
        self.script, self.heard, self.end = {}, [], None

    def step(self, tick):
        self.heard += [(tick, *frame[:3]) for frame in self.end.receive()]
        for identifier, data in self.script.get(tick, ()):
            self.end.send(identifier, data, time=round(tick * self.dt * 1e9))


class Script(Block):
    """Commands by tick: `commands[tick]`, a dict; zero where it says nothing. It promises to stay inside the limits, and may lie."""

    position = Output("rad")
    velocity = Output("rad/s")
    torque = Output("N·m")
    stiffness = Output("N·m/rad")
    damping = Output("N·m·s/rad")

    def output_range(self):
        return {
            "position": Interval(-12.5, 12.5), "velocity": Interval(-50.0, 50.0), "torque": Interval(-18.0, 18.0),
            "stiffness": Interval(0.0, 500.0), "damping": Interval(0.0, 5.0),
        }

    def configure(self):
        self.commands = {}

    def step(self, tick):
        now = self.commands.get(tick, {})
        return [now.get(name, 0.0) for name in self.outputs]


def wire(drive, script):
    """Every command of a drive from a script."""
    return drive(
        position_command=script.position, velocity_command=script.velocity, torque_command=script.torque,
        stiffness_command=script.stiffness, damping_command=script.damping)

"""One drive at a joint whose motion is imposed, in virtual time: what it is sent, what it gives at every substep, how
the run ends.
"""

import math

import numpy as np

from blocks.actuators import CubeMars
from graph import Block, Diagram, Input, Output
from tests.cext.rigs import Rig


class Imposed(Block):
    """Position and velocity as a function of time, and noise in what the encoder reports of the velocity."""

    position = Output("rad")
    velocity = Output("rad/s")

    def __init__(self, motion, noise=0.0, **options):
        self.motion, self.noise, self.random = motion, noise, np.random.default_rng(1)
        super().__init__(**options)

    def step(self, t):
        position, velocity = self.motion(t)
        return position, velocity + (self.random.normal(0.0, self.noise) if self.noise else 0.0)


class Given(Block):
    """A number as a function of time."""

    y = Output("any")

    def __init__(self, value, unit="any", dtype=float, **options):
        self.value, self.outputs = value, {"y": Output(unit, dtype=dtype).named("y")}
        super().__init__(**options)

    def step(self, t):
        return self.value(t)


class Kept(Block):
    """Keeps (time, torque) of every substep."""

    torque = Input("N·m")

    def __init__(self, **options):
        self.rows = []
        super().__init__(**options)

    def step(self, torque, t):
        self.rows.append((t, torque))


UNITS = {
    "temperature": ("°C", float),
    "power_lost": ("1", bool),
    "fault": ("1", int),
    "dropped": ("1", float),
    "delay": ("s", float),
}


def imposed(
    motion,
    *,
    rate=200,
    substeps=4,
    seconds=1.0,
    noise=0.0,
    drive=CubeMars,
    model="AK80-9",
    commands=None,
    emulator=None,
    fade=0.0,
    **parameters,
):
    """(Rig after its run, Outcome). rig.torques : rows of time and the drive's torque; rig.watched : what was seen

    motion : (position, velocity) as a function of time; commands : by name, numbers or functions of time
    emulator : parameters of the drive that is played, and its inputs as functions of time
    """
    emulator = dict(emulator or {})
    with Diagram("robot", rate=rate) as robot:
        knee = drive(model, name="knee", **parameters)
        limits = knee.command_limits()
        wires = {}
        for name, value in (commands or {"torque_command": 0.0}).items():
            if callable(value):
                source = Given(value, unit=knee.inputs[name].unit)
                source.outputs["y"] = Output(knee.inputs[name].unit, range=(limits[name].low, limits[name].high)).named(
                    "y"
                )
                value = source()
            wires[name] = value
        knee(**wires)
    with Diagram("plant", rate=rate * substeps) as plant:
        inputs = {
            name: Given(emulator.pop(name), *kind, name=f"given_{name}")()
            for name, kind in UNITS.items()
            if name in emulator
        }
        played = robot["knee"].emulator(name="drive", **emulator)
        joint = Imposed(motion, noise)()
        kept = Kept(name="kept")
        kept(played.torque)
        played(position=joint.position, velocity=joint.velocity, **inputs)
    rig = Rig(robot, plant)
    outcome = rig.run(round(seconds * rate), fade=fade)
    rig.torques, [rig.watched] = np.array(kept.rows), rig.control.reports.watched
    return rig, outcome


def still(position=0.0):
    return lambda t: (position, 0.0)


def sine(amplitude, frequency):
    w = 2.0 * math.pi * frequency
    return lambda t: (amplitude * math.sin(w * t), amplitude * w * math.cos(w * t))


def accelerated(rate, begin=0.5, until=math.inf, start=0.0):
    """At rest until `begin`, then with a constant acceleration to the velocity `until`."""
    length = abs(until / rate)

    def motion(t):
        t = max(0.0, t - begin)
        a, b = min(t, length), max(0.0, t - length)
        return start + 0.5 * rate * a * a + rate * a * b, rate * a

    return motion

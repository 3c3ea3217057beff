"""A netlist in Tickwork: of blocks from the library, and of the same blocks written in Python."""

import math
from unittest import mock

import numpy as np

from blocks.controllers import PD
from blocks.discrete import UnitDelay
from blocks.filters import Butterworth
from blocks.limiters import Saturation, SlewRate
from blocks.mathematics import Gain, Sum
from blocks.sources import Constant, Sine
from blocks.vectors import Stack
from cext.fused import library
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, Input, Output, Param, Sink, compile
from tests.peers.netlists import RATE


class Tap(Sink):
    """Where a signal ends."""

    u = Input("any", "any signal", shape=...)
    variadic = False


class PySine(Block):
    amplitude, frequency, phase = Param(1.0, "any"), Param(1.0, "Hz"), Param(0.0, "rad")
    y = Output("any")

    def step(self, t):
        return self.amplitude * math.sin(6.283185307179586 * self.frequency * t + self.phase)


class PySines(Block):
    amplitude, frequency, phase = Param((), dtype=tuple), Param((), dtype=tuple), Param((), dtype=tuple)
    y = Output("any")

    def configure(self):
        self.amplitudes, self.phases = np.array(self.amplitude), np.array(self.phase)
        self.pulsations = 6.283185307179586 * np.array(self.frequency)
        self.outputs = {"y": Output("any", shape=(len(self.amplitude),)).named("y")}

    def step(self, t):
        return self.amplitudes * np.sin(self.pulsations * t + self.phases)


class PyConstant(Block):
    value = Param(0.0, "any")
    y = Output("any")

    def step(self):
        return self.value


class PyGain(Block):
    gain = Param(1.0, "any")
    u = Input("any", shape=...)
    y = Output("any", shape=...)

    def step(self, u):
        return self.gain * u


class PyAdd(Block):
    a, b = Input("any", shape=...), Input("any", shape=...)
    y = Output("any", shape=...)

    def step(self, a, b):
        return a + b


class PySubtract(Block):
    a, b = Input("any", shape=...), Input("any", shape=...)
    y = Output("any", shape=...)

    def step(self, a, b):
        return a - b


class PyAddThree(Block):
    a, b, c = Input("any", shape=...), Input("any", shape=...), Input("any", shape=...)
    y = Output("any", shape=...)

    def step(self, a, b, c):
        return a + b + c


class PySaturation(Block):
    lower, upper = Param(-1.0, "any"), Param(1.0, "any")
    u = Input("any")
    y = Output("any")

    def step(self, u):
        return self.lower if u < self.lower else self.upper if u > self.upper else u


class PySaturations(Block):
    lower, upper = Param(-1.0, "any"), Param(1.0, "any")
    u = Input("any", shape=...)
    y = Output("any", shape=...)

    def step(self, u):
        return np.minimum(np.maximum(u, self.lower), self.upper)


class PyLowpass(Block):
    cutoff = Param(1.0, "Hz")
    b0, b1, b2, a1, a2 = Param(1.0), Param(0.0), Param(0.0), Param(0.0), Param(0.0)
    u = Input("any")
    y = Output("any")

    def reset(self):
        self.s0 = self.s1 = 0.0

    def step(self, u):
        y = self.b0 * u + self.s0
        self.s0 = self.b1 * u - self.a1 * y + self.s1
        self.s1 = self.b2 * u - self.a2 * y
        return y


class PyPD(Block):
    kp, kd, filter_time, start = Param(1.0, "any"), Param(0.0, "any"), Param(0.0, "s"), Param(0.0, "any")
    u = Input("any")
    y = Output("any")

    def reset(self):
        self.follower = self.start

    def step(self, u):
        slope = (u - self.follower) / (self.filter_time + self.dt)
        self.follower += self.dt * slope
        return self.kp * u + self.kd * slope


class PyRate(Block):
    rate = Param(1.0, "any")
    u = Input("any")
    y = Output("any")

    def reset(self):
        self.before = 0.0

    def step(self, u):
        most = self.rate * self.dt
        change = u - self.before
        self.before = self.before + most if change > most else self.before - most if change < -most else u
        return self.before


class PyDelay(Block):
    u = Input("any")
    y = Output("any")

    def reset(self):
        self.held = 0.0

    def step(self):
        return self.held

    def update(self, u):
        self.held = u


class PyDelays(Block):
    u = Input("any", shape=...)
    y = Output("any", shape=...)

    def reset(self):
        self.held = np.zeros(self.width)

    def step(self):
        return self.held

    def update(self, u):
        self.held[:] = u


PYTHON = {
    "sine": PySine,
    "constant": PyConstant,
    "gain": PyGain,
    "saturation": PySaturation,
    "lowpass": PyLowpass,
    "pd": PyPD,
    "rate": PyRate,
    "delay": PyDelay,
}
PYTHON_VECTORS = PYTHON | {"sine": PySines, "saturation": PySaturations, "delay": PyDelays}
PYTHON_SUMS = {"++": PyAdd, "+-": PySubtract, "+++": PyAddThree}


def native_block(node, width):
    """A block of the library: a callable that takes the signals it hears and gives its output. A vector of sines is a
    stack of them.
    """
    if node.kind == "sine":
        waves = [Sine(*wave)() for wave in zip(node.amplitude, node.frequency, node.phase)]
        return lambda: waves[0] if width == 1 else Stack(width)(*waves)
    if node.kind == "pd":
        controller = PD(node.kp, node.kd, node.filter_time, c=1.0)
        return lambda error: controller(error, 0.0)
    made = {
        "constant": lambda: Constant(node.value),
        "gain": lambda: Gain(node.gain),
        "sum": lambda: Sum(node.signs),
        "saturation": lambda: Saturation(node.lower, node.upper),
        "lowpass": lambda: Butterworth(2, node.cutoff),
        "rate": lambda: SlewRate(node.rate),
        "delay": UnitDelay,
        "sink": lambda: Tap(name=node.name),
    }
    return made[node.kind]()


def python_block(node, width):
    if node.kind == "sink":
        return Tap(name=node.name)
    if node.kind == "sum":
        return PYTHON_SUMS[node.signs]()
    kind = (PYTHON if width == 1 else PYTHON_VECTORS)[node.kind]
    values = {
        key: value[0] if width == 1 and isinstance(value, tuple) else value for key, value in node.parameters.items()
    }
    return kind(**values)


def diagram_of(netlist, make):
    """The Diagram of a netlist. make : native_block or python_block"""
    with Diagram(netlist.name, RATE) as diagram:
        signals, waiting = {}, []
        for node in netlist.nodes:
            block = make(node, netlist.width)
            if node.kind == "delay":
                signals[node.name] = block.y
                waiting.append((block, node.inputs))
            else:
                signals[node.name] = block(*(signals[name] for name in node.inputs))
        for block, inputs in waiting:
            block(*(signals[name] for name in inputs))
    return diagram


class Blocks:
    """A compiled diagram that spins without a clock. It begins anew whenever it advances."""

    def __init__(self, netlist, make):
        schedule = compile(diagram_of(netlist, make))
        taken = {
            sink.block.path: [schedule.columns[column.index] for column in sink.columns] for sink in schedule.sinks
        }
        self.slots = [slot for node in netlist.sinks for slot in taken[node.name]]
        self.program = Program(schedule)
        self.executor = Executor(self.program, RATE)

    def restart(self):
        pass

    def advance(self, ticks):
        return self.executor.spin(ticks) * 1e-9

    @property
    def sinks(self):
        return [float(self.program.values[slot]) for slot in self.slots]


class NativeBlocks(Blocks):
    name = "Tickwork, native blocks"

    def __init__(self, netlist):
        super().__init__(netlist, native_block)


class CalledBlocks(Blocks):
    """Native blocks on a machine without fused schedules: each kernel is called."""

    name = "Tickwork, native blocks, not fused"

    def __init__(self, netlist):
        with mock.patch.object(library, "library", lambda: None):
            super().__init__(netlist, native_block)


class PythonBlocks(Blocks):
    name = "Tickwork, Python blocks"

    def __init__(self, netlist):
        super().__init__(netlist, python_block)

"""A netlist in PathSim: its own blocks where it has them, blocks in its style where it has none."""

import time

import numpy as np
from pathsim import Connection, Simulation
from pathsim.blocks import Adder, Amplifier, Clip, Constant, SinusoidalSource
from pathsim.blocks._block import Block

from tests.peers.netlists import RATE

H = 1.0 / RATE


class VectorSine(Block):
    """Its sources are scalar."""

    def __init__(self, amplitude, frequency, phase):
        super().__init__()
        self.amplitude, self.pulsation, self.phase = (
            np.array(amplitude),
            2.0 * np.pi * np.array(frequency),
            np.array(phase),
        )

    def update(self, t):
        self.outputs.update_from_array(self.amplitude * np.sin(self.pulsation * t + self.phase))


class VectorSum(Block):
    """Its Adder adds up the elements of one vector; this adds vectors, which come one behind the other."""

    def __init__(self, count):
        super().__init__()
        self.count = count

    def update(self, t):
        self.outputs.update_from_array(self.inputs.to_array().reshape(self.count, -1).sum(axis=0))


class Sampled(Block):
    """A block with state: `output` from state and inputs while the graph is evaluated, `after` at the end of the
    step.
    """

    def update(self, t):
        self.outputs.update_from_array(self.output(self.inputs.to_array()))

    def sample(self, t, dt):
        self.after(self.inputs.to_array())


class UnitDelay(Sampled):
    """Its own Delay lags a sample more or less, depending on the order of the blocks."""

    def __init__(self, n):
        super().__init__()
        self.held = np.zeros(n)

    def __len__(self):
        return 0  # nothing feeds through

    def output(self, u):
        return self.held

    def after(self, u):
        self.held = u


class Lowpass(Sampled):
    def __init__(self, b0, b1, b2, a1, a2):
        super().__init__()
        self.coefficients, self.memory = (b0, b1, b2, a1, a2), (0.0, 0.0)

    def output(self, u):
        return self.coefficients[0] * float(u[0]) + self.memory[0]

    def after(self, u):
        b0, b1, b2, a1, a2 = self.coefficients
        u = float(u[0])
        y = b0 * u + self.memory[0]
        self.memory = b1 * u - a1 * y + self.memory[1], b2 * u - a2 * y


class PD(Sampled):
    def __init__(self, kp, kd, filter_time, start):
        super().__init__()
        self.kp, self.kd, self.span, self.follower = kp, kd, filter_time + H, start

    def output(self, u):
        u = float(u[0])
        return self.kp * u + self.kd * (u - self.follower) / self.span

    def after(self, u):
        self.follower += H * (float(u[0]) - self.follower) / self.span


class Rate(Sampled):
    def __init__(self, rate):
        super().__init__()
        self.most, self.before = rate * H, 0.0

    def output(self, u):
        return self.before + min(max(float(u[0]) - self.before, -self.most), self.most)

    def after(self, u):
        self.before = self.output(u)


class Sink(Sampled):
    def __len__(self):
        return 0

    def update(self, t):
        pass

    def after(self, u):
        self.taken = u


class PathSim:
    name = "PathSim"

    def __init__(self, netlist):
        self.netlist = netlist

    def restart(self):
        n = self.netlist.width
        blocks = {node.name: self.block(node, n) for node in self.netlist.nodes}
        connections = [
            Connection(blocks[name][0:n], blocks[node.name][place * n : (place + 1) * n])
            for node in self.netlist.nodes
            for place, name in enumerate(node.inputs)
        ]
        self.simulation = Simulation(list(blocks.values()), connections, dt=H, log=False)
        self.simulation.time = -H  # a step evaluates the graph at its end
        self.taken = [blocks[node.name] for node in self.netlist.sinks]

    def block(self, node, n):
        if node.kind == "sine" and n == 1:
            return SinusoidalSource(node.frequency[0], node.amplitude[0], node.phase[0])
        if node.kind == "sine":
            return VectorSine(node.amplitude, node.frequency, node.phase)
        if node.kind == "sum":
            return Adder() if n == 1 else VectorSum(len(node.inputs))
        made = {
            "constant": lambda: Constant(node.value),
            "gain": lambda: Amplifier(node.gain),
            "saturation": lambda: Clip(node.lower, node.upper),
            "delay": lambda: UnitDelay(n),
            "lowpass": lambda: Lowpass(node.b0, node.b1, node.b2, node.a1, node.a2),
            "pd": lambda: PD(node.kp, node.kd, node.filter_time, node.start),
            "rate": lambda: Rate(node.rate),
            "sink": Sink,
        }
        return made[node.kind]()

    def advance(self, ticks):
        step = self.simulation.timestep
        began = time.thread_time()
        for _ in range(ticks):
            step(H)
        return time.thread_time() - began

    @property
    def sinks(self):
        return [float(value) for sink in self.taken for value in sink.taken]

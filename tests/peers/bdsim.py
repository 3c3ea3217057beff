"""A netlist in bdsim: its own blocks where it has them, blocks in its style where it has none."""

import contextlib
import io
import math
import time

import numpy as np
from bdsim import BDSim
from bdsim.block import FunctionBlock, SampledBlock, SinkBlock, SourceBlock
from bdsim.blocks.functions import Clip, Gain, Sum
from bdsim.blocks.sampled import ZOH
from bdsim.blocks.sources import Constant

from tests.peers.netlists import RATE

H = 1.0 / RATE


class Wave(SourceBlock):
    """Its clocks tick first at t = h: what is tick 0 elsewhere is there."""

    nin, nout = 0, 1

    def __init__(self, amplitude, frequency, phase, **options):
        super().__init__(**options)
        self.waves = list(zip(amplitude, frequency, phase))

    def output(self, t, u, x):
        values = [
            amplitude * math.sin(6.283185307179586 * frequency * (t - H) + phase)
            for amplitude, frequency, phase in self.waves
        ]
        return values if len(values) == 1 else [np.array(values)]


class Lowpass(SampledBlock):
    nin = nout = 1

    def __init__(self, clock, b0, b1, b2, a1, a2, **options):
        super().__init__(clock, x0=[0.0, 0.0], feedthrough=True, **options)
        self.coefficients = b0, b1, b2, a1, a2

    def output(self, t, u, x):
        return [self.coefficients[0] * u[0] + float(x[0])]

    def next(self, t, u, x):
        b0, b1, b2, a1, a2 = self.coefficients
        y = b0 * u[0] + x[0]
        return np.array([b1 * u[0] - a1 * y + x[1], b2 * u[0] - a2 * y])


class PD(SampledBlock):
    nin = nout = 1

    def __init__(self, clock, kp, kd, filter_time, start, **options):
        super().__init__(clock, x0=[start], feedthrough=True, **options)
        self.gains, self.span = (kp, kd), filter_time + H

    def output(self, t, u, x):
        return [self.gains[0] * u[0] + self.gains[1] * (u[0] - float(x[0])) / self.span]

    def next(self, t, u, x):
        return x + H * (u[0] - x) / self.span


class Rate(SampledBlock):
    nin = nout = 1

    def __init__(self, clock, rate, **options):
        super().__init__(clock, x0=[0.0], feedthrough=True, **options)
        self.most = rate * H

    def output(self, t, u, x):
        before = float(x[0])
        return [before + min(max(u[0] - before, -self.most), self.most)]

    def next(self, t, u, x):
        return np.array(self.output(t, u, x))


class VectorClip(FunctionBlock):
    """Its Clip is for scalars and lists."""

    nin = nout = 1

    def __init__(self, lower, upper, **options):
        super().__init__(**options)
        self.lower, self.upper = lower, upper

    def output(self, t, u, x):
        return [np.minimum(np.maximum(u[0], self.lower), self.upper)]


class Sink(SinkBlock):
    nin, nout = 1, 0

    def step(self, t, u):
        self.taken = np.atleast_1d(u[0])


class Bdsim:
    """Runs from the start whenever it advances, as its `run` does."""

    name = "bdsim"

    def __init__(self, netlist):
        self.netlist = netlist
        with silence():
            self.simulator = BDSim(sysargs=False, graphics=False, progress=False, quiet=True)
            self.diagram = self.simulator.blockdiagram()
            clock = self.diagram.clock(H)
            blocks = {node.name: self.block(node, clock, netlist.width) for node in netlist.nodes}
            for name, block in blocks.items():
                block.name = name
                self.diagram.add_block(block)
            for node in netlist.nodes:
                for port, source in enumerate(node.inputs):
                    self.diagram.connect(blocks[source][0], blocks[node.name][port])
            self.diagram.compile()
        self.taken = [blocks[node.name] for node in netlist.sinks]

    def block(self, node, clock, n):
        made = {
            "sine": lambda: Wave(node.amplitude, node.frequency, node.phase),
            "constant": lambda: Constant(node.value),
            "gain": lambda: Gain(node.gain),
            "sum": lambda: Sum(node.signs),
            "saturation": lambda: Clip(node.lower, node.upper) if n == 1 else VectorClip(node.lower, node.upper),
            "delay": lambda: ZOH(clock, x0=np.zeros(n)),
            "lowpass": lambda: Lowpass(clock, node.b0, node.b1, node.b2, node.a1, node.a2),
            "pd": lambda: PD(clock, node.kp, node.kd, node.filter_time, node.start),
            "rate": lambda: Rate(clock, node.rate),
            "sink": Sink,
        }
        return made[node.kind]()

    def restart(self):
        pass

    def advance(self, ticks):
        with silence():
            began = time.thread_time()
            self.simulator.run(self.diagram, T=ticks * H)
            return time.thread_time() - began

    @property
    def sinks(self):
        return [float(value) for sink in self.taken for value in sink.taken]


@contextlib.contextmanager
def silence():
    with contextlib.redirect_stdout(io.StringIO()):
        yield

"""A netlist in Drake (pydrake): of its own C++ systems, and of systems written in Python."""

import math
import time

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    Gain,
    LinearSystem,
    LogVectorOutput,
    Saturation,
    Sine,
    ZeroOrderHold,
)

from tests.peers.netlists import RATE

H = 1.0 / RATE


class Drake:
    """Advances tick by tick, as a program must that talks to hardware in between. Sinks are vector logs."""

    def __init__(self, netlist):
        self.netlist = netlist

    def restart(self):
        builder, net = DiagramBuilder(), self.netlist
        self.starts, outputs, waiting, taps = [], {}, [], []
        for node in net.nodes:
            if node.kind == "sink":
                taps.append(LogVectorOutput(outputs[node.inputs[0]], builder, H))
                continue
            inputs, outputs[node.name] = self.add(builder, node, net.width)
            waiting += zip(inputs, node.inputs)
        for port, name in waiting:
            builder.Connect(outputs[name], port)
        diagram = builder.Build()
        self.simulator = Simulator(diagram)
        context = self.simulator.get_mutable_context()
        for system, start in self.starts:
            system.GetMyMutableContextFromRoot(context).SetDiscreteState(start)
        self.logs = [tap.FindLog(context) for tap in taps]
        self.k = 0

    def advance(self, ticks):
        simulator, first = self.simulator, self.k
        began = time.thread_time()
        for k in range(first, first + ticks):
            simulator.AdvanceTo(k * H) if k else simulator.Initialize()
        took = time.thread_time() - began
        self.k = first + ticks
        if self.k > 100_000:  # the logs grow for ever
            self.restart()
        return took

    @property
    def sinks(self):
        return [float(value) for log in self.logs for value in log.data()[:, -1]]


class DrakeCpp(Drake):
    name = "Drake, C++ systems"

    def add(self, builder, node, n):
        """Add what a node needs; (its input ports, its output port)."""
        if node.kind == "sine":
            wave = builder.AddSystem(
                Sine(np.array(node.amplitude), 2.0 * np.pi * np.array(node.frequency), np.array(node.phase), True)
            )
            return [], wave.get_output_port(0)
        if node.kind == "constant":
            return [], builder.AddSystem(ConstantVectorSource(np.full(n, node.value))).get_output_port()
        if node.kind == "sum":
            return self.add_sum(builder, node.signs, n)
        if node.kind == "rate":
            return self.add_rate(builder, node.rate * H, n)
        if node.kind == "lowpass":  # direct form II transposed: y = b0 u + s0
            b0, b1, b2, a1, a2 = node.b0, node.b1, node.b2, node.a1, node.a2
            system = LinearSystem([[-a1, 1.0], [-a2, 0.0]], [[b1 - a1 * b0], [b2 - a2 * b0]], [[1.0, 0.0]], [[b0]], H)
        elif node.kind == "pd":
            span = node.filter_time + H
            system = LinearSystem(
                [[1.0 - H / span]], [[H / span]], [[-node.kd / span]], [[node.kp + node.kd / span]], H
            )
            self.starts.append((system, [node.start]))
        elif node.kind == "gain":
            system = Gain(node.gain, n)
        elif node.kind == "saturation":
            system = Saturation(np.full(n, node.lower), np.full(n, node.upper))
        elif node.kind == "delay":
            system = ZeroOrderHold(H, n)
        builder.AddSystem(system)
        return [system.get_input_port(0)], system.get_output_port(0)

    def add_sum(self, builder, signs, n):
        total = builder.AddSystem(Adder(len(signs), n))
        ports = []
        for index, sign in enumerate(signs):
            if sign == "-":
                negative = builder.AddSystem(Gain(-1.0, n))
                builder.Connect(negative.get_output_port(), total.get_input_port(index))
                ports.append(negative.get_input_port())
            else:
                ports.append(total.get_input_port(index))
        return ports, total.get_output_port()

    def add_rate(self, builder, most, n):
        """y = before + saturation(u - before)."""
        (u, back), change = self.add_sum(builder, "+-", n)
        step = builder.AddSystem(Saturation(np.full(n, -most), np.full(n, most)))
        total = builder.AddSystem(Adder(2, n))
        before = builder.AddSystem(ZeroOrderHold(H, n))
        builder.Connect(change, step.get_input_port())
        builder.Connect(step.get_output_port(), total.get_input_port(0))
        builder.Connect(before.get_output_port(), total.get_input_port(1))
        builder.Connect(before.get_output_port(), back)
        builder.Connect(total.get_output_port(), before.get_input_port())
        return [u], total.get_output_port()


class PythonSystem(LeafSystem):
    """One node as a LeafSystem. What it computes is in the classes below."""

    states = 0
    feedthrough = True

    def __init__(self, node, n):
        super().__init__()
        self.node, self.n = node, n
        self.ports = [self.DeclareVectorInputPort(f"u{i}", n) for i in range(len(node.inputs))]
        read = {self.input_port_ticket(port.get_index()) for port in self.ports} if self.feedthrough else set()
        if node.kind == "sine":
            read.add(self.time_ticket())
        if self.states:
            self.state = self.DeclareDiscreteState(self.states * n)
            self.DeclarePeriodicDiscreteUpdateEvent(H, 0.0, self.after)
            read.add(self.discrete_state_ticket(self.state))
        self.DeclareVectorOutputPort("y", n, self.compute, read or {self.nothing_ticket()})

    def hear(self, context, port=0):
        """A float, or an array where signals are vectors."""
        u = self.ports[port].Eval(context)
        return float(u[0]) if self.n == 1 else u

    def tell(self, output, y):
        if self.n == 1:
            output.SetAtIndex(0, y)
        else:
            output.SetFromVector(y)


class PySine(PythonSystem):
    def compute(self, context, output):
        t = context.get_time()
        for i, (amplitude, frequency, phase) in enumerate(
            zip(self.node.amplitude, self.node.frequency, self.node.phase)
        ):
            output.SetAtIndex(i, amplitude * math.sin(6.283185307179586 * frequency * t + phase))


class PyConstant(PythonSystem):
    def compute(self, context, output):
        self.tell(output, self.node.value)


class PyGain(PythonSystem):
    def compute(self, context, output):
        self.tell(output, self.node.gain * self.hear(context))


class PySum(PythonSystem):
    def compute(self, context, output):
        self.tell(output, sum(self.hear(context, port) for port in range(len(self.ports))))


class PySaturation(PythonSystem):
    def compute(self, context, output):
        u, lower, upper = self.hear(context), self.node.lower, self.node.upper
        self.tell(output, min(max(u, lower), upper) if self.n == 1 else np.minimum(np.maximum(u, lower), upper))


class PyDelay(PythonSystem):
    states, feedthrough = 1, False

    def compute(self, context, output):
        output.SetFrom(context.get_discrete_state(self.state))

    def after(self, context, state):
        state.get_mutable_vector(self.state).SetFromVector(self.ports[0].Eval(context))


class PyLowpass(PythonSystem):
    states = 2

    def compute(self, context, output):
        self.tell(output, self.node.b0 * self.hear(context) + context.get_discrete_state(self.state).GetAtIndex(0))

    def after(self, context, state):
        node, u, s = self.node, self.hear(context), context.get_discrete_state(self.state)
        y = node.b0 * u + s.GetAtIndex(0)
        state.get_mutable_vector(self.state).SetFromVector(
            [node.b1 * u - node.a1 * y + s.GetAtIndex(1), node.b2 * u - node.a2 * y]
        )


class PyPD(PythonSystem):
    states = 1

    def slope(self, context, u):
        return (u - context.get_discrete_state(self.state).GetAtIndex(0)) / (self.node.filter_time + H)

    def compute(self, context, output):
        u = self.hear(context)
        self.tell(output, self.node.kp * u + self.node.kd * self.slope(context, u))

    def after(self, context, state):
        follower = context.get_discrete_state(self.state).GetAtIndex(0)
        state.get_mutable_vector(self.state).SetAtIndex(0, follower + H * self.slope(context, self.hear(context)))


class PyRate(PythonSystem):
    states = 1

    def value(self, context):
        most, before = self.node.rate * H, context.get_discrete_state(self.state).GetAtIndex(0)
        return before + min(max(self.hear(context) - before, -most), most)

    def compute(self, context, output):
        self.tell(output, self.value(context))

    def after(self, context, state):
        state.get_mutable_vector(self.state).SetAtIndex(0, self.value(context))


SYSTEMS = {
    "sine": PySine,
    "constant": PyConstant,
    "gain": PyGain,
    "sum": PySum,
    "saturation": PySaturation,
    "delay": PyDelay,
    "lowpass": PyLowpass,
    "pd": PyPD,
    "rate": PyRate,
}


class DrakePython(Drake):
    name = "Drake, Python systems"

    def add(self, builder, node, n):
        system = builder.AddSystem(SYSTEMS[node.kind](node, n))
        if node.kind == "pd":
            self.starts.append((system, [node.start]))
        return system.ports, system.get_output_port()

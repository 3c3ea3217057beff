"""A slow executor in plain Python: what every native kernel must agree with, bit for bit.

A network is a list of nodes; node i gives one number and is called f"n{i:02}". Nodes without feedthrough may be read by
any node, the others only by later ones.
"""

import math
from dataclasses import dataclass, field

from blocks._plumbing.biquads import butterworth
from blocks.discrete import UnitDelay
from blocks.filters import Butterworth
from blocks.limiters import Saturation, SlewRate
from blocks.mathematics import Gain, Product, Sum
from blocks.sources import Sine, StepSource
from graph import Block, Input, Output


class Affine(Block):
    """Python, without state: y = 0.5 a - b + t."""

    a = Input("any")
    b = Input("any")
    y = Output("any")

    def step(self, b, t, a):
        return 0.5 * a - b + t


class Largest(Block):
    """Python, with state in its step: y = max(y, u); NaN passes and is not held."""

    u = Input("any")
    y = Output("any")

    def reset(self):
        self.peak = -math.inf

    def step(self, u):
        if not u <= self.peak:
            if u != u:
                return u
            self.peak = u
        return self.peak


class Integral(Block):
    """Python, with state in its update and no feedthrough: y[k + 1] = y[k] + dt u[k]."""

    u = Input("any")
    y = Output("any")

    def reset(self):
        self.total = 0.25

    def step(self):
        return self.total

    def update(self, u, dt):
        self.total += dt * u


@dataclass
class Node:
    """kind : name of the block's class; parameters : for it; inputs : numbers of the nodes it reads."""

    kind: str
    parameters: dict = field(default_factory=dict)
    inputs: tuple = ()
    every: int = 1

    @property
    def block(self):
        return BLOCKS[self.kind]


BLOCKS = {
    block.__name__: block
    for block in (
        Sine,
        StepSource,
        Gain,
        Sum,
        Product,
        Saturation,
        SlewRate,
        Butterworth,
        UnitDelay,
        Affine,
        Largest,
        Integral,
    )
}
OPEN = ("UnitDelay", "Integral")  # no direct feedthrough
SOURCES = ("Sine", "StepSource")
ARITY = {"Sum": 3, "Product": 2, "Affine": 2, "Sine": 0, "StepSource": 0}


def clip(x, low, high):
    return math.nan if math.isinf(x) else low if x < low else high if x > high else x


def toward(previous, target, most):
    change = target - previous
    return (
        math.nan
        if math.isinf(target)
        else previous + most
        if change > most
        else previous - most
        if change < -most
        else target
    )


class Cell:
    """A node with its state: compute(inputs, clock), then remember(inputs, clock)."""

    def __init__(self, node, rate):
        self.node, self.y = node, 0.0
        p = self.p = {name: param.default for name, param in node.block.parameters.items()} | node.parameters
        self.state = {"UnitDelay": p.get("initial"), "Largest": -math.inf, "Integral": 0.25}.get(node.kind, 0.0)
        if node.kind == "Butterworth":
            self.sections = [
                (*section, [0.0, 0.0]) for section in butterworth(p["order"], p["cutoff"], "lowpass", node.every / rate)
            ]

    def compute(self, u, t, dt):
        kind, p = self.node.kind, self.p
        if kind == "Sine":
            angle = 6.283185307179586 * p["frequency"] * t + p["phase"]
            return p["bias"] + p["amplitude"] * (math.sin(angle) if math.isfinite(angle) else math.nan)
        if kind == "StepSource":
            return p["before"] if t < p["time"] else p["after"]
        if kind == "Gain":
            return p["gain"] * u[0]
        if kind == "Sum":
            total = 1.0 * u[0] if p["signs"][0] == "+" else -1.0 * u[0]
            for sign, value in zip(p["signs"][1:], u[1:]):
                total += value if sign == "+" else -value
            return total
        if kind == "Product":
            return u[0] * u[1]
        if kind == "Saturation":
            return clip(u[0], p["lower"], p["upper"])
        if kind == "SlewRate":
            y = toward(self.state, u[0], p["rate"] * dt)
            self.state = y if y == y else self.state
            return y
        if kind == "Butterworth":
            return self.filtered(u[0])
        if kind == "Affine":
            return 0.5 * u[0] - u[1] + t
        if kind == "Largest":
            if u[0] != u[0]:
                return u[0]
            self.state = max(self.state, u[0])
        return self.state

    def filtered(self, x):
        for b0, b1, b2, a1, a2, z in self.sections:
            y = b0 * x + z[0]
            z[0] = b1 * x - a1 * y + z[1]
            z[1] = b2 * x - a2 * y
            x = y
        return x

    def remember(self, u, dt):
        if self.node.kind == "UnitDelay":
            self.state = u[0]
        elif self.node.kind == "Integral":
            self.state += dt * u[0]


def execute(nodes, rate, ticks):
    """Rows of outputs, one a tick, of the network at that rate."""
    cells = [Cell(node, rate) for node in nodes]
    order = sorted(range(len(nodes)), key=lambda i: (nodes[i].kind not in OPEN, i))
    rows = []
    for tick in range(ticks):

        def inputs(i):
            return [cells[k].y for k in nodes[i].inputs]

        def due(i):
            return tick % nodes[i].every == 0

        def dt(i):
            return 1.0 / rate if nodes[i].every == 1 else 1.0 / rate * nodes[i].every

        for i in filter(due, order):
            cells[i].y = cells[i].compute(inputs(i), tick / rate, dt(i))
        rows.append([cell.y for cell in cells])
        for i in filter(due, order):
            cells[i].remember(inputs(i), dt(i))
    return rows

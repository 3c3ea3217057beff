"""The diagrams that are measured, as data: every contender builds the same one from here.

knee    two joints: sine -> 2nd-order low-pass -> gain -> sum with a reference -> PD -> saturation -> rate limiter ->
sink, and a total wide    4 sines, lanes of 6 groups of gain, 3-input sum, saturation and a unit delay that closes a
loop, 4 sinks chain   one sine, then gain, saturation and sum, 33 times
"""

import math
from dataclasses import dataclass, field

RATE = 1000.0  # Hz

# What every kind computes, from inputs u, v, w and parameters, y being its output and h the sampling period:
#
#   sine        y = amplitude sin(2 pi frequency t + phase)
#   constant    y = value
#   gain        y = gain u
#   sum         y = ± u ± v ± w
#   saturation  y = min(max(u, lower), upper)
#   lowpass     y = b0 u + s0;  s0 = b1 u - a1 y + s1;  s1 = b2 u - a2 y                  (direct form II transposed)
#   pd          y = kp u + kd (u - f) / (filter_time + h);  f = f + h (u - f) / (filter_time + h);  f(0) = start
#   rate        y = u, but no further than rate h from the y before
#   delay       y is the u before, 0 at first
#   sink        takes u


@dataclass(frozen=True)
class Node:
    """One block: its kind, the names of the nodes it hears, its parameters."""

    name: str
    kind: str
    inputs: tuple = ()
    parameters: dict = field(default_factory=dict)

    def __getattr__(self, name):
        try:
            return self.__dict__["parameters"][name]
        except KeyError:
            raise AttributeError(name) from None


@dataclass(frozen=True)
class Netlist:
    """Nodes in an order in which they can be computed: only delays hear nodes behind them.

    width : elements of every signal. Parameters of sines are tuples of as many; all others hold for every element
    """

    name: str
    width: int
    nodes: tuple

    @property
    def blocks(self):
        return len(self.nodes)

    @property
    def sinks(self):
        return [node for node in self.nodes if node.kind == "sink"]


def knee():
    nodes, limited = [], []
    cutoff, reference = 20.0, 0.3
    for side, frequency in (("left", 0.9), ("right", 1.0)):

        def add(kind, *inputs, **parameters):
            nodes.append(Node(f"{side}_{kind}", kind, inputs, parameters))
            return nodes[-1].name

        wave = add("sine", amplitude=(1.0,), frequency=(frequency,), phase=(0.0,))
        smooth = add("lowpass", wave, cutoff=cutoff, **lowpass(cutoff))
        error = add("sum", add("constant", value=reference), add("gain", smooth, gain=-0.8), signs="++")
        asked = add("pd", error, kp=30.0, kd=1.5, filter_time=0.005, start=reference)
        limited.append(add("rate", add("saturation", asked, lower=-12.0, upper=12.0), rate=200.0))
        add("sink", limited[-1])
    nodes += [Node("total", "sum", tuple(limited), {"signs": "++"}), Node("total_sink", "sink", ("total",))]
    return Netlist("knee", 1, tuple(nodes))


def wide(lanes=8, width=1, name="wide"):
    """24 blocks a lane, and 8."""
    nodes = [
        Node(
            f"sine_{i}",
            "sine",
            (),
            {
                "amplitude": (1.0,) * width,
                "frequency": tuple(0.5 + 0.3 * i + 0.1 * j for j in range(width)),
                "phase": tuple(0.2 * j for j in range(width)),
            },
        )
        for i in range(4)
    ]
    ends = []
    for lane in range(lanes):
        before = f"sine_{lane % 4}"
        for group in range(6):
            own = f"lane_{lane}_{group}_"
            nodes += [
                Node(own + "delay", "delay", (own + "saturation",)),
                Node(own + "gain", "gain", (own + "delay",), {"gain": -0.5}),
                Node(own + "sum", "sum", (before, f"sine_{(lane + 1) % 4}", own + "gain"), {"signs": "+++"}),
                Node(own + "saturation", "saturation", (own + "sum",), {"lower": -1.2, "upper": 1.2}),
            ]
            before = own + "saturation"
        ends.append(before)
    nodes += [Node(f"sink_{i}", "sink", (end,)) for i, end in enumerate(ends[-4:])]
    return Netlist(name, width, tuple(nodes))


def wide6():
    return wide(width=6, name="wide6")


def chain():
    wave = {"amplitude": (1.0,), "frequency": (1.0,), "phase": (0.0,)}
    nodes = [Node("sine", "sine", (), wave), Node("offset", "constant", (), {"value": 0.001})]
    before = "sine"
    for i in range(33):
        nodes += [
            Node(f"gain_{i}", "gain", (before,), {"gain": 1.01}),
            Node(f"saturation_{i}", "saturation", (f"gain_{i}",), {"lower": -1.0, "upper": 1.0}),
            Node(f"sum_{i}", "sum", (f"saturation_{i}", "offset"), {"signs": "+-"}),
        ]
        before = nodes[-1].name
    return Netlist("chain", 1, (*nodes, Node("sink", "sink", (before,))))


def lowpass(cutoff):
    """Coefficients of a 2nd-order Butterworth low-pass: the bilinear transform of 1 / (s² + √2 s + 1), prewarped."""
    k = math.tan(math.pi * cutoff / RATE)
    norm = 1.0 / (1.0 + math.sqrt(2.0) * k + k * k)
    return {
        "b0": k * k * norm,
        "b1": 2.0 * k * k * norm,
        "b2": k * k * norm,
        "a1": 2.0 * (k * k - 1.0) * norm,
        "a2": (1.0 - math.sqrt(2.0) * k + k * k) * norm,
    }

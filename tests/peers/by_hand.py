"""A netlist as one straight line of Python, or of C, without blocks."""

import ctypes
import time
from math import sin

from tests.bench.c_program import build
from tests.peers.netlists import RATE

# The body of a tick, in words that both languages have; {y} is the node's own name, {u}, {v}, {w} what it hears.
_STEPS = {
    "sine": ("{y} = {amplitude!r} * sin(6.283185307179586 * {frequency!r} * t + {phase!r})",),
    "constant": ("{y} = {value!r}",),
    "gain": ("{y} = {gain!r} * {u}",),
    "lowpass": (
        "{y} = {b0!r} * {u} + {y}_s0",
        "{y}_s0 = {b1!r} * {u} - {a1!r} * {y} + {y}_s1",
        "{y}_s1 = {b2!r} * {u} - {a2!r} * {y}",
    ),
    "pd": ("slope = ({u} - {y}_f) / {span!r}", "{y}_f = {y}_f + {h!r} * slope", "{y} = {kp!r} * {u} + {kd!r} * slope"),
}
_PYTHON = {
    "saturation": ("{y} = {lower!r} if {u} < {lower!r} else {upper!r} if {u} > {upper!r} else {u}",),
    "rate": (
        "change = {u} - {y}",
        "{y} = {y} + {most!r} if change > {most!r} else {y} - {most!r} if change < -{most!r} else {u}",
    ),
}
_C = {
    "saturation": ("{y} = {u} < {lower!r} ? {lower!r} : {u} > {upper!r} ? {upper!r} : {u}",),
    "rate": (
        "change = {u} - {y}",
        "{y} = change > {most!r} ? {y} + {most!r} : change < -{most!r} ? {y} - {most!r} : {u}",
    ),
}


def lines(netlist, language):
    """(state, body): variables with their first values, and the statements of a tick, element by element. language :
    "python" or "c".
    """
    state, body, updates = {}, [], []
    steps = _STEPS | (_C if language == "c" else _PYTHON)
    number = 0
    for node in netlist.nodes:
        for element in range(netlist.width):
            y, *heard = (f"{name}_{element}" for name in (node.name, *node.inputs))
            if node.kind == "sink":
                body.append(f"sinks[{number}] = {heard[0]}")
                number += 1
            elif node.kind == "delay":
                state[y] = 0.0
                updates.append(f"{y} = {heard[0]}")
            elif node.kind == "sum":
                terms = " ".join(f"{sign} {name}" for sign, name in zip(node.signs, heard))
                body.append(f"{y} = {terms.removeprefix('+ ')}")
            else:
                values = {
                    key: value[element] if isinstance(value, tuple) else value for key, value in node.parameters.items()
                }
                values |= {"y": y, "h": 1.0 / RATE} | dict(zip("uvw", heard))
                if node.kind == "pd":
                    values["span"] = node.filter_time + 1.0 / RATE
                    state[f"{y}_f"] = node.start
                if node.kind == "lowpass":
                    state |= {f"{y}_s0": 0.0, f"{y}_s1": 0.0}
                if node.kind == "rate":
                    values["most"] = node.rate / RATE
                    state[y] = 0.0
                body += [step.format(**values) for step in steps[node.kind]]
    return state, body + updates


class PlainPython:
    """The netlist as one function of t, called in a loop. The reference of all contenders."""

    name = "plain Python, one straight line"

    def __init__(self, netlist):
        state, body = lines(netlist, "python")
        text = ["def begin(sinks):", *(f"    {name} = {value!r}" for name, value in state.items()), "    def tick(t):"]
        if state:
            text.append(f"        nonlocal {', '.join(state)}")
        text += [f"        {line}" for line in body] + ["    return tick"]
        namespace = {"sin": sin}
        exec("\n".join(text), namespace)
        self.begin = namespace["begin"]
        self.sinks = [0.0] * (len(netlist.sinks) * netlist.width)

    def restart(self):
        self.tick, self.k = self.begin(self.sinks), 0

    def advance(self, ticks):
        tick, first = self.tick, self.k
        began = time.thread_time()
        for k in range(first, first + ticks):
            tick(k / RATE)
        self.k = first + ticks
        return time.thread_time() - began


class StraightC:
    """The netlist as one C function, compiled here and now, loop included."""

    name = "C, one straight line"

    def __init__(self, netlist):
        state, body = lines(netlist, "c")
        assigned = {line.split(" = ")[0] for line in body}
        numbers = sorted(name for name in assigned - set(state) if not name.startswith("sinks["))
        text = [
            "#include <math.h>",
            "#include <time.h>",
            "",
            "double run(long first, long ticks, double *memory, volatile double *sinks)",
            "{",
            "    struct timespec began, ended;",
            "    long k;",
            "    double t, change, slope;",
            *(f"    double {name} = memory[{place}];" for place, name in enumerate(state)),
            *(f"    double {name};" for name in numbers if name not in ("change", "slope")),
            "    (void)change; (void)slope;",
            "    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &began);",
            "    for (k = first; k < first + ticks; k++) {",
            f"        t = k / {RATE!r};",
            *(f"        {line};" for line in body),
            "    }",
            "    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &ended);",
            *(f"    memory[{place}] = {name};" for place, name in enumerate(state)),
            "    return (ended.tv_sec - began.tv_sec) + 1e-9 * (ended.tv_nsec - began.tv_nsec);",
            "}",
        ]
        self.initial = list(state.values())
        self.run = build("\n".join(text) + "\n")
        self.sinks = (ctypes.c_double * (len(netlist.sinks) * netlist.width))()

    def restart(self):
        self.memory, self.k = (ctypes.c_double * max(1, len(self.initial)))(*self.initial), 0

    def advance(self, ticks):
        seconds = self.run(self.k, ticks, self.memory, self.sinks)
        self.k += ticks
        return seconds

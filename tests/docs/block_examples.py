"""Examples of blocks for their pages, as code that runs.

The declarations of a block determine its example, and SHOWN replaces what does not show its behaviour:

* Devices, sinks and emergency stops have no example that computes anything without a robot.
* A block without inputs runs by itself.
* An input of the library's gait and wearer modules is wired to a Walker.
* Otherwise one input gets a ramp if the block has no memory, and a step if it has; several inputs get sine waves.
"""

import math
import os
import re
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from graph import Actuator, Block, Device, Signal, Sink, units
from runtime.robot.loading.catalog import import_line, libraries
from tests.blocks.examples import EXAMPLES, compile_spring
from tests.docs.pages import ROOT
from tests.docs.shown import RATE, SHOWN, Shown

LONG_LINE = 80  # columns, beyond which each connection takes a line
WALKING = ("blocks.gait", "blocks.wearer", "blocks.controllers.gait", "blocks.sensors.insole")
SETTLED = 0.02  # share of the range of a response within which it has settled
DURATIONS = (0.5, 1.0, 2.0, 5.0, 10.0, 100.0, 1000.0)  # s
AMPLITUDES = {"N·m": 15.0, "m/s²": 9.81, "°C": 100.0, "N": 500.0, "V": 3.0}  # of inputs by unit; 1 for others


@dataclass
class Example:
    """Example of a block.

    given : its parameters, as keyword arguments
    path : path of the block in the diagram
    motion : parameters of the Walker
    plant, closing : as in Shown
    """

    kind: type[Block]
    given: list[str]
    walker: bool = False
    motion: str = ""
    plant: str = ""
    closing: str = ""
    style: str = "none"  # time, curve, step, waves, walk or none
    duration: float = 2.0
    rate: float = RATE
    inputs: dict[str, str] = field(default_factory=dict)  # {input: expression}

    def __post_init__(self):
        self.path = "".join(f"_{c.lower()}" if c.isupper() else c for c in self.kind.__name__)

    def code(self):
        """Return the code of the diagram."""
        wires = [f"{name}={value}" for name, value in self.inputs.items()]
        body = _call("command = " * bool(self.plant) + self.kind.__name__, [*self.given, 'name="block"'], LONG_LINE)
        if wires:
            *body, last = body
            body += _call(last, wires, LONG_LINE)
        settings = self.motion and f"{self.motion}, "
        walker = [f'walker = Walker({settings}name="walker")()'] if self.walker else []
        head = f'with Diagram("example", rate={self.rate:g}) as diagram:\n'
        if self.plant:
            body = [f"plant = {self.plant}", *body, *f"plant({self.closing})".splitlines()]
        return head + "".join(f"    {line}\n" for line in walker + body)

    def whole(self):
        """Return the code with its imports and its run."""
        code = self.code()
        run = "" if self.style == "none" else f"trial = runtime.run(diagram, {self.duration:g})\n"
        heads = [f"import {name}" for name, used in (("math", "math." in code), ("runtime", run)) if used]
        return "\n".join(heads + _imports(code)) + "\n\n" + code + run


def _call(name, arguments, columns):
    """Return the lines of a call: one, or a line for each argument if it were longer."""
    line = f"{name}({', '.join(arguments)})"
    return [line] if len(line) <= columns else [f"{name}(", *(f"    {argument}," for argument in arguments), ")"]


def _imports(code):
    """Return the import statements of the names that code calls, one per module."""
    names = set(re.findall(r"\b([A-Z]\w*|stack)\(", code))
    modules = {"graph": names & {"Diagram", "stack"}}
    for kind, home in libraries()[0].homes.items():
        if kind.__name__ in names:
            modules.setdefault(import_line(kind, home).split()[1], set()).add(kind.__name__)
    return [f"from {module} import {', '.join(sorted(modules[module]))}" for module in sorted(modules)]


@contextmanager
def folder():
    """Work in an empty folder with the files that the examples name."""
    from tests.blocks import fmus  # skips a test without FMPy

    before = os.getcwd()
    with tempfile.TemporaryDirectory() as path:
        os.chdir(path)
        os.symlink(ROOT / "diagrams" / "networks", "networks")
        os.symlink(ROOT / "diagrams" / "examples", "examples")
        compile_spring(".")
        fmus.make(Path(), name="knee")
        rows = (f"{k / 100},{30.0 - 25.0 * math.cos(2.0 * math.pi * k / 110)}" for k in range(1000))
        Path("walk.csv").write_text("time,knee\n" + "\n".join(rows) + "\n")
        try:
            yield
        finally:
            os.chdir(before)


def parameters(kind):
    """Return the parameters with which a block is shown."""
    own = SHOWN.get(kind.__name__, Shown()).parameters
    return own or (EXAMPLES.get(kind.__name__) or getattr(kind, "examples", None) or ({},))[0]


def made(kind):
    """Return a block of a class with the ports that its parameters create."""
    return kind(**parameters(kind))


def example_of(kind, home):
    """Return the Example of a block.

    home : module that exports it
    """
    given = [f"{name}={_text(value)}" for name, value in parameters(kind).items()]
    own = SHOWN.get(kind.__name__, Shown())
    shown = Example(kind, given, rate=own.rate, motion=own.walker, plant=own.plant, closing=own.closing)
    required = {
        name: port
        for name, port in made(kind).inputs.items()
        if (port.default is None or name in own.inputs) and not kind.variadic
    }
    if (
        issubclass(kind, (Device, Sink))
        or (kind.always and not kind.continuous)
        or not kind.outputs
        and not made(kind).outputs
    ):
        shown.inputs = {name: "0.0" if port.dtype == "float" else "False" for name, port in required.items()}
        if issubclass(kind, Actuator):
            commands = [name for name in made(kind).inputs if name.endswith("_command")]
            shown.inputs["torque_command" if "torque_command" in commands else commands[0]] = "0.0"
        shown.inputs |= own.inputs
        shown.walker = any("walker." in value for value in shown.inputs.values())
        return shown
    remembers = bool(kind.memory) or kind.reset is not Block.reset
    if home.startswith(WALKING) and required:
        shown.style, shown.duration = "walk", 6.0
    elif not required:
        shown.style = "time"
    elif len(required) > 1 or not _is_number(*required.values()):
        shown.style = "waves"
    else:
        shown.style = "step" if remembers else "curve"
    shown.style = own.style or shown.style
    for place, (name, port) in enumerate(required.items()):
        shown.inputs[name] = own.inputs.get(name) or _source(shown, place, name, port)
    shown.walker = any("walker." in value for value in shown.inputs.values())
    if own.duration:
        shown.duration = own.duration
    elif shown.style == "step":
        shown.duration = next((duration for duration in DURATIONS if _settles(shown, duration)), DURATIONS[1])
    return shown


def _is_number(port):
    return port.dtype == "float" and port.shape in (..., ())


def _text(value):
    return repr(value).replace("'", '"') if not isinstance(value, float) or math.isfinite(value) else f"math.{value}"


def _source(shown, place, name, port):
    """Return the expression of the signal that an input gets, and add what it imports."""
    if shown.style == "walk":
        found = _of_walker(shown, name, port)
        if found:
            return found
    shape = () if port.shape is ... else port.shape
    if port.dtype == "int":
        return "1"
    if port.dtype == "bool":
        return f'Compare(">")(Sine(frequency={place + 1})(), 0.0)'
    if shape == (4,) and port.unit == units.ONE:
        return f'QuaternionFromEuler()(yaw=Sine(frequency={place + 1}, unit="rad")())'
    if shape:
        return f"stack({', '.join(_wave(shown, place + k, port) for k in range(shape[0]))})"
    return _wave(shown, place, port)


def _wave(shown, place, port):
    size = AMPLITUDES.get(port.unit, 1.0)
    unit = "" if port.unit in (units.ANY, units.ONE) else f', unit="{port.unit}"'
    if shown.style == "step":
        after = "" if size == 1.0 else f", after={size:g}"
        return f"StepSource(time=0.1{after}{unit})()"
    if shown.style == "curve":
        low, high = _range(port, size)
        return f"Ramp(slope={(high - low) / shown.duration:g}, initial={low:g}{unit})()"
    amplitude = "" if size == 1.0 else f", amplitude={size:g}"
    return f"Sine(frequency={place + 1}{amplitude}{unit})()"


def _range(port, size):
    """Return the interval of an input over which a curve is drawn."""
    return (-math.pi, math.pi) if port.unit == "rad" else (-2.0 * size, 2.0 * size)


def _of_walker(shown, name, port):
    """Return the signal of a Walker for an input, "" if it has none."""
    words = f"{port.description} {shown.kind.__name__}".lower()
    joint = next((joint for joint in ("knee", "ankle") if joint in words), "hip")
    side, _, quantity = name.rpartition("_") if name.startswith(("left_", "right_")) else ("left", "", name)
    quantity = {"position": "angle", "u": "torque" if port.unit == "N·m" else "angle", "moment": "torque"}.get(
        quantity, quantity
    )
    if quantity in ("angle", "velocity") or quantity == "torque" and shown.kind.__name__ != "Cuff":
        return f"walker.{side}_{joint}_{quantity}"
    if quantity in ("phase", "contact"):
        return f"walker.{side}_{quantity}"
    if quantity == "strike":
        return "Edge()(walker.left_contact)"
    if quantity == "walking":
        return "True"
    if quantity == "enable":
        return "walker.left_contact"
    if quantity == "motion":
        return "walker.left_shank_motion"
    if name in ("force", "heel"):
        return "walker.left_ground_force[1]"
    if name in ("ground_force", "centre_of_pressure"):
        return f"walker.left_{name}"
    return ""


def diagram(shown):
    """Return the Diagram of an example."""
    names = {"math": math}
    exec(shown.whole().partition("\ntrial = ")[0], names)
    return names["diagram"]


def run(shown):
    """Return the Trial of an example, and {input: path of its signal}."""
    names = {"math": math}
    exec(shown.whole(), names)
    wires = [wire for wire in names["diagram"].wires if wire.block.path == "block"]
    return names.get("trial"), {wire.port: wire.source.path for wire in wires if isinstance(wire.source, Signal)}


def _settles(shown, duration):
    """Return whether the response of a step ends within a small share of its range, before the last third."""
    shown.duration = duration
    trial, _ = run(shown)
    [value, *_] = [trial[path] for path in trial.signals if path.startswith("block.")]
    value = np.asarray(value, float)
    span = np.ptp(value)
    return span > 0 and np.ptp(value[2 * len(value) // 3 :]) < SETTLED * span

"""Examples of blocks for their pages, as code that runs, and their responses as pictures.

The declarations of a block determine its example. Devices, sinks and emergency stops have none that computes anything
without a robot. A block without inputs runs by itself. An input of the library's gait and wearer modules is wired to a
Walker. Otherwise a block with one input gets a ramp if it has no memory, and a step if it has; more than one input get
sine waves.
"""

import math
import os
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib
import numpy as np

import runtime
from blocks.discrete import UnitDelay
from blocks.sources import GaussianNoise, StepSource
from graph import Actuator, Block, Device, Diagram, Signal, Sink, units
from runtime.diagrams.catalog import import_line
from tests.blocks.examples import EXAMPLES
from tests.docs.pages import ROOT

FILES = {"OnnxModel": {"file": "networks/hip_torque.onnx"}, "Playback": {"file": "walk.csv", "column": "knee"}}
RATE = 200.0  # Hz
WALKING = ("blocks.gait", "blocks.wearer", "blocks.controllers.gait", "blocks.sensors.insole")
AMPLITUDES = {"N·m": 15.0, "m/s²": 9.81, "°C": 100.0, "N": 500.0, "V": 3.0}  # of inputs by unit; 1 for others
SETTLED = 0.02  # share of the range of a response within which it has settled
DURATIONS = (0.5, 1.0, 10.0, 100.0, 1000.0)  # s
FREQUENCIES = np.geomspace(0.5, 95.0, 200)  # Hz
INK, FAINT = "#0072b2", "#888888"
COLOURS = (INK, "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")


@dataclass
class Example:
    """Example of a block. code : lines that make `diagram` and, if it computes, `trial`; path : of the block in it"""

    kind: type[Block]
    call: str
    imports: set[str]
    walker: bool = False
    style: str = "none"  # time, curve, step, waves, walk or none
    duration: float = 2.0
    inputs: dict[str, str] = field(default_factory=dict)  # {input: expression}

    def __post_init__(self):
        self.path = "".join(f"_{c.lower()}" if c.isupper() else c for c in self.kind.__name__)

    def code(self):
        """Return the code of the diagram."""
        wires = ", ".join(f"{name}={value}" for name, value in self.inputs.items())
        made = f'{self.call[:-1]}{", " if self.call[-2] != "(" else ""}name="block")'
        body = (['walker = Walker(name="walker")()'] if self.walker else []) + [made + (f"({wires})" if wires else "")]
        return f'with Diagram("example", rate={RATE:g}) as diagram:\n' + "".join(f"    {line}\n" for line in body)

    def whole(self):
        """Return the code with its imports and its run."""
        imports = sorted(self.imports | {"from graph import Diagram"})
        run = "" if self.style == "none" else f"trial = runtime.run(diagram, {self.duration:g})\n"
        return "\n".join((["import runtime"] if run else []) + _merged(imports)) + "\n\n" + self.code() + run


def _merged(lines):
    """Return import statements with one line per module."""
    modules = {}
    for line in lines:
        _, module, _, name = line.split()
        modules.setdefault(module, []).append(name)
    return [f"from {module} import {', '.join(sorted(names))}" for module, names in modules.items()]


@contextmanager
def folder():
    """Work in an empty folder with the files that the examples name."""
    before = os.getcwd()
    with tempfile.TemporaryDirectory() as path:
        os.chdir(path)
        os.symlink(ROOT / "diagrams" / "networks", "networks")
        rows = (f"{k / 100},{30.0 - 25.0 * math.cos(2.0 * math.pi * k / 110)}" for k in range(1000))
        Path("walk.csv").write_text("time,knee\n" + "\n".join(rows) + "\n")
        try:
            yield
        finally:
            os.chdir(before)


def parameters(kind):
    """Return the parameters with which a block is shown."""
    return FILES.get(kind.__name__) or (EXAMPLES.get(kind.__name__) or getattr(kind, "examples", None) or ({},))[0]


def made(kind):
    """Return a block of a class with the ports that its parameters create."""
    return kind(**parameters(kind))


def example_of(kind, home):
    """Return the Example of a block.

    home : module that exports it
    """
    given = parameters(kind)
    call = f"{kind.__name__}({', '.join(f'{name}={_text(value)}' for name, value in given.items())})"
    shown = Example(kind, call, {import_line(kind, home)})
    required = {name: port for name, port in made(kind).inputs.items() if port.default is None and not kind.variadic}
    if issubclass(kind, (Device, Sink)) or kind.always or not kind.outputs and not made(kind).outputs:
        shown.inputs = {name: "0.0" if port.dtype == "float" else "False" for name, port in required.items()}
        if issubclass(kind, Actuator):
            commands = [name for name in made(kind).inputs if name.endswith("_command")]
            shown.inputs["torque_command" if "torque_command" in commands else commands[0]] = "0.0"
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
    for place, (name, port) in enumerate(required.items()):
        shown.inputs[name] = _source(shown, place, name, port)
    if shown.style == "step":
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
        shown.imports |= {"from blocks.logic import Compare", "from blocks.sources import Sine"}
        return f'Compare(">")(Sine(frequency={place + 1})(), 0.0)'
    if shape == (4,) and port.unit == units.ONE:
        shown.imports |= {"from blocks.quaternions import QuaternionFromEuler", "from blocks.sources import Sine"}
        return f'QuaternionFromEuler()(yaw=Sine(frequency={place + 1}, unit="rad")())'
    if shape:
        shown.imports.add("from graph import stack")
        return f"stack({', '.join(_wave(shown, place + k, port) for k in range(shape[0]))})"
    return _wave(shown, place, port)


def _wave(shown, place, port):
    size = AMPLITUDES.get(port.unit, 1.0)
    unit = "" if port.unit in (units.ANY, units.ONE) else f', unit="{port.unit}"'
    if shown.style == "step":
        shown.imports.add("from blocks.sources import StepSource")
        after = "" if size == 1.0 else f", after={size:g}"
        return f"StepSource(time=0.1{after}{unit})()"
    if shown.style == "curve":
        shown.imports.add("from blocks.sources import Ramp")
        low, high = _range(port, size)
        return f"Ramp(slope={(high - low) / shown.duration:g}, initial={low:g}{unit})()"
    shown.imports.add("from blocks.sources import Sine")
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
    shown.walker = True
    shown.imports.add("from blocks.wearer import Walker")
    if quantity in ("angle", "velocity") or quantity == "torque" and shown.kind.__name__ != "Cuff":
        return f"walker.{side}_{joint}_{quantity}"
    if quantity in ("phase", "contact"):
        return f"walker.{side}_{quantity}"
    if quantity == "strike":
        shown.imports.add("from blocks.logic import Edge")
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


# Runs


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


def frequency_response(shown):
    """Return (gain, phase in rad) over FREQUENCIES of a block with one input and one output, None if it is nonlinear.

    The response to the sum of two noises is compared with the sum of their responses, and the transform of one
    output divided by that of its input.
    """
    if shown.style != "step" or len(made(shown.kind).outputs) != 1:
        return None
    a, b, both = (_noise(shown, weights) for weights in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0)))
    if not np.allclose(a + b, both, rtol=1e-6, atol=1e-9 * np.abs(both).max()) or np.ptp(both) == 0.0:
        return None
    impulse, later = _impulse(shown, 5.0), _impulse(shown, 7.0)
    if not np.allclose(impulse, later, rtol=1e-6, atol=1e-9) or np.abs(impulse[-100:]).max() > 1e-3 * impulse.max():
        return None  # of a block that changes with time, or that does not forget
    times = np.arange(len(impulse)) / RATE
    response = np.array([np.sum(impulse * np.exp(-2j * math.pi * f * times)) for f in FREQUENCIES])
    gain, phase = np.abs(response), np.unwrap(np.angle(response))
    return None if np.ptp(gain) < 1e-6 and np.ptp(phase) < 1e-6 else (gain, phase)


def _noise(shown, weights):
    with Diagram("noise", rate=RATE) as diagram:
        noise = [weight * GaussianNoise(seed=seed)() for seed, weight in enumerate(weights)]
        _block(shown)(noise[0] + noise[1])
    return _output(diagram, 2.0)


def _impulse(shown, time):
    """Return the response to one sample of 1 at a time in s, from then on for 10 s."""
    with Diagram("impulse", rate=RATE) as diagram:
        step = StepSource(time=time)()
        _block(shown)(step - UnitDelay()(step))
    return _output(diagram, time + 10.0)[round(time * RATE) :]


def _block(shown):
    return shown.kind(**parameters(shown.kind), name="block")


def _output(diagram, seconds):
    trial = runtime.run(diagram, seconds)
    [path] = [path for path in trial.signals if path.startswith("block.")]
    return np.asarray(trial[path], float)


# Pictures


def draw(shown, target):
    """Write the response of an example as SVG. Returns its description, "" if it has none or if it is constant."""
    if shown.style == "none":
        return ""
    trial, inputs = run(shown)
    outputs = [path for path in trial.signals if path.startswith("block.") and np.ptp(np.asarray(trial[path], float))]
    if not outputs:
        return ""
    if shown.style == "curve":
        return _draw_curve(trial, inputs, outputs, target)
    return _draw_times(shown, trial, inputs, outputs, target)


def _axes(rows, height=1.7):
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 0.6 + height * rows), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    for each in axes:
        each.grid(color="#dddddd", linewidth=0.6)
        each.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _save(figure, target):
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": target.name}):
        figure.savefig(target, format="svg", metadata={"Date": None})


def _label(name, unit):
    return name if unit in (units.ONE, units.ANY, "", None) else f"{name} [{unit}]"


def _draw_curve(trial, inputs, outputs, target):
    [[name, source]] = inputs.items()
    figure, axes = _axes(len(outputs), 2.4)
    for each, path in zip(axes, outputs):
        each.plot(np.asarray(trial[source], float), np.asarray(trial[path], float), color=INK)
        each.set_ylabel(_label(path.rpartition(".")[2], trial.unit(path)))
    axes[-1].set_xlabel(_label(name, trial.unit(source)))
    _save(figure, target)
    return "Output over input"


def _draw_times(shown, trial, inputs, outputs, target):
    if shown.style == "time" and len(outputs) > 8:  # a Walker
        outputs = [path for path in outputs if path.startswith("block.left") and path.endswith(("_angle", "_phase"))]
    signals = [(name, path, True) for name, path in inputs.items()]
    signals += [(path.rpartition(".")[2], path, False) for path in outputs]
    panels = {}
    for name, path, given in signals:
        values = np.asarray(trial[path])
        key = (given, trial.unit(path), "" if values.ndim == 1 and values.dtype.kind != "i" else name)
        panels.setdefault(key, []).append((name, path))
    figure, axes = _axes(min(len(panels), 7))
    for each, ((given, unit, _), entries) in zip(axes, panels.items()):
        count = 0
        for name, path in entries:
            values = np.asarray(trial[path], float).reshape(len(trial[path]), -1)
            for part, value in enumerate(values.T):
                label = f"{name}[{part}]" if values.shape[1] > 1 else name
                each.plot(trial.time_of(path), value, color=COLOURS[count % len(COLOURS)], label=label)
                count += 1
        if count == 1:
            each.lines[0].set_color(FAINT if given else INK)
        else:
            each.legend(fontsize=8, loc="upper right", framealpha=0.7)
        sign = "" if unit in (units.ONE, units.ANY, "", None) else f" [{unit}]"
        each.set_ylabel((entries[0][0] if count == 1 else "inputs" if given else "outputs") + sign)
    axes[-1].set_xlabel("time [s]")
    if shown.style == "walk":
        axes[-1].set_xlim(shown.duration / 2, shown.duration)
    _save(figure, target)
    return {"step": "Step response", "walk": "Response to a walking adult", "time": "Output over time"}.get(
        shown.style, "Response to waves"
    )


def draw_frequency_response(shown, target):
    """Write the frequency response of a linear block as SVG. Returns whether there is one."""
    found = frequency_response(shown)
    if found is None:
        return False
    figure, axes = _axes(2)
    gain, phase = found
    axes[0].loglog(FREQUENCIES, np.maximum(gain, 1e-6), color=INK)
    axes[0].set_ylabel("gain")
    axes[1].semilogx(FREQUENCIES, np.degrees(phase), color=INK)
    axes[1].set_ylabel("phase [deg]")
    axes[1].set_xlabel("frequency [Hz]")
    _save(figure, target)
    return True

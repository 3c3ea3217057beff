"""`check_block(MyBlock)`: what every block must keep, for the authors of libraries to run in their tests.

In the spirit of scikit-learn's check_estimator. A block whose parameters have no usable defaults names some: `examples = ({"limit": 12.0},)`.
"""

import math
import random

import numpy as np

from graph import units
from graph.block import Sink, range_of
from graph.device import Device
from graph.diagnostics import DiagramError
from graph.diagram import Diagram
from graph.interval import Interval
from graph.store import from_json, loadable, registered, to_json

RATE = 200.0
STEPS = 50


def check_block(kind, examples=None):
    """Raise AssertionError, saying what, if a Block class breaks a rule; return the number of checks that were made.

    1. every declaration has a unit and a description, and the class a docstring
    2. parameters refuse what is out of their bounds
    3. outputs have the declared number, shape and dtype
    4. the same inputs give the same outputs after `reset()`, also when a NaN was among what came before
    5. a NaN on every input shows in an output
    6. no output leaves the range that `output_range` states, for inputs at the ends of theirs as well
    7. the block comes back from JSON as it was
    """
    made = 0
    for parameters in examples or getattr(kind, "examples", ({},)):
        for check in (check_declarations, check_bounds, check_outputs, check_reset, check_nan, check_range, check_json):
            check(kind, dict(parameters))
            made += 1
    return made


def make(kind, parameters):
    with Diagram("conformance", RATE):
        return kind(**parameters)


def computes(kind):
    return not issubclass(kind, (Device, Sink))


def check_declarations(kind, parameters):
    assert kind.__doc__ and kind.__doc__.strip(), f"{kind.__name__} has no docstring"
    block = make(kind, parameters)
    for name, declaration in (block.inputs | block.outputs | block.parameters).items():
        assert declaration.description, f"{kind.__name__}.{name} has no description"
        units.canonical(declaration.unit)
    assert not (set(block.inputs) & set(block.outputs) or (set(block.inputs) | set(block.outputs)) & set(block.parameters)), (
        f"{kind.__name__} uses one name for two things")


def check_bounds(kind, parameters):
    for name, param in kind.parameters.items():
        if not param.numeric or param.dtype is bool:
            continue
        for value in (
            None if param.min is None else param.min - 1, None if param.max is None else param.max + 1, param.above, param.below, math.nan,
        ):
            if value is None:
                continue
            try:
                make(kind, parameters | {name: value})
            except (DiagramError, ValueError):
                continue
            raise AssertionError(f"{kind.__name__} takes {name}={value}, which is out of its bounds")


class Drive:
    """A block that is stepped by hand, with inputs drawn from intervals."""

    def __init__(self, kind, parameters, seed):
        self.block = make(kind, parameters)
        self.shape = (3,) if any(p.shape is ... for p in self.block.inputs.values()) and seed % 2 else ()
        self.block.width = int(np.prod(self.shape))
        self.random = random.Random(seed)

    def shape_of(self, port):
        return self.shape if port.shape is ... else port.shape

    def draw(self, intervals=None):
        return {name: self.value(port, (intervals or {}).get(name, Interval(-3.0, 3.0))) for name, port in self.block.inputs.items()}

    def value(self, port, interval):
        def one():
            if port.dtype == "bool":
                return self.random.random() < 0.5
            x = self.random.choice((interval.low, interval.high, self.random.uniform(interval.low, interval.high)))
            return int(x) if port.dtype == "int" else x

        shape = self.shape_of(port)
        return np.array([one() for _ in range(int(np.prod(shape)))], dtype=float).reshape(shape) if shape else one()

    def constant(self, value):
        return {name: np.full(self.shape_of(port), value) if self.shape_of(port) else value for name, port in self.block.inputs.items()}

    def step(self, inputs):
        """Outputs by name of one tick, updates included."""
        block = self.block
        if block.is_python:
            clock = {"t": 0.0, "tick": 0, "dt": block.dt}
            values = block.step(*[inputs[n] if n in inputs else clock[n] for n in block.step_inputs()])
        else:
            values = block.step(**inputs)
        if block.has_python_update:
            block.update(*[inputs[n] for n in block.update_inputs()])
        elif block.update_kernel is not None:
            block.update(**inputs)
        names = list(block.outputs)
        return dict(zip(names, [values] if len(names) == 1 else values or ()))


def check_outputs(kind, parameters):
    if not computes(kind):
        return
    for seed in (0, 1):
        drive = Drive(kind, parameters, seed)
        outputs = drive.step(drive.draw())
        assert set(outputs) == set(drive.block.outputs), f"{kind.__name__} returned {len(outputs)} outputs, and declares {len(drive.block.outputs)}"
        for name, port in drive.block.outputs.items():
            assert np.shape(outputs[name]) == drive.shape_of(port), (
                f"{kind.__name__}.{name} has shape {np.shape(outputs[name])}, and {drive.shape_of(port)} is declared")
            if port.dtype == "int" and np.all(np.isfinite(outputs[name])):
                assert np.all(np.equal(np.mod(outputs[name], 1), 0)), f"{kind.__name__}.{name} is not a whole number"


def check_reset(kind, parameters):
    if not computes(kind):
        return
    for seed in (2, 3):
        drive = Drive(kind, parameters, seed)
        inputs = [drive.draw() for _ in range(STEPS)]
        first = [drive.step(values) for values in inputs]
        drive.step(drive.constant(math.nan))
        drive.block.reset()
        again = [drive.step(values) for values in inputs]
        for before, after in zip(first, again):
            for name in before:
                assert np.array_equal(before[name], after[name], equal_nan=True), (
                    f"{kind.__name__}.{name} is not the same after reset(): {before[name]} then, {after[name]} now")


def check_nan(kind, parameters):
    drive = Drive(kind, parameters, 4) if computes(kind) else None
    if drive is None or not any(p.dtype == "float" for p in drive.block.inputs.values()):
        return
    floats = [name for name, port in drive.block.outputs.items() if port.dtype == "float"]
    seen = [drive.step(drive.constant(math.nan)) for _ in range(3)]
    assert not floats or any(np.any(np.isnan(outputs[name])) for outputs in seen for name in floats), (
        f"{kind.__name__} hides a NaN: its outputs are {seen[-1]}")


def check_range(kind, parameters):
    if not computes(kind):
        return
    for seed, bound in ((5, 1.0), (6, 1e6), (7, 10.0)):
        drive = Drive(kind, parameters, seed)
        block = drive.block
        intervals = {name: Interval(0.0, 1.0) if port.dtype == "bool" else Interval(-bound, bound) for name, port in block.inputs.items()}
        found = block.output_range(**intervals)
        stated = {name: range_of(block, name, found) for name in block.outputs}
        for _ in range(STEPS):
            for name, value in drive.step(drive.draw(intervals)).items():
                finite = np.ravel(value)[~np.isnan(np.ravel(np.asarray(value, dtype=float)))]
                assert all(float(x) in stated[name] for x in finite), f"{kind.__name__}.{name} is {value}, outside its stated range {stated[name]}"


def check_json(kind, parameters):
    if not loadable(kind, registered()):
        return
    with Diagram("conformance", RATE) as diagram:
        kind(**parameters)
    text = to_json(diagram)
    assert to_json(from_json(text)) == text, f"{kind.__name__} does not come back from JSON as it was"

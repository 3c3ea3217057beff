"""Conformance test for authors of block libraries: `check_block(MyBlock)`.

Like scikit-learn's check_estimator. A block class without usable defaults lists parameters for the test:
`examples = ({"limit": 12.0},)`.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import numpy as np

from graph import kernel_items, units
from graph.block import Sink, range_of
from graph.declarations import Live
from graph.device import Device
from graph.diagnostics import DiagramError
from graph.diagram import Diagram
from graph.interval import Interval
from graph.live_checks import rejected_combination, values_in_words
from graph.store import from_json, loadable, registered, to_json

if TYPE_CHECKING:
    from graph.block import Block
    from graph.declarations import Input, Param, Port

RATE = 200.0
STEPS = 50  # ticks in each check


def check_block(kind: type[Block], examples: Sequence[dict[str, Any]] | None = None) -> int:
    """Check that a Block class obeys the rules for blocks. Returns the number of checks.

    1. Every declaration has a unit and a description, and the class has a docstring.
    2. Parameters reject values outside their bounds.
    3. Outputs have the declared number, shape and dtype.
    4. Equal inputs produce equal outputs after `reset()`, also if an earlier input was NaN.
    5. NaN or infinity at every input results in NaN or infinity at an output. A limiter converts infinity to NaN.
    6. No output leaves its `output_range`, also for inputs at the bounds of theirs.
    7. The block is unchanged after conversion to JSON and back.
    8. A parameter that may be Live takes effect while running; any other is declared `fixed`.
    9. The class declares every item that its kernels name.
    10. Two parameters that may be Live have no values that the rules allow and `configure` or `prepare` rejects.

    examples : list of parameters to test; `kind.examples` by default

    Raises AssertionError with the violated rule.
    """
    made = 0
    for parameters in examples or getattr(kind, "examples", ({},)):
        for check in (
            check_declarations,
            check_kernels,
            check_bounds,
            check_outputs,
            check_reset,
            check_nan,
            check_range,
            check_json,
            check_live,
            check_rules,
        ):
            check(kind, dict(parameters))
            made += 1
    return made


def make(kind: type[Block], parameters: dict[str, Any]) -> Block:
    """Return a block in a diagram of its own."""
    with Diagram("conformance", RATE):
        return kind(**parameters)


def computes(kind: type[Block]) -> bool:
    """Return whether a block class has a step: devices and sinks do not."""
    return not issubclass(kind, (Device, Sink))


def check_declarations(kind: type[Block], parameters: dict[str, Any]) -> None:
    """Check that class, ports and parameters have descriptions and units, and no name is used twice."""
    assert kind.__doc__ and kind.__doc__.strip(), f"{kind.__name__} has no docstring"
    block = make(kind, parameters)
    for name, declaration in (block.inputs | block.outputs | block.parameters).items():
        assert declaration.description, f"{kind.__name__}.{name} has no description"
        units.canonical(declaration.unit)
    assert not (
        set(block.inputs) & set(block.outputs) or (set(block.inputs) | set(block.outputs)) & set(block.parameters)
    ), f"{kind.__name__} uses a name for more than one port or parameter"


def check_kernels(kind: type[Block], parameters: dict[str, Any]) -> None:
    """Check that the class does not change the items of a kernel that it inherits."""
    try:
        kernel_items.check_kernels(kind)
    except TypeError as error:
        raise AssertionError(str(error)) from None


def check_bounds(kind: type[Block], parameters: dict[str, Any]) -> None:
    """Check that each numeric parameter rejects values outside its bounds, and NaN."""
    for name, param in kind.parameters.items():
        if not param.numeric or param.dtype is bool:
            continue
        for value in (
            None if param.min is None else param.min - 1,
            None if param.max is None else param.max + 1,
            param.above,
            param.below,
            math.nan,
        ):
            if value is None:
                continue
            try:
                make(kind, parameters | {name: value})
            except (DiagramError, ValueError):
                continue
            raise AssertionError(f"{kind.__name__} accepts {name}={value}, which is outside its bounds")


class Drive:
    """A block under test and a generator of random inputs."""

    def __init__(self, kind: type[Block], parameters: dict[str, Any], seed: int) -> None:
        self.block = make(kind, parameters)
        self.shape = (3,) if any(p.shape is ... for p in self.block.inputs.values()) and seed % 2 else ()
        self.block.width = int(np.prod(self.shape))
        self.random = random.Random(seed)
        self.tick = 0

    def shape_of(self, port: Port) -> tuple[int, ...]:
        """Return the shape of a port; that of this drive if the port has any shape."""
        return self.shape if port.shape is ... else port.shape

    def draw(self, intervals: dict[str, Interval] | None = None) -> dict[str, float | np.ndarray]:
        """Return random values for all inputs. intervals : {input: Interval}, -3 to 3 by default"""
        return {
            name: self.value(port, (intervals or {}).get(name, Interval(-3.0, 3.0)))
            for name, port in self.block.inputs.items()
        }

    def draw_around(self, bound: float, defaults: bool) -> dict[str, Any]:
        """Return inputs from -bound to bound; with `defaults`, inputs that have a default keep it."""
        drawn = self.draw({name: Interval(-bound, bound) for name in self.block.inputs})
        return drawn | {
            name: port.default for name, port in self.block.inputs.items() if defaults and port.default is not None
        }

    def value(self, port: Input, interval: Interval) -> float | np.ndarray:
        """Return a random value for an input: often an end of the interval."""

        def one():
            if port.dtype == "bool":
                return self.random.random() < 0.5
            x = self.random.choice((interval.low, interval.high, self.random.uniform(interval.low, interval.high)))
            return int(x) if port.dtype == "int" else x

        shape = self.shape_of(port)
        return np.array([one() for _ in range(int(np.prod(shape)))], dtype=float).reshape(shape) if shape else one()

    def constant(self, value: float) -> dict[str, float | np.ndarray]:
        """Return {input: value} with the same value for all inputs."""
        return {
            name: np.full(self.shape_of(port), value) if self.shape_of(port) else value
            for name, port in self.block.inputs.items()
        }

    def restart(self) -> None:
        """Reset the block as at the start of a run: a native block is not prepared again."""
        self.tick = 0
        if self.block.is_python:
            self.block.reset()
        else:
            self.block.scratch.restart()

    def step(self, inputs: dict[str, Any]) -> dict[str, Any]:
        """Compute one tick, including the update. Returns {output: value}."""
        block = self.block
        if block.is_python:
            clock = {"t": self.tick * block.dt, "tick": self.tick, "dt": block.dt}
            values = block.step(*[inputs[n] if n in inputs else clock[n] for n in block.step_inputs()])
        else:
            values = block.step(**inputs)
        if block.has_python_update:
            clock = {"t": self.tick * block.dt, "tick": self.tick, "dt": block.dt}
            block.update(*[inputs[n] if n in inputs else clock[n] for n in block.update_inputs()])
        elif block.update_kernel is not None:
            block.update(**inputs)
        self.tick += 1
        names = list(block.outputs)
        return dict(zip(names, [values] if len(names) == 1 else values or ()))


def check_outputs(kind: type[Block], parameters: dict[str, Any]) -> None:
    """Check that a step returns the declared outputs, in shape and dtype."""
    if not computes(kind):
        return
    for seed in (0, 1):
        drive = Drive(kind, parameters, seed)
        outputs = drive.step(drive.draw())
        assert set(outputs) == set(drive.block.outputs), (
            f"{kind.__name__} returned {len(outputs)} outputs, but declares {len(drive.block.outputs)}"
        )
        for name, port in drive.block.outputs.items():
            assert np.shape(outputs[name]) == drive.shape_of(port), (
                f"{kind.__name__}.{name} has shape {np.shape(outputs[name])}, but declares {drive.shape_of(port)}"
            )
            if port.dtype == "int" and np.all(np.isfinite(outputs[name])):
                assert np.all(np.equal(np.mod(outputs[name], 1), 0)), f"{kind.__name__}.{name} is not a whole number"


def check_reset(kind: type[Block], parameters: dict[str, Any]) -> None:
    """Check that a reset block repeats its outputs."""
    if not computes(kind):
        return
    for seed in (2, 3):
        drive = Drive(kind, parameters, seed)
        inputs = [drive.draw() for _ in range(STEPS)]
        first = [drive.step(values) for values in inputs]
        drive.step(drive.constant(math.nan))
        drive.restart()
        again = [drive.step(values) for values in inputs]
        for before, after in zip(first, again):
            for name in before:
                assert np.array_equal(before[name], after[name], equal_nan=True), (
                    f"{kind.__name__}.{name} differs after reset(): {before[name]} before, {after[name]} after"
                )


def check_nan(kind: type[Block], parameters: dict[str, Any]) -> None:
    """Check that a NaN or infinity at the float inputs reaches a float output."""
    drive = Drive(kind, parameters, 4) if computes(kind) else None
    if drive is None or not any(p.dtype == "float" for p in drive.block.inputs.values()):
        return
    floats = [name for name, port in drive.block.outputs.items() if port.dtype == "float"]
    for value, what in ((math.nan, "a NaN"), (math.inf, "an infinity"), (-math.inf, "an infinity")):
        drive = Drive(kind, parameters, 4)
        inputs = {
            name: given
            for name, given in drive.constant(value).items()
            if value != value or drive.block.inputs[name].dtype != "bool"
        }
        seen = [drive.step(drive.draw() | inputs) for _ in range(3)]
        assert not floats or any(not np.all(np.isfinite(outputs[name])) for outputs in seen for name in floats), (
            f"{kind.__name__} hides {what}: its outputs are {seen[-1]}"
        )


def check_range(kind: type[Block], parameters: dict[str, Any]) -> None:
    """Check that outputs stay inside `output_range`, for random inputs."""
    if not computes(kind):
        return
    for seed, bound in ((5, 1.0), (6, 1e6), (7, 10.0)):
        drive = Drive(kind, parameters, seed)
        block = drive.block
        intervals = {
            name: Interval(0.0, 1.0) if port.dtype == "bool" else Interval(-bound, bound)
            for name, port in block.inputs.items()
        }
        ranges = block.output_range(**intervals)
        stated = {name: range_of(block, name, ranges) for name in block.outputs}
        for _ in range(STEPS):
            for name, value in drive.step(drive.draw(intervals)).items():
                finite = np.ravel(value)[~np.isnan(np.ravel(np.asarray(value, dtype=float)))]
                assert all(float(x) in stated[name] for x in finite), (
                    f"{kind.__name__}.{name} is {value}, outside its stated range {stated[name]}"
                )


def check_json(kind: type[Block], parameters: dict[str, Any]) -> None:
    """Check that a diagram with the block is the same after conversion to JSON and back."""
    if not loadable(kind, registered()):
        return
    with Diagram("conformance", RATE) as diagram:
        kind(**parameters)
    text = to_json(diagram)
    assert to_json(from_json(text)) == text, f"{kind.__name__} changes in the conversion to JSON and back"


def check_live(kind: type[Block], parameters: dict[str, Any]) -> None:
    """Check that a change of each live parameter takes effect, and parameters without effect are fixed."""
    for name, param in kind.parameters.items():
        if param.fixed or param.live and not computes(kind):
            continue
        assert computes(kind), (
            f"{kind.__name__}.{name} is read before the run only, like all parameters of devices and "
            "sinks: declare it fixed=True"
        )
        values = [
            value
            for value in test_values(param, getattr(make(kind, parameters), name))
            if takes(kind, parameters, name, value)
        ]
        for before, after in zip(values, values[1:] + values[:1]):
            if not has_effect(kind, parameters, name, before, after):
                raise AssertionError(
                    f"{kind.__name__}.{name} has no effect while running: after a change from {before} to {after}, the "
                    "outputs differ from those of a block made with the new value. Read the parameter in the step, "
                    "or declare it fixed=True"
                )


def check_rules(kind: type[Block], parameters: dict[str, Any]) -> None:
    """Check that the class declares its rules between parameters that may be Live."""
    names = (
        [name for name, param in kind.parameters.items() if param.numeric and not param.fixed] if computes(kind) else []
    )
    for chosen in (*((name,) for name in names), *combinations(names, 2)):
        block = with_live(kind, parameters, chosen)
        found = rejected_combination(block, list(chosen), block.dt) if block is not None else None
        assert found is None, (
            f"{kind.__name__} rejects {values_in_words(found[0])} ({found[1]}), which a live change may set: declare "
            'the rule in the class, as in rules = ("lower <= upper",), give the parameters bounds, or declare one '
            "fixed=True"
        )


def with_live(kind: type[Block], parameters: dict[str, Any], names: Sequence[str]) -> Block | None:
    """Return a block with live parameters between some of their valid values, or None if it accepts no such bounds."""
    block = make(kind, parameters)
    numeric = [name for name, param in kind.parameters.items() if param.numeric]  # also those that a rule compares with
    pool = [value for name in numeric for value in test_values(kind.parameters[name], getattr(block, name))]
    valid = [sorted(accepted(kind.parameters[name], pool)) for name in names]
    for values in product(*valid):
        live = {
            name: Live(value, min=choice[0], max=choice[-1], slew=math.inf)
            for name, value, choice in zip(names, values, valid)
        }
        try:
            return make(kind, parameters | live)
        except DiagramError:
            continue
    return None


def accepted(param: Param[Any], values: Sequence[Any]) -> set[float]:
    """Return the finite ones of some values that a parameter accepts, in its type."""
    found: set[float] = set()
    for value in values:
        try:
            value = param.check(value if param.dtype is float or value is None else param.dtype(value))
        except (ValueError, OverflowError):
            continue
        if value is not None and math.isfinite(value):
            found.add(value)
    return found


def test_values(param: Param[Any], value: float | None) -> Sequence[float | bool | None]:
    """Return some valid values of a parameter, the present one first."""
    if param.dtype is bool:
        return [value, not value]
    base = value if value is not None and math.isfinite(value) else 1.0
    values = [] if value is None else [value]
    for other in (base + 1, base - 1, 0.4 * base, 1.7 * base):
        try:
            other = param.check(round(other) if param.dtype is int else other)
        except ValueError:
            continue
        values += [other] if other not in values else []
    return values


def takes(kind: type[Block], parameters: dict[str, Any], name: str, value: Any) -> bool:
    """Return whether a block accepts a value of a parameter."""
    try:
        return bool(Drive(kind, parameters | {name: value}, 8))
    except DiagramError:
        return False


def has_effect(kind: type[Block], parameters: dict[str, Any], name: str, before: Any, after: Any) -> bool:
    """Return whether a parameter changed while running has the same effect as when set at construction."""
    for seed, bound, defaults in ((8, 3.0, False), (9, 100.0, True), (10, 3.0, True)):
        changed, made = Drive(kind, parameters | {name: before}, seed), Drive(kind, parameters | {name: after}, seed)
        if list(changed.block.inputs) != list(made.block.inputs) or list(changed.block.outputs) != list(
            made.block.outputs
        ):
            return False
        inputs = [made.draw_around(bound, defaults) for _ in range(STEPS)]
        changed.step(inputs[0])
        setattr(changed.block, name, after)
        changed.step(inputs[1])
        changed.restart()
        for values in inputs:
            one, other = changed.step(values), made.step(values)
            if not all(same(one[port], other[port]) for port in one):
                return False
    return True


def same(one: Any, other: Any) -> bool:
    """Return whether two numbers or arrays are equal; NaN equals NaN."""
    if isinstance(one, float) and isinstance(other, float):
        return one == other or (one != one and other != other)
    return np.array_equal(one, other, equal_nan=True)

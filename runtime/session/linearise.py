"""Steady states of a diagram, and its linearisation about a point as a system of python-control."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec.structs import replace

from blocks.discrete import Delay
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Device, Diagram, Signal
from graph.diagram import Wire
from graph.upstream import computes, upstream
from runtime.host.errors import BadInput
from runtime.host.optional_dependencies import need
from runtime.host.suggestions import suggestion
from runtime.robot.loading.file import compile_diagram, load

if TYPE_CHECKING:
    import os

    from graph import Schedule
    from runtime.robot.loading.overrides import Settings

STEP = 1e-5  # of the central differences, relative to values above 1
SHIFT = 1e-7  # by which a memory is found that a tick writes
PRECISE = 1e-12  # tolerances of a solver, whose error must be smaller than the differences
TOLERANCE = 1e-4  # of the prediction of two ticks, relative to the response
STEADY = 1e-8  # largest change of a steady state per second, relative to values above 1


@dataclass(frozen=True)
class Trim:
    """A steady state of a diagram, by the diagram's names. print() shows it as a table.

    inputs, outputs : values in units[name]; the outputs are arrays where a signal is a vector
    states : values of the memory that a tick writes, {"shank.state[0]": 0.5}
    units : of inputs and outputs
    residual : largest change of a state or error of a given output, per second and relative to values above 1
    """

    inputs: dict[str, float]
    outputs: dict[str, Any]
    states: dict[str, float]
    units: dict[str, str]
    residual: float
    schedule: Schedule = field(repr=False)  # of the diagram that is opened at the inputs
    arena: np.ndarray = field(repr=False)  # at the start of a tick
    after: np.ndarray = field(repr=False)  # a tick later

    def __str__(self) -> str:
        values = self.inputs | self.outputs | self.states
        width = max(map(len, values), default=0)
        lines = [
            f"{name:<{width}}  {value:.6g} {self.units.get(name, '')}"
            if np.ndim(value) == 0
            else f"{name:<{width}}  {value} {self.units[name]}"
            for name, value in values.items()
        ]
        return "\n".join([*(line.rstrip() for line in lines), f"largest change per second: {self.residual:.1e}"])


def trim(
    given: str | os.PathLike[str] | Diagram | Callable[..., Diagram],
    inputs: Mapping[str, float | None],
    outputs: Mapping[str, Any],
    at: float = 0.0,
    settings: Settings = (),
) -> Trim:
    """Find a steady state. Arguments, result and errors: see runtime.trim."""
    need("control", "a steady state")  # which brings SciPy
    optimize = need("scipy.optimize", "a steady state")

    for kind, values in (("inputs", inputs), ("outputs", outputs)):
        if not isinstance(values, Mapping):
            raise BadInput(f"{kind} are {{name: value}}, with None for a value to find, got {values!r}")
    _, diagram = load(given, settings)
    check(diagram)
    ticks = max(1, tick_at(diagram, at))  # the first tick sets memories that are NaN
    closed = compile_diagram(diagram.name, diagram)
    memory, now = run(closed, closed.arena, ticks), run(closed, closed.arena, ticks + 1)
    with opened(diagram, closed, now, inputs):
        schedule = compile_diagram(diagram.name, diagram)
        wires: dict[Any, Any] = {(wire.block, wire.port): wire.source for wire in diagram.wires}
    known(diagram, schedule, outputs)
    named = {name.rpartition(".")[0] for name in (*inputs, *outputs)} or set(diagram.blocks)
    before = upstream([diagram[path] for path in named], wires)
    resting = {block.path for block in before if block.inputs or block.continuous}
    model = Model(diagram, schedule, moved(closed, schedule, memory), list(inputs), list(outputs), resting)
    places = {name: schedule.signals[name] for name in outputs}
    wanted = np.concatenate([[], *(_wanted(name, outputs[name], place.size) for name, place in places.items())])
    u = np.concatenate([[], *(_wanted(name, value, 1) for name, value in inputs.items())])
    free, fixed = np.isnan(u), np.isfinite(wanted)
    if free.sum() > fixed.sum():
        raise BadInput(
            f"{diagram.name} has more inputs to find ({free.sum()}) than values of outputs ({fixed.sum()}): give a "
            "value for another output, or for an input"
        )
    u[free] = model.arena[model.inputs][free]
    n = len(model.slots)

    def point(unknown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        here = u.copy()
        here[free] = unknown[n:]
        return unknown[:n], here

    def change(unknown: np.ndarray) -> np.ndarray:
        states, here = point(unknown)
        after, seen = model.tick(states, here)
        return np.concatenate([(after - states) * diagram.rate, (seen - wanted)[fixed]])

    def slope(unknown: np.ndarray) -> np.ndarray:
        model.arena[model.slots], model.arena[model.inputs] = point(unknown)
        A, B, C, D = model.jacobian()
        changing = np.hstack([A - np.eye(n), B[:, free]]) * diagram.rate
        return np.vstack([changing, np.hstack([C, D[:, free]])[fixed]])

    unknown = np.concatenate([model.arena[model.slots], u[free]])
    if unknown.size:
        options = {"xtol": 1e-15, "ftol": 1e-15}
        unknown = optimize.root(change, unknown, jac=slope, method="lm", options=options).x
    left = change(unknown)
    states, here = point(unknown)
    values = [model.tick(states, here, count)[1] for count in (1, 2)]
    left = np.concatenate([left, (values[1] - values[0]) * diagram.rate])
    labels = [name for name, place in places.items() for _ in range(place.size)]
    about = [*model.states, *(name for name, one in zip(labels, fixed) if one), *labels]
    scale = np.maximum(1.0, np.abs(np.concatenate([states, wanted[fixed], values[0]])))
    share = np.abs(left) / scale
    if not (share <= STEADY).all():
        worst = int(np.argmax(np.where(np.isfinite(share), share, np.inf)))
        what = (
            f"is {left[worst]:+.3g} from its value"
            if n <= worst < n + fixed.sum()
            else f"changes by {left[worst]:.3g} /s"
        )
        raise BadInput(
            f"{diagram.name} has no steady state near {at:g} s: {about[worst]} {what} at the nearest point found; "
            "free an input, give other values, or start the search at another time with `at`"
        )
    arena = model.arena.copy()
    arena[model.slots], arena[model.inputs] = states, here
    after = run(schedule, arena, 1)
    units = {name: schedule.signals[name].unit for name in outputs}
    units |= {name: unit_of(diagram, closed, name) for name in inputs}
    seen = {name: after[place.slot : place.slot + place.size].reshape(place.shape) for name, place in places.items()}
    return Trim(
        dict(zip(inputs, here.tolist())),
        {name: float(value) if value.ndim == 0 else value for name, value in seen.items()},
        dict(zip(model.states, states.tolist())),
        units,
        float(share.max(initial=0.0)),
        schedule,
        arena,
        after,
    )


def _wanted(name: str, value: Any, size: int) -> np.ndarray:
    """Return the values of an input or output, NaN where they are to be found."""
    if value is None:
        return np.full(size, np.nan)
    try:
        values = np.broadcast_to(np.ravel(np.asarray(value, float)), (size,))
    except (TypeError, ValueError):
        values = np.full(size, np.nan)
    if not np.isfinite(values).all():
        raise BadInput(f"{name} cannot be {value!r}: give {size} finite number{'s' * (size > 1)}, or None to find it")
    return values


def linearise(
    given: str | os.PathLike[str] | Diagram | Callable[..., Diagram],
    inputs: Sequence[str],
    outputs: Sequence[str],
    at: float | Trim = 0.0,
    settings: Settings = (),
) -> Any:
    """Linearise a diagram. Arguments, result and errors: see runtime.linearise."""
    control = need("control", "linearisation")
    _, diagram = load(given, settings)
    check(diagram)
    closed = compile_diagram(diagram.name, diagram)
    held = at.inputs if isinstance(at, Trim) else {}
    if isinstance(at, Trim):
        if sizes(closed) != sizes(at.schedule):
            raise BadInput(f"the steady state is of other blocks than {diagram.name}: use the diagram that was trimmed")
        memory, now = moved(at.schedule, closed, at.arena), moved(at.schedule, closed, at.after)
        for name, place in closed.signals.items():
            start = at.schedule.signals[name].slot
            now[place.slot : place.slot + place.size] = at.after[start : start + place.size]
    else:
        ticks = tick_at(diagram, at)
        memory, now = run(closed, closed.arena, ticks), run(closed, closed.arena, ticks + 1)
    with opened(diagram, closed, now, [*inputs, *held]):
        schedule = compile_diagram(diagram.name, diagram)
    known(diagram, schedule, outputs)
    arena = moved(closed, schedule, memory)
    for name, value in held.items():
        path, _, port = name.rpartition(".")
        arena[schedule.inputs[path][port]] = value
    model = Model(diagram, schedule, arena, inputs, outputs)
    if not len(model.slots) + len(model.inputs):
        raise BadInput(f"{diagram.name} has no states, and no input is named: name one, as in ['pendulum.torque']")
    A, B, C, D = model.jacobian()
    model.check(A, B, C, D)
    A, B, C, states = observed(A, B, C, model.states)
    named = {"inputs": inputs, "outputs": outputs, "states": states}
    labels = {kind: [name.replace(".", ":") for name in names] for kind, names in named.items()}
    made = control.ss(A, B, C, D, 1.0 / diagram.rate, **labels)
    made.units = {name: schedule.signals[name].unit for name in outputs}
    made.units |= {name: unit_of(diagram, closed, name) for name in inputs}
    return made


def known(diagram: Diagram, schedule: Schedule, outputs: Iterable[str]) -> None:
    """Raise BadInput for an output that is not a signal of the diagram."""
    unknown = next((name for name in outputs if name not in schedule.signals), None)
    if unknown is not None:
        raise BadInput(f"{diagram.name} has no signal {unknown!r}: {suggestion(unknown, schedule.signals)}")


def tick_at(diagram: Diagram, at: float) -> int:
    """Return the tick at a time in s of the run, or raise BadInput."""
    if not 0.0 <= at < math.inf:
        raise BadInput(f"the time must be a finite number of seconds from 0, got at={at!r}")
    return round(at * diagram.rate)


def sizes(schedule: Schedule) -> dict[str, dict[str, int]]:
    """Return the size of each memory of each block."""
    return {path: {name: size for name, (_, size) in items.items()} for path, items in schedule.items.items()}


def check(diagram: Diagram) -> None:
    """Raise BadInput for a diagram that is not one linear system about a point."""
    for block in diagram:
        if isinstance(block, Device):
            raise BadInput(
                f"{block.path} is a device, whose frames have whole numbers: linearise a diagram of the controller and "
                "a plant block, such as Pendulum, without the bus between them"
            )
        if block.every != 1 or block.conditions:
            raise BadInput(f"{block.path} does not run at every tick: remove `every` and `enabled` to linearise")
        kind = type(block)
        python = block.is_python or block.has_python_update and not block.continuous
        if python and block.inputs and (kind.update is not Block.update or kind.reset is not Block.reset):
            raise BadInput(f"{block.path} has state in Python, which cannot be varied: set `jit = True` in its class")


def run(schedule: Schedule, arena: np.ndarray, ticks: int) -> np.ndarray:
    """Return the arena after a number of ticks. arena : at the first of them"""
    program = Program(replace(schedule, arena=arena))
    Executor(program, schedule.rate).spin(ticks)
    return program.values.copy()


@contextmanager
def opened(diagram: Diagram, schedule: Schedule, now: np.ndarray, inputs: Iterable[str]) -> Iterator[None]:
    """Replace the signals at some inputs, and those of sources, by their present values.

    schedule : of the closed diagram
    now : its arena
    """
    wires = diagram.wires
    wanted = dict.fromkeys(inputs)
    diagram.wires = []
    for wire in wires:
        source, name = wire.source, f"{wire.block.path}.{wire.port}"
        fed = isinstance(source, Signal) and not source.block.inputs and not source.block.continuous
        if isinstance(source, Signal) and (name in wanted or fed and computes(source.block)):
            place = schedule.signals[source.path]
            source = now[place.slot : place.slot + place.size].reshape(place.shape)
        diagram.wires.append(Wire(source, wire.block, wire.port, wire.where))
    try:
        for name in wanted:
            path, _, port = name.rpartition(".")
            block = diagram.blocks.get(path)
            if block is None or port not in block.inputs:
                known = [f"{each.path}.{one}" for each in diagram for one in each.inputs]
                raise BadInput(f"{diagram.name} has no input {name!r}: {suggestion(name, known)}")
            if not any(wire.block is block and wire.port == port for wire in diagram.wires):
                diagram.wires.append(Wire(block.inputs[port].default, block, port, None))
        yield
    finally:
        diagram.wires = wires


def moved(source: Schedule, schedule: Schedule, arena: np.ndarray) -> np.ndarray:
    """Return the arena of a schedule with the memory of another, of the same blocks. arena : of the other, `source`"""
    found = schedule.arena.copy()
    for path, items in source.items.items():
        for name, (slot, size) in items.items():
            start = schedule.items[path][name][0]
            if start >= schedule.memory_start:
                found[start : start + size] = arena[slot : slot + size]
    return found


def unit_of(diagram: Diagram, schedule: Schedule, name: str) -> str:
    """Return the unit of an input."""
    path, _, port = name.rpartition(".")
    source = next((w.source for w in diagram.wires if w.block.path == path and w.port == port), None)
    return schedule.signals[source.path].unit if isinstance(source, Signal) else diagram[path].inputs[port].unit


class Model:
    """One tick of an opened diagram, as a function of its states and inputs.

    arena : about which it is linearised
    states : name of each state
    resting : paths of the blocks whose memory is a state; None: of all
    """

    def __init__(
        self,
        diagram: Diagram,
        schedule: Schedule,
        arena: np.ndarray,
        inputs: Sequence[str],
        outputs: Sequence[str],
        resting: set[str] | None = None,
    ) -> None:
        self.schedule, self.arena = schedule, arena
        self.rings = [
            (*schedule.items[block.path]["held"], schedule.items[block.path]["place"][0], block.width)
            for block in diagram
            if isinstance(block, Delay)
        ]
        self.working: list[int] = []  # slots of a solver, which are not states
        for block in diagram:
            items = schedule.items[block.path] if block.continuous else {}
            for name in block.memory if block.continuous else ():
                self.working += [] if name == "state" else range(items[name][0], sum(items[name]))
            if block.continuous:
                arena[sum(items["control"]) - 2 : sum(items["control"])] = PRECISE
        self.inputs = [self._slot(name) for name in inputs]
        self.outputs = np.concatenate(
            [
                np.zeros(0, int),
                *(np.arange(at.slot, at.slot + at.size) for at in map(schedule.signals.__getitem__, outputs)),
            ]
        )
        names = {
            slot + index: f"{path}.{name}" + f"[{index}]" * (size > 1)
            for path, items in schedule.items.items()
            for name, (slot, size) in items.items()
            if slot >= schedule.memory_start and (resting is None or path in resting)
            for index in range(size)
        }
        self.slots = np.array([slot for slot in np.flatnonzero(self._written()) if slot in names], int)
        self.states = [names[slot] for slot in self.slots]
        bad = next((name for name, slot in zip(self.states, self.slots) if not np.isfinite(arena[slot])), None)
        if bad is not None:
            raise BadInput(f"{bad} is {arena[self.slots[self.states.index(bad)]]:g} here: choose a later time")

    def _slot(self, name: str) -> int:
        path, _, port = name.rpartition(".")
        if port not in self.schedule.inputs.get(path, {}):
            raise BadInput(f"{name} is a vector: name a scalar input")
        return self.schedule.inputs[path][port]

    def _written(self) -> np.ndarray:
        """Return which slots of the memory a tick writes, here or nearby; not the places of delays, which turn."""
        start = self.schedule.memory_start
        found = np.zeros(len(self.arena), bool)
        for shift in (0.0, SHIFT):
            before = self.arena.copy()
            before[start:] += shift * np.linspace(1.0, 2.0, len(before) - start)  # not an equilibrium by chance
            before[self.inputs] += 3.0 * shift
            for place in (*self.working, *(place for *_, place, _ in self.rings)):
                before[place] = self.arena[place]
            found |= before != run(self.schedule, before, 1)
        found[:start] = found[self.working] = False
        for first, size, place, _ in self.rings:
            found[first : first + size], found[place] = True, False
        return found

    def tick(self, states: np.ndarray, inputs: np.ndarray, ticks: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Return (states after some ticks, outputs at the last of them), from states and with constant inputs."""
        arena = self.arena.copy()
        arena[self.slots], arena[self.inputs] = states, inputs
        after = run(self.schedule, arena, ticks)
        outputs = after[self.outputs].copy()
        for first, size, place, width in self.rings:  # the oldest input is again where it was
            turned = round(after[place] - arena[place]) * width
            after[first : first + size] = np.roll(after[first : first + size], -turned)
        return after[self.slots], outputs

    def jacobian(self) -> tuple[np.ndarray, ...]:
        """Return (A, B, C, D) by central differences."""
        n, m = len(self.slots), len(self.inputs)
        point = self.arena[[*self.slots, *self.inputs]]
        columns = []
        for index, value in enumerate(point):
            step = STEP * max(1.0, abs(value))
            ends = []
            for sign in (step, -step):
                near = point.copy()
                near[index] += sign
                ends.append(np.concatenate(self.tick(near[:n], near[n:])))
            columns.append((ends[0] - ends[1]) / (2.0 * step))
        table = np.array(columns).T.reshape(-1, n + m)
        table[np.abs(table) < 1e-10] = 0.0  # rounding of the differences
        return table[:n, :n], table[:n, n:], table[n:, :n], table[n:, n:]

    def check(self, A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> None:
        """Raise BadInput if the model does not predict two ticks near the point: a counter, a window or a limit."""
        states, inputs = self.arena[self.slots], self.arena[self.inputs]
        dx = STEP * np.random.default_rng(0).uniform(0.5, 1.0, len(states)) * np.maximum(1.0, np.abs(states))
        du = STEP * np.ones(len(inputs))
        wanted = A @ (A @ dx + B @ du) + B @ du, C @ (A @ dx + B @ du) + D @ du
        seen = [near - here for near, here in zip(self.tick(states + dx, inputs + du, 2), self.tick(states, inputs, 2))]
        for found, expected, names in zip(seen, wanted, (self.states, range(len(self.outputs)))):
            wrong = np.abs(found - expected) > TOLERANCE * (STEP + np.abs(expected))
            used = [index for index in np.flatnonzero(wrong) if names is not self.states or C[:, index].any()]
            if used:
                raise BadInput(
                    f"{names[used[0]]} does not respond linearly here, as at a limit, or with a counter or a window: "
                    "choose another time, or replace that block"
                )


def observed(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, names: list[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Remove the states that neither a following state nor an output depends on, such as buffers of a solver."""
    while True:
        kept = np.array((A - np.diag(np.diag(A))).any(axis=0) | C.any(axis=0))
        if kept.all():
            return A, B, C, names
        A, B, C = A[np.ix_(kept, kept)], B[kept], C[:, kept]
        names = [name for name, one in zip(names, kept) if one]

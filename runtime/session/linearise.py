"""Linearisation of a diagram about a point of its run, as a system of python-control."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec.structs import replace

from blocks.discrete import Delay
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Device, Diagram, Signal
from graph.diagram import Wire
from graph.upstream import computes
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


def linearise(
    given: str | os.PathLike[str] | Diagram | Callable[..., Diagram],
    inputs: Sequence[str],
    outputs: Sequence[str],
    at: float = 0.0,
    settings: Settings = (),
) -> Any:
    """Linearise a diagram. Arguments, result and errors: see runtime.linearise."""
    control = need("control", "linearisation")
    _, diagram = load(given, settings)
    check(diagram)
    ticks = round(at * diagram.rate)
    closed = compile_diagram(diagram.name, diagram)
    memory, now = run(closed, closed.arena, ticks), run(closed, closed.arena, ticks + 1)
    with opened(diagram, closed, now, inputs):
        schedule = compile_diagram(diagram.name, diagram)
    unknown = next((name for name in outputs if name not in schedule.signals), None)
    if unknown is not None:
        raise BadInput(f"{diagram.name} has no signal {unknown!r}: {suggestion(unknown, schedule.signals)}")
    model = Model(diagram, schedule, moved(closed, schedule, memory), inputs, outputs)
    A, B, C, D = model.jacobian()
    model.check(A, B, C, D)
    A, B, C, states = observed(A, B, C, model.states)
    named = {"inputs": inputs, "outputs": outputs, "states": states}
    labels = {kind: [name.replace(".", ":") for name in names] for kind, names in named.items()}
    made = control.ss(A, B, C, D, 1.0 / diagram.rate, **labels)
    made.units = {name: schedule.signals[name].unit for name in outputs}
    made.units |= {name: unit_of(diagram, closed, name) for name in inputs}
    return made


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
def opened(diagram: Diagram, schedule: Schedule, now: np.ndarray, inputs: Sequence[str]) -> Iterator[None]:
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
        for name in inputs:
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


def moved(closed: Schedule, schedule: Schedule, arena: np.ndarray) -> np.ndarray:
    """Return the arena of the opened diagram with the memory of the closed one. arena : of the closed one"""
    found = schedule.arena.copy()
    for path, items in closed.items.items():
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
    """

    def __init__(
        self, diagram: Diagram, schedule: Schedule, arena: np.ndarray, inputs: Sequence[str], outputs: Sequence[str]
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
            [np.arange(place.slot, place.slot + place.size) for place in map(schedule.signals.__getitem__, outputs)]
        )
        names = {
            slot + index: f"{path}.{name}" + f"[{index}]" * (size > 1)
            for path, items in schedule.items.items()
            for name, (slot, size) in items.items()
            if slot >= schedule.memory_start
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
            raise BadInput(f"{name} is a vector: linearise at a scalar input")
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

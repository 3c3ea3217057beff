"""Blocks with continuous states, x' = f(x, u), and their integration between the ticks of a plant.

The method is explicit Runge-Kutta with a fixed step, the tick of the diagram. A compile unrolls it to steps of the
update phase: for each stage the derivatives of all continuous blocks, then their states, then the blocks without state
between them. Blocks with state of their own, blocks in Python, and sources keep their outputs during a tick.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from msgspec.structs import replace

from cext.kernels import continuous as kernels
from graph.block import Block, Sink
from graph.class_checks import arguments_of
from graph.declarations import Memory
from graph.device import Device
from graph.signal import Signal
from graph.solvers import DEFAULT, SOLVERS
from graph.upstream import upstream

if TYPE_CHECKING:
    from graph.compilation import Compilation
    from graph.schedule import Step


class Continuous(Block):
    """Base class of the blocks of a plant that have continuous states: x' = f(x, u).

        class Pendulum(Continuous):
            torque = Input("N·m", "torque", default=0.0)
            position = Output("rad", "angle")
            velocity = Output("rad/s", "angular velocity")

            def derivative(self, position, velocity, torque):
                return velocity, torque - 9.81 * math.sin(position)

    Every output is a state. `derivative` takes states and inputs by their names, and returns the rate of change of each
    state, in the order of the outputs and in their units per second; it must not change the block. A native block names
    a `derivative_kernel` instead, which writes the rates to the memory `slope`. `initial` returns the states at the
    start. The outputs are the states, without direct feedthrough: a continuous block may close a loop.

    `Diagram(..., solver="rk4")` chooses the method: "euler", "heun", "rk4" or "dopri5", of order 1, 2, 4 and 5.
    """

    abstract = True
    continuous = True
    always = True
    kernel = kernels.states
    feedthrough = ()
    derivative_kernel: Any = None
    derivative: ClassVar[Any]

    state = Memory(0.0, "states, in the order of the outputs")
    slope = Memory(0.0, "rate of change of the states")
    origin = Memory(0.0, "states at the begin of the tick")
    following = Memory(0.0, "states at the end of the tick")
    slopes = Memory(0.0, "rates of change of the states in each stage")
    tableau = Memory(0.0, "weights of the slopes, a row for each stage")
    stage = Memory(0.0, "index of the present stage")

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if vars(cls).get("abstract") or cls.derivative_kernel is not None:
            return
        if not hasattr(cls, "derivative"):
            raise TypeError(f"{cls.__name__} has no rates of change: define derivative(self, ...) of states and inputs")
        names, _ = arguments_of(cls.derivative)
        unknown = next((name for name in names if name not in cls.outputs and name not in cls.inputs), None)
        if unknown is not None:
            raise TypeError(
                f"{cls.__name__}.derivative takes {unknown!r}, which is neither a state ({', '.join(cls.outputs)}) "
                f"nor an input ({', '.join(cls.inputs) or 'none'})"
            )

    def initial(self) -> Sequence[Any]:
        """Return the initial value of each output. Default: zeros."""
        return [np.zeros(self.size_of(name)) for name in self.outputs]

    def size_of(self, name: str) -> int:
        """Return the number of elements of an output."""
        shape = self.outputs[name].shape
        return self.width if shape is ... else int(np.prod(shape))

    @property
    def method(self) -> tuple[tuple[float, ...], ...]:
        """Tableau of the diagram's solver."""
        return SOLVERS[DEFAULT if self.diagram is None else self.diagram.solver]

    def prepare(self, dt: float) -> None:
        rows = self.method
        self.state = np.concatenate([np.ravel(value) for value in self.initial()]).astype(float)
        self.slope, self.origin, self.following = (np.zeros(len(self.state)) for _ in range(3))
        self.slopes = np.zeros(len(rows) * len(self.state))
        self.tableau = np.concatenate([[*row, *[0.0] * (len(rows) - len(row))] for row in rows])

    @property
    def has_python_update(self) -> bool:
        """Whether the derivative runs in Python."""
        return self.derivative_kernel is None

    def update_inputs(self) -> list[str]:
        """Return the names of the inputs that the derivative takes."""
        return list(self.inputs)

    def update(self, *values: Any, **named: Any) -> None:
        """Integrate the block alone over one period, during which the inputs are constant."""
        scratch = self.scratch
        scratch.load(values, named, self.inputs)
        for _ in self.method:
            scratch.call(kernels.states)
            if self.derivative_kernel is not None:
                scratch.call(self.derivative_kernel)
            else:
                slot, size = scratch.items["slope"]
                rates = self.derivative(*(self._value(name) for name in self.arguments_of("derivative")))
                rates = rates if len(self.outputs) > 1 else (rates,)
                scratch.arena[slot : slot + size] = np.concatenate([np.ravel(rate) for rate in rates])
            scratch.call(kernels.advance)
        scratch.call(kernels.finish)

    def _value(self, name: str) -> Any:
        """Return the value of a port on the arena of `step`: a number, or an array."""
        slot, size = self.scratch.items[name]
        shape = self.scratch.shapes[name]
        return self.scratch.arena[slot : slot + size].reshape(shape) if shape else float(self.scratch.arena[slot])


def integration(assembly: Any) -> list[Step]:
    """Return the steps that integrate all continuous blocks of a diagram over one tick. assembly : Assembly

    In the last stage `advance` restores the states, so that the signals are again those of the tick.
    """
    blocks = [block for block in assembly.blocks if isinstance(block, Continuous)]
    inner = between(assembly.compilation, blocks)
    stage = [
        *(rates_step(assembly, block) for block in blocks),
        *(assembly.native_step(block, kernels.advance) for block in blocks),
        *(assembly.output_step(block) for block in assembly.compilation.order if block in inner),
    ]
    return stage * len(blocks[0].method) + [assembly.native_step(block, kernels.finish) for block in blocks]


def rates_step(assembly: Any, block: Continuous) -> Step:
    """Return the step that computes the rates of change of a block."""
    if block.derivative_kernel is not None:
        return assembly.native_step(block, block.derivative_kernel)
    places = {name: assembly.places[Signal(block, name)] for name in block.outputs}
    arguments = tuple(
        (name, places[name].slot, "float", places[name].shape) if name in places else assembly.argument(block, name)
        for name in block.arguments_of("derivative")
    )
    slot = assembly.items[block]["slope"][0]
    results: list[Any] = []
    for name, place in places.items():
        results.append((name, slot, "float", place.shape, -math.inf, math.inf))
        slot += place.size
    step = assembly.python_step(block, block.derivative, (), {})
    return replace(step, inputs=arguments, outputs=tuple(results))


def between(compilation: Compilation, blocks: Sequence[Continuous]) -> set[Block]:
    """Return the continuous blocks, and the native blocks without state on the paths between them."""
    behind: set[Block] = set(blocks)
    for block in compilation.order:
        sources = (compilation.sources[block, name] for name in block.inputs)
        if is_stateless(block) and any(isinstance(each, Signal) and each.block in behind for each in sources):
            behind.add(block)
    inner = {
        place: source
        for place, source in compilation.sources.items()
        if isinstance(source, Signal) and source.block in behind
    }
    return upstream(blocks, inner) & behind


def is_stateless(block: Block) -> bool:
    """Return whether a block may be computed several times in a tick: a native one without memory, in every tick."""
    return not (
        isinstance(block, (Device, Sink))
        or block.is_python
        or block.has_python_update
        or block.update_kernel is not None
        or block.memory
        or block.conditions
        or block.every != 1
    )

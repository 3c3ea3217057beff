"""Blocks with continuous states, x' = f(x, u), and their integration between the ticks of a plant.

The methods are explicit Runge-Kutta, with one step per tick or with error control. A compile unrolls an attempt at a
step to steps of the update phase, which run again until the tick is complete: for each stage the derivatives of all
continuous blocks, then their states, then the blocks without state between them. Blocks with state of their own, blocks
in Python, and sources keep their outputs during a tick.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from msgspec.structs import replace

from cext.kernels import continuous as kernels
from cext.schedule.kernel_table import call_kernel
from cext.schedule.python_step import PythonStep
from graph.block import Block, Sink
from graph.class_checks import arguments_of
from graph.declarations import Memory
from graph.device import Device
from graph.signal import Signal
from graph.solvers import ADAPTIVE, ATOL, DEFAULT, INACCURATE, RTOL, SOLVERS
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

    An event: `crossing` of states and inputs returns a number that becomes negative at the event, whose time the solver
    finds, and `jump` returns the states after it. A native block has `crossing_kernel`, which writes the memory
    `margin`, and a `jump_kernel`, which writes `state`.

    `Diagram(..., solver="rk45", rtol=1e-6, atol=1e-9)` chooses the method: "rk45" with error control, or with a tick as
    the step "euler", "heun", "rk4" and "dopri5", of order 1, 2, 4 and 5.
    """

    abstract = True
    continuous = True
    always = True
    kernel = kernels.states
    feedthrough = ()
    derivative_kernel: Any = None
    crossing_kernel: Any = None
    jump_kernel: Any = None
    derivative: ClassVar[Any]
    crossing: ClassVar[Any]
    jump: ClassVar[Any]

    state = Memory(0.0, "states, in the order of the outputs")
    slope = Memory(0.0, "rate of change of the states")
    origin = Memory(0.0, "states at the begin of the step")
    following = Memory(0.0, "states at the end of the step, then of the tick")
    begun = Memory(0.0, "states at the begin of the tick")
    slopes = Memory(0.0, "rates of change of the states in each stage")
    tableau = Memory(0.0, "weights of the slopes, a row for each stage")
    stage = Memory(0.0, "index of the present stage")
    margin = Memory(0.0, "value of the crossing")
    before = Memory(0.0, "its value at the begin of the step")
    event = Memory(0.0, "whether it became negative in this step")
    landed = Memory(0.0, "whether it became negative in the last step of the solution")
    control = Memory(0.0, "progress of the integration in this tick, of all blocks")

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if vars(cls).get("abstract"):
            return
        if cls.derivative_kernel is None and not hasattr(cls, "derivative"):
            raise TypeError(f"{cls.__name__} has no rates of change: define derivative(self, ...) of states and inputs")
        for method in ("derivative", "crossing", "jump"):
            names, _ = arguments_of(getattr(cls, method)) if hasattr(cls, method) else ((), ())
            unknown = next((name for name in names if name not in cls.outputs and name not in cls.inputs), None)
            if unknown is not None:
                raise TypeError(
                    f"{cls.__name__}.{method} takes {unknown!r}, which is neither a state ({', '.join(cls.outputs)}) "
                    f"nor an input ({', '.join(cls.inputs) or 'none'})"
                )
        if cls.has("crossing") != cls.has("jump"):
            raise TypeError(f"{cls.__name__} needs both crossing(self, ...) and jump(self, ...), or neither")

    @classmethod
    def has(cls, method: str) -> bool:
        """Return whether the block states a method or its kernel. method : "crossing" or "jump" """
        return hasattr(cls, method) or getattr(cls, f"{method}_kernel") is not None

    def initial(self) -> Sequence[Any]:
        """Return the initial value of each output. Default: zeros."""
        return [np.zeros(self.size_of(name)) for name in self.outputs]

    def size_of(self, name: str) -> int:
        """Return the number of elements of an output."""
        shape = self.outputs[name].shape
        return self.width if shape is ... else int(np.prod(shape))

    @property
    def solver(self) -> tuple[str, float, float]:
        """Name of the diagram's solver, and its tolerances (rtol, atol)."""
        diagram = self.diagram
        return (DEFAULT, RTOL, ATOL) if diagram is None else (diagram.solver, *diagram.tolerances)

    def prepare(self, dt: float) -> None:
        solver, rtol, atol = self.solver
        rows = SOLVERS[solver]
        self.state = np.concatenate([np.ravel(value) for value in self.initial()]).astype(float)
        self.slope, self.origin, self.following, self.begun = (np.zeros(len(self.state)) for _ in range(4))
        self.slopes = np.zeros(len(rows) * len(self.state))
        self.tableau = np.concatenate([[*row, *[0.0] * (len(rows) - len(row))] for row in rows])
        self.control = np.array([0.0] * 10 + [solver == ADAPTIVE, rtol, atol])

    def fault_text(self, status: int) -> str:
        return (
            "the solver needs more than 20000 steps in one tick: its states grow without bound, its rates of change "
            "are discontinuous, or its events accumulate"
        )

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
        while True:
            scratch.call(kernels.begin)
            scratch.call(kernels.states)
            self._evaluate("crossing", "margin")
            for _ in SOLVERS[self.solver[0]]:
                self._evaluate("derivative", "slope")
                scratch.call(kernels.advance)
                scratch.call(kernels.states)
            self._evaluate("crossing", "margin")
            for kernel in (kernels.meet, kernels.judge, kernels.commit):
                scratch.call(kernel)
            if scratch.arena[scratch.items["event"][0]]:
                self._evaluate("jump", "state")
            if not scratch.arena[scratch.items["control"][0]]:
                return

    def _evaluate(self, method: str, item: str) -> None:
        """Write the result of a method, or of its kernel, to an item on the arena of `step`."""
        kernel = getattr(self, f"{method}_kernel")
        if kernel is not None:
            self.scratch.call(kernel)
        elif hasattr(self, method):
            slot, size = self.scratch.items[item]
            found: Any = getattr(self, method)(*(self._value(name) for name in self.arguments_of(method)))
            values: tuple[Any, ...] = found if type(found) is tuple else (found,)  # pyright: ignore
            self.scratch.arena[slot : slot + size] = np.concatenate([np.ravel(each) for each in values])

    def _value(self, name: str) -> Any:
        """Return the value of a port on the arena of `step`: a number, or an array."""
        slot, size = self.scratch.items[name]
        shape = self.scratch.shapes[name]
        return self.scratch.arena[slot : slot + size].reshape(shape) if shape else float(self.scratch.arena[slot])


def integration(assembly: Any) -> list[Step]:
    """Return the steps that integrate all continuous blocks of a diagram over one tick. assembly : Assembly

    All but the last are an attempt at a step, which is repeated until the tick is complete. Then `close` has restored
    the states of its begin, so that the signals are again those of the tick.
    """
    blocks = [block for block in assembly.blocks if isinstance(block, Continuous)]
    leader, hybrid = blocks[0], [block for block in blocks if block.has("crossing")]
    control = assembly.items[leader]["control"]
    for block in blocks:
        assembly.items[block]["control"] = control
    inner = between(assembly.compilation, blocks)
    outputs = [assembly.output_step(block) for block in assembly.compilation.order if block in inner]
    crossings = [evaluation(assembly, block, "crossing", "margin") for block in hybrid]

    def each(kernel: Any, of: Sequence[Continuous] = blocks) -> list[Step]:
        return [assembly.native_step(block, kernel) for block in of]

    rates = [evaluation(assembly, block, "derivative", "slope") for block in blocks]
    if leader.solver[0] != ADAPTIVE:
        warn_of_stiffness(assembly, blocks, outputs + rates)
    stage = rates + each(kernels.advance) + outputs
    attempt = [
        *each(kernels.begin, [leader]),
        *crossings,
        *stage * len(SOLVERS[leader.solver[0]]),
        *crossings,
        *each(kernels.meet, hybrid),
        *each(kernels.judge, [leader]),
        *each(kernels.commit),
        *(
            replace(evaluation(assembly, block, "jump", "state"), conditions=(assembly.items[block]["event"][0],))
            for block in hybrid
        ),
        *each(kernels.close),
        *outputs,
    ]
    return [replace(step, repeat=control[0]) for step in attempt] + each(kernels.finish)


def warn_of_stiffness(assembly: Any, blocks: Sequence[Continuous], steps: Sequence[Step]) -> None:
    """Warn of a time constant, at the start of the run, that is shorter than the fixed step of the solver.

    steps : which compute the rates of change from the states
    """
    arena = assembly.layout.arena()

    def slots(name: str) -> list[int]:
        places = [assembly.items[block][name] for block in blocks]
        return [slot for first, size in places for slot in range(first, first + size)]

    state, slope = slots("state"), slots("slope")
    calls = [
        partial(call_kernel, step.kernel, arena, step.table)
        if step.kernel is not None
        else partial(PythonStep(step.function, step.name, step.inputs, step.outputs, arena), arena)
        for step in steps
    ]

    def rates_at(x: np.ndarray) -> np.ndarray:
        arena[state] = x
        for call in calls:
            call()
        return arena[slope].copy()

    start = arena[state].copy()
    shifts = np.diag(1e-6 * np.maximum(1.0, np.abs(start)))
    try:
        jacobian = [(rates_at(start + shift) - rates_at(start - shift)) / (2.0 * shift.max()) for shift in shifts]
        fastest = float(np.abs(np.linalg.eigvals(jacobian)).max())
    except (ArithmeticError, ValueError):  # not defined at zero inputs
        return
    diagram = assembly.compilation.diagram
    if fastest > diagram.rate:
        assembly.compilation.report(
            INACCURATE,
            f"the shortest time constant of the continuous states is {1e3 / fastest:.2g} ms, and the step of "
            f"{diagram.solver!r} is {1e3 / diagram.rate:.2g} ms: the states are inaccurate, or grow without bound",
            blocks[0],
            hint=f'use the default solver "{ADAPTIVE}", or a rate of {float(f"{5.0 * fastest:.1g}"):g} Hz',
            severity="warning",
        )


def evaluation(assembly: Any, block: Continuous, method: str, item: str) -> Step:
    """Return the step that writes the result of a method of a block, or of its kernel, to an item of the block."""
    kernel = getattr(block, f"{method}_kernel")
    if kernel is not None:
        return assembly.native_step(block, kernel)
    places = {name: assembly.places[Signal(block, name)] for name in block.outputs}
    arguments = tuple(
        (name, places[name].slot, "float", places[name].shape) if name in places else assembly.argument(block, name)
        for name in block.arguments_of(method)
    )
    slot = assembly.items[block][item][0]
    results: list[Any] = []
    shapes = {item: ()} if item == "margin" else {name: place.shape for name, place in places.items()}
    for name, shape in shapes.items():
        results.append((name, slot, "float", shape, -math.inf, math.inf))
        slot += math.prod(shape)
    step = assembly.python_step(block, getattr(block, method), (), {})
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

"""Finite state machines, a common high-level controller of prostheses and exoskeletons."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from math import isfinite
from numbers import Real
from typing import Any

from blocks._plumbing.conditions import Code, compile_assignment, compile_condition
from blocks._plumbing.ports import check_port_names
from blocks._plumbing.ranges import hull
from cext.kernels import states as kernels
from graph import Block, Input, Interval, Memory, Output, Param
from graph.narrowing import is_row, is_table

INSIDE = ("states", "history", "entry", "exit")  # what a state has besides values of outputs


class StateMachine(Block):
    """Finite state machine: constant outputs in each state, and transitions on conditions of the inputs.

        gait = StateMachine(
            takes={"angle": "rad", "contact": "1"},
            gives={"stiffness": "N·m/rad", "damping": "N·m·s/rad"},
            states={
                "stance": {"stiffness": 60.0, "damping": 1.0},
                "swing": {"stiffness": 0.0, "damping": 0.4},
            },
            transitions=[
                ("stance", "swing", "not contact and angle > 0.5"),
                ("swing", "stance", "contact and time_in_state > 0.1"),
            ],
        )(angle=knee.position, contact=foot.contact)

    Principle: 1. once per tick the conditions of the transitions from the present state are evaluated in their order;
    2. the first that is true is taken, and the outputs of the new state apply at once; 3. there is at most one
    transition per tick. The machine starts in the first state, or in `initial`.

    A state may contain others, and have actions (a statechart, Harel 1987):

        "walking": {
            "damping": 1.0,
            "states": {"stance": {"stiffness": 60.0}, "swing": {"stiffness": 0.0, "damping": 0.4}},
            "history": True,
            "entry": {"start": "angle"},
            "exit": {"walks": "walks + 1"},
        },

    A value of the outer state applies to those in it that do not state their own. A transition from the outer state
    leaves it from any inner one, and its `time_in_state` is the time in the outer state. Entering the outer state
    enters its first inner one, or with `history` the one that was left. `entry` and `exit` set outputs of `holds`, from
    the innermost state left to the innermost one entered. A transition from a state to itself, or between a state and
    one inside it, leaves and enters both.

    A condition consists of names of inputs and held outputs, `time_in_state` in s, numbers, `+ - * /`, `abs()`,
    comparisons, `and`, `or` and `not`. A NaN or infinity at an input changes no state and makes every output NaN, which
    is a fault at an actuator.
    """

    takes = Param({}, "1", "inputs, as {name: unit}", dtype=dict)
    gives = Param({}, "1", "outputs, as {name: unit}", dtype=dict)
    holds = Param({}, "1", "outputs that actions set, as {name: (unit, value at the start)}", dtype=dict)
    states = Param({}, "1", "states, as {state: {output: value}}", dtype=dict, required=True)
    transitions = Param((), "1", "transitions (from, to, condition), evaluated in this order", dtype=tuple)
    initial = Param("", "1", "initial state; the first by default", dtype=str)

    state = Output("1", "index of the present state, in the order of those in `states` without inner ones", dtype=int)
    time_in_state = Output("s", "time since the present state was entered")
    table = Memory(0.0, "from, to, innermost state that remains, and condition of each transition")
    code = Memory(0.0, "operations of all conditions and actions")
    nodes = Memory(0.0, "outer state, first inner state, history, index, and actions of each state")
    values = Memory(0.0, "numbers of constant and held outputs, then values of the former in each state")
    current = Memory(0.0, "innermost active state, 1 after the first tick, periods and last inner state of each state")
    held = Memory(0.0, "values of the held outputs")

    kernel = kernels.machine
    examples = (
        {
            "takes": {"u": "1"},
            "gives": {"y": "N·m"},
            "states": {"low": {"y": 0.0}, "high": {"y": 1.5}},
            "transitions": (("low", "high", "u > 1"), ("high", "low", "u < -1 and time_in_state > 0.02")),
        },
    )

    def configure(self) -> None:
        self.inputs = {name: Input(unit, f"input {name}").named(name) for name, unit in self.takes.items()}
        own = {
            name: Output(unit, f"value of {name} in the present state").named(name) for name, unit in self.gives.items()
        }
        for name, held in self.holds.items():
            if not (is_row(held) and len(held) == 2 and isinstance(held[1], Real) and isfinite(held[1])):
                raise ValueError(f"holds: {name} must be (unit, finite value at the start), got {held!r}")
        kept = {
            name: Output(unit, f"value of {name} that an action has set").named(name)
            for name, (unit, _) in self.holds.items()
        }
        check_port_names([*self.inputs, *own, *kept], [*StateMachine.outputs, *INSIDE])
        self.outputs = {**StateMachine.outputs, **own, **kept, **type(self).outputs}  # the kernel finds its own first
        self.chart = list(flatten(self.states, self.gives))
        self._places = {state.name: place for place, state in enumerate(self.chart)}
        if not self.chart:
            raise ValueError("a state machine requires at least one state")
        leaves = [state for state in self.chart if not state.inner]
        self.names = [state.path for state in leaves]
        self.values = [len(own), len(kept), *(float(state.values[name]) for state in leaves for name in own)]
        self.held = [float(value) for _, value in self.holds.values()] or [0.0]
        self.names_in_conditions = (
            {name: ("input", place) for place, name in enumerate(self.inputs)}
            | {name: ("held", place) for place, name in enumerate(kept)}
            | {"time_in_state": ("elapsed", 0)}
        )
        code: Code = []
        nodes: list[float] = []
        numbers = iter(range(len(leaves)))
        for state in self.chart:
            number = -1.0 if state.inner else next(numbers)
            nodes += [state.outer, state.inner[0] if state.inner else -1.0, state.history, number]
            for actions in (state.entry, state.exit):
                compiled = self.actions(state, actions)
                nodes += [len(code), len(compiled)]
                code += compiled
        table: list[float] = []
        for entry in self.transitions:
            if len(entry) != 3:
                raise ValueError(f"a transition must be (from, to, condition), got {entry!r}")
            source, target = (self.index(name, entry[2]) for name in entry[:2])
            compiled = compile_condition(entry[2], self.names_in_conditions)
            table += [source, target, self.scope(source, target), len(code), len(compiled)]
            code += compiled
        first = self.index(self.initial, "initial") if self.initial else 0
        while self.chart[first].inner:
            first = self.chart[first].inner[0]
        self.nodes, self.table = nodes, table or [0.0]
        self.current = [first, 0.0, *[-1.0, -1.0] * len(self.chart)]
        self.code = [number for operation in code for number in operation] or [0.0, 0.0]

    def actions(self, state: State, actions: dict[str, Any]) -> Code:
        """Return the operations of the actions of a state. Raises ValueError for an output that is not held."""
        code: Code = []
        for name, expression in actions.items():
            if name not in self.holds:
                raise ValueError(
                    f"state {state.name!r}: an action sets {name!r}, which `holds` does not have "
                    f"({', '.join(self.holds) or 'none'})"
                )
            code += compile_assignment(str(expression), list(self.holds).index(name), self.names_in_conditions)
        return code

    def index(self, name: str, where: str) -> int:
        """Return the index of a state in the chart. where : transition that names it, for the message

        Raises ValueError for an unknown state.
        """
        if name not in self._places:
            raise ValueError(f"{where!r}: there is no state {name!r}. The states are {', '.join(self._places)}")
        return self._places[name]

    def scope(self, source: int, target: int) -> int:
        """Return the innermost state around both states of a transition, -1 for none."""
        around = set(self.around(source))
        return next((state for state in self.around(target) if state in around), -1)

    def around(self, state: int) -> Iterator[int]:
        """Yield the states around a state, the innermost first."""
        while (state := self.chart[state].outer) >= 0:
            yield state

    def output_range(self, **inputs: Interval) -> dict[str, Interval]:
        leaves = [state for state in self.chart if not state.inner]
        ranges = {"state": Interval(0.0, len(leaves) - 1.0), "time_in_state": Interval(0.0)}
        for output in self.gives:
            ranges[output] = hull(Interval.point(float(state.values[output])) for state in leaves)
        actions = [each for state in self.chart for each in (state.entry, state.exit)]
        for output, (_, start) in self.holds.items():
            values = [start, *(each[output] for each in actions if output in each)]
            if all(isinstance(value, (int, float)) for value in values):
                ranges[output] = hull(Interval.point(float(value)) for value in values)
        return ranges


@dataclass(frozen=True)
class State:
    """State of a machine. outer : index of the state around it, -1 for none; inner : indices of those directly in it

    values : of the constant outputs, its own and those of the states around it
    """

    name: str
    path: str
    outer: int
    inner: tuple[int, ...]
    values: dict[str, float]
    history: bool
    entry: dict[str, Any]
    exit: dict[str, Any]


def table_of(value: Any, what: str) -> dict[Any, Any]:
    """Return a value that is a dict. what : its name, for the message. Raises ValueError for another one"""
    if not is_table(value):
        raise ValueError(f"{what} must be a table in braces, got {value!r}")
    return value


def flatten(states: dict[str, Any], gives: Iterable[str]) -> list[State]:
    """Return the states, each before those in it. Raises ValueError for a name or a value that is wrong."""
    found: list[State] = []
    names: set[str] = set()

    def add(states: dict[Any, Any], outer: int, path: str, values: dict[str, float], level: int) -> tuple[int, ...]:
        if level > kernels.NESTING:
            raise ValueError(f"states {path!r}: they are nested in more than {kernels.NESTING} levels")
        added: list[int] = []
        for name, content in table_of(states, f"the states in {path[:-1]!r}" if path else "states").items():
            table_of(content, f"state {name!r}")
            if not isinstance(content.get("history", False), bool):
                raise ValueError(f"state {name!r}: history must be True or False, got {content['history']!r}")
            if not isinstance(name, str) or name in names:
                problem = "there are two states" if name in names else "the name of a state must be text, got"
                raise ValueError(f"{problem} {name!r}: each needs a name of its own, in any state")
            if name != name.strip() or not name.isprintable() or not name:
                raise ValueError(f"the name of a state must be printable and not begin or end with a space: {name!r}")
            names.add(name)
            for key, value in content.items():
                if key not in INSIDE and not (isinstance(value, Real) and isfinite(value)):
                    raise ValueError(f"state {name!r}: {key} must be a finite number, got {value!r}")
            own = values | {key: value for key, value in content.items() if key not in INSIDE}
            place, inside = len(found), content.get("states", {})
            added.append(place)
            more = (
                content.get("history", False),
                *(table_of(content.get(actions, {}), f"{actions} of state {name!r}") for actions in ("entry", "exit")),
            )
            found.append(State(name, f"{path}{name}", outer, (), own, *more))
            if inside:
                inner = add(inside, place, f"{path}{name}.", own, level + 1)
                found[place] = replace(found[place], inner=inner)
            missing = () if inside else set(gives) - set(own)
            unknown = set(own) - set(gives)
            if missing or unknown:
                problem = (
                    f"has no value for {sorted(missing)[0]}"
                    if missing
                    else f"has a value for {sorted(unknown)[0]}, which is not an output"
                )
                raise ValueError(
                    f"state {name!r} {problem}. Each state needs a value for each of {', '.join(gives) or 'no outputs'}"
                )
        return tuple(added)

    add(states, -1, "", {}, 1)
    return found

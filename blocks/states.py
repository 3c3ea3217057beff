"""Finite state machines, a common high-level controller of prostheses and exoskeletons."""

from __future__ import annotations

import ast
from collections.abc import Sequence

from blocks._plumbing.ports import check_port_names
from cext.kernels import states as kernels
from graph import Block, Input, Interval, Memory, Output, Param


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

    A condition consists of names of inputs, `time_in_state` in s, numbers, `+ - * /`, `abs()`, comparisons, `and`, `or`
    and `not`. A NaN or infinity at an input changes no state and makes every output NaN, which is a fault at an
    actuator.
    """

    takes = Param({}, "1", "inputs, as {name: unit}", dtype=dict)
    gives = Param({}, "1", "outputs, as {name: unit}", dtype=dict)
    states = Param({}, "1", "states, as {state: {output: value}}", dtype=dict, required=True)
    transitions = Param((), "1", "transitions (from, to, condition), evaluated in this order", dtype=tuple)
    initial = Param("", "1", "initial state; the first by default", dtype=str)

    state = Output("1", "index of the present state, in the order of `states`", dtype=int)
    time_in_state = Output("s", "time since the present state was entered")
    table = Memory(0.0, "from, to, first operation and number of operations of each transition")
    code = Memory(0.0, "operations of all conditions")
    values = Memory(0.0, "number of outputs, then their values in each state")
    current = Memory((0.0, 0.0, 0.0), "state, periods in it, 1 after the first tick")

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
        check_port_names([*self.inputs, *own], StateMachine.outputs)
        self.outputs = {**StateMachine.outputs, **own, **type(self).outputs}  # the kernel finds its own first
        self.names = list(self.states)
        self.check_states(own)
        first = self.initial or self.names[0]
        self.current = (self.index(first, "initial"), 0.0, 0.0)
        self.values = [len(own), *(float(self.states[state][output]) for state in self.names for output in own)]
        operations: list[tuple[float, float]] = []
        table: list[float] = []
        for entry in self.transitions:
            if len(entry) != 3:
                raise ValueError(f"a transition must be (from, to, condition), got {entry!r}")
            source, target, condition = entry
            code = compile_condition(condition, list(self.inputs))
            table += [self.index(source, condition), self.index(target, condition), len(operations), len(code)]
            operations += code
        self.table = table or [-1.0, 0.0, 0.0, 0.0]
        self.code = [number for operation in operations for number in operation] or [0.0, 0.0]

    def check_states(self, outputs: dict[str, Output]) -> None:
        """Raise ValueError unless each state has a value for each output, and for nothing else."""
        if not self.states:
            raise ValueError("a state machine requires at least one state")
        for state, values in self.states.items():
            missing, unknown = set(outputs) - set(values), set(values) - set(outputs)
            if missing or unknown:
                problem = (
                    f"has no value for {sorted(missing)[0]}"
                    if missing
                    else (f"has a value for {sorted(unknown)[0]}, which is not an output")
                )
                raise ValueError(
                    f"state {state!r} {problem}. "
                    f"Each state needs a value for each of {', '.join(outputs) or 'no outputs'}"
                )

    def index(self, state: str, where: str) -> float:
        """Return the number of a state. where : transition that names it, for the message

        Raises ValueError for an unknown state.
        """
        if state not in self.names:
            raise ValueError(f"{where!r}: there is no state {state!r}. The states are {', '.join(self.names)}")
        return float(self.names.index(state))

    def output_range(self, **inputs: Interval) -> dict[str, Interval]:
        ranges = {"state": Interval(0.0, len(self.names) - 1.0), "time_in_state": Interval(0.0)}
        for output in self.gives:
            values = [float(self.states[state][output]) for state in self.names]
            ranges[output] = Interval(min(values), max(values))
        return ranges


_BINARY: dict[object, str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_COMPARE: dict[object, str] = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}


def compile_condition(text: str, inputs: Sequence[str]) -> list[tuple[float, float]]:
    """Compile a condition to a list of (operation, operand) for the kernel's stack.

    ValueError for an invalid condition. inputs : names of the inputs
    """
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, AttributeError):
        raise ValueError(f"the condition {text!r} is not an expression") from None
    code: list[tuple[float, float]] = []

    def emit(name: str, operand: float = 0.0) -> None:
        code.append((float(kernels.OPERATIONS[name]), float(operand)))

    def visit(node: ast.expr) -> None:
        match node:
            case ast.Constant(value=bool() | int() | float() as value):
                emit("constant", value)
            case ast.Name(id="time_in_state"):
                emit("elapsed")
            case ast.Name() if node.id in inputs:
                emit("input", inputs.index(node.id))
            case ast.Name():
                raise ValueError(
                    f"the condition {text!r} uses {node.id!r}, which is not an input "
                    f"({', '.join([*inputs, 'time_in_state'])})"
                )
            case ast.UnaryOp(op=ast.USub()):
                visit(node.operand)
                emit("negate")
            case ast.UnaryOp(op=ast.Not()):
                visit(node.operand)
                emit("not")
            case ast.BinOp() if type(node.op) in _BINARY:
                visit(node.left)
                visit(node.right)
                emit(_BINARY[type(node.op)])
            case ast.BoolOp():
                visit(node.values[0])
                for value in node.values[1:]:
                    visit(value)
                    emit("and" if isinstance(node.op, ast.And) else "or")
            case ast.Compare() if all(type(op) in _COMPARE for op in node.ops):
                for number, (left, op, right) in enumerate(
                    zip([node.left, *node.comparators], node.ops, node.comparators)
                ):
                    visit(left)
                    visit(right)
                    emit(_COMPARE[type(op)])
                    if number:
                        emit("and")
            case ast.Call(func=ast.Name(id="abs"), args=[argument], keywords=[]):
                visit(argument)
                emit("abs")
            case _:
                raise ValueError(
                    f"the condition {text!r} uses {ast.unparse(node)!r}: only names, numbers, + - * /, "
                    "abs(), comparisons, and, or, not"
                )

    visit(tree)
    depth = deepest = 0
    for operation, _ in code:
        depth += 1 if operation <= kernels.OPERATIONS["elapsed"] else 0 if operation in _UNARY else -1
        deepest = max(deepest, depth)
    if deepest > kernels.STACK_DEPTH:
        raise ValueError(f"the condition {text!r} is nested too deeply. Divide it between two states")
    return code


_UNARY = {kernels.OPERATIONS[name] for name in ("negate", "abs", "not")}

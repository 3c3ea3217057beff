"""Conditions and assignments in text, compiled to operations of the kernel of state machines."""

from __future__ import annotations

import ast
from collections.abc import Mapping

from cext.kernels import states as kernels

Code = list[tuple[float, float]]
"""Pairs of an operation and its operand."""

_BINARY: dict[object, str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_COMPARE: dict[object, str] = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}


def compile_assignment(text: str, held: int, names: Mapping[str, tuple[str, int]]) -> Code:
    """Compile the expression whose value a held output gets. held : index of the output; others as compile_condition"""
    return [*compile_condition(text, names), (float(kernels.OPERATIONS["store"]), float(held))]


def compile_condition(text: str, names: Mapping[str, tuple[str, int]]) -> Code:
    """Compile a condition for the kernel's stack. Raises ValueError for an invalid one.

    names : {name: operation that reads it, and its operand}
    """
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, AttributeError, RecursionError):
        raise ValueError(f"the condition {text!r} is not an expression") from None
    code: Code = []

    def emit(name: str, operand: float = 0.0) -> None:
        code.append((float(kernels.OPERATIONS[name]), float(operand)))

    def visit(node: ast.expr) -> None:
        match node:
            case ast.Constant(value=bool() | int() | float() as value):
                emit("constant", value)
            case ast.Name() if node.id in names:
                emit(*names[node.id])
            case ast.Name():
                raise ValueError(f"the condition {text!r} uses {node.id!r}, which is not an input ({', '.join(names)})")
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
        depth += 1 if operation <= kernels.OPERATIONS["held"] else 0 if operation in _UNARY else -1
        deepest = max(deepest, depth)
    if deepest > kernels.STACK_DEPTH:
        raise ValueError(f"the condition {text!r} is nested too deeply. Divide it between two states")
    return code


_UNARY = {kernels.OPERATIONS[name] for name in ("negate", "abs", "not")}

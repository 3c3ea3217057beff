"""Rules between the parameters of a block: `rules = ("lower <= upper",)` in its class.

A rule compares two linear expressions of numeric parameters, numbers and `dt`, the block's sampling period in s; it may
be a chain, as in "lower <= initial <= upper". It holds when the block is made, for each request to change a live
parameter, and at each tick of a ramp (cext/schedule/live_rules.pyx). A parameter that is None frees its rules.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from typing import Any

from cext.rules import Rule, Side
from graph.interval import EVERYTHING, Interval
from graph.syntax import parse

DT = "dt"
WORDS: dict[type[ast.cmpop], str] = {ast.LtE: "at most", ast.Lt: "below", ast.GtE: "at least", ast.Gt: "above"}


def rules_of(kind: type[Any]) -> list[Rule]:
    """Return the rules of a block's class and its base classes.

    Raises TypeError for one that is not a linear comparison of numeric parameters.
    """
    if isinstance(vars(kind).get("rules"), str):
        raise TypeError(f'{kind.__name__}.rules is a string: write a tuple, as in rules = ("{kind.rules}",)')
    texts = dict.fromkeys(text for base in reversed(kind.__mro__) for text in vars(base).get("rules", ()))
    return [rule for text in texts for rule in parse_rules(kind, text)]


def parse_rules(kind: Any, text: str) -> list[Rule]:
    """Return the rules of a text, one for each comparison of a chain. Raises TypeError."""
    try:
        tree = parse(text, mode="eval").body
    except (SyntaxError, TypeError):
        tree = None
    if not isinstance(tree, ast.Compare) or not all(type(operator) in WORDS for operator in tree.ops):
        raise TypeError(
            f'{kind.__name__}.rules: {text!r} is not a comparison with <, <=, > or >=, as in "lower <= upper"'
        )
    sides = [side_of(kind, text, node) for node in (tree.left, *tree.comparators)]
    rules = [
        Rule(left, WORDS[type(operator)], right, unit_of(kind, (left, right)))
        for (left, right), operator in zip(pairwise(sides), tree.ops)
    ]
    for rule in rules:
        if not any(key != DT for key in rule.keys):
            raise TypeError(f"{kind.__name__}.rules: {text!r} compares two sides without a parameter")
    return rules


def bound(rule: Rule, name: str, span: Callable[[str], Interval]) -> Interval:
    """Return an Interval that contains a parameter, from the spans of the others; only of plain comparisons.

    Without arithmetic the comparison is exact, and so is the interval.
    """
    small, large = rule.ascending

    def of(side: Side) -> Interval:
        return Interval.point(side.constant) if not side.terms else span(side.alone)

    if name == small.alone and (large.alone is not None or not large.terms):
        return Interval(EVERYTHING.low, of(large).high)
    if name == large.alone and (small.alone is not None or not small.terms):
        return Interval(of(small).low, EVERYTHING.high)
    return EVERYTHING


def held_bounds_of(kind: Any, held_within: Mapping[str, tuple[str, str]]) -> dict[str, tuple[Side, Side]]:
    """Return {output or memory: (low, high)} of `held_within` of a block or its class. Raises TypeError."""
    bounds: dict[str, tuple[Side, Side]] = {}
    for name, texts in held_within.items():
        if name not in kind.outputs and name not in kind.memory:
            raise TypeError(f"held_within: {name!r} is neither an output nor memory of the class")
        low, high = (side_of(kind, text, parse(text, mode="eval").body) for text in texts)
        bounds[name] = low, high
    return bounds


def side_of(kind: Any, text: str, node: ast.expr) -> Side:
    """Return a side of a rule. text : rule, as named in messages. Raises TypeError."""
    factors: dict[str, float] = {}

    def number(node: ast.expr) -> float | None:
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
            value = number(node.operand)
            return -value if value is not None and isinstance(node.op, ast.USub) else value
        value: Any = node.value if isinstance(node, ast.Constant) else None
        return float(value) if type(value) in (int, float) else None

    def add(node: ast.expr, factor: float) -> float:
        """Add a part to `factors`. Returns its constant."""
        if (value := number(node)) is not None:
            return factor * value
        if isinstance(node, ast.Name):
            if node.id != DT and (node.id not in kind.parameters or not kind.parameters[node.id].numeric):
                raise TypeError(f"{name_of(kind)}: {text!r}: {node.id!r} is not a numeric parameter of the class")
            factors[node.id] = factors.get(node.id, 0.0) + factor
            return 0.0
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return add(node.operand, -factor)
        if isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Add, ast.Sub)):
            return add(node.left, factor) + add(node.right, -factor if isinstance(node.op, ast.Sub) else factor)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
            for one, other in ((node.left, node.right), (node.right, node.left)):
                if (value := number(one)) is not None:
                    return add(other, factor * value)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div) and (value := number(node.right)):
            return add(node.left, factor / value)
        raise TypeError(
            f"{name_of(kind)}: {text!r}: {ast.unparse(node)!r} is not linear in the parameters: use sums and "
            "products with numbers, as in 2 * a + b"
        )

    constant = add(node, 1.0)
    return Side(ast.unparse(node), tuple(factors.items()), constant)


def name_of(kind: Any) -> str:
    """Return the name of a class, or of that of a block."""
    return (kind if isinstance(kind, type) else type(kind)).__name__


def unit_of(kind: Any, sides: Iterable[Side]) -> str:
    """Return " " and the unit that all parameters of a rule share, or ""."""
    names = {name for side in sides for name, _ in side.terms}
    units = {"s" if name == DT else kind.parameters[name].unit for name in names}
    return f" {units.pop()}" if len(units) == 1 and not units & {"1", "any"} else ""

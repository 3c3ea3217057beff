"""Rules between parameters as data: comparisons of linear expressions. Blocks declare them (graph/rules.py)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from msgspec import Struct
from msgspec.structs import replace


class Side(Struct, frozen=True):
    """One side of a rule: constant + Σ factor · value. terms : (name or index of a parameter, factor)"""

    text: str
    terms: tuple[tuple[Any, float], ...] = ()
    constant: float = 0.0

    def value(self, of: Callable[[Any], float]) -> float:
        """Return its value. of : function that returns the value of a parameter"""
        total = self.constant
        for key, factor in self.terms:
            total += factor * of(key)
        return total

    def folded(self, live: Mapping[Any, int], of: Callable[[Any], float]) -> Side:
        """Return the side of live parameters only: the values of the others become part of the constant.

        live : {name: index} of the live parameters, in the new terms
        of : function that returns the value of a parameter
        """
        fixed = tuple(term for term in self.terms if term[0] not in live)
        terms = tuple((live[key], factor) for key, factor in self.terms if key in live)
        return Side(self.text, terms, Side("", fixed, self.constant).value(of))

    @property
    def alone(self) -> Any:
        """The parameter that is the whole side, or None."""
        return self.terms[0][0] if len(self.terms) == 1 and (self.terms[0][1], self.constant) == (1.0, 0.0) else None


class Rule(Struct, frozen=True):
    """A comparison of two sides.

    word : "at most", "below", "at least" or "above"
    unit : of both sides, with a space before it, for messages
    """

    left: Side
    word: str
    right: Side
    unit: str = ""

    @property
    def strict(self) -> bool:
        """Whether the two sides must differ."""
        return self.word in ("below", "above")

    @property
    def ascending(self) -> tuple[Side, Side]:
        """The side that must not be larger, and the other."""
        return (self.left, self.right) if self.word in ("at most", "below") else (self.right, self.left)

    @property
    def keys(self) -> list[Any]:
        """Its parameters."""
        return list(dict.fromkeys(key for side in (self.left, self.right) for key, _ in side.terms))

    def holds(self, of: Callable[[Any], float]) -> bool:
        """Return whether values obey the rule. of : function that returns the value of a parameter"""
        small, large = (side.value(of) for side in self.ascending)
        return small < large if self.strict else small <= large

    def sentence(self, of: Callable[[Any], float]) -> str:
        """Return what a violation of the rule reports: "lower must be at most upper (3 N·m), got 5 N·m"."""
        number = f"{self.right.value(of):g}"
        bound = f"{number}{self.unit}"
        named = bound if self.right.text == number else f"{self.right.text} ({bound})"
        return f"{self.left.text} must be {self.word} {named}, got {self.left.value(of):g}{self.unit}"

    def folded(self, live: Mapping[Any, int], of: Callable[[Any], float]) -> Rule:
        """Return the rule of live parameters only: the values of the others become part of the constants.

        live : {name: index} of the live parameters, in the new terms
        of : function that returns the value of a parameter
        """

        return replace(self, left=self.left.folded(live, of), right=self.right.folded(live, of))


class LiveRule(NamedTuple):
    """Rule between live parameters of a block. rule : whose keys are the indices of the parameters"""

    path: str  # of the block
    rule: Rule

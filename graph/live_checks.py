"""Checks of live parameters: every combination that the rules of a block allow must also be valid for its hooks.

The loop knows the bounds and the rules of a block, not what its `configure` and `prepare` check. These are called on a
copy of the block with combinations of live values; one that they reject and the rules allow is an error of the diagram.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from copy import copy
from itertools import combinations, product
from typing import TYPE_CHECKING, Any

from cext.user_text import text_of
from graph.block import Block

if TYPE_CHECKING:
    from graph.compilation import Compilation

NEAR = 1e-3  # distance of two values that nearly break a rule, as a share of their range
CORNERS_LIMIT = 6  # live parameters whose bounds are combined in all ways; of more, only each two


def check_live(compilation: Compilation) -> None:
    """Report live values that the hooks of a block reject, and rules between ramps and steps."""
    for block in compilation.blocks:
        names = [name for name in block.parameters if block.live(name)]
        if not names or any(diagnostic.path == block.path for diagnostic in compilation.diagnostics):
            continue
        compilation.attempt(block, lambda: check_ramps(block, names))
        dt = block.every / compilation.diagram.rate
        found = rejected_combination(block, names, dt)
        if found is not None:
            values, message = found
            compilation.report(
                "TW010",
                f"its live bounds allow {values_in_words(values)}, which it rejects: {message}",
                block,
                hint='declare the rule in its class, as in rules = ("lower <= upper",), which holds for live values, '
                "or choose narrower bounds in Live(...)",
            )


def check_ramps(block: Block, names: list[str]) -> None:
    """Raise ValueError if a rule relates a live parameter that ramps to a live int or bool, which steps."""
    for rule in block.applying_rules():
        live = [key for key in rule.keys if key in names]
        steps = [key for key in live if block.parameters[key].dtype is not float]
        ramps = [key for key in live if key not in steps and (bounds := block.live(key)) and math.isfinite(bounds.slew)]
        if steps and ramps:
            raise ValueError(
                f"a rule relates {ramps[0]}, which ramps, to {steps[0]}, which steps: pass "
                f"{ramps[0]}=Live(..., slew=math.inf), or leave one of them out of Live"
            )


def rejected_combination(block: Block, names: list[str], dt: float) -> tuple[dict[str, Any], str] | None:
    """Return a combination of live values that the rules allow and a hook rejects, and its message; None without one.

    names : names of the live parameters
    dt : s
    """
    kind: Any = type(block)
    if kind.configure is Block.configure and kind.prepare is Block.prepare:
        return None
    for values in samples(block, names):
        trial = copy(block)
        for name, value in values.items():
            setattr(trial, name, value)
        trial.dt = dt
        try:
            trial.check_rules()
        except ValueError:
            continue
        try:
            trial.configure()
            trial.prepare(dt)
        except (ValueError, ArithmeticError) as error:
            return values, text_of(error)
    return None


def samples(block: Block, names: list[str]) -> Iterator[dict[str, Any]]:
    """Yield combinations of live values: the corners of the bounds, and pairs of values in between."""
    corners: dict[str, list[Any]] = {}
    for name in names:
        bounds: Any = block.live(name)
        corners[name] = [block.parameters[name].dtype(value) for value in dict.fromkeys((bounds.min, bounds.max))]
    if len(names) <= CORNERS_LIMIT:
        for values in product(*corners.values()):
            yield dict(zip(names, values))
    for one, other in combinations(names, 2):
        shared = [*corners[one], *corners[other], getattr(block, one), getattr(block, other)]
        near = NEAR * (max(shared) - min(shared))
        close = [pair for value in shared for pair in ((value, value + near), (value + near, value))]
        for first, second in (*product(shared, repeat=2), *close):
            if all(within(block, name, value) for name, value in ((one, first), (other, second))):
                yield {one: first, other: second}


def within(block: Block, name: str, value: float) -> bool:
    """Return whether a parameter's type and live bounds allow a value."""
    bounds: Any = block.live(name)
    return type(value) is block.parameters[name].dtype and bounds.min <= value <= bounds.max


def values_in_words(values: Mapping[str, Any]) -> str:
    """Return values as text: "lower=5, upper=3"."""
    return ", ".join(f"{name}={value:g}" for name, value in values.items())

"""Settings of an actuator that differ from the table of its model, and their effect if the table is correct.

The effective values are compared, not the parameters: those of a subclass and of another table also count.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from blocks.actuators.ranges import RANGES
from blocks.actuators.sources import with_ranges
from graph import Deviation

TOLERANCE = 1e-6  # relative
DISAGREEMENT = 0.02  # relative difference of two sources up to which the first is used without a statement of the rig
UNITS = ("rad", "rad/s", "N·m/rad", "N·m·s/rad", "N·m")

# effect of each range if the drive evaluates the law with that of the table, and if it only reports with it
IN_LAW = (
    "the joint turns {0:.3g} times as far as reported, and a stiffness gives {0:.3g} times its torque",
    "the joint turns {0:.3g} times as fast as reported, and a damping gives {0:.3g} times its torque",
    "a stiffness gives {0:.3g} times its torque",
    "a damping gives {0:.3g} times its torque",
    "the drive gives {0:.3g} times the commanded torque, up to {1:.3g} N·m at the limit of {2:.3g} N·m",
)
IN_REPORTS = (
    "the joint turns {0:.3g} times as far as reported",
    "the joint turns {0:.3g} times as fast as reported",
    "",
    "",
    "the torque is {0:.3g} times that reported",
)
BETWEEN = (  # the ranges of two sources
    "the joint turns {:.3g} times as far as reported",
    "the joint turns {:.3g} times as fast as reported",
    "a stiffness gives {:.3g} times its torque",
    "a damping gives {:.3g} times its torque",
    "the drive gives {:.3g} times the commanded torque",
)
PROPERTIES = ("rated", "peak", "gear", "pole_pairs", "torque_constant")  # of a model, beside its encoded ranges


def table_of(block: Any) -> Any:
    """Return the model of a block in the table of its family, None if the table does not list it.

    The table is that of the first class that has one: a subclass may find its models elsewhere.
    """
    try:
        return original(block).find(block.model)
    except ValueError:
        return None


def original(block: Any) -> Any:
    """Return the first class of a block that has a table: its family's own."""
    kind: type[Any] = block.__class__
    return next((base for base in reversed(kind.__mro__) if "find" in vars(base)), kind)


def of_ranges(block: Any, scales: Sequence[float], law: bool = True) -> Iterator[Deviation]:
    """Yield the Deviations of the encoded ranges.

    scales : factors from motor to joint; law : whether the drive evaluates the law with its ranges
    """
    spec = with_ranges(table_of(block) or block.spec, block.ranges)
    for name, unit, wire, scale, effect in zip(RANGES, UNITS, block.wire, scales, IN_LAW if law else IN_REPORTS):
        own, table = wire / scale, getattr(spec, f"wire_{name}")
        if effect and differ(own, table):
            factor = table / own
            text = effect.format(factor, factor * block.torque_limit, block.torque_limit)
            yield Deviation(
                f"wire_{name}", own, table, unit, f"the table of {spec.name}", if_correct(text), factor if law else None
            )


def of_sources(block: Any, scales: Sequence[float]) -> Iterator[Deviation]:
    """Yield the Deviation of a model whose sources disagree on its ranges, unless `ranges` states those of the unit.

    scales : factors from motor to joint
    """
    sets = getattr(block.spec, "range_sets", ())
    if block.ranges or not sets:
        return
    for other in sets[1:]:
        own = [wire / scale for wire, scale in zip(block.wire, scales)]
        factors = [table / value for table, value in zip(other.values, own)]
        effects = [words.format(factor) for words, factor in zip(BETWEEN, factors) if abs(factor - 1.0) > DISAGREEMENT]
        if effects:
            yield Deviation(
                "ranges",
                f"'', as {sets[0].name!r} ({sets[0].source.text})",
                repr(other.name),
                "1",
                other.source.text,
                f"{if_correct(', '.join(effects))}. Stiffness and damping cannot be read from the drive. Set ranges to "
                f"{' or '.join(repr(each.name) for each in sets)}",
            )


def of_constant(block: Any, constant: float, commanded: bool) -> Iterator[Deviation]:
    """Yield the Deviation of the torque constant from the table.

    constant : N·m/A at the output of the actuator; commanded : whether the current bounds the torque
    """
    spec = table_of(block) or block.spec
    table, source = spec.torque_constant, f"the table of {spec.name}"
    if not differ(constant, table):
        return
    factor = table / constant
    most = block.current_limit * table * block.gear_ratio
    text = (IN_LAW if commanded else IN_REPORTS)[-1].format(factor, most, block.torque_limit)
    yield Deviation(
        "torque_constant", constant, table, "N·m/A", source, if_correct(text), factor if commanded else None
    )


def of_model(block: Any, *compared: str) -> Iterator[Deviation]:
    """Yield the Deviations of the gear, of properties of the model, and of its ambiguity after a power cycle.

    compared : properties that are compared elsewhere
    """
    yield from of_gear(block)
    table, used = table_of(block), block.spec
    if table is None:
        yield Deviation(
            "model",
            used.name,
            "no such model",
            "1",
            f"the table of {original(block).__name__}",
            "no source confirms its encoded ranges, ratings and constants",
        )
    elif table != used:
        names = [
            name
            for name in PROPERTIES
            if name not in compared and getattr(used, name, None) != getattr(table, name, None)
        ]
        if names:
            own, listed = (
                ", ".join(f"{name} {getattr(model, name, None)}" for name in names) for model in (used, table)
            )
            yield Deviation(
                "model",
                f"{used.name} with {own}",
                listed,
                "1",
                f"the table of {table.name}",
                if_correct("the limits of torque, current and velocity are not those of the motor"),
            )
    shift = (table or used).wake_shift / block.gear_ratio
    if differ(block.shift, shift):
        yield Deviation(
            "wake_shift",
            block.shift,
            shift,
            "rad",
            f"the table of {used.name}",
            if_correct(f"a power cycle can shift the reading of the joint by multiples of {shift:.4g} rad"),
            safe=True,
        )


def of_gear(block: Any) -> Iterator[Deviation]:
    """Yield the Deviation of the gear behind the actuator.

    The diagram states it. Without the gear, a ratio below 1 gives more torque than the limit.
    """
    ratio = block.gear_ratio
    table, source = block.set_from.get("gear_ratio", ("", ratio))[1], "the diagram"
    if not differ(ratio, table) and ratio < 1.0:
        table, source = 1.0, "an actuator without a gear"
    if differ(ratio, table):
        factor = table / ratio
        text = IN_LAW[-1].format(factor, factor * block.torque_limit, block.torque_limit)
        yield Deviation("gear_ratio", ratio, table, "1", source, if_correct(text), factor)


def differ(a: float, b: float) -> bool:
    """Return whether two values differ by more than the rounding of a conversion."""
    return not math.isclose(a, b, rel_tol=TOLERANCE)


def if_correct(text: str) -> str:
    """Return the effect that holds if the table is correct."""
    return f"if that is correct, {text}"

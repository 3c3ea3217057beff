"""Options that select strides, of `plot --strides` and `diff --strides`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from runtime.cli.parsing import add_count
from runtime.host.errors import BadInput
from runtime.record.analysis.conditions import conditions

if TYPE_CHECKING:
    from argparse import Namespace

    from runtime.cli.parsing import Parser
    from runtime.record.analysis.conditions import Condition
    from runtime.record.analysis.trial import Trial

OPTIONS = ("events", "between", "last", "per_kg", "label")


def add(parser: Parser) -> None:
    """Add the options to a Parser."""
    parser.add_argument(
        "--events",
        metavar="SIGNAL",
        help="with --strides: signal that starts a stride, a bool or a gait phase (default: of the subsystem)",
    )
    parser.add_argument(
        "--between",
        nargs=2,
        action="append",
        metavar=("FROM", "TO"),
        help="with --strides: strides between two times: seconds, start, end, or a mark, as in --between 'mark 1' end. "
        "May be repeated: each is a condition",
    )
    add_count(parser, "--last", "with --strides: the last N strides of each leg and condition")
    parser.add_argument(
        "--per-kg",
        nargs="?",
        const="mass",
        metavar="KG",
        help="with --strides: divide torque, power and work by the body mass: KG, or the field mass of each recording",
    )
    parser.add_argument(
        "--label",
        action="append",
        metavar="TEXT",
        help="with --strides: name of a condition in the picture, given once for each (default: its field condition, "
        "or the name of its file)",
    )


def check(options: Namespace, strides: bool) -> None:
    """Raise BadInput for options that need --strides, or with a wrong value.

    options : whose `per_kg` becomes a number in kg, "mass" or None
    strides : whether --strides was given
    """
    for name in OPTIONS:
        if getattr(options, name) is not None and not strides:
            raise BadInput(f"--{name.replace('_', '-')} needs --strides")
    if options.per_kg not in (None, "mass"):
        try:
            options.per_kg = float(options.per_kg)
        except ValueError:
            options.per_kg = 0.0
        if not 0.0 < options.per_kg < float("inf"):
            raise BadInput("--per-kg needs a body mass in kg above 0, as in --per-kg 72")


def conditions_of(trials: Sequence[Trial], options: Namespace) -> list[Condition]:
    """Return the Conditions of recordings. Raises BadInput."""
    return conditions(trials, options.events, options.between or (), options.last, options.per_kg, options.label or ())

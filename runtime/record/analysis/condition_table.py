"""Differences of two conditions over the gait cycle, the clearest first: `python -m runtime diff A B --strides`.

The effect is the difference in standard deviations over strides, pooled over both conditions (Cohen 1988):

    figures of a stride     d = |m₂ − m₁| / s,  s² = (s₁² + s₂²) / 2
    curves                  d = RMS(m₂ − m₁) / RMS(s), over the gait cycle
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from runtime.host.errors import BadInput
from runtime.record.storage.messages import split

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from runtime.record.analysis.conditions import Condition, Leg


ANGLE, TORQUE, POWER = range(3)  # among CURVES
FIGURES = (  # of a stride: name, unit, function of a Stride, whether it scales with body mass
    ("stride time", "s", lambda stride: stride.time, False),
    ("angle, range", "deg", lambda stride: np.degrees(np.ptp(stride.curves[ANGLE])), False),
    ("torque, peak", "N·m", lambda stride: np.max(np.abs(stride.curves[TORQUE])), True),
    ("power, peak", "W", lambda stride: np.max(stride.curves[POWER]), True),
    ("positive work", "J", lambda stride: stride.positive_work, True),
    ("negative work", "J", lambda stride: stride.negative_work, True),
)
SIGNAL_LIMIT = 10  # signals of a leg in the table
ROUNDING = 1e-12  # relative difference below which means are equal
EFFECT_LIMIT = 99.0  # larger effects are printed as ">99"
Differences: TypeAlias = "tuple[tuple[int, int], list[Row], list[Row]]"
MINUS = str.maketrans("-", "−")


@dataclass(frozen=True)
class Row:
    """One line of the table.

    effect : effect size in pooled standard deviations
    relative : difference of a figure relative to the first; of a curve, RMS relative to the RMS of the first
    largest : difference of a figure; largest difference of the mean curves, signed
    first, second : (mean, standard deviation) of a figure; None for a curve
    at : place of the largest difference in % of the gait cycle; None for a figure
    """

    name: str
    unit: str
    effect: float
    relative: float
    largest: float
    first: tuple[float, float] | None = None
    second: tuple[float, float] | None = None
    at: float | None = None


def compare(first: Condition, second: Condition) -> dict[str, Differences]:
    """Return {title of a leg: (strides of both, figures, signals)}: [Row] each, in order of their effect.

    first, second : Condition

    Raises BadInput if they have no leg in common.
    """
    mine, others = first.legs(), second.legs()
    differences = {}
    for title in [title for title in mine if title in others]:
        a, b = mine[title], others[title]
        per_kg = "/kg" if first.mass is not None else ""
        figures = [
            figure(name, unit + per_kg * scales, *(np.array([of(one) for one in leg.strides]) for leg in (a, b)))
            for name, unit, of, scales in FIGURES
        ]
        differences[title] = (
            (len(a.strides), len(b.strides)),
            sort_by_effect(figures),
            sort_by_effect(signals(a, b))[:SIGNAL_LIMIT],
        )
    if not differences:
        raise BadInput(
            f"{first.label} has {', '.join(mine)} and {second.label} has {', '.join(others)}: no leg in common"
        )
    return differences


def figure(name: str, unit: str, a: np.ndarray, b: np.ndarray) -> Row:
    """Return the Row of a figure. a, b : value of each stride"""
    spread = np.sqrt((deviation(a) ** 2 + deviation(b) ** 2) / 2)
    first, second = float(a.mean()), float(b.mean())
    difference = 0.0 if math.isclose(first, second, rel_tol=ROUNDING) else second - first
    return Row(
        name,
        unit,
        share(abs(difference), float(spread)),
        share(difference, abs(first)),
        difference,
        (first, float(deviation(a))),
        (second, float(deviation(b))),
    )


def signals(a: Leg, b: Leg) -> Iterator[Row]:
    """Yield a Row for each float signal of a leg's subsystem that both conditions have. a, b : Leg"""
    folder = split(a.signals["angle"])[0]
    here, there = a.condition.trial, b.condition.trial
    paths = [
        path
        for path in here.names
        if split(path)[0] == folder and path in here.signals and path in there.signals and here.dtype(path) == "float"
    ]
    for trial in (here, there):
        trial.read(paths)  # in one pass
    for path in paths:
        if path == a.signals["phase"]:
            continue
        try:
            mine, others = (leg.condition.curves(path) for leg in (a, b))
        except BadInput:  # no stride with finite values
            continue
        difference = others.mean(axis=0) - mine.mean(axis=0)
        spread = np.sqrt((deviation(mine) ** 2 + deviation(others) ** 2) / 2)
        place = int(np.argmax(np.abs(difference)))
        yield Row(
            path.removeprefix(f"{folder}/"),
            a.condition.trial.unit(path),
            share(rms(difference), rms(spread)),
            share(rms(difference), rms(mine.mean(axis=0))),
            float(difference[place]),
            at=100.0 * place / (len(difference) - 1),
        )


def deviation(values: np.ndarray) -> np.ndarray:
    """Return the sample standard deviation over the strides; 0 for a single one."""
    return values.std(axis=0, ddof=1) if len(values) > 1 else np.zeros(values.shape[1:])


def rms(values: np.ndarray) -> float:
    """Return the root mean square of values."""
    return float(np.sqrt(np.mean(np.square(values))))


def share(difference: float, of: float) -> float:
    """Return a difference relative to something: 0 for none, infinite relative to 0."""
    return 0.0 if difference == 0.0 else difference / of if of > 0.0 else math.copysign(math.inf, difference)


def sort_by_effect(rows: Iterable[Row]) -> list[Row]:
    """Return the rows in order of their effect; beyond EFFECT_LIMIT, where strides hardly vary, of their size."""
    return sorted(rows, key=lambda row: (min(row.effect, EFFECT_LIMIT), abs(row.relative)), reverse=True)


def table(first: Condition, second: Condition, comparison: dict[str, Differences]) -> list[str]:
    """Return the lines for standard output. comparison : as `compare` returns it"""
    lines = [f"A  {first.label}", f"B  {second.label}"]
    for title, (counts, figures, curves) in comparison.items():
        lines += ["", f"{title}: {counts[0]} strides in A, {counts[1]} in B", ""]
        lines += columns(
            ("a stride", "A", "B", "B − A", "", "effect"),
            [
                (
                    f"{row.name} [{row.unit}]",
                    spread_text(row.first),
                    spread_text(row.second),
                    signed_text(row.largest),
                    percent(row),
                    effect_text(row.effect),
                )
                for row in figures
            ],
        )
        if curves:
            lines += [""]
            lines += columns(
                ("over the gait cycle", "largest B − A", "at", "effect"),
                [
                    (
                        f"{row.name} [{row.unit}]" if row.unit not in ("1", "any") else row.name,
                        signed_text(row.largest),
                        f"{row.at:.0f} %",
                        effect_text(row.effect),
                    )
                    for row in curves
                ],
            )
    return [*lines, "", "effect: difference in standard deviations of the strides, the clearest first"]


def columns(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return lines of a table: the first column on the left, the others on the right."""
    widths = [max(len(row[place]) for row in [head, *rows]) for place in range(len(head))]
    return [
        "  " + "  ".join([row[0].ljust(widths[0]), *(text.rjust(width) for text, width in zip(row[1:], widths[1:]))])
        for row in [head, *rows]
    ]


def spread_text(spread: tuple[float, float] | None) -> str:
    """Return "mean ± standard deviation", with three digits of the mean; "" for a curve, which has neither."""
    if spread is None:
        return ""
    mean, deviation = spread
    digits = max(0, 2 - math.floor(math.log10(abs(mean)))) if mean else 2
    return f"{mean:.{digits}f} ± {deviation:.{digits}f}".translate(MINUS)


def signed_text(value: float) -> str:
    """Return a number with its sign and three digits; '0' for zero."""
    return f"{value:+.3g}".translate(MINUS) if value else "0"


def percent(row: Row) -> str:
    """Return the relative difference of a row in percent; '' from 1000 % on, relative to almost nothing."""
    return f"{100.0 * row.relative:+.0f} %".translate(MINUS) if abs(row.relative) < 10.0 else ""


def effect_text(value: float) -> str:
    """Return an effect as text; '>99' above EFFECT_LIMIT."""
    return f">{EFFECT_LIMIT:.0f}" if value > EFFECT_LIMIT else f"{value:.1f}"

"""The average stride of each leg, and of signals, of one recording or of several, for JSON."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.host.errors import BadInput
from runtime.record.analysis.average_stride import CURVES
from runtime.record.analysis.condition_table import FIGURES, deviation
from runtime.record.analysis.conditions import Condition
from runtime.record.analysis.names import shown_unit, words_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from runtime.record.view.recording import Recording

UNITS = {"angle": "rad", "torque": "N·m", "power": "W"}


def average(
    recordings: Sequence[tuple[int, Recording, tuple[float, float] | None]], paths: Iterable[str]
) -> dict[str, Any]:
    """Return {"legs", "signals", "problems"}: means and standard deviations at 0, 1, ... 100 % of the stride.

    recordings : [(number of the recording, Recording, (begin, end) in s or None for all of it)]
    paths : signals to average besides angle, torque and power of each leg
    """
    legs: dict[str, dict[str, Any]] = {}
    signals: dict[str, dict[str, Any]] = {}
    problems: list[str] = []
    for number, recording, between in recordings:
        of_legs: set[str] = set()  # signals that are averaged already
        without: list[str] = []
        begin, end = between or (-math.inf, math.inf)
        condition = Condition(recording.label, recording.trial.between(begin, end))  # which is not kept
        try:
            for title, leg in condition.legs().items():
                of_legs |= {leg.signals[name] for name in ("angle", "torque")}
                joint = words_of(leg.joint)
                entry = legs.setdefault(title, {"title": title, "joint": joint, "positive": leg.positive, "of": []})
                curves = {name: statistics(leg.curves(name), UNITS[name]) for name in CURVES}
                entry["of"].append(
                    {"recording": number, "strides": len(leg.strides), "toe_off": leg.toe_off, "curves": curves}
                    | {"figures": [figure(leg.strides, *each[:3]) for each in FIGURES]}
                )
        except BadInput:
            problems.append(f"{recording.label} has no complete stride of a joint with a gait phase")
        for described in recording.signals:
            path = described["path"]
            if path not in paths or path in of_legs:
                continue
            try:
                curve = statistics(condition.curves(path), described["unit"])
            except BadInput:
                without.append(f"{described['block']} {described['port']}".strip())
                continue
            entry = signals.setdefault(path, {**described, "of": []})
            entry["of"].append({"recording": number, **curve})
        if without:
            problems.append(f"{recording.label} has no complete stride for {'; '.join(without)}")
    return {"legs": list(legs.values()), "signals": list(signals.values()), "problems": problems}


def statistics(values: np.ndarray, unit: str) -> dict[str, Any]:
    """Return mean and standard deviation of strides in the unit for people. values : (strides, points)"""
    shown, factor = shown_unit(unit)
    return {
        "strides": len(values),
        "shown": shown,
        "mean": (factor * values.mean(axis=0)).tolist(),
        "sd": (factor * deviation(values)).tolist(),
    }


def figure(strides: Sequence[Any], name: str, unit: str, value: Any) -> dict[str, Any]:
    """Return mean and standard deviation of one figure of strides, as in FIGURES."""
    values = np.array([value(stride) for stride in strides])
    unit = "°" if unit == "deg" else unit
    return {"name": name, "unit": unit, "mean": float(values.mean()), "sd": float(deviation(values))}

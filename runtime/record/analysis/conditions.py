"""Conditions: strides of recordings, or of parts of them, side by side over the gait cycle.

plot without.mcap assisted.mcap --strides
plot trial.mcap --strides --between "mark 1" "mark 2" --between "mark 3" "mark 4" --last 20
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.host.errors import BadInput
from runtime.record.analysis.average_stride import CURVES, Stride
from runtime.record.analysis.legs import average_strides
from runtime.record.analysis.strides import bounds, over
from runtime.record.storage.files import short_names
from runtime.record.storage.messages import split

if TYPE_CHECKING:
    from collections.abc import Sequence

    from runtime.record.analysis.trial_data import TrialData


@dataclass(frozen=True)
class Condition:
    """Strides of one condition.

    label : name of the condition
    trial : TrialData
    events, between, last : as for Trial.strides
    mass : kg, by which torque, power and work are divided; None to leave them as they are
    """

    label: str
    trial: TrialData
    events: str | None = None
    between: tuple[str, str] | None = None
    last: int | None = None
    mass: float | None = None

    def legs(self) -> dict[str, Leg]:
        """Return the legs by title. Raises BadInput without a stride."""
        scale = 1.0 if self.mass is None else 1.0 / self.mass
        return {
            result["title"]: Leg(
                self, result["title"], result["positive"], result["signals"], [scaled(stride, scale) for stride in each]
            )
            for result, each in average_strides(self.trial, self.events, self.between, self.last)
        }

    def curves(self, path: str) -> np.ndarray:
        """Return a scalar signal over the gait cycle, as (strides, 101), without strides that are not finite.

        Raises KeyError, or BadInput without a stride or for a vector.
        """
        values = over(self.trial, path, bounds(self.trial, path, self.events, self.between, self.last))
        if values.shape[2] != 1:
            raise BadInput(f"{path} has {values.shape[2]} elements: name one, as in {path}[0]")
        values = values[np.isfinite(values).all(axis=(1, 2)), :, 0]
        if not len(values):
            raise BadInput(f"{self.trial.path} has no complete stride for {path}")
        return values


@dataclass(frozen=True)
class Leg:
    """One leg in one condition.

    condition : Condition
    title : name of the leg
    positive : direction of positive angles and torques, such as "flexion"; "" if it is not stated
    signals : {"phase", "angle", "velocity", "torque", ...: path}
    strides : [Stride], divided by the body mass if the condition has one
    """

    condition: Condition
    title: str
    positive: str
    signals: dict[str, str]
    strides: list[Stride]

    def curves(self, name: str) -> np.ndarray:
        """Return a curve of each stride, as (strides, 101). name : "angle", "torque" or "power" """
        return np.array([stride.curves[CURVES.index(name)] for stride in self.strides])

    @property
    def joint(self) -> str:
        """Name of the block that measures the angle, such as "knee"."""
        return split(self.signals["angle"])[1]

    @property
    def toe_off(self) -> float | None:
        """Mean phase at which ground contact ends, as fraction of the stride; None where it is not measured."""
        phases = [stride.toe_off for stride in self.strides if stride.toe_off == stride.toe_off]
        return sum(phases) / len(phases) if phases else None


def scaled(stride: Stride, scale: float) -> Stride:
    """Return a Stride with its torque, power and work multiplied by `scale`."""
    factors = np.array([1.0 if name == "angle" else scale for name in CURVES])[:, np.newaxis]
    return stride._replace(
        positive_work=scale * stride.positive_work,
        negative_work=scale * stride.negative_work,
        curves=factors * stride.curves,
    )


def conditions(
    trials: Sequence[TrialData],
    events: str | None = None,
    sections: Sequence[tuple[str, str]] = (),
    last: int | None = None,
    per_kg: float | str | None = None,
    names: Sequence[str] = (),
) -> list[Condition]:
    """Return the Conditions of recordings: one for each section of each trial.

    trials : [TrialData]
    events : as for Trial.strides
    sections : [(begin, end)], as `between` of Trial.strides; none for whole trials
    last : number of strides, the last of each leg; None for all
    per_kg : None; body mass in kg; or "mass" for the field of this name of each recording
    names : labels of the conditions; by default from the fields of the trials or the names of their files

    Raises BadInput.
    """
    result = []
    for trial, name in zip(trials, trial_labels(trials)):
        mass = body_mass(trial) if isinstance(per_kg, str) else per_kg
        for section in sections or [None]:
            words = [] if section is None else [" to ".join(map(time_text, section))]
            label = ", ".join([name] * (len(trials) > 1 or not words) + words)
            result.append(Condition(label, trial, events, section, last, mass))
    if names and len(names) != len(result):
        raise BadInput(f"{len(names)} labels for {len(result)} conditions: pass a label for each, or none")
    return [replace(condition, label=name) for condition, name in zip(result, names)] if names else result


def time_text(text: str) -> str:
    """Return a time for a label: seconds with their unit, others as they are."""
    try:
        return f"{float(text):g} s"
    except ValueError:
        return text


def trial_labels(trials: Sequence[TrialData]) -> list[str]:
    """Return a label for each trial: its field "condition" if each has another one, else its file name, without the
    time of the run where the names differ without it.
    """
    fields = [trial.fields.get("condition", "") for trial in trials]
    if all(fields) and len(set(fields)) == len(fields):
        return fields
    names = short_names([trial.path for trial in trials])
    brief = [re.sub(r"_\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d(-\d+)?$", "", name) for name in names]
    return brief if len(set(brief)) == len(brief) else names


def body_mass(trial: TrialData) -> float:
    """Return the field "mass" of a recording in kg. Raises BadInput."""
    text: Any = trial.fields.get("mass", "")
    try:
        mass = float(str(text).removesuffix("kg"))
    except ValueError:
        mass = 0.0
    if not 0.0 < mass < float("inf"):
        problem = f"mass={text!r} is not a number of kg above 0" if text else "the recording has no field mass"
        raise BadInput(
            f"{trial.path}: {problem}: pass the body mass, as in --per-kg 72, or record with --trial mass=72"
        )
    return mass

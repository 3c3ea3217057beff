"""The legs of a recording, and the strides of each: `plot --strides` and `diff --strides`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from runtime.host.errors import BadInput
from runtime.record.analysis.average_stride import AverageStride, Stride
from runtime.record.analysis.resample import at_ticks
from runtime.record.analysis.stride_signals import INPUTS, contact_of
from runtime.record.analysis.strides import beginnings, interval, phase_of
from runtime.record.storage.messages import split

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from typing import Any

    from runtime.record.analysis.trial_data import TrialData


JOINT = ("position", "velocity", "torque")
CURVES_OF = ("angle", "velocity", "torque")  # the same, as inputs of a StrideReport
STRIDE_REPORT = "blocks.recorders:StrideReport"


class EachStride(AverageStride):
    """Average stride that also keeps each stride.

    each : [Stride]
    """

    def __init__(self, rate: float) -> None:
        super().__init__(rate)
        self.each: list[Stride] = []

    def keep(self, stride: Stride) -> None:
        super().keep(stride)
        self.each.append(stride)


def legs(
    trial: TrialData,
    events: str | Sequence[float] | np.ndarray | None = None,
    between: tuple[str, str] | None = None,
    last: int | None = None,
) -> list[dict[str, Any]]:
    """Return the results of `measured` without the single strides, for runtime.record.analysis.stride_picture.

    Arguments and errors are those of `measured`.
    """
    return [result for result, _ in average_strides(trial, events, between, last)]


def average_strides(
    trial: TrialData,
    events: str | Sequence[float] | np.ndarray | None = None,
    between: tuple[str, str] | None = None,
    last: int | None = None,
) -> list[tuple[dict[str, Any], list[Stride]]]:
    """Return [(result of AverageStride, [Stride])] of each leg, from the recorded rows.

    The legs are those of the diagram's StrideReports with the same signals, so that the figures equal those of the run;
    then every other joint with position, velocity and torque.

    events : as for Trial.strides
    between : as for Trial.strides
    last : number of strides, the last of each leg; None for all

    Raises BadInput without a stride.
    """
    known = reports(trial)
    used = {signals["angle"] for *_, signals in known}
    begin, end = interval(trial, between)
    measured_legs, refused = [], None
    others = [joint for joint in joints(trial) if joint[-1]["angle"] not in used]
    for title, path, positive, signals in [*known, *others]:
        if contact := contact_of(trial.signals, signals["angle"]):
            signals["contact"] = contact
        trial.read(name for name in signals.values() if name in trial.signals)  # in one pass
        try:
            rows, phase, walking = gait(trial, signals, events)
        except BadInput as error:  # this joint has no gait phase, but another may have
            refused = refused or error
            continue
        measured = (*CURVES_OF, *(["contact"] if contact else []))
        columns = (phase, walking, *(at_ticks(trial, signals[name])[rows] for name in measured))
        samples = np.column_stack([column.astype(float) for column in columns])
        ticks, time = trial.tick[rows], trial.time[rows]
        chosen = (time >= begin) & (time <= end)
        average = each_stride_of(trial, ticks[chosen], samples[chosen])
        if last is not None and len(average.each) > last:
            chosen &= (ticks >= average.each[-last].begin - 1) & (ticks <= average.each[-1].end)
            average = each_stride_of(trial, ticks[chosen], samples[chosen])
        if average.each:
            about = {"title": title, "path": path, "positive": positive, "signals": signals}
            measured_legs.append((about | average.result(), average.each))
    if not measured_legs:
        raise refused or BadInput(
            f"{trial.path} has no complete stride of a joint with position, velocity and torque"
            + ("" if between is None else f" between {begin:g} s and {end:g} s")
            + ". Run for longer, or name signals to average those, as in --strides left/knee_angle"
        )
    several = len({one["title"] for one, _ in measured_legs}) < len(measured_legs)
    return [({**one, "title": one["path"] if several else one["title"]}, each) for one, each in measured_legs]


def each_stride_of(trial: TrialData, ticks: np.ndarray, samples: np.ndarray) -> EachStride:
    """Return the EachStride of rows. ticks, samples : as for AverageStride.add"""
    average = EachStride(trial.about["rate"])
    average.add(ticks, samples)
    return average


def reports(trial: TrialData) -> list[tuple[str, str, str, dict[str, str]]]:
    """Return [(title, path, positive direction, {input: signal})] of the StrideReports with recorded signals."""
    diagram, entries = trial.diagram or {}, []
    for block in diagram.get("blocks", []):
        if block["type"] == STRIDE_REPORT:
            path = block["path"]
            wires = {wire["port"]: wire["from"] for wire in diagram["wires"] if wire["to"] == path}
            if set(wires) == set(INPUTS) and all(signal in trial.signals for signal in wires.values()):
                entries.append(
                    (
                        block["parameters"].get("title") or path.rpartition("/")[0] or path,
                        path,
                        str(block["parameters"].get("positive") or ""),
                        {name: wires[name] for name in INPUTS},
                    )
                )
    return entries


def joints(trial: TrialData) -> Iterator[tuple[str, str, str, dict[str, str]]]:
    """Yield (title, path, "", {input: signal}) of each joint with position, velocity and torque, without its phase."""
    for path in trial.names:
        folder, block, port = split(path)
        stem = f"{folder}/{block}".lstrip("/")
        if port == "position" and all(f"{stem}.{other}" in trial.signals for other in JOINT):
            yield folder or stem, stem, "", {name: f"{stem}.{port}" for name, port in zip(CURVES_OF, JOINT)}


def gait(
    trial: TrialData, signals: dict[str, str], events: str | Sequence[float] | np.ndarray | None
) -> tuple[slice, np.ndarray, np.ndarray]:
    """Return (rows, phase, walking) of the part of the recording with strides, and add the names to `signals`.

    events : as for Trial.strides

    Raises BadInput without a phase.
    """
    everything, ones = slice(None), np.ones(len(trial))
    if events is None:
        if "phase" not in signals:
            signals["phase"], walking = phase_of(trial, signals["angle"])
            signals |= {} if walking is None else {"walking": walking}
        walking = at_ticks(trial, signals["walking"]) if "walking" in signals else ones
        return everything, at_ticks(trial, signals["phase"]), walking
    signals.pop("walking", None)
    signals["phase"] = events if isinstance(events, str) else "given times"
    if isinstance(events, str) and trial[events].ndim == 1 and trial[events].dtype == float:
        return everything, at_ticks(trial, events), ones
    return phase_between(
        trial,
        beginnings(trial, events) if isinstance(events, str) else np.sort(np.asarray(events, dtype=float).ravel()),
    )


def phase_between(trial: TrialData, times: np.ndarray) -> tuple[slice, np.ndarray, np.ndarray]:
    """Return (rows, phase, walking) from the tick before the first event to the last one.

    The phase is the fraction of the time to the next event. times : s
    """
    near = 0.5 / trial.about["rate"]
    places = np.searchsorted(trial.time, times - near)
    events = np.unique(places[(places < len(trial)) & (times >= trial.time[:1].sum() - near)])
    if len(events) < 2:
        return slice(0, 0), np.empty(0), np.empty(0)
    phase = np.zeros(len(trial))
    for first, last in zip(events[:-1], events[1:]):
        phase[first:last] = np.arange(last - first) / (last - first)
    begin = max(0, events[0] - 1)
    if begin < events[0]:  # a stride begins at a fall of the phase
        phase[begin] = 1.0 - 1.0 / (events[1] - events[0])
    rows = slice(begin, events[-1] + 1)
    return rows, phase[rows], np.ones(events[-1] + 1 - begin)

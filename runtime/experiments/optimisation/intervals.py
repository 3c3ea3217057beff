"""Intervals of a recording in which an optimisation measured the conditions that are worth a comparison."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any


def of_conditions(events: Iterable[Mapping[str, Any]], rate: float, measure: float) -> dict[str, tuple[float, float]]:
    """Return {condition: (begin, end) in s} of measurements: the last one of each condition of the validation trials.

    Without validation trials they are the first evaluation and the one with the lowest cost.

    events : events of the recording
    rate : Hz
    measure : duration of each measurement in s
    """
    measured = [event for event in events if event.get("step") == "measurement" and event["cost"] is not None]
    validations = [event for event in measured if "condition" in event]
    if validations:
        chosen = {event["condition"]: event for event in validations}
    elif measured:
        lowest = min(measured, key=lambda event: event["cost"])
        chosen = {f"evaluation {event['number']}": event for event in (measured[0], lowest)}
    else:
        chosen = {}
    return {name: (event["tick"] / rate - measure, event["tick"] / rate) for name, event in chosen.items()}

"""The signals that a run records: those that its recorders select, at their rates."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from msgspec.structs import asdict, replace

from graph import Schedule
from graph.schedule import Column
from runtime.host.errors import BadInput
from runtime.robot.loading.signal_selection import select

PLANT = "plant/"  # start of the paths of a plant's signals


def select_recorded(schedule: Schedule) -> Schedule:
    """Return a Schedule without the columns that no sink uses. Raises BadInput for a name without a signal.

    A recorder takes the columns that its parameter `record` selects, at every n-th tick if it has `every=n`. Sinks
    without connections take what the recorders take; the connected signals of other sinks are recorded at every tick.
    A signal that several sinks take is recorded at the ticks of all of them.
    """
    numbers = sum(place.size for place in schedule.signals.values())
    recorders = [sink for sink in schedule.sinks if "record" in sink.block.parameters]
    if not any(sink.block.record or sink.block.every > 1 for sink in recorders):
        return schedule
    selected = {sink.block: selection(sink) for sink in recorders}
    taken = set().union(*selected.values())
    sinks: list[tuple[Any, list[Any]]] = []
    every: dict[int, int] = {}  # {column: ticks from one sample to the next}
    for sink in schedule.sinks:
        follows = sink.block not in selected and len(sink.columns) == numbers
        own = selected.get(sink.block, taken if follows else None)
        columns = [column for column in sink.columns if own is None or column.index in own]
        sinks.append((sink, columns))
        period = sink.block.every if sink.block in selected else 1
        for column in () if follows else columns:
            every[column.index] = math.gcd(every.get(column.index, 0), period)
    kept = sorted(every)
    index = {old: new for new, old in enumerate(kept)}
    return replace(
        schedule,
        columns=schedule.columns[kept],
        recorded=[replace(schedule.recorded[old], index=index[old], every=every[old]) for old in kept],
        sinks=[
            replace(sink, columns=tuple(replace(column, index=index[column.index]) for column in columns))
            for sink, columns in sinks
        ],
    )


def selection(sink: Any) -> set[int]:
    """Return the indices in the row of the columns that a recorder selects."""
    if not sink.block.record:
        return {column.index for column in sink.columns}
    try:
        places = select([asdict(column) for column in sink.columns], sink.block.record)
    except BadInput as error:
        raise BadInput(
            f"{sink.block.location}: {sink.block.path}: record: {error}; it selects signals: the option --record sets "
            "the folder of the files"
        ) from None
    return {sink.columns[place].index for place in places}


def everything(schedule: Schedule) -> dict[str, Any]:
    """Return every signal of a schedule as recorded numbers: its fields `columns` and `recorded`."""
    slots, recorded = [], []
    for place in sorted(schedule.signals.values(), key=lambda place: place.path):
        for offset, index in enumerate(np.ndindex(place.shape)):
            path = place.path + "".join(f"[{number}]" for number in index)
            recorded.append(Column(len(slots), path, place.dtype, place.unit, place.circle))
            slots.append(place.slot + offset)
    return {"columns": np.array(slots, dtype=np.int32), "recorded": recorded}


def recorded_of_plant(schedule: Schedule, names: str, first: int) -> dict[str, Any]:
    """Return signals of a plant that are recorded with those of its robot: its fields `columns` and `recorded`.

    names : signals or blocks, as in runtime.robot.loading.signal_selection.select; "" for none
    first : number of the robot's columns, before those of the plant

    Raises BadInput for a name without a signal.
    """
    if not names:
        return {"columns": np.empty(0, np.int32), "recorded": []}
    fields = everything(schedule)
    columns = fields["recorded"]
    try:
        places = select([asdict(column) for column in columns], names)
    except BadInput as error:
        raise BadInput(f"plant: {error}") from None
    return {
        "columns": fields["columns"][places],
        "recorded": [
            replace(columns[place], index=first + index, path=f"{PLANT}{columns[place].path}")
            for index, place in enumerate(places)
        ],
    }

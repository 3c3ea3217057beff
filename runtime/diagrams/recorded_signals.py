"""The signals that a run records: those that the parameter `record` of its recorders selects."""

from dataclasses import replace
from typing import Any

from graph import Schedule
from runtime.base.errors import BadInput
from runtime.recording.signal_selection import select


def select_recorded(schedule: Schedule) -> Schedule:
    """Return a Schedule without the columns that no sink takes. Raises BadInput for a name without a signal.

    A recorder with the parameter `record` takes the columns that it selects. Sinks without connections take what the
    recorders take.
    """
    numbers = sum(place.size for place in schedule.signals.values())
    selected = {sink.block: selection(sink) for sink in schedule.sinks if getattr(sink.block, "record", "")}
    if not selected:
        return schedule
    taken = set().union(*selected.values())
    sinks: list[tuple[Any, list[Any]]] = []
    for sink in schedule.sinks:
        own = selected.get(sink.block, taken if len(sink.columns) == numbers else None)
        sinks.append((sink, [column for column in sink.columns if own is None or column.index in own]))
    kept = sorted({column.index for _, columns in sinks for column in columns})
    index = {old: new for new, old in enumerate(kept)}
    return replace(
        schedule,
        columns=schedule.columns[kept],
        recorded=[replace(schedule.recorded[old], index=index[old]) for old in kept],
        sinks=[
            replace(sink, columns=tuple(replace(column, index=index[column.index]) for column in columns))
            for sink, columns in sinks
        ],
    )


def selection(sink: Any) -> set[int]:
    """Return the indices in the row of the columns that a recorder selects."""
    try:
        places = select([vars(column) for column in sink.columns], sink.block.record)
    except BadInput as error:
        raise BadInput(f"{sink.block.path}: record: {error}") from None
    return {sink.columns[place].index for place in places}

"""Trial of a run that wrote no file: its signals, description and end."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec.structs import asdict

from graph.store import to_json
from runtime.host.errors import BadInput
from runtime.record.analysis.trial import Trial
from runtime.record.recorder.report import ending
from runtime.session.recording_plan import limits, states

if TYPE_CHECKING:
    from runtime.session.result import Result

MEMORY_SHARE = 0.5  # of this machine's, that the rows of one run may take


def trial_of(result: Result, rows: np.ndarray, events: list[dict[str, Any]], keep: bool) -> Trial:
    """Return the Trial of a run.

    rows : array (ticks, 2 + recorded signals): tick, lateness in s, and every signal
    events : changes of live parameters, in order
    keep : describe the diagram now, because its parameters may change after the run
    """
    robot = result.diagram
    description = to_json(robot) if keep else None
    return Trial.in_memory(
        about(result), end(result, len(rows), events), lambda: json.loads(description or to_json(robot)), rows
    )


def table(ticks: int, width: int) -> np.ndarray:
    """Return an uninitialized array (ticks, width) of doubles. Raises BadInput as `check_memory` does."""
    check_memory(ticks, width)
    return np.empty((ticks, width))


def check_memory(ticks: int, width: int) -> None:
    """Raise BadInput if rows of `width` doubles take more than MEMORY_SHARE of this machine's memory."""
    need, memory = 8 * ticks * width, os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if need > MEMORY_SHARE * memory:
        raise BadInput(
            f"{ticks} ticks of {width - 2} signals need {need / 2**30:.1f} GiB of memory, and this machine has "
            f"{memory / 2**30:.1f} GiB: run for a shorter time, or record fewer signals in the diagram"
        )


def about(result: Result) -> dict[str, Any]:
    """Return the description of a run: the keys that a recording has, without those of the machine."""
    request, schedule = result.request, result.schedule
    columns = [*schedule.recorded, *(result.simulation.recorded if result.simulation is not None else ())]
    return {
        "name": schedule.name,
        "rate": schedule.rate,
        "virtual": True,
        "simulated": result.plant is not None,
        "buses": schedule.buses,
        "part": 1,
        "limits": {path: list(ends) for path, ends in limits(result.diagram, schedule).items()},
        "states": states(result.diagram),
        "metadata": {
            "diagram_file": str(request.file),
            "source_sha256": result.source_sha256,
            "settings": dict(request.settings),
            "seed": request.seed,
            "trial": {},
            "rig": None,
        },
        "signals": [{**asdict(column), "circle": list(column.circle)} for column in columns],
    }


def end(result: Result, ticks: int, events: list[dict[str, Any]]) -> dict[str, Any]:
    """Return how the run ended: the keys of a recording's end.json. ticks : number of rows"""
    event = result.end_event()
    return {
        "ended": ending(event, False),
        "end": event,
        "ticks": ticks,
        "first_tick": 0 if ticks else None,
        "last_tick": ticks - 1 if ticks else None,
        "events": events,
        "problems": [],
    }

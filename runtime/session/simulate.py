"""A run in virtual time inside this process: no files, no other process, no output."""

from __future__ import annotations

import json
import math
import os
import signal
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph.schedule import Column
from graph.store import to_json
from runtime.analysis.trial import Trial
from runtime.base.errors import BadInput
from runtime.diagrams.file import build, compiled, source
from runtime.diagrams.overrides import restore, set_seeds
from runtime.diagrams.simulation import Simulation
from runtime.recorder.report import ending
from runtime.report.fault import explain
from runtime.session.prepare import ticks_of
from runtime.session.recording_plan import limits
from runtime.session.request import Request
from runtime.session.result import Result

if TYPE_CHECKING:
    from graph import Diagram, Schedule
    from runtime.diagrams.diagram_file import DiagramFile
    from runtime.diagrams.overrides import Replaced

MEMORY_SHARE = 0.5  # of this machine's, that the rows of one run may take


def simulate(
    diagram: str | os.PathLike[str] | Diagram | Callable[..., Diagram],
    duration: float,
    *,
    settings: Mapping[str, Any] | Iterable[tuple[str, Any]] = (),
    plant: Diagram | Callable[..., Diagram] | None = None,
    seed: int | None = None,
    rate: float | None = None,
) -> Trial:
    """Run a diagram in virtual time. Arguments, result and errors: see runtime.run."""
    for name, value in (("duration", duration), ("rate", rate)):
        if value is not None and not 0.0 < value < math.inf:
            raise BadInput(f"{name}={value!r}: expected a finite number above 0")
    given: Any = settings
    pairs: list[tuple[str, Any]] = list(given.items() if hasattr(given, "items") else given)
    file = source(diagram, plant)
    replaced: list[Replaced] = []
    own_rate = file.given.rate if file.given is not None else 0.0
    try:
        robot = build(file, pairs, before=replaced)
        if rate is not None:
            robot.rate = rate
        return run(file, robot, Request(file.path, duration=duration, fast=True, settings=pairs, seed=seed), replaced)
    finally:
        if file.given is not None:  # a Diagram of the caller, for more runs
            file.given.rate = own_rate
            restore(replaced)


def run(file: DiagramFile, robot: Diagram, request: Request, replaced: list[Replaced]) -> Trial:
    """Compile a diagram, run it, and return its Trial.

    replaced : list that receives the parameters that were set
    """
    if request.seed is not None:
        replaced += set_seeds(robot, request.seed)
    ticks = ticks_of(request, robot)
    schedule = compiled(file.path, robot)
    if not schedule.sinks:
        schedule = replace(schedule, **everything(schedule))
    simulation = Simulation(file, robot, schedule, seed=request.seed)
    replaced += simulation.replaced
    rows = table(ticks, 2 + len(schedule.columns))
    control = Program(schedule, simulation.ends())
    executor = Executor(
        control,
        schedule.rate,
        plant=simulation.program,
        substeps=simulation.substeps,
        virtual=True,
        rows=rows,
        hosted=True,
    )
    outcome = executor.run(ticks)
    if outcome.signal:  # Ctrl-C and others have their usual effect now
        signal.raise_signal(outcome.signal)
    result = Result(
        request,
        robot,
        schedule,
        simulation,
        None,
        ticks,
        source_sha256=file.sha256,
        outcome=outcome,
        statistics={"missed": 0},  # frames are not counted
        recording={},
        seconds=None,
        control=control,
        realtime=None,
        overruns=executor.overruns,
        profile=executor.profile,
        page=None,
        newest=executor.newest,
    )
    if outcome.faulted:
        result.report += explain(result)
    description = to_json(robot) if file.given is not None else None
    return Trial.in_memory(
        about(result),
        end(result, executor.rows),
        lambda: json.loads(description or to_json(robot)),
        rows[: executor.rows],
    )


def table(ticks: int, width: int) -> np.ndarray:
    """Return an uninitialized array (ticks, width) of doubles.

    Raises BadInput if it takes more than MEMORY_SHARE of this machine's memory.
    """
    need, memory = 8 * ticks * width, os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if need > MEMORY_SHARE * memory:
        raise BadInput(
            f"{ticks} ticks of {width - 2} signals need {need / 2**30:.1f} GiB of memory, and this machine has "
            f"{memory / 2**30:.1f} GiB: run for a shorter time, or let the diagram's recorder take fewer signals"
        )
    return np.empty((ticks, width))


def everything(schedule: Schedule) -> dict[str, Any]:
    """Return every signal of a schedule as recorded numbers: its fields `columns` and `recorded`."""
    slots, recorded = [], []
    for place in sorted(schedule.signals.values(), key=lambda place: place.path):
        for offset, index in enumerate(np.ndindex(place.shape)):
            path = place.path + "".join(f"[{number}]" for number in index)
            recorded.append(Column(len(slots), path, place.dtype, place.unit, place.circle))
            slots.append(place.slot + offset)
    return {"columns": np.array(slots, dtype=np.int32), "recorded": recorded}


def about(result: Result) -> dict[str, Any]:
    """Return the description of a run: the keys that a recording has, without those of the machine."""
    request, schedule = result.request, result.schedule
    return {
        "name": schedule.name,
        "rate": schedule.rate,
        "virtual": True,
        "simulated": result.plant is not None,
        "buses": schedule.buses,
        "part": 1,
        "limits": {path: list(ends) for path, ends in limits(result.diagram, schedule).items()},
        "metadata": {
            "diagram_file": str(request.file),
            "source_sha256": result.source_sha256,
            "settings": dict(request.settings),
            "seed": request.seed,
            "trial": {},
            "rig": None,
        },
        "signals": [{**vars(column), "circle": list(column.circle)} for column in schedule.recorded],
    }


def end(result: Result, ticks: int) -> dict[str, Any]:
    """Return how the run ended: the keys of a recording's end.json. ticks : number of rows"""
    event = result.end_event()
    return {
        "ended": ending(event, False),
        "end": event,
        "ticks": ticks,
        "first_tick": 0 if ticks else None,
        "last_tick": ticks - 1 if ticks else None,
        "events": [],
        "problems": [],
    }

"""Optimisation on a simulated wearer in virtual time: the protocol of an experiment, thousands of times faster."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.experiments.optimisation.costs import SignalCost
from runtime.experiments.optimisation.live_robot import Targets
from runtime.experiments.optimisation.metabolic import Estimate
from runtime.experiments.optimisation.optimisers import restore_optimiser
from runtime.experiments.optimisation.planner import expectation
from runtime.experiments.optimisation.protocol import Protocol, Robot, Settings
from runtime.experiments.optimisation.recorder import SUFFIX
from runtime.experiments.optimisation.state_file import StateFile
from runtime.host.console.terminal import print_to_stderr
from runtime.host.ending import Interrupted
from runtime.host.errors import BadInput, RunFault
from runtime.host.live.table import describe, parse
from runtime.session.recording_plan import stem
from runtime.session.simulate import SimulatedRun

if TYPE_CHECKING:
    from graph.schedule import Column, Schedule
    from runtime.session.request import Request

STEP = 0.5  # s between two looks of the protocol


class SimulatedRobot(Robot):
    """Robot and wearer of a SimulatedRun."""

    running = True

    def __init__(self, run: SimulatedRun, targets: Targets) -> None:
        self.run, self.targets = run, targets
        self.applied: dict[str, float] = {}  # {path: value}

    @property
    def tick(self) -> int:
        """Newest tick."""
        return self.run.tick - 1

    def apply(self, values: Mapping[str, float], zero: bool) -> bool:
        changes, complete = self.targets.changes(values, zero, lambda live: self.run[live.path])
        self.run.set({live.path: live.plain(value) for live, value in changes if self.run[live.path] != value})
        self.applied = {live.path: value for live, value in changes}
        return complete

    def has_arrived(self) -> bool:
        return all(self.run[path] == value for path, value in self.applied.items())

    def value_text(self, name: str, value: float) -> str:
        return self.targets.value_text(name, value)


def optimise(
    request: Request,
    plan_of: Callable[[Schedule, Sequence[Column]], dict[str, Any]],
    resume: os.PathLike[str] | None,
    plant_signals: Iterable[str] = (),
) -> str:
    """Optimise parameters of a diagram on its simulated wearer.

    request : options of the run
    plan_of : function that returns the plan of runtime.experiments.optimisation.process for a schedule and its recorded
        signals
    resume : state file that is continued; None for a new one
    plant_signals : signals of the plant that the cost needs, without "plant/"

    Returns the path of the state file. Raises BadInput.
    """
    with SimulatedRun(
        request.file,
        settings=request.settings,
        seed=request.seed,
        rate=request.rate,
        subject=request.subject,
        plant_signals=plant_signals,
        keep_rows=False,
    ) as run:
        plan = plan_of(run.schedule, run.columns)
        if plan["cost"]["kind"] != "signal":
            raise BadInput("--fast needs --cost signal:NAME: a cart and an operator are not in virtual time")
        folder = Path(request.record or "recordings")
        path = os.fspath(resume if resume is not None else folder / f"{stem(request)}{SUFFIX}")
        if resume is None:
            folder.mkdir(parents=True, exist_ok=True)
        protocol, columns = protocol_of(run, plan, path), plan["cost"]["columns"]
        cost, ticks = protocol.cost, max(1, round(STEP * run.rate))
        assert isinstance(cost, SignalCost)
        protocol.save()
        try:
            while not protocol.step(run.time):
                run.step(ticks / run.rate)
                first = run.tick - ticks
                for place, values in enumerate(run.newest(columns, ticks).tolist()):
                    cost.add((first + place) / run.rate, *values)
        except RunFault as error:
            raise BadInput(f"the simulation ended with a fault: {error}. {path} has the evaluations so far") from None
        except Interrupted:
            print_to_stderr([f"tickwork: the evaluations so far are stored: --resume {path} continues"])
            raise
    if not protocol.finished:
        raise BadInput(f"the optimisation has no result: see the last lines. {path} has the evaluations so far")
    return path


def protocol_of(run: SimulatedRun, plan: dict[str, Any], path: str) -> Protocol:
    """Return the Protocol of a plan. path : path of the state file"""
    state, cost = plan["state"], plan["cost"]
    optimiser = restore_optimiser(state["optimiser"])
    robot = SimulatedRobot(run, Targets(parse(describe(run.schedule)[1]), optimiser.parameters, plan["zero"]))
    file = StateFile(path, state)
    protocol = Protocol(
        optimiser,
        robot,
        SignalCost(cost["name"], cost["unit"], cost["time_constant"], len(cost["columns"]) > 1),
        Settings.of(plan, optimiser.population),
        lambda step, lines, **fields: print_to_stderr(lines),
        lambda: file.save(protocol),
        state["accepted"],
        [(name, Estimate(*numbers)) for name, numbers in state["validated"]],
        expectation(plan),
    )
    return protocol

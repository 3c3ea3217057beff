"""A run in virtual time inside this process, whole or in steps: no files, no other process, no output."""

from __future__ import annotations

import math
import numbers
import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec.structs import replace

from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph.solvers import INACCURATE
from runtime.host.arguments import check_arguments, is_number
from runtime.host.errors import BadInput, RunFault, UnknownName
from runtime.host.interrupts import interruptible, show_as_line
from runtime.host.live.requests import as_text, changes_of
from runtime.host.live.table import describe, parse
from runtime.host.options import pairs_of
from runtime.host.suggestions import suggestion
from runtime.record.analysis.trial import Trial
from runtime.record.report.fault import explain
from runtime.robot.loading.file import build, compile_diagram, source
from runtime.robot.loading.overrides import restore, set_seeds
from runtime.robot.loading.recorded_signals import PLANT, everything
from runtime.robot.loading.simulation import Simulation
from runtime.session.memory_trial import check_memory, table, trial_of
from runtime.session.prepare import Prepared, read_subject, ticks_of
from runtime.session.request import Request
from runtime.session.result import Result

if TYPE_CHECKING:
    from typing_extensions import Self

    from graph import Diagram, Schedule
    from graph.schedule import Column, SignalPlace
    from runtime.robot.loading.overrides import Replaced

ROWS = 4096  # of a simulation without a duration, after which more memory is taken
ENDED = "the simulation has ended: make another one with runtime.simulate"
TYPES = {"float": float, "int": int, "bool": bool}


def simulate(
    diagram: str | os.PathLike[str] | Diagram | Callable[..., Diagram], duration: float, **options: Any
) -> Trial:
    """Run a diagram in virtual time. Arguments, result and errors: see runtime.run."""
    check_above_zero("duration", duration)
    with SimulatedRun(diagram, duration=duration, **options) as run:
        if run.fault is None:
            run.advance(run.ticks)
    return run.trial


def value_of(place: SignalPlace, arena: np.ndarray) -> Any:
    """Return the present value of a signal: a number, or an array for a vector. arena : arena of its program"""
    values = arena[place.slot : place.slot + place.size]
    if place.shape == ():
        return TYPES[place.dtype](values[0])
    return values.reshape(place.shape).astype(TYPES[place.dtype])


def check_above_zero(name: str, value: Any) -> None:
    """Raise BadInput unless an argument is a finite number above 0. name : name of the argument"""
    if value is None or not is_number(value) or not value > 0.0:
        raise BadInput(f"{name}={value!r}: expected a finite number above 0")


class SimulatedRun:
    """Run in virtual time inside this process, which `step` advances.

    Arguments as in runtime.simulate. `duration` is that of the whole run in s, None if it is unknown. Without
    `keep_rows` the trial has the signals of at least the last tick and at most ROWS ticks, for a run of many hours.

    tick : number of ticks done
    fault : fault that has ended the run, as in Trial.fault; None without one
    """

    def __init__(
        self,
        diagram: str | os.PathLike[str] | Diagram | Callable[..., Diagram],
        *,
        settings: Mapping[str, Any] | Iterable[tuple[str, Any]] = (),
        plant: Diagram | Callable[..., Diagram] | None = None,
        seed: int | None = None,
        rate: float | None = None,
        plant_signals: str | Iterable[str] = (),
        duration: float | None = None,
        keep_rows: bool = True,
        subject: str | os.PathLike[str] | None = None,
    ) -> None:
        if rate is not None:
            check_above_zero("rate", rate)
        if seed is not None and not isinstance(seed, numbers.Integral):
            raise BadInput(f"seed={seed!r}: expected a whole number")
        pairs = pairs_of(settings)
        self._file = source(diagram, plant)
        self._own_rate = self._file.given.rate if self._file.given is not None else 0.0
        self._replaced: list[Replaced] = []
        self._lock, self._keep_rows, self._trial = threading.Lock(), keep_rows, None
        self._taker: int | None = None  # thread that is about to take the lock
        self._full: list[np.ndarray] = []  # copies of `_rows`, each filled once
        self._events: list[dict[str, Any]] = []
        self._subject_undo = ExitStack()
        person = None if subject is None else Path(subject)
        request = Request(self._file.path, subject=person, duration=duration, fast=True, settings=pairs, seed=seed)
        named = plant_signals if isinstance(plant_signals, str) else ",".join(plant_signals)
        try:
            self._prepared, self._simulation = prepared, simulation = self._prepare(request, rate, named)
            for warning in prepared.warnings:
                if warning.code == INACCURATE:
                    warnings.warn(str(warning), stacklevel=3)
            self._robot, self._schedule, self.ticks = prepared.diagram, prepared.schedule, prepared.ticks
            width = 2 + len(self._schedule.columns) + len(simulation.recorded)
            self._rows = table(self.ticks if self.ticks > 0 else ROWS, width)
            self._control = Program(self._schedule, simulation.ends())
            self._executor = Executor(
                self._control,
                self._schedule.rate,
                plant=simulation.program,
                substeps=simulation.substeps,
                virtual=True,
                rows=self._rows,
                hosted=True,
                **prepared.ramp,
            )
            self.advance(0)  # arms
        except BaseException:
            self._restore()
            raise

    def _prepare(self, request, rate, plant_signals):
        """Build and compile robot and plant. Returns (Prepared, Simulation)."""
        subject = read_subject(request)
        robot = build(self._file, request.settings, None, self._replaced, subject, self._subject_undo)
        if rate is not None:
            robot.rate = rate
        if request.seed is not None:
            self._replaced += set_seeds(robot, request.seed)
        ticks = ticks_of(request, robot, subject)
        schedule = compile_diagram(self._file.path, robot)
        schedule = schedule if schedule.sinks else replace(schedule, **everything(schedule))
        simulation = Simulation(self._file, robot, schedule, seed=request.seed, plant_signals=plant_signals)
        self._replaced += simulation.replaced
        prepared = Prepared(
            request, robot, schedule, simulation, None, ticks, source_sha256=self._file.sha256, subject=subject
        )
        return prepared, simulation

    @interruptible
    def step(self, seconds: float | None = None) -> None:
        """Advance the run.

        seconds : whole number of ticks, in s; by default one tick

        Raises RunFault at a fault, which ends the run, and BadInput after the end. A signal, such as Ctrl-C, is
        handled between two ticks.
        """
        count = 1.0 if seconds is None else seconds * self.rate if is_number(seconds) else math.nan
        if not (0.5 < count < math.inf and abs(count - round(count)) < 1e-6 * count):
            raise BadInput(
                f"step({seconds!r}): expected a whole number of ticks, which take {1.0 / self.rate:g} s each"
            )
        if self._trial is None:
            self.advance(round(count))
        elif self.fault is None:
            raise BadInput(ENDED)
        if self.fault is not None:
            raise RunFault(self.fault)

    @interruptible
    def advance(self, ticks: int) -> None:
        """Advance the run by a number of ticks. A fault ends it."""
        with self._alone():
            self._taker = None
            last, going = self._done + ticks, True
            last = min(last, self._prepared.ramp.get("ends_at", last))
            while going:
                room = (1 + len(self._full)) * len(self._rows) - self._done
                if room == 0 and self._done < last:
                    if self._keep_rows:
                        check_memory(self._done + ROWS, self._rows.shape[1])
                    self._full.append(self._rows[: len(self._rows) * self._keep_rows].copy())
                    continue
                going = self._executor.advance(min(last - self._done, room))
                if going and self._done == last:
                    return
                if not going and (number := self._executor.signal):
                    signal.raise_signal(number)  # has its usual effect now
                    going = not self._executor.failed
        self.close()

    def _alone(self):
        """Return the lock of the simulation for `with`, whose block first clears `_taker`.

        From Python 3.14 on, Ctrl-C can come when `with` has taken the lock and before it would release it.
        """
        if self._lock.locked():
            if self._taker != threading.get_ident():
                raise RuntimeError(
                    "the simulation is being advanced already, by another thread or by one of its blocks"
                )
            self._lock.release()
        self._taker = threading.get_ident()
        return self._lock

    def __getitem__(self, path: str) -> Any:
        """Return the present value of a signal or parameter: a number, or an array for a vector.

        path : such as "left/knee.torque", "plant/walker.left_knee_angle" or "left/profile.scale"

        Raises KeyError with a suggestion for an unknown name.
        """
        if not isinstance(path, str):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise UnknownName(
                f"{path!r} is not the name of a signal or parameter", "pass text, as in sim['knee.torque']"
            )
        if path in self._schedule.signals:
            return value_of(self._schedule.signals[path], self._control.values)
        plant, program = self._simulation.plant, self._simulation.program
        of_plant = {} if plant is None else {f"{PLANT}{name}": place for name, place in plant.signals.items()}
        if path in of_plant and program is not None:
            return value_of(of_plant[path], program.values)
        for live in self._schedule.live:
            if live.path == path:
                value = self._control.values[live.slot] if live.slot >= 0 else getattr(live.block, live.name)
                return TYPES[live.dtype](value)
        block, _, name = path.rpartition(".")
        if block in self._robot.blocks and name in self._robot[block].parameters:
            return getattr(self._robot[block], name)
        parameters = [f"{block.path}.{name}" for block in self._robot for name in block.parameters]
        hint = suggestion(path, [*self._schedule.signals, *of_plant, *parameters])
        raise UnknownName(f"{self._schedule.name} has no signal or parameter {path!r}", hint)

    def newest(self, columns: Sequence[int], ticks: int) -> np.ndarray:
        """Return recorded signals of the newest ticks, an array (ticks, columns).

        columns : indices of `columns`
        ticks : number of ticks that were done, at most ROWS
        """
        rows = np.arange(self._done - ticks, self._done) % len(self._rows)
        return self._rows[rows][:, [2 + column for column in columns]]

    @property
    def columns(self) -> list[Column]:
        """Recorded signals of robot and plant."""
        return [*self._schedule.recorded, *self._simulation.recorded]

    @property
    def schedule(self) -> Schedule:
        """Schedule of the robot."""
        return self._schedule

    def __setitem__(self, name: str, value: Any) -> None:
        """Change a live parameter from the next tick on, as `set` does: within its bounds, at its slew.

        name : name of the parameter, or a pattern such as "*/profile.scale"
        value : number, bool, or text with a unit

        Raises BadInput.
        """
        self.set({name: value} if isinstance(name, str) else name)  # pyright: ignore[reportUnnecessaryIsInstance]

    def set(self, changes: Mapping[str, Any]) -> None:
        """Change live parameters from the next tick on, together, such as two with a rule between them.

        changes : {name: value}, as in item assignment

        Raises BadInput, and then none was changed.
        """
        if self._trial is not None:
            raise BadInput(ENDED)
        check_arguments("set", {"changes": changes})
        found = [
            change
            for name, value in changes.items()
            for change in changes_of(self._live_parameters, name, as_text(value))
        ]
        try:
            values_before = self._control.live.assign([(parameter.index, number) for parameter, number in found])
        except ValueError as error:
            raise BadInput(f"{error}; nothing was changed") from None
        for (parameter, number), before in zip(found, values_before):
            event = {"event": "set", "path": parameter.path, "value": parameter.plain(number)}
            event |= {"from": parameter.plain(before), "tick": self._done, "by": "step"}
            self._events.append(event | ({"slew": parameter.slew} if math.isfinite(parameter.slew) else {}))

    def mark(self) -> None:
        """Set a mark in the trial."""
        if self._trial is not None:
            raise BadInput(ENDED)
        number = 1 + sum(event["event"] == "mark" for event in self._events)
        self._events.append({"event": "mark", "number": number, "tick": self._done, "by": "step"})

    def __iter__(self) -> Iterator[int]:
        """Yield each tick after it is done. Leaving the loop ends the run. Raises RunFault."""
        try:
            while self._trial is None and (self.ticks < 0 or self._done < self.ticks):
                self.step()
                yield self._done - 1
        finally:
            self.close()

    @cached_property
    def _live_parameters(self):
        return parse(describe(self._schedule)[1])

    @property
    def _done(self) -> int:
        return self._executor.rows

    @property
    def tick(self) -> int:
        """Number of ticks done."""
        return self._done

    @property
    def rate(self) -> float:
        """Rate of the run in Hz."""
        return self._schedule.rate

    @property
    def time(self) -> float:
        """Time of the next tick in s."""
        return self._done / self.rate

    @property
    def state(self) -> str:
        """State of the run: "running", or "safe" after its end."""
        return "running" if self._trial is None else "safe"

    @property
    def fault(self) -> dict[str, Any] | None:
        """Fault that has ended the run, as in Trial.fault; None without one."""
        return None if self._trial is None else self._trial.fault

    @property
    def trial(self) -> Trial:
        """The Trial of the run. Raises BadInput before `close`."""
        if self._trial is None:
            raise BadInput("the simulation has not ended: leave its `with` block, or call close(), then use its trial")
        return self._trial

    def close(self) -> None:
        """Perform the safe stop and end the run. A second call has no effect."""
        if self._trial is not None:
            return
        with self._alone():
            self._taker = None
            try:
                self._trial = self._finish()
            finally:
                self._restore()

    def _finish(self) -> Trial:
        executor = self._executor
        outcome = executor.finish()
        result = Result(
            **vars(self._prepared),
            outcome=outcome,
            statistics={"missed": 0},  # frames are not counted
            recording={},
            seconds=None,
            control=self._control,
            realtime=None,
            overruns=executor.overruns,
            profile=executor.profile,
            shared=None,
            newest=executor.newest,
        )
        if outcome.faulted:
            result.report += explain(result)
        rest = self._rows[: self._done - len(self._full) * len(self._rows)]
        rows = np.concatenate([*self._full, rest]) if self._full else rest
        self._full = []
        return trial_of(result, rows, self._events, keep=self._file.given is not None)

    def _restore(self):
        """Restore a Diagram of the caller, for more runs."""
        if self._file.given is not None:
            self._file.given.rate = self._own_rate
            self._subject_undo.close()
            restore(self._replaced)
        self._replaced = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self.close()
        if isinstance(error, KeyboardInterrupt):
            show_as_line(error)

    def __repr__(self) -> str:
        fault = "" if self.fault is None else f", fault: {self.fault['status']}"
        state = "running" if self._trial is None else f"ended{fault}"
        return f"<SimulatedRun {self._schedule.name}: {self._done} ticks at {self.rate:g} Hz, {state}>"


class SimulatedLoop(SimulatedRun):
    """Run in virtual time whose ticks a program follows, as those of a ConnectedRobot.

    missed : number of ticks that the loop did not see, always 0
    """

    missed = 0

    @property
    def tick(self) -> int:
        """Newest tick, -1 before the first."""
        return self._done - 1

    @property
    def time(self) -> float:
        """Time of the newest tick in s."""
        return self.tick / self.rate

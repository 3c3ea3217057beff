"""Runs a schedule on a rig or in simulation: life cycle, buses, recorder, command line."""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # not from typing: a typing.py in the working folder could still hide it here
if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from typing import Any, overload

    from typing_extensions import Unpack

    from graph import Diagram
    from runtime.experiments.optimisation.result import OptimisationResult
    from runtime.experiments.studies.result import StudyResult
    from runtime.record.analysis.trial import Trial
    from runtime.record.analysis.trials import Trials
    from runtime.session.check.text import Report
    from runtime.session.connected import ConnectedRobot
    from runtime.session.linearise import Trim
    from runtime.session.request import RunOptions
    from runtime.session.simulate import SimulatedLoop, SimulatedRun
else:

    def overload(function):
        return function


class _CheckedImports:
    """Raises an ImportError that names a damaged bytecode cache at which an import within it fails."""

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, (EOFError, ValueError, TypeError, ImportError)):
            sys.pycache_prefix, prefix = os.devnull, sys.pycache_prefix  # the next import ignores all caches
            from runtime.host.installation_check import DAMAGED, damaged_cache

            sys.pycache_prefix = prefix
            damaged = damaged_cache(error)
            if damaged is not None:
                raise ImportError(damaged, name=DAMAGED) from None


with _CheckedImports():
    from runtime.host.interrupts import interruptible

__all__ = ["check", "connect", "linearise", "load", "optimise", "run", "simulate", "study", "trim"]


def __dir__() -> list[str]:
    return __all__


if not TYPE_CHECKING:

    def __getattr__(name):
        """Raise AttributeError for a function that there is not, with the one that does what its name says."""
        other = {
            "plot": "a recording plots itself, as in runtime.load('trials').plot('knee.torque')",
            "start": "runtime.connect starts a robot for a loop of your own, runtime.run runs it to its end",
        }.get(name, f"its functions are {', '.join(__all__)}")
        raise AttributeError(f"runtime has no {name!r}: {other}", name=name)


@overload
def load(path: str | os.PathLike[str]) -> Trial | Any: ...  # Any: the Trials of a pattern


@overload
def load(path: Iterable[str | os.PathLike[str]]) -> Trials: ...  # noqa: F811


@interruptible
def load(path: str | os.PathLike[str] | Iterable[str | os.PathLike[str]]) -> Trial | Trials:  # noqa: F811
    """Load a recording, or several as one table. Needs NumPy and mcap, and no compiled module.

        trial = load("trial.mcap")              # a runtime.record.analysis.trial.Trial
        trial["left/knee.position"]             # array over the ticks
        newest = load("trials")                 # the newest recording of a folder
        trials = load("trials/*.mcap")          # a runtime.record.analysis.trials.Trials, one recording after the other

    path : path of a file or folder, a pattern, or a list of paths. A type checker cannot distinguish a pattern from
        the path of one file: pass `glob.glob(pattern)` for a return type of Trials

    Raises BadInput if there is no such recording.
    """
    with _CheckedImports():
        from runtime.record.analysis.trials import load

    return load(path)


@interruptible
def run(
    diagram: str | os.PathLike[str] | Diagram | Callable[..., Diagram],
    duration: float | None = None,
    *,
    settings: Mapping[str, Any] | Iterable[tuple[str, Any]] = (),
    plant: Diagram | Callable[..., Diagram] | None = None,
    seed: int | None = None,
    rate: float | None = None,
    plant_signals: str | Iterable[str] = (),
    fast: bool = True,
    rig: str | os.PathLike[str] | None = None,
    subject: str | os.PathLike[str] | None = None,
    **options: Unpack[RunOptions],
) -> Trial:
    """Run a diagram, and return its runtime.record.analysis.trial.Trial.

        trial = runtime.run("diagrams/knee_exo.py", duration=60, settings={"left/profile.scale": 0.5})
        trial["left/knee.position"]         # array over the ticks, rad
        runtime.run("diagrams/knee_exo.py", 60, fast=False)             # in real time
        runtime.run("diagrams/knee_exo.py", 60, rig="lab.toml", trial={"subject": "S03"})

    In virtual time, the default, the run takes place in this process. It writes no file, starts no process and prints
    nothing. Its signals equal those of `python -m runtime FILE --fast` bit for bit. The Trial has the signals that
    the diagram's recorders and viewers take, or all signals if it has neither, and no frames of the buses.

    In real time and on a rig, the run is the command `python -m runtime FILE` in a process of its own, with its
    guardian, recorder and safe stop. Its output is printed, and the Trial is that of its recording. A rig is armed
    after the answer to input(), or at once with yes=True. Ctrl-C, the interrupt of a notebook, and the end of this
    process stop the robot.

    diagram : path of a diagram file; in virtual time also a Diagram, which may be run again and keeps its parameters,
        or a function that builds one
    duration : duration in s; in real time None runs until Ctrl-C
    settings : {"left/impedance.stiffness": 40, "assistance": "0.5"} or pairs, as with --set: parameters of blocks and
        of the functions `build` and `plant`
    plant : Diagram, or function plant(robot) that builds one, for virtual time; by default the file's own. Without
        either every device is emulated and each actuator turns a free inertia
    seed : integer from which the seeds of all noise sources of robot and plant are derived; None: their own seeds
    rate : Hz instead of the diagram's own
    plant_signals : signals of the plant that the Trial has in virtual time, besides those of the robot, at the end of
        each tick: "walker.left_knee_torque" is trial["plant/walker.left_knee_torque"]. A string of names separated by
        commas, or several; * stands for any text, and a block for all its signals
    fast : virtual time; False runs the simulation in real time
    rig : path of a rig file, whose run is in real time
    subject : path of a subject file, whose limits no setting and no change exceeds
    options : further options of the command in real time, by their names: yes=True, record="trials",
        trial={"subject": "S03"}, overrun="fault:5". stop_for=S is the time in s for which a safe stop on a rig
        continues, at a falling rate, for drives that do not confirm it, by default 10 s

    A run that ends in a fault returns the Trial up to there, and `trial.fault` describes the fault. Raises BadInput or
    DiagramError for errors before the run.

    Ctrl-C ends the run in the main thread and raises KeyboardInterrupt, whose text is the place of the recording. A
    program that does not catch it ends with that in one line instead of a traceback, and with the exit code 130 of a
    shell. This holds for every function of this module, and within `with` of `simulate` and `connect`. In another
    thread, the run continues to its end, however often Ctrl-C is pressed: give it a duration. One in real time is
    stopped from another shell by `python -m runtime set PID --stop`, and by the end of this process.
    """
    _check("run", locals())
    with _CheckedImports():
        from runtime.host.errors import BadInput

    if fast and rig is None:
        with _CheckedImports():
            from runtime.session.simulate import simulate

        _refuse(options)
        if duration is None:
            raise BadInput("a run in virtual time needs a duration in s, as in runtime.run(diagram, 10)")
        named: dict[str, Any] = {"plant": plant, "seed": seed, "rate": rate, "subject": subject}
        return simulate(diagram, duration, settings=settings, plant_signals=plant_signals, **named)
    if plant_signals:
        raise BadInput("plant_signals: only a run in virtual time records signals of the plant")
    with _CheckedImports():
        from runtime.session.own_process import process_of

    given = {
        "rig": rig,
        "duration": duration,
        "plant": plant,
        "seed": seed,
        "rate": rate,
        "subject": subject,
        **options,
    }
    return process_of(diagram, settings, **given).wait()


@interruptible
def simulate(
    diagram: str | os.PathLike[str] | Diagram | Callable[..., Diagram],
    *,
    settings: Mapping[str, Any] | Iterable[tuple[str, Any]] = (),
    plant: Diagram | Callable[..., Diagram] | None = None,
    seed: int | None = None,
    rate: float | None = None,
    plant_signals: str | Iterable[str] = (),
    subject: str | os.PathLike[str] | None = None,
) -> SimulatedRun:
    """Prepare a run in virtual time in this process, which the caller advances step by step.

        with runtime.simulate("diagrams/knee_exo.py") as sim:
            while sim.time < 10.0:
                sim.step(0.005)                                 # s
                if sim["left/knee.torque"] > 5.0:
                    sim["left/profile.scale"] = 0.8             # a live parameter, which ramps
        sim.trial["left/knee.position"]                         # as in runtime.run

    Arguments, recorded signals and errors as in `run`. Any division into steps gives the signals of one `run`, bit for
    bit. Returns a runtime.session.simulate.SimulatedRun.
    """
    _check("simulate", locals())
    with _CheckedImports():
        from runtime.session.simulate import SimulatedRun

    named: dict[str, Any] = {"plant": plant, "seed": seed, "rate": rate, "subject": subject}
    return SimulatedRun(diagram, settings=settings, plant_signals=plant_signals, **named)


@interruptible
def connect(
    diagram: str | os.PathLike[str],
    *,
    rig: str | os.PathLike[str] | None = None,
    duration: float | None = None,
    settings: Mapping[str, Any] | Iterable[tuple[str, Any]] = (),
    seed: int | None = None,
    rate: float | None = None,
    subject: str | os.PathLike[str] | None = None,
    fast: bool = True,
    loop_timeout: float = 0.1,
    **options: Unpack[RunOptions],
) -> ConnectedRobot | SimulatedLoop:
    """Arm a robot for a loop of the caller, which runs between its ticks.

        with runtime.connect("robot.py", rig="lab.toml") as robot:
            for tick in robot:
                angle = robot["left/knee.position"]                 # rad, of this tick
                robot.set({"torque.value": -20.0 * angle})          # a live parameter, from the next tick on
                if angle > 1.2:
                    break                                           # the safe stop
        robot.trial["left/knee.position"]                           # as in runtime.run

    On a rig, and with fast=False in a simulation in real time, the robot is the command `python -m runtime FILE` in a
    process of its own, with guardian, recorder, pre-flight table and safe stop; it is armed when `with` begins. By
    default the same program runs in virtual time. The robot's process holds the rate. The program reads the newest tick
    and sets live parameters, whose bounds the proof covers; `left/knee.disabled` takes a drive out and arms it again. A
    parameter that ramps follows at its slew: declare a torque as `Live(0.0, min=-9.0, max=9.0, slew=math.inf)`.

    The run ends in its safe stop when the loop ends, by `break` or an exception too, with Ctrl-C, and if this process
    dies. A pass of the loop that takes longer than `loop_timeout` is a fault of the run.

    diagram : path of a diagram file
    rig : path of a rig file
    duration : duration in s; None runs until the loop ends
    settings, seed, rate, subject : as in `run`
    fast : virtual time; not on a rig
    loop_timeout : s that one pass of the loop may take in real time
    options : further options of the command in real time, as in `run`: yes=True, record="trials"

    Returns a runtime.session.connected.ConnectedRobot, or in virtual time a runtime.session.simulate.SimulatedLoop with
    the same names. Iteration raises runtime.host.errors.RunFault after a fault. Raises BadInput.
    """
    _check("connect", locals())
    if fast and rig is None:
        _refuse(options)
        with _CheckedImports():
            from runtime.session.simulate import SimulatedLoop

        return SimulatedLoop(diagram, settings=settings, seed=seed, rate=rate, duration=duration, subject=subject)
    with _CheckedImports():
        from runtime.session.connected import ConnectedRobot
        from runtime.session.own_process import process_of

    given = {"rig": rig, "duration": duration, "seed": seed, "rate": rate, "subject": subject, **options}
    return ConnectedRobot(lambda: process_of(diagram, settings, **given), loop_timeout)


@interruptible
def check(
    diagram: str | os.PathLike[str] | Diagram | Callable[..., Diagram],
    *,
    settings: Mapping[str, Any] | Iterable[tuple[str, Any]] = (),
    rate: float | None = None,
    rig: str | os.PathLike[str] | None = None,
    subject: str | os.PathLike[str] | None = None,
) -> Report:
    """Compile a diagram and return the report of `python -m runtime check`, which print() and a notebook show.

        report = runtime.check("diagrams/knee_exo.py", rig="lab.toml")
        report["ok"], report["proofs"]      # the keys of `check --json`

    diagram : path of a diagram file, a Diagram, or a function that builds one
    settings, rate, rig, subject : as in `run`; not for a Diagram

    Returns a runtime.session.check.text.Report, a dict. Raises BadInput if a file cannot be read.
    """
    _check("check", locals())
    with _CheckedImports():
        from graph import Diagram
        from runtime.host.errors import BadInput
        from runtime.host.options import pairs_of
        from runtime.session.check.report import check
        from runtime.session.check.text import Report

    pairs = pairs_of(settings)
    if isinstance(diagram, Diagram) and (pairs or not rate is rig is subject is None):
        raise BadInput(
            "settings, rate, rig and subject would change the Diagram: pass the function or the file that builds it"
        )
    files = (None if path is None else os.fspath(path) for path in (rig, subject))
    return Report(check(diagram, pairs, rate, *files))


@interruptible
def linearise(
    diagram: str | os.PathLike[str] | Diagram | Callable[..., Diagram],
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    at: float | Trim = 0.0,
    settings: Mapping[str, Any] | Iterable[tuple[str, Any]] = (),
) -> Any:
    """Linearise a diagram about a point of its run, and return a control.StateSpace of python-control.

        system = runtime.linearise("swing.py", ["pendulum.torque"], ["pendulum.position"], at=5.0)
        system.poles(), system.units["pendulum.torque"]

    Its period is one tick. The derivatives are central differences over a tick: of every number that a tick of the
    native blocks writes, delays included. Sources keep their values.

    diagram : path of a diagram file, a Diagram, or a function that builds one, without devices: with a plant block
        instead of the drive and its bus
    inputs : inputs of blocks, "pendulum.torque"; the signal that is connected there is cut off
    outputs : signals, "pendulum.position"
    at : time in s of the closed run about which it is linearised, the start by default; or a steady state of `trim`,
        whose inputs stay cut off at their values
    settings : as in `run`

    The system's names have `:` in place of each `.`, and `system.units` has the units by the diagram's names. Raises
    BadInput for a diagram that is not linear there, as at a limit, and MissingExtra without python-control.
    """
    _check("linearise", locals())
    with _CheckedImports():
        from runtime.host.options import pairs_of
        from runtime.session.linearise import linearise

    return linearise(diagram, inputs, outputs, at, pairs_of(settings))


@interruptible
def trim(
    diagram: str | os.PathLike[str] | Diagram | Callable[..., Diagram],
    inputs: Mapping[str, float | None] | None = None,
    outputs: Mapping[str, Any] | None = None,
    *,
    at: float = 0.0,
    settings: Mapping[str, Any] | Iterable[tuple[str, Any]] = (),
) -> Trim:
    """Find a steady state of a diagram, in which no state, input or output changes from tick to tick.

    The states are those of the blocks with these inputs and outputs, and of all before them; without either, of all.

        point = runtime.trim("swing.py", {"shank.torque": None}, {"shank.position": 0.5})
        point.inputs["shank.torque"], point.units["shank.torque"]
        runtime.linearise("swing.py", ["shank.torque"], ["shank.position"], at=point)

    The method is that of Levenberg and Marquardt (MINPACK), from the states of the closed run. It finds one steady
    state, stable or not. Sources keep their values.

    diagram : as of `linearise`
    inputs : {input of a block: its value, or None to find it}; the signal that is connected there is cut off
    outputs : {signal: its value, or None to return it}, with at least as many values as there are inputs to find
    at : time in s of the closed run at which the search begins, by default after the first tick
    settings : as in `run`

    Returns a runtime.session.linearise.Trim. Raises BadInput if no steady state is found, with the state that changes
    most, and MissingExtra without python-control.
    """
    _check("trim", locals())
    with _CheckedImports():
        from runtime.host.options import pairs_of
        from runtime.session.linearise import trim

    return trim(diagram, inputs or {}, outputs or {}, at, pairs_of(settings))


@interruptible
def study(
    diagram: str | os.PathLike[str] | Callable[..., Diagram],
    duration: float,
    objectives: Mapping[str, Any],
    *,
    grid: Mapping[str, Iterable[Any]] | None = None,
    sample: Mapping[str, Mapping[str, Any]] | None = None,
    samples: int = 0,
    sample_seed: int = 0,
    seeds: Iterable[int] = (),
    settings: Mapping[str, Any] | None = None,
    rate: float | None = None,
    subject: str | os.PathLike[str] | None = None,
    output: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    dask: str | None = None,
) -> StudyResult:
    """Run a diagram in virtual time for grids and samples of parameters, and return the objectives of all runs.

        result = runtime.study(
            "diagrams/knee_exo.py",
            duration=30,
            grid={"assistance": [0.0, 0.5, 1.0]},
            objectives={"work": {"function": "positive_work", "leg": "left"}},
            output="assistance.parquet",
        )
        result["work"]                  # J, array over the trials

    diagram : path of a diagram file; with workers=0 also a function that builds a Diagram
    duration : duration of each run, s
    objectives : {name: function of a Trial that returns a number, or {"function": function, argument: value}}. A
        function is the name of one in runtime.experiments.studies.objectives, "module:function", or with workers=0 a
        callable
    grid : {name of a setting: values}, whose combinations are run
    sample : {name of a setting: {"uniform": [low, high]}}; also log_uniform: [low, high], normal: [mean, deviation].
        Every combination of the grid is run with the same samples
    samples : number of samples
    sample_seed : integer from which the samples are drawn
    seeds : every combination is run with each of them, as `seed` of runtime.run
    settings, rate, subject : of every run, as in `run`
    output : path of a Parquet table. A study that was interrupted continues when it is called again, and a finished
        table of the same study is read
    workers : number of processes, by default one for each processor; 0 runs the trials in this process
    dask : address of a Dask scheduler, such as `tcp://10.0.0.5:8786`, whose workers run the trials

    The result is the same, bit for bit, for any number of workers and on a cluster. A run that ends in a fault has no
    values. Returns a runtime.experiments.studies.result.StudyResult. Raises BadInput.
    """
    _check("study", locals())
    with _CheckedImports():
        from pathlib import Path

        from runtime.experiments.studies.description import Study
        from runtime.experiments.studies.run import run

    given = _study(diagram, duration, objectives, grid, sample, samples, sample_seed, seeds, settings, rate, subject)
    return run(Study(**given), None if output is None else Path(output), workers, dask)


@interruptible
def optimise(
    diagram: str | os.PathLike[str] | Callable[..., Diagram],
    duration: float,
    objectives: Mapping[str, Any],
    over: Mapping[str, Iterable[float]],
    *,
    cost: str = "",
    optimiser: str = "cma",
    generations: int = 12,
    population: int = 9,
    seed: int = 0,
    output: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    dask: str | None = None,
    grid: Mapping[str, Iterable[Any]] | None = None,
    sample: Mapping[str, Mapping[str, Any]] | None = None,
    samples: int = 0,
    sample_seed: int = 0,
    seeds: Iterable[int] = (),
    settings: Mapping[str, Any] | None = None,
    rate: float | None = None,
    subject: str | os.PathLike[str] | None = None,
) -> OptimisationResult:
    """Vary parameters of a diagram in virtual time until a cost is low, and return all runs and the best values.

        result = runtime.optimise(
            "diagrams/knee_exo.py",
            duration=20,
            objectives={"cost": "costs:effort"},
            over={"*/profile.scale": [0.0, 1.0], "stride_time": [0.9, 1.3, 1.1]},
        )
        result.optimum                  # {"*/profile.scale": ..., "stride_time": ...}
        result.plot()                   # costs and parameters over the generations

    diagram, duration, objectives : as in `study`
    over : {name of a setting: [low, high] or [low, high, initial]}
    cost : name of the objective to minimise, by default the only one
    optimiser : "cma" (CMA-ES), "bayesian" (of Optuna) or "random"
    generations, population : number of generations, and of proposals in each
    seed : integer from which the random numbers of the optimiser are derived
    output, workers, dask : as in `study`
    grid, sample, samples, sample_seed, seeds : as in `study`. Each proposal is run with all combinations, such as
        wearers, and its cost is the mean
    settings, rate, subject : of every run, as in `run`

    The result is the same, bit for bit, for any number of workers and on a cluster. Returns a
    runtime.experiments.optimisation.result.OptimisationResult. Raises BadInput, and MissingExtra without the
    optimiser's package.
    """
    _check("optimise", locals())
    with _CheckedImports():
        from pathlib import Path

        from runtime.experiments.optimisation.description import Optimisation
        from runtime.experiments.optimisation.simulated import run

    description = Optimisation(
        **_study(diagram, duration, objectives, grid, sample, samples, sample_seed, seeds, settings, rate, subject),
        over=_plain_lists(over),
        cost=cost,
        optimiser=optimiser,
        generations=generations,
        population=population,
        seed=seed,
    )
    return run(description, None if output is None else Path(output), workers, dask)


def _check(function, given):
    """Raise BadInput for an argument of a type that cannot be valid. function : its name; given : by name"""
    with _CheckedImports():
        from runtime.host.arguments import check_arguments

    check_arguments(function, given)


def _refuse(options):
    """Raise BadInput for options of a run in real time."""
    if not options:
        return
    with _CheckedImports():
        from runtime.host.errors import BadInput
        from runtime.session.own_process import check_names

    check_names(options)
    raise BadInput(f"{', '.join(options)}: only a run in real time has options, with fast=False or a rig")


def _study(diagram, duration, objectives, grid, sample, samples, sample_seed, seeds, settings, rate, subject):
    """Return the fields of a Study."""
    with _CheckedImports():
        from runtime.host.options import pairs_of

    return {
        "diagram": diagram,
        "duration": duration,
        "rate": rate,
        "seeds": list(seeds),
        "samples": samples,
        "sample_seed": sample_seed,
        "subject": None if subject is None else os.fspath(subject),
        "settings": dict(pairs_of(settings or ())),
        "grid": _plain_lists(grid or {}),
        "sample": {name: dict(given) for name, given in (sample or {}).items()},
        "objectives": dict(objectives) if hasattr(objectives, "items") else objectives,
    }


def _plain_lists(table: Any) -> Any:
    """Return {name: values} with lists of Python numbers. Values of another type are left for the check of Study."""
    if not hasattr(table, "items"):
        return table
    return {
        name: values.tolist()
        if hasattr(values, "tolist")
        else [value.item() if hasattr(value, "item") else value for value in values]
        if hasattr(values, "__iter__") and not isinstance(values, str)
        else values
        for name, values in table.items()
    }

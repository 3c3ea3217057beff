"""A study of the knee exoskeleton beside its bare ticks and the same study by other means, in turn."""

import importlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, suppress
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import psutil

import runtime
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from runtime.experiments.studies.cluster import Cluster
from runtime.experiments.studies.description import Study
from runtime.experiments.studies.engine import Here, Processes
from runtime.experiments.studies.objectives import rms
from runtime.robot.loading.file import compile_diagram, load
from runtime.robot.loading.simulation import Simulation
from tests.peers import netlists
from tests.peers.tickwork import diagram_of, native_block

ROOT = Path(__file__).parents[2]
KNEE_EXO = str(ROOT / "diagrams" / "knee_exo.py")
DURATION = 60.0  # s, of a trial
TORQUE = "left/knee.torque"
PROCESSORS = 2
SHORT = 0.05  # s, of a trial that is little more than the work around it
SHORT_TRIALS = 200
COMMAND_SHARE = 10  # trials of the study for one trial of the much slower command
SCALED = 0.01  # of the ticks, that slower frameworks run
BY_HAND = "runtime.run, two processes by hand"


def bare_ticks():
    """Processor time of the ticks of one trial, in s, without recording."""
    file, robot = load(KNEE_EXO)
    schedule = compile_diagram(file.path, robot)
    plant = Simulation(file, robot, schedule)
    executor = Executor(
        Program(schedule, plant.ends()),
        schedule.rate,
        plant=plant.program,
        substeps=plant.substeps,
        virtual=True,
        hosted=True,
    )
    began = time.thread_time()
    executor.run(round(DURATION * schedule.rate))
    return time.thread_time() - began


def whole_run():
    """Processor time of runtime.run, in s."""
    began = time.thread_time()
    runtime.run(KNEE_EXO, DURATION)
    return time.thread_time() - began


def by_call(assistance):
    """Objective of a trial by runtime.run, for a pool of processes."""
    return rms(runtime.run(KNEE_EXO, DURATION, settings={"assistance": assistance}), TORQUE)


def by_command(assistance):
    """Objective of a trial by the command and its recording."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "runtime", KNEE_EXO, "--fast", f"--duration={DURATION}"]
        command += [f"--set=assistance={assistance}", "--record", folder]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
        return rms(runtime.load(folder), TORQUE)


def through(engine, values):
    """Objectives of trials by an engine of a study, in order."""
    rows = engine.run(enumerate({"assistance": value} for value in values))
    return [row["torque"] for row in sorted(rows, key=lambda row: row["trial"])]


def study_of(duration):
    torque = {"function": "rms", "signal": TORQUE}
    return Study(KNEE_EXO, duration, grid={"assistance": [0.0]}, objectives={"torque": torque})


def contenders(stack):
    """{name: (function from the values of `assistance` to objectives, whether it is slow)} of this machine.

    stack : ExitStack that ends their processes
    """
    # in sessions of their own, as those of a study: the scheduler shares the processors among sessions
    pool = stack.enter_context(ProcessPoolExecutor(PROCESSORS, get_context("spawn"), os.setsid))
    engine = stack.enter_context(Processes(study_of(DURATION), PROCESSORS))
    made = {
        BY_HAND: (lambda values: list(pool.map(by_call, values)), False),
        "runtime.study, two processes": (lambda values: through(engine, values), False),
    }
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        print(f"  Dask left out: {error}")
    else:
        workers = stack.enter_context(
            distributed.LocalCluster(n_workers=PROCESSORS, threads_per_worker=1, dashboard_address=None)
        )
        cluster = stack.enter_context(Cluster(study_of(DURATION), workers.scheduler_address))
        made["runtime.study, two workers of Dask"] = lambda values: through(cluster, values), False
    try:
        joblib = importlib.import_module("joblib")
    except ImportError as error:
        print(f"  joblib left out: {error}")
    else:
        parallel = stack.enter_context(joblib.Parallel(PROCESSORS))
        made["joblib around the command"] = lambda values: parallel(map(joblib.delayed(by_command), values)), True
    return made


def timed(function, values):
    """(wall time, processor time of all processes) of a study in s per trial, and its objectives."""
    began, used = time.perf_counter(), processor_time()
    objectives = function(values)
    return ((time.perf_counter() - began) / len(values), (processor_time() - used) / len(values)), objectives


def processor_time():
    """Processor time of this process, its children and their ended children, in s."""
    this = psutil.Process()
    return sum(sum(each.cpu_times()[:4]) for each in (this, *this.children(recursive=True)))


def dask_overhead(address):
    """(wall time, processor time) that Dask adds to a trial, in s: short trials on one worker, and in this process."""
    values = [0.5] * SHORT_TRIALS
    with Cluster(study_of(SHORT), address) as cluster:
        through(cluster, values[:8])
        far, objectives = timed(lambda given: through(cluster, given), values)
    here, expected = timed(lambda given: through(Here(study_of(SHORT)), given), values)
    assert objectives == expected
    return [there - own for there, own in zip(far, here)]


def other_frameworks(rounds):
    """{name: wall times in s of 60 s of the diagram `knee` of this benchmark, which has no wearer}."""
    netlist = netlists.knee()
    diagram, ticks = diagram_of(netlist, native_block), round(DURATION * netlists.RATE)
    runs = {"Tickwork, runtime.run": lambda: time_of(lambda: runtime.run(diagram, DURATION))}
    for module, name in (("pathsim", "PathSim"), ("bdsim", "Bdsim")):
        try:
            contender = getattr(importlib.import_module(f"tests.peers.{module}"), name)(netlist)
        except ImportError as error:
            print(f"  {name} left out: {error}")
            continue
        runs[f"{contender.name}, {SCALED} of the ticks"] = partial(slow, contender, ticks)
    return {name: [run() for _ in range(rounds)] for name, run in runs.items()}


def time_of(function):
    began = time.perf_counter()
    function()
    return time.perf_counter() - began


def slow(contender, ticks):
    """Wall time in s of all ticks, extrapolated from SCALED of them."""
    contender.restart()
    return time_of(lambda: contender.advance(round(SCALED * ticks))) / SCALED


def line(name, times):
    numbers = (min(times), statistics.median(times), max(times))
    return f"  {name:44}" + "".join(f"{number * 1e3:12.4g}" for number in numbers)


def ratio(times, others):
    """Text with the median over the rounds of a ratio, each against its neighbour in time, and its range."""
    ratios = sorted(mine / theirs for mine, theirs in zip(times, others))
    return f"{statistics.median(ratios):.3g} ({ratios[0]:.3g} to {ratios[-1]:.3g})"


def print_times(trials=20, rounds=5):
    """Print what a trial of 60 s takes. trials : of a study in each round"""
    heading = f"{'min':>12}{'median':>12}{'max':>12}"
    print("", f"load average {os.getloadavg()[0]:.1f}", sep="\n")
    pairs = [(bare_ticks(), whole_run()) for _ in range(rounds + 1)][1:]
    bare, whole = zip(*pairs)
    print(f"{'60 s of knee_exo.py, ms of processor time':46}{heading}")
    print(line("bare ticks", bare), line("runtime.run", whole), f"  ratio {ratio(whole, bare)}", sep="\n")
    values = [number / (trials - 1) for number in range(trials)]
    with ExitStack() as stack:
        made, times, expected = contenders(stack), {}, None
        for number in range(rounds // 2 + 1):  # the first round starts processes and is not counted
            for name, (function, is_slow) in made.items():
                given = values[: max(2, trials // COMMAND_SHARE)] if is_slow else values
                took, objectives = timed(function, given)
                expected = expected or objectives
                assert objectives == expected[: len(given)], f"{name} gives other objectives"
                if number > 0:
                    times.setdefault(name, []).append(took)
    print("", f"{f'studies of {trials} such trials on two processors':46}{heading}", sep="\n")
    for kind, place in (("wall", 0), ("processor", 1)):
        print(f"  ms of {kind} time per trial")
        for name, each in times.items():
            of_kind, best = ([took[place] for took in one] for one in (each, times[BY_HAND]))
            print(line(f"  {name}", of_kind), f"   x {ratio(of_kind, best)}")
    with suppress(ImportError):
        distributed = importlib.import_module("distributed")
        with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as worker:
            added = [dask_overhead(worker.scheduler_address) for _ in range(rounds // 2)]
        print("", f"{f'Dask, added to each of {SHORT_TRIALS} trials, ms':46}{heading}", sep="\n")
        for kind, one in zip(("wall time", "processor time"), zip(*added)):
            print(line(kind, one))
    print("", f"{'60 s of 20 blocks at 1000 Hz, ms of wall time':46}{heading}", sep="\n")
    print(*(line(name, each) for name, each in other_frameworks(rounds // 2).items()), sep="\n")
    print("", f"load average {os.getloadavg()[0]:.1f}", sep="\n")

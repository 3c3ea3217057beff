"""runtime.run: a diagram in virtual time inside this process, as a script, a notebook or a test of a lab calls it."""

import gc
import os
import pickle
import signal
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import psutil
import pytest

import runtime
from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sources import GaussianNoise, Sine
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, DiagramError, Output
from runtime.host.errors import OK, BadInput
from runtime.robot.loading.file import compile_diagram, load
from runtime.robot.loading.simulation import Simulation
from tests.runtime.runs import KNEE_EXO, knee, open_files

HIP_EXO = KNEE_EXO.with_name("hip_exo.py")
HANDLED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGUSR1)


class Step(Block):
    """Calls a function with the tick, and returns what it returns."""

    y = Output("1")

    def __init__(self, function):
        super().__init__(name="step")
        self.function = function

    def step(self, tick):
        return self.function(tick)


def sine(recorder=True):
    with Diagram("sine", rate=100) as diagram:
        Gain(2.0)(Sine(frequency=1.0, name="sine")())
        if recorder:
            CsvRecorder()
    return diagram


def noise():
    with Diagram("noise", rate=100) as diagram:
        GaussianNoise(name="first")()
        GaussianNoise(name="second")()
        CsvRecorder()
    return diagram


def calling(function):
    with Diagram("calling", rate=100) as diagram:
        Gain(1.0)(Step(function)())
        CsvRecorder()
    return diagram


def recorded(command_line, file, *options):
    """The Trial of a run of the command."""
    code, _, err = command_line(file, "--fast", *options)
    [path] = (command_line.folder / "recordings").glob("*.mcap")
    return code, runtime.load(path)


def same(one, other):
    """Whether two Trials have the same signals, ticks and samples, bit for bit."""
    return (
        one.signals == other.signals
        and one.rows.tobytes() == other.rows.tobytes()
        and one.tick.tobytes() == other.tick.tobytes()
        and one.time.tobytes() == other.time.tobytes()
        and one.lateness.tobytes() == other.lateness.tobytes()
    )


@pytest.mark.parametrize(
    "file, settings",
    [
        (KNEE_EXO, {}),
        (HIP_EXO, {}),
        (KNEE_EXO, {"assistance": 0.5, "left/torque_limiter.limit": 9.0, "stride_time": 1.0}),
    ],
)
def test_signals_equal_those_of_the_command_bit_for_bit(command_line, file, settings):
    words = [word for name, value in settings.items() for word in ("--set", f"{name}={value}")]
    code, loaded = recorded(command_line, file, "--duration", "20", "--record", "recordings", *words)
    trial = runtime.run(file, duration=20, settings=settings)
    assert code == OK and len(trial) == len(loaded) > 1000 and len(trial.names) > 10
    assert same(trial, loaded)
    assert trial.diagram == loaded.diagram and trial.events == loaded.events
    assert {key: trial.end[key] for key in loaded.end if key != "end"} == {
        key: loaded.end[key] for key in loaded.end if key != "end"
    }
    assert trial.fault is loaded.fault is None and trial.complete and trial.about["limits"] == loaded.about["limits"]


def test_a_repeated_run_gives_the_same_result():
    first = runtime.run(KNEE_EXO, 5)
    assert same(first, runtime.run(str(KNEE_EXO), duration=5))


def test_a_diagram_and_a_function_that_builds_one_run_as_a_file_does(tmp_path):
    expected = np.sin(2 * np.pi * np.arange(100) / 100)
    for source in (sine(), sine):
        trial = runtime.run(source, 1.0)
        assert trial["gain.y"] == pytest.approx(2.0 * expected, abs=1e-12)
        assert trial.unit("gain.y") == "any" and repr(trial) == "<Trial sine: 100 ticks at 100 Hz, 2 signals>"
        assert trial.diagram["name"] == "sine"


def test_the_trial_has_the_methods_of_a_recording():
    trial = runtime.run(KNEE_EXO, 10)
    assert trial.strides("left/knee.position").shape[1] == 101
    assert len(trial.resample(100.0)) == 1000
    with pytest.raises(KeyError, match="did you mean 'left/knee.position'"):
        trial["left/knee.positoin"]


def test_a_trial_can_be_sent_to_another_process():
    trial = runtime.run(KNEE_EXO, 1)
    copy = pickle.loads(pickle.dumps(trial))
    assert same(copy, trial) and copy.diagram == trial.diagram and copy.end == trial.end and copy.complete


def test_without_recorder_and_viewer_every_signal_is_recorded():
    assert runtime.run(sine(recorder=False), 1).names == ["gain.y", "sine.y"]


def test_only_signals_of_recorders_are_recorded():
    with Diagram("part", rate=100) as diagram:
        wave = Sine(name="sine")()
        Gain(2.0)(wave)
        CsvRecorder()(wave)
    assert runtime.run(diagram, 1).names == ["sine.y"]


# Settings, plants and seeds


def test_settings_are_a_mapping_or_pairs_and_values_or_texts():
    def gain(settings):
        return runtime.run(sine(), 1, settings=settings)["gain.y"].max()

    for settings in ({"gain.gain": 3.0}, {"gain.gain": "3"}, [("gain.gain", 3)], {"g*.gain": 3}):
        assert gain(settings) == pytest.approx(3.0)


def test_settings_reach_the_parameters_of_the_building_function():
    def build(amplitude=1.0):
        with Diagram("built", rate=100) as diagram:
            Gain(amplitude)(Sine(name="sine")())
            CsvRecorder()
        return diagram

    assert runtime.run(build, 1, settings={"amplitude": 5.0})["gain.y"].max() == pytest.approx(5.0)
    with pytest.raises(BadInput, match="did you mean 'amplitude'"):
        runtime.run(build, 1, settings={"amplitud": 5.0})


def test_a_diagram_keeps_its_parameters_and_its_rate():
    diagram = sine()
    changed = runtime.run(diagram, 1, settings={"gain.gain": 7.0}, rate=200)
    assert len(changed) == 200 and changed["gain.y"].max() == pytest.approx(7.0)
    assert changed.diagram["rate"] == 200 and changed.about["metadata"]["settings"] == {"gain.gain": 7.0}
    again = runtime.run(diagram, 1)
    assert len(again) == 100 and again["gain.y"].max() == pytest.approx(2.0)
    with pytest.raises(BadInput, match="no parameter 'zzz'"):
        runtime.run(diagram, 1, settings={"gain.gain": 7.0, "gain.zzz": 1})
    assert diagram["gain"].gain == 2.0


def test_a_plant_is_given_as_a_function_or_a_diagram(tmp_path):
    file = knee(tmp_path, "return 1.0")

    def plant(robot, inertia=0.1):
        from blocks.models import Limb

        with Diagram("plant", rate=1000) as made:
            drive = robot["knee"].emulator()
            limb = Limb(inertia=inertia, damping=0.0, stiffness=0.0, reflex=0.0)
            limb(torque=drive.torque)
            drive(position=limb.position, velocity=limb.velocity)
        return made

    light, heavy = (
        runtime.run(file, 0.5, plant=plant, settings={"inertia": inertia})["knee.velocity"][-1]
        for inertia in (0.1, 0.4)
    )
    assert light == pytest.approx(4 * heavy, rel=0.1) and light > 0.5
    robot = load(file)[1]
    assert runtime.run(robot, 0.5, plant=plant(robot))["knee.velocity"][-1] == light
    assert runtime.run(robot, 0.5)["knee.velocity"][-1] != light  # the default: a damped inertia


def test_a_seed_changes_every_noise_source_and_is_restored():
    diagram = noise()
    as_declared = runtime.run(diagram, 1)
    assert np.array_equal(as_declared["first.y"], as_declared["second.y"])  # both have seed 0
    one, other, again = (runtime.run(diagram, 1, seed=seed) for seed in (1, 2, 1))
    assert same(one, again) and not same(one, other)
    assert abs(np.corrcoef(one["first.y"], one["second.y"])[0, 1]) < 0.3
    assert same(runtime.run(diagram, 1), as_declared) and one.about["metadata"]["seed"] == 1


# Faults and bad input


def test_a_fault_ends_the_trial_and_is_described(command_line):
    file = knee(command_line.folder, "return 1.0 / (100 - tick)")
    code, loaded = recorded(command_line, file, "--duration", "2")
    trial = runtime.run(file, 2)
    assert same(trial, loaded) and len(trial) == 100 and trial.complete
    assert trial.fault == loaded.fault and trial.end["ended"] == loaded.end["ended"]
    assert (trial.fault["status"], trial.fault["culprit"], trial.fault["tick"]) == ("exception", "law", 100)
    assert "FAULT at law, tick 100" in trial.fault["report"][0]
    assert any("ZeroDivisionError" in line for line in trial.fault["report"])
    assert "fault: exception" in repr(trial)


def test_devices_without_a_plant_are_a_fault(tmp_path):
    def nothing(robot):
        with Diagram("nothing", rate=robot.rate) as plant:
            Sine(name="sine")()
        return plant

    trial = runtime.run(knee(tmp_path), 1, plant=nothing)
    assert len(trial) == 0 and trial.fault["status"] == "no answer"
    assert trial.fault["report"][0].endswith(
        'no reply from knee (id 1 on bus legs); add robot["knee"].emulator() to the plant'
    )


@pytest.mark.parametrize(
    "arguments, options, message",
    [
        ((42, 1), {}, "expected a Diagram, the path of a diagram file or a function"),
        (("nowhere.py", 1), {}, "file nowhere.py does not exist"),
        ((sine, 0.001), {}, "shorter than one tick"),
        ((sine, -1), {}, "duration=-1: expected a finite number above 0"),
        ((sine, float("nan")), {}, "duration=nan"),
        ((sine, 1e9), {}, "GiB of memory"),
        ((lambda: 3, 1), {}, "must return a Diagram"),
        ((sine, 1), {"plant_signals": "limb.torque"}, "sine has no plant"),
        ((KNEE_EXO, 1), {"plant_signals": "walker.speeed"}, "plant: there is no signal 'walker.speeed'; did you mean"),
        ((KNEE_EXO, 1), {"plant_signals": "walker", "fast": False}, "only a run in virtual time records signals"),
    ],
)
def test_a_diagram_that_cannot_run_raises_bad_input(arguments, options, message):
    with pytest.raises(BadInput, match=message):
        runtime.run(*arguments, **options)


def test_an_error_of_the_diagram_is_a_diagram_error():
    with pytest.raises(DiagramError, match="limit"):
        runtime.run(KNEE_EXO, 1, settings={"left/torque_limiter.limit": 30.0})


# A guest in the process


def test_runtime_run_leaves_no_files_and_prints_nothing(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    runtime.run(KNEE_EXO, 1)
    process, opened = psutil.Process(), open_files()

    def state():
        return process.num_threads(), len(process.children()), len(sys.modules), sorted(os.listdir("/dev/shm"))

    before = state()
    for _ in range(5):
        runtime.run(KNEE_EXO, 1)
    assert state() == before and not open_files() - opened
    assert list(tmp_path.iterdir()) == [] and capfd.readouterr() == ("", "")


@pytest.mark.soak
def test_repeated_runs_keep_no_memory():
    def resident():
        gc.collect()
        return psutil.Process().memory_info().rss

    runtime.run(KNEE_EXO, 60)
    before = resident()
    for _ in range(8):  # each Trial has 3.6 MB
        runtime.run(KNEE_EXO, 60)
    assert resident() - before < 15e6


@pytest.mark.soak
def test_ten_thousand_runs_leave_the_process_as_it_was(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    def state():
        gc.collect()
        process = psutil.Process()
        shared = {f"/dev/shm/{name}" for name in os.listdir("/dev/shm")}
        mapped = [item.path for item in process.memory_maps() if item.path in shared or "/memfd:" in item.path]
        counts = process.num_fds(), process.num_threads(), process.children(), len(sys.modules)
        return process.memory_info().rss, (*counts, mapped, os.listdir(tmp_path))

    for _ in range(200):
        runtime.run(KNEE_EXO, 0.1)
    memory, others = state()
    for _ in range(10_000):
        runtime.run(KNEE_EXO, 0.1)
    after, others_after = state()
    assert after - memory < 2e6 and others_after == others


def test_handlers_collector_and_switch_interval_stay_as_they_are():
    during = []

    def look(tick):
        during.append((gc.isenabled(), sys.getswitchinterval()))
        return 0.0

    def state():
        return [signal.getsignal(number) for number in HANDLED], gc.isenabled(), sys.getswitchinterval()

    before = state()
    runtime.run(calling(look), 0.1)
    assert state() == before and set(during) == {before[1:]}


@pytest.mark.parametrize("number, status", [(signal.SIGINT, KeyboardInterrupt), (signal.SIGUSR1, LookupError)])
def test_a_signal_ends_the_run_and_then_has_its_usual_effect(number, status):
    def handler(number, frame):
        raise LookupError(number)

    seen, before = [], signal.getsignal(signal.SIGUSR1)
    signal.signal(signal.SIGUSR1, handler)

    def strike(tick):
        seen.append(tick)
        if tick == 50:
            os.kill(os.getpid(), number)
        return 0.0

    try:
        with pytest.raises(status):
            runtime.run(calling(strike), 100)
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert 50 <= seen[-1] < 60


@pytest.mark.paced
def test_a_second_interrupt_ends_a_python_block_that_does_not_return():
    waited = []

    def hang(tick):
        if tick == 5:
            threading.Thread(target=strike).start()
            while len(waited) < 3000:  # sleeping: without the GIL
                time.sleep(0.01)
                waited.append(tick)
        return 0.0

    def strike():
        for pause in (0.1, 1.2):
            time.sleep(pause)
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        runtime.run(calling(hang), 1)
    assert len(waited) < 1000


def test_outside_the_main_thread_signals_stay_with_the_program():
    caught, ticks = [], []
    before = signal.signal(signal.SIGUSR1, lambda number, frame: caught.append(number))

    def strike(tick):
        ticks.append(tick)
        if tick == 10:
            os.kill(os.getpid(), signal.SIGUSR1)
        return 0.0

    try:
        trials = []
        thread = threading.Thread(target=lambda: trials.append(runtime.run(calling(strike), 1)))
        thread.start()
        thread.join()
        assert len(trials[0]) == 100 and trials[0].fault is None and caught == [signal.SIGUSR1]
    finally:
        signal.signal(signal.SIGUSR1, before)


@pytest.mark.soak
def test_several_threads_run_at_once():
    alone = [runtime.run(KNEE_EXO, 20, settings={"assistance": share}) for share in (0.2, 0.4, 0.6, 0.8)]
    with ThreadPoolExecutor(4) as pool:
        together = pool.map(
            lambda share: runtime.run(KNEE_EXO, 20, settings={"assistance": share}), (0.2, 0.4, 0.6, 0.8)
        )
        assert all(same(one, other) for one, other in zip(alone, together))
    assert not same(alone[0], alone[1])


def test_a_run_inside_another_run_works():
    def nested(tick):
        return runtime.run(sine(), 0.5)["gain.y"].max() if tick == 3 else 0.0

    assert runtime.run(calling(nested), 0.1)["gain.y"].max() == pytest.approx(2.0)


@pytest.mark.soak
@pytest.mark.timing
def test_a_minute_of_the_knee_exoskeleton_takes_little_more_than_its_ticks():
    """Processor time, because other processes run as well. The ticks alone record nothing."""
    shares = []
    runtime.run(KNEE_EXO, 60)
    file, robot = load(KNEE_EXO)
    schedule = compile_diagram(file.path, robot)
    for _ in range(5):
        plant = Simulation(file, robot, schedule)
        bare = Executor(
            Program(schedule, plant.ends()),
            200,
            plant=plant.program,
            substeps=plant.substeps,
            virtual=True,
            hosted=True,
        )
        began = time.thread_time()
        bare.run(12_000)
        ticks = time.thread_time() - began
        began = time.thread_time()
        runtime.run(KNEE_EXO, 60)
        shares.append((time.thread_time() - began) / ticks)
    assert min(shares) < 1.3

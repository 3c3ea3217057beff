"""OnnxModel in a worker: results after the declared latency, late results, stale outputs, faults."""

import numpy as np
import pytest

from blocks.networks import OnnxModel
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from cext.kernels.networks.model import FAILED, IN_USE, STALE
from cext.memory.shared_state import SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, compile, subsystem
from tests.blocks.networks import models
from tests.blocks.running import player, run
from tests.forking import exit_code, fork
from tests.graph.complaints import complaints, refusal

REAL_TIME = 7  # slot of the clock: the kernel does not wait
DT = 0.005  # s


def compared(path, latency, rate=1.0 / DT, **options):
    """A diagram with a model in the tick and in a worker, of the same signals."""
    with Diagram("robot", rate=rate) as diagram:
        signals = Sine(frequency=1.7, unit="rad")(), Sine(frequency=3.1, unit="rad/s")(), 70.0
        OnnxModel(path, name="tick", **options)(*signals)
        OnnxModel(path, name="worker", run="worker", latency=latency, **options)(*signals)
    return diagram


@pytest.mark.parametrize(
    "kind, latency, every, delay",
    [("window", 0.012, 1, 3), ("streaming", 0.02, 2, 4), ("streaming", 0.001, 1, 1), ("streaming", 0.03, 4, 8)],
)
def test_a_worker_returns_the_results_of_the_tick_after_its_latency(tmp_path, kind, latency, every, delay):
    path = getattr(models, kind)(tmp_path / "m.onnx")
    recording = run(compared(path, latency, every=every), 200)
    for port in ("hip_torque", "effort", "valid"):
        np.testing.assert_array_equal(recording[f"worker.{port}"][delay:], recording[f"tick.{port}"][:-delay])
        assert not recording[f"worker.{port}"][:delay].any()
    assert not recording["worker.overruns"].any() and not recording["tick.age"].any()
    assert recording["worker.age"][delay + 1] == pytest.approx(delay * DT)


def test_a_worker_repeats_its_results_after_a_reset(tmp_path):
    program = Program(compile(recorded(compared(models.streaming(tmp_path / "m.onnx"), 0.02))))
    finals = []
    for _ in range(2):
        Executor(program, 200.0, virtual=True).run(50)
        finals.append(program.final.copy())
    assert finals[0].any()
    np.testing.assert_array_equal(*finals)


def recorded(diagram):
    with diagram:
        CsvRecorder()
    return diagram


def stepping(path, **options):
    """A block in a worker, stepped by hand at 200 Hz: (block, function that steps it in real time or not)."""
    with Diagram("robot", rate=1.0 / DT):
        block = OnnxModel(path, run="worker", **options)
    block.prepare(DT)

    def step(row, real_time):
        if block.scratch.arena is not None:
            block.scratch.arena[REAL_TIME] = real_time
        return block.step(*row)

    return block, step


ROWS = np.random.default_rng(2).normal(size=(40, 3)) + (0.2, 0.0, 70.0)


def test_late_results_hold_count_and_fade_without_delay_of_a_tick(tmp_path):
    path = models.slow(tmp_path / "m.onnx", 500)
    in_tick = OnnxModel(path)
    latency, stale = 2, 5  # ticks
    block, step = stepping(path, latency=latency * DT, stale=stale * DT)
    reference, late = [], 0
    for tick, row in enumerate(ROWS):
        real_time = tick >= 4
        *values, valid, age, overruns = step(row, real_time)
        if tick < 4:
            reference.append(in_tick.step(*row)[:2])
            continue
        source = tick - round(age / DT)  # tick of the samples of these outputs
        while len(reference) <= source:
            reference.append(in_tick.step(*ROWS[len(reference)])[:2])
        late += source < tick - latency
        share = min(max(2.0 - age / (stale * DT), 0.0), 1.0)
        assert values == pytest.approx([share * y for y in reference[source]], abs=1e-12)
        assert valid == (age <= stale * DT + 1e-9) and overruns == late
    assert late >= 30  # of 36 steps: none waited


def test_stale_outputs_are_a_fault_where_the_diagram_asks_for_it(tmp_path):
    block, step = stepping(models.slow(tmp_path / "m.onnx", 1000), latency=DT, stale=3 * DT, when_stale="fault")
    step(ROWS[0], False)
    with pytest.raises(ArithmeticError, match=f"status {STALE}"):
        for row in ROWS:
            step(row, True)
    assert block.fault_text(STALE) == "its outputs are older than 0.015 s"


def test_a_worker_that_was_disabled_begins_with_new_results(tmp_path):
    path = models.window(tmp_path / "m.onnx", samples=1)
    with Diagram("robot", rate=1.0 / DT) as diagram:
        enable = player(np.r_[np.ones(20), np.zeros(60), np.ones(40)], dtype=bool)
        angle = Sine(frequency=1.7, unit="rad")()
        OnnxModel(path, name="tick")(angle, 0.0, 70.0)
        with subsystem("part", enabled=enable):
            OnnxModel(path, name="net", run="worker", latency=3 * DT, when_stale="fault")(angle, 0.0, 70.0)
    recording = run(diagram, 120)
    assert recording.outcome.status == "ok" and len(recording.tick) == 120
    resumed = np.flatnonzero(recording["part/net.valid"])[len(range(3, 80)) :]
    assert resumed.tolist() == list(range(83, 120))
    assert not recording["part/net.effort"][80:83].any()
    np.testing.assert_array_equal(recording["part/net.effort"][83:], recording["tick.effort"][80:-3])


def test_a_streaming_model_begins_again_after_dropped_samples(tmp_path, monkeypatch):
    monkeypatch.setattr("blocks.networks.BACKLOG", DT)  # two samples wait
    needed = models.METADATA | {"receptive_field": 4}
    path = models.slow(tmp_path / "m.onnx", 300, streams=True, metadata=needed)
    block, step = stepping(path, latency=DT)
    assert [step(row, False)[2] for row in ROWS[:7]] == [False] * 4 + [True] * 3
    for row in ROWS[7:17]:  # faster than the worker
        step(row, True)
    outputs = [step(ROWS[0], False) for _ in range(10)]
    assert [valid for _, _, valid, *_ in outputs].count(False) >= 3 and outputs[-1][2]
    in_tick = OnnxModel(path)
    assert outputs[-1][:2] == [in_tick.step(*ROWS[0]) for _ in range(4)][-1][:2]


def test_a_failed_inference_is_a_fault_with_the_text_of_onnx_runtime(tmp_path):
    path = models.failing(tmp_path / "m.onnx")
    block = OnnxModel(path)
    assert block.step(0.4, 0.0, 70.0)[:2] == (0.1, 0.0)
    with pytest.raises(ArithmeticError, match=f"status {FAILED}"):
        block.step(9.0, 0.0, 70.0)
    assert "the inference failed: " in block.fault_text(FAILED) and "indices" in block.fault_text(FAILED)
    block, step = stepping(path, latency=DT)
    with pytest.raises(ArithmeticError, match=f"status {FAILED}"):
        for _ in range(3):
            step((9.0, 0.0, 70.0), False)
    assert "indices" in block.fault_text(FAILED)


def test_a_worker_serves_one_program_at_a_time(tmp_path):
    block, step = stepping(models.streaming(tmp_path / "m.onnx"), latency=DT)
    step(ROWS[0], False)
    other = block.scratch.arena.copy()
    step(ROWS[1], False)
    block.scratch.arena[:] = other
    with pytest.raises(ArithmeticError, match=f"status {IN_USE}"):
        step(ROWS[1], False)


def test_a_worker_runs_in_a_forked_process(tmp_path):
    block, step = stepping(models.streaming(tmp_path / "m.onnx"), latency=DT)
    before = [step(row, False) for row in ROWS[:5]]

    def work():
        block.scratch.restart()
        assert [step(row, False) for row in ROWS[:5]] == before

    assert exit_code(fork(work)) == 0


def test_parameters_that_cannot_hold_are_refused(tmp_path):
    path = models.streaming(tmp_path / "m.onnx")
    assert 'pass run="worker"' in refusal(OnnxModel, path, latency=0.01).message
    assert "needs the delay of its results" in refusal(OnnxModel, path, run="worker").message
    [problem] = [each for each in complaints(compared(path, 0.2)) if each.code == "TW010"]
    assert problem.message.startswith("stale: 0.1 s is shorter than the latency and one step of the block, 0.205 s")


def test_the_watchdog_allows_for_inferences_in_the_tick(tmp_path):
    path = models.streaming(tmp_path / "m.onnx")
    with Diagram("robot", rate=200.0) as diagram:
        for index, options in enumerate(({}, {"inference_time": 0.05}, {"run": "worker", "latency": 0.02})):
            OnnxModel(path, name=f"n{index}", **options)(0.0, 0.0, 70.0)
    assert compile(recorded(diagram)).allowance == pytest.approx(0.02 + 0.05)


@pytest.mark.timing
def test_an_inference_of_many_periods_makes_no_tick_late(tmp_path):
    path = models.slow(tmp_path / "m.onnx", 6000)
    with Diagram("robot", rate=200.0) as diagram:
        OnnxModel(path, name="net", run="worker", latency=0.02)(Sine(unit="rad")(), 0.0, 70.0)
    executor = Executor(Program(compile(recorded(diagram))), 200.0, shared=SharedState(1 << 20))
    assert executor.run(120).status == "ok"
    assert not any("net" in row["name"] for row in executor.overruns)
    assert diagram["net"].inference_times["max"] > 0.05

"""The average stride, against closed forms."""

import json
import math
import os
import signal

import pytest

from blocks.recorders import StrideReport
from cext.memory.shared_state import SharedState
from cext.recording.ring_batch import Batch
from runtime.record.analysis.average_stride import CURVES, resample
from runtime.record.recorder import RecorderProcess, await_files
from runtime.record.recorder.services.strides import StrideAverage
from tests.runtime.record.recorder.processes import writers
from tests.runtime.record.recorder.running import STRIDES, columns, plan, record, row, sink
from tests.runtime.terminals import patient

RATE = 200.0
INPUTS = columns("phase 1", "walking 1 bool", "angle rad", "velocity rad/s", "torque N·m")


def walk(strides, period=1.0, start=0.3, amplitude=0.6, torque=10.0, walking=lambda tick: True, grow=0.0):
    """Rows of sinusoidal gait: angle = A sin 2πφ, torque = T cos 2πφ, so that power = A T (2π / period) cos² 2πφ >=
    0.
    """
    rows = []
    for tick in range(round((strides + 0.6) * period * RATE)):
        phase = start + tick / RATE / period
        scale = 1.0 + grow * math.floor(phase)
        angle, around = phase % 1.0, 2.0 * math.pi * phase
        rows.append(
            (
                tick,
                angle,
                float(walking(tick)),
                scale * amplitude * math.sin(around),
                amplitude * 2.0 * math.pi / period * math.cos(around),
                scale * torque * math.cos(around),
            )
        )
    return rows


def average(rows, rate=RATE, title=""):
    order = sink(STRIDES, "left/stride_report", INPUTS, title=title)
    service = StrideAverage(plan(None, order, rate=rate), order)
    service.open()
    for tick, *values in rows:
        service.records(Batch([row(tick, *values)]))
    service.close()
    return service.result


def test_columns_equal_the_inputs_of_the_block():
    assert [column["path"] for column in INPUTS] == list(StrideReport.inputs)


def test_work_time_and_peak_of_a_sinusoidal_gait_are_those_of_the_closed_form():
    result = average(walk(10))
    assert result["strides"] == 9 and result["left_out"] == 0 and result["title"] == "left"
    assert result["stride_time"] == pytest.approx(1.0, abs=1e-12)
    assert result["peak_torque"] == 10.0
    assert result["positive_work"] == pytest.approx(math.pi * 0.6 * 10.0, rel=1e-9)  # ∫ A T 2π cos² = π A T
    assert result["negative_work"] == pytest.approx(0.0, abs=1e-12)


def test_torque_against_the_motion_is_negative_work():
    result = average(walk(5, torque=-10.0))
    assert result["negative_work"] == pytest.approx(-math.pi * 0.6 * 10.0, rel=1e-9)
    assert result["positive_work"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("period", [0.8, 1.1, 1.37])
def test_strides_of_any_duration_are_resampled_to_101_points(period):
    curves = average(walk(8, period))["curves"]
    assert set(curves) == set(CURVES)
    for point in range(101):
        around = 2.0 * math.pi * point / 100
        # straight lines between samples
        assert curves["angle"]["mean"][point] == pytest.approx(0.6 * math.sin(around), abs=0.6 * 2e-3)
        assert curves["torque"]["mean"][point] == pytest.approx(10.0 * math.cos(around), abs=10.0 * 2e-3)
        assert curves["angle"]["sd"][point] < 1e-3


def test_the_standard_deviation_is_that_of_the_strides():
    result = average(walk(5, grow=0.1))  # the four whole strides 1, 2, 3, 4 are scaled by 1.1, 1.2, 1.3, 1.4
    scales = [1.1, 1.2, 1.3, 1.4]
    mean = sum(scales) / 4
    sd = math.sqrt(sum((scale - mean) ** 2 for scale in scales) / 3)
    assert result["strides"] == 4
    assert result["curves"]["angle"]["mean"][25] == pytest.approx(0.6 * mean, rel=1e-3)
    assert result["curves"]["angle"]["sd"][25] == pytest.approx(0.6 * sd, rel=1e-3)


def test_a_stride_with_a_missing_tick_is_left_out():
    rows = walk(10)
    assert average(rows)["strides"] == 9
    gap = average([r for r in rows if r[0] != 450])
    assert gap["strides"] == 8 and gap["left_out"] == 1 and gap["left_out_because"] == {"with missed ticks": 1}
    assert gap["positive_work"] == pytest.approx(math.pi * 6.0, rel=1e-9)


def test_a_stride_with_nan_is_left_out_and_does_not_hide_the_peak():
    rows = [(*r[:5], math.nan) if r[0] == 450 else r for r in walk(10)]
    result = average(rows)
    assert result["strides"] == 8 and result["left_out"] == 1 and result["peak_torque"] == 10.0


def test_a_stride_counts_only_if_the_leg_walks_all_through_it():
    result = average(walk(10, walking=lambda tick: not 440 <= tick < 460))
    assert result["strides"] == 8 and result["left_out_because"] == {"in which walking ended": 1}
    assert result["unused"]["standing"] == pytest.approx(0.1)
    assert average(walk(10, walking=lambda tick: False))["strides"] == 0


@pytest.mark.parametrize("period", [0.3, 4.2])
def test_strides_of_implausible_duration_are_left_out(period):
    result = average(walk(6, period))
    assert result["strides"] == 0 and result["left_out"] >= 5


def test_every_second_is_in_a_stride_or_reported_unused():
    # phase 0.3 to 10.9; it wraps at 0.7 s, 1.7 s and so on
    result = average(walk(10, walking=lambda tick: tick >= 100))
    assert (result["strides"], result["left_out"]) == (9, 0)
    assert result["unused"] == {"standing": pytest.approx(0.5), "unfinished": pytest.approx(10.6 - 9.0 - 0.5)}


def test_standing_for_an_hour_uses_no_memory():
    order = sink(STRIDES, "left/stride_report", INPUTS)
    service = StrideAverage(plan(None, order), order)
    service.open()
    for tick in range(20_000):
        service.records(Batch([row(tick, 0.99 if tick == 0 else 0.1, 1.0, 0.0, 0.0, 0.0)]))
    assert service.average.stride is None


def test_resampling_passes_over_samples_that_do_not_advance():
    [curve] = resample([-0.1, 0.5, 0.5, 0.4, 0.6, 1.1], [-1.0, 5.0, 50.0, 40.0, 6.0, 11.0])
    assert curve[0] == pytest.approx(0.0) and curve[50] == pytest.approx(5.0) and curve[100] == pytest.approx(10.0)


def both(folder, rows, ended_by=0, **changed):
    sinks = [sink(STRIDES, f"{side}/stride_report", INPUTS, title="") for side in ("left", "right")]
    records = [row(tick, *values) for tick, *values in rows]
    return record(plan(folder, *sinks, name="gait", **changed), records, ended_by=ended_by)


def test_both_legs_make_one_picture(tmp_path):
    report = both(tmp_path, walk(5))
    picture = tmp_path / "bench_1.png"
    assert [(leg["title"], leg["strides"]) for leg in report["strides"]] == [("left", 4), ("right", 4)]
    assert picture.read_bytes().startswith(b"\x89PNG\r\n") and picture.stat().st_size > 30_000
    assert {"path": str(picture), "note": "the average stride of left, right"} in report["files"] and report[
        "problems"
    ] == []


def test_the_report_of_a_run_in_real_time_does_not_wait_for_the_picture(tmp_path):
    (tmp_path / "killed").mkdir()
    report = both(tmp_path / "killed", walk(5), virtual=False)
    os.kill(report["completing"], signal.SIGKILL)  # while it imports Matplotlib
    await_files(report)
    sidecar = json.loads((tmp_path / "killed/bench_1.json").read_text())
    assert sidecar["ended"] == "ok" and [leg["strides"] for leg in sidecar["strides"]] == [4, 4]
    assert report["problems"] == [] and (tmp_path / "killed/bench_1.png").stat().st_size == 0
    report = both(tmp_path, walk(5), virtual=False)
    await_files(report)
    assert (tmp_path / "bench_1.png").stat().st_size > 30_000
    assert {"path": str(tmp_path / "bench_1.png"), "note": "the average stride of left, right"} in report["files"]


def test_run_that_a_signal_ends_reports_strides_and_draws_no_picture(tmp_path):
    report = both(tmp_path, walk(5), ended_by=signal.SIGINT)
    assert [leg["strides"] for leg in report["strides"]] == [4, 4] and report["problems"] == []
    assert not list(tmp_path.glob("*.png"))


def test_strides_restart_after_killed_writer_and_report_states_it():
    rows, shared = walk(12), SharedState(1 << 20)
    recorder = RecorderProcess(shared)
    columns = [{**column, "index": index} for index, column in enumerate(INPUTS)]
    recorder.configure(plan(None, sink(STRIDES, "left/stride_report", columns), virtual=False))
    for number, values in enumerate(rows):
        if number == 700:  # in the middle of the fourth stride
            patient(lambda: shared.empty)
            os.kill(*patient(lambda: writers(recorder.pid)), signal.SIGKILL)
        assert shared.push(*row(*values))
    shared.close()
    report = recorder.finish()
    assert report["strides"][0]["strides"] == 8 and report["problems"][1:] == [
        "left: the average does not include strides before part 2"
    ]


@pytest.mark.soak
def test_two_pictures_of_the_same_walk_are_the_same_file(tmp_path):
    for name in ("a", "b"):
        both(tmp_path / name, walk(3))
    assert (tmp_path / "a" / "bench_1.png").read_bytes() == (tmp_path / "b" / "bench_1.png").read_bytes()


def test_report_states_missing_plot_without_whole_stride(tmp_path):
    report = both(tmp_path, walk(1)[:100])
    assert [leg["strides"] for leg in report["strides"]] == [0, 0] and "curves" not in report["strides"][0]
    assert report["strides"][0]["peak_torque"] == 10.0
    assert not list(tmp_path.glob("*.png"))


def test_without_a_folder_strides_are_reported_and_nothing_is_drawn(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    report = both(None, walk(3))
    assert report["strides"][1]["strides"] == 2 and list(tmp_path.iterdir()) == []

"""A recording read back without a compiler: as arrays, tables, at another rate, and stride by stride."""

import math
import pickle
import sys

import numpy as np
import pytest

import runtime
from runtime.host.errors import BadInput
from runtime.host.optional_dependencies import EXTRAS, MissingExtra, need
from tests.checkout import copy_packages, python
from tests.runtime.record.recorder.running import CSV, columns, plan, record, row, sink
from tests.test_installation_check import PYPROJECT

SIGNALS = (
    "left/imu.quaternion[0] 1",
    "left/imu.quaternion[1] 1",
    "left/imu.quaternion[2] 1",
    "left/imu.quaternion[3] 1",
    "left/gait.phase 1",
    "left/gait.walking 1 bool",
    "left/knee.fault 1 int",
    "left/knee.position rad",
)


def recorded(folder, rows, stem="trial", signals=SIGNALS, **changed):
    """rows : of (tick, *values). Returns the path of the recording."""
    order = plan(folder, sink(CSV, "csv", columns(*signals)), stem=stem, **changed)
    report = record(order, [row(*values) for values in rows])
    return next(entry["path"] for entry in report["files"] if entry["path"].endswith(".mcap"))


def walk(ticks, stride=1.1, rate=200.0):
    """Rows of a knee that bends by sin² of its phase, and an IMU that turns by 90° a second about x."""
    for tick in ticks:
        phase = (tick / rate / stride) % 1.0
        half = math.pi / 4.0 * tick / rate
        yield (
            tick,
            math.cos(half),
            math.sin(half),
            0.0,
            0.0,
            phase,
            tick >= 100,
            tick // 7,
            math.sin(math.pi * phase) ** 2,
        )


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    return runtime.load(recorded(tmp_path_factory.mktemp("trial"), walk(range(2000))))


def test_reading_needs_nothing_that_was_compiled(tmp_path):
    path = recorded(tmp_path, walk(range(300)))
    rooms = copy_packages(tmp_path / "clone", built=False)
    text = (
        "import sys, runtime\n"
        f"trial = runtime.load({path!r})\n"
        "print(len(trial), trial['left/knee.position'][100], trial.unit('left/knee.position'), "
        "trial.strides('left/knee.position').shape)\n"
        "print(sorted({'cext', 'graph', 'blocks', 'networkx', 'can', 'google.protobuf', 'termios', 'matplotlib'} & "
        "set(sys.modules)))\n"
    )
    process = python("-c", text, cwd=rooms)
    assert process.stderr == ""
    expected = math.sin(math.pi * (100 / 200 / 1.1)) ** 2
    assert process.stdout.splitlines() == [f"300 {expected!r} rad (0, 101)", "[]"]


def test_signals_are_typed_arrays_with_units_and_time(trial):
    assert trial["left/knee.position"].dtype == np.float64 and trial.unit("left/knee.position") == "rad"
    assert trial["left/knee.fault"].dtype == np.int64 and trial["left/knee.fault"][-1] == 1999 // 7
    assert (
        trial["left/gait.walking"].dtype == np.bool_
        and not trial["left/gait.walking"][99]
        and trial["left/gait.walking"][100]
    )
    assert trial["left/imu.quaternion"].shape == (2000, 4) and trial["left/imu.quaternion[1]"].shape == (2000,)
    assert trial.names == [
        "left/imu.quaternion",
        "left/gait.phase",
        "left/gait.walking",
        "left/knee.fault",
        "left/knee.position",
    ]
    assert trial.time[1] == 0.005 and trial.dtype("left/knee.fault") == "int"


def test_a_trial_is_the_same_in_another_process(trial, monkeypatch):
    for whole in (trial, trial.resample(100.0), trial.between(0.01, 0.03)):
        data = pickle.dumps(whole)
        with monkeypatch.context() as there:
            there.chdir("/")
            copy = pickle.loads(data)
            assert copy.rows.tobytes() == whole.rows.tobytes() and copy.signals == whole.signals
            assert (copy.time == whole.time).all() and copy.events == whole.events and copy.diagram == whole.diagram
            assert copy.complete == whole.complete and repr(copy) == repr(whole)


def test_a_misspelt_signal_is_suggested(trial):
    with pytest.raises(KeyError, match="has no signal 'left/knee.positoin': did you mean 'left/knee.position'"):
        trial["left/knee.positoin"]


def test_an_integer_with_a_missing_value_is_a_float(tmp_path):
    found = runtime.load(recorded(tmp_path, [(0, 1.0, 1.0), (1, math.nan, 2.0)], signals=("a.x 1 int", "a.y 1 int")))
    assert found["a.x"].dtype == np.float64 and math.isnan(found["a.x"][1]) and found["a.y"].dtype == np.int64


def test_a_matrix_has_its_shape(tmp_path):
    found = runtime.load(
        recorded(tmp_path, [(0, 1.0, 2.0, 3.0, 4.0)], signals=[f"a.m[{i}][{j}] 1" for i in (0, 1) for j in (0, 1)])
    )
    assert found["a.m"].tolist() == [[[1.0, 2.0], [3.0, 4.0]]]


def test_resampling_at_recorded_rate_is_exact(trial):
    same = trial.resample(200)
    assert (
        np.array_equal(same.rows, trial.rows)
        and np.array_equal(same.tick, trial.tick)
        and same.time.tolist() == trial.time.tolist()
    )


def test_each_signal_type_is_resampled_by_its_own_rule(trial):
    fine = trial.resample(1000)
    assert len(fine) == 9996 and fine.about["rate"] == 1000 and fine.time[1] == 0.001
    between = 4003  # 3/5 of the way from tick 800 to tick 801
    half = math.pi / 4.0 * 4.003
    assert np.allclose(fine["left/imu.quaternion"][between], [math.cos(half), math.sin(half), 0.0, 0.0], atol=1e-12)
    a, b = trial["left/knee.position"][800:802]
    assert fine["left/knee.position"][between] == pytest.approx(a + 0.6 * (b - a), abs=1e-12)
    assert fine["left/knee.fault"][between] == 800 // 7 and fine["left/knee.fault"].dtype == np.int64
    assert (
        fine["left/gait.walking"].dtype == np.bool_
        and not fine["left/gait.walking"][499]
        and fine["left/gait.walking"][500]
    )


def test_ticks_that_were_missed_are_filled_in(tmp_path):
    found = runtime.load(recorded(tmp_path, [(0, 0.0, 1.0), (4, 4.0, 5.0)], signals=("a.x m", "a.n 1 int"))).resample(
        200
    )
    assert found["a.x"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0] and found["a.n"].tolist() == [1, 1, 1, 1, 5]


def test_nan_does_not_spread_to_other_samples(tmp_path):
    found = runtime.load(recorded(tmp_path, [(0, 0.0), (1, math.nan), (2, 2.0)], signals=("a.x m",)))
    assert [math.isnan(value) for value in found.resample(400)["a.x"]] == [False, True, True, True, False]


def test_quaternion_is_interpolated_along_shorter_arc(tmp_path):
    signals = [f"imu.quaternion[{i}] 1" for i in range(4)]
    found = runtime.load(
        recorded(tmp_path, [(0, 1.0, 0.0, 0.0, 0.0), (1, -math.cos(0.1), -math.sin(0.1), 0.0, 0.0)], signals=signals)
    )
    assert np.allclose(found.resample(400)["imu.quaternion"][1], [math.cos(0.05), math.sin(0.05), 0.0, 0.0], atol=1e-12)


def test_phases_and_bearings_are_interpolated_around_the_circle(tmp_path):
    circles = ((0.0, 1.0), (-math.pi, math.pi), ())
    signals = [
        {**column, "circle": circle}
        for column, circle in zip(columns("gait.phase 1", "imu.yaw rad", "knee.angle rad"), circles)
    ]
    rows = [(0, 0.9, 3.0, 3.0), (1, 0.1, -3.0, -3.0), (2, 0.6, 2.9, 2.9)]
    report = record(plan(tmp_path, sink(CSV, "csv", signals), stem="round"), [row(*values) for values in rows])
    fine = runtime.load(next(entry["path"] for entry in report["files"] if entry["path"].endswith(".mcap"))).resample(
        800
    )
    assert fine["gait.phase"] == pytest.approx([0.9, 0.95, 1.0, 0.05, 0.1, 0.225, 0.35, 0.475, 0.6], abs=1e-12)
    step = (2.0 * math.pi - 6.0) / 4.0
    assert fine["imu.yaw"][:5] == pytest.approx([3.0, 3.0 + step, math.pi, -3.0 - step, -3.0], abs=1e-12)
    assert fine["imu.yaw"][8] == 2.9 and fine["imu.yaw"][7] > 2.9 and fine["knee.angle"][2] == 0.0


@pytest.mark.parametrize("rate", [0.0, -1.0, math.nan, math.inf])
def test_invalid_rate_is_refused(trial, rate):
    with pytest.raises(BadInput, match="expected a rate in Hz above 0"):
        trial.resample(rate)


def test_strides_are_cut_where_the_phase_of_the_subsystem_begins_again(trial):
    found = trial.strides("left/knee.position")
    assert found.shape == (8, 101)  # 10 s less the 0.5 s that nobody walks, and the torn ones at both ends
    expected = np.sin(np.pi * np.arange(101) / 100) ** 2
    assert np.abs(found - expected).max() < 2e-3
    assert trial.strides("left/imu.quaternion").shape == (8, 101, 4)


def test_strides_begin_at_given_events(trial):
    strikes = 1.1 * np.arange(3)
    assert trial.strides("left/knee.position", events=strikes).shape == (2, 101)
    assert trial.strides("left/knee.position", events=strikes, points=11).shape == (2, 11)
    assert trial.strides("left/knee.position", events=[1.1, 1.2, 7.0]).shape == (0, 101)  # too short, too long
    assert trial.strides("left/knee.position", events="left/gait.phase").shape == (8, 101)


def test_a_contact_that_becomes_true_is_a_heel_strike(tmp_path):
    rows = [(tick, float(tick % 200 < 100), tick / 200) for tick in range(1000)]
    found = runtime.load(recorded(tmp_path, rows, signals=("foot.contact 1 bool", "clock.t s")))
    strides = found.strides("clock.t", events="foot.contact")
    assert strides.shape == (3, 101) and np.allclose(strides[0], 1.0 + np.arange(101) / 100)


def test_a_stride_with_a_missing_tick_is_left_out(tmp_path):
    whole = runtime.load(recorded(tmp_path, walk(range(1000)), stem="whole"))
    torn = runtime.load(recorded(tmp_path, walk(tick for tick in range(1000) if tick != 500), stem="torn"))
    assert len(torn.strides("left/knee.position")) == len(whole.strides("left/knee.position")) - 1


def test_several_trials_are_one_table_with_their_fields(tmp_path):
    for number, condition in enumerate(("assist", "none")):
        signals = SIGNALS if number == 0 else SIGNALS[:-1]
        rows = [values[: 1 + len(signals)] for values in walk(range(10 * (number + 1)))]
        recorded(
            tmp_path, rows, f"trial{number}", signals, metadata={"trial": {"subject": "S03", "condition": condition}}
        )
    trials = runtime.load(tmp_path / "*.mcap")
    assert (
        len(trials) == 2 and trials.fields == ["subject", "condition"] and [len(trial) for trial in trials] == [10, 20]
    )
    assert trials["condition"].tolist() == ["assist"] * 10 + ["none"] * 20 and trials["trial"][-1] == "trial1"
    assert trials["left/imu.quaternion"].shape == (30, 4) and trials.time[10] == 0.0
    assert np.isnan(trials["left/knee.position"][10:]).all() and not np.isnan(trials["left/knee.position"][:10]).any()
    with pytest.raises(KeyError, match="has no signal 'nothing'"):
        trials["nothing"]
    with pytest.raises(BadInput, match="no such recording"):
        runtime.load(tmp_path / "other*.mcap")


def test_trial_with_killed_recorder_is_one_trial(tmp_path):
    rows = list(walk(range(300)))
    recorded(tmp_path, rows[:110], "cut")  # ten rows more than the next part takes for granted
    recorded(tmp_path, rows[100:200], "cut_part2", part=2)
    (tmp_path / "cut_part3.mcap").write_bytes(b"")  # whose recorder was killed before its first tick
    recorded(tmp_path, rows[200:], "cut_part4", part=4)
    cut = runtime.load(tmp_path / "cut.mcap")
    assert np.array_equal(np.column_stack((cut.tick, cut.rows)), rows) and cut.complete
    assert [path.name for path in cut.parts] == ["cut.mcap", "cut_part2.mcap", "cut_part4.mcap"]
    assert [trial.path.name for trial in runtime.load(tmp_path / "*.mcap")] == ["cut.mcap"]
    assert runtime.load(tmp_path / "cut_part2.mcap").tick.tolist() == list(range(100, 300))
    (tmp_path / "late.mcap").write_bytes(b"")  # nothing of it was sure, and the next one began anew
    (tmp_path / "cut_part2.mcap").rename(tmp_path / "late_part2.mcap")
    late = runtime.load(tmp_path / "late.mcap")
    assert late.path.name == "late.mcap" and len(late) == 100 and late.about["part"] == 1
    head = late.parts[0].read_bytes()
    (tmp_path / "late_part2.mcap").rename(tmp_path / "late_part3.mcap")
    (tmp_path / "late_part2.mcap").write_bytes(head[: head.index(b"about.json") - 40])  # nor of the next one
    with pytest.raises(BadInput, match="late.mcap was truncated before its first tick"):
        runtime.load(tmp_path / "late.mcap")  # its third part says that it is the second
    (tmp_path / "late_part3.mcap").unlink()
    recorded(tmp_path, rows[100:200], "late_part3", part=3)
    late = runtime.load(tmp_path / "late.mcap")
    assert [path.name for path in late.parts] == ["late_part3.mcap"] and len(late) == 100
    recorded(tmp_path, rows[:50], "other", signals=SIGNALS)
    recorded(tmp_path, [values[:-1] for values in rows[50:]], "other_part2", signals=SIGNALS[:-1], part=2)
    assert len(runtime.load(tmp_path / "other.mcap")) == 50  # of a run of something else


def test_pandas_gets_units_and_fields(tmp_path, trial):
    pandas = pytest.importorskip("pandas")
    table = trial.table()
    assert (
        table.index.name == "time"
        and table["left/knee.fault"].dtype == np.int64
        and table.attrs["units"]["left/knee.position"] == "rad"
    )
    assert np.array_equal(table["left/knee.position"].to_numpy(), trial["left/knee.position"])
    recorded(tmp_path, walk(range(5)), "one", metadata={"trial": {"subject": "S03"}})
    recorded(tmp_path, walk(range(7)), "two", metadata={"trial": {"condition": "none"}})
    both = runtime.load(tmp_path / "*.mcap").table()
    assert isinstance(both, pandas.DataFrame) and list(both.columns[:5]) == [
        "trial",
        "subject",
        "condition",
        "time",
        "tick",
    ]
    assert (
        both.groupby("trial")["tick"].count().tolist() == [5, 7]
        and both["condition"].tolist() == [""] * 5 + ["none"] * 7
    )


def test_a_missing_library_is_reported_with_its_extra(monkeypatch, trial):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingExtra, match=r"a table needs pandas: pip install 'tickwork\[tables\]'"):
        trial.table()


def test_every_extra_is_declared():
    declared = PYPROJECT["project"]["optional-dependencies"]
    names = {"rerun": "rerun-sdk", "zenoh": "eclipse-zenoh"}
    for module, extra in EXTRAS.items():
        assert any(requirement.startswith(names.get(module, module)) for requirement in declared[extra]), extra
    assert need("json", "nothing").loads("1") == 1


def test_stride_start_is_required_without_gait_phase(tmp_path):
    found = runtime.load(recorded(tmp_path, [(0, 1.0), (1, 2.0)], signals=("right/knee.position rad",)))
    with pytest.raises(BadInput, match="subsystem 'right' has no gait phase: specify the start of strides"):
        found.strides("right/knee.position")

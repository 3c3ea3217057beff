"""Several recordings as one table, and gait analysis stride by stride."""

import os

import numpy as np
import pytest

import runtime
from runtime.host.errors import BadInput
from runtime.record.storage.parts import newest
from tests.runtime.record.recorder.running import CSV, columns, plan, record, row, sink
from tests.shared import shared


def recorded(path, signals, rows, **fields):
    """A recording of that path, and the Trial of it."""
    record(
        plan(path.parent, sink(CSV, "csv", columns(*signals)), stem=path.stem, metadata={"trial": fields}),
        [row(*values) for values in rows],
    )
    return runtime.load(path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two trials of one name, of which the second has its angle in another unit, and more of it; and fields that are
    called as columns of all are.
    """
    folder = tmp_path_factory.mktemp("trials")
    recorded(
        folder / "S01" / "walk.mcap",
        ("knee.angle rad", "imu.gyro[0] rad/s", "imu.gyro[1] rad/s", "a.n 1 int"),
        [(0, 1, 2, 3, 4)] * 2,
        time="noon",
        trial="7",
        subject="S01",
    )
    recorded(
        folder / "S02" / "walk.mcap",
        ("knee.angle deg", "imu.gyro[0] rad/s", "a.n 1 int"),
        [(0, 1, 2, 3)],
        subject="S02",
    )
    return folder


@pytest.mark.soak
def test_nested_folders_form_one_table_with_distinct_names(folder):
    trials = runtime.load(folder / "**" / "*.mcap")
    assert trials["trial"].tolist() == ["S01/walk"] * 2 + ["S02/walk"] and trials["a.n"].tolist() == [4, 4, 3]
    assert runtime.load(folder / "S0[12]" / "*.mcap")["subject"].tolist() == ["S01", "S01", "S02"]


def test_a_folder_stands_for_its_newest_recording_with_all_parts(folder, tmp_path, command_line):
    assert runtime.load(folder / "S01").path == folder / "S01" / "walk.mcap"
    assert command_line("plot", folder / "S02", "-o", "walk.svg")[0] == 0
    for age, name in enumerate(("new_part2.mcap", "new.mcap", "old.mcap")):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (1000 - age, 1000 - age))
    assert newest(tmp_path).name == "new.mcap"


def test_a_field_named_like_a_standard_column_is_prefixed(folder):
    pytest.importorskip("pandas")
    trials = runtime.load([folder / "S01" / "walk.mcap"])
    assert trials.fields == ["trial.time", "trial.trial", "subject"] and trials["trial.time"].tolist() == ["noon"] * 2
    table = trials.table()
    assert (
        list(table.columns[:6]) == ["trial", "trial.time", "trial.trial", "subject", "time", "tick"]
        and table["trial.trial"][0] == "7"
    )


def test_trials_with_different_units_or_shapes_are_rejected(folder):
    pytest.importorskip("pandas")
    trials = runtime.load(folder / "*" / "*.mcap")
    with pytest.raises(
        BadInput,
        match=r"^knee.angle differs between trials: \[rad\] in S01/walk, \[deg\] in "
        r"S02/walk\. Load",
    ):
        trials["knee.angle"]
    with pytest.raises(
        BadInput,
        match=r"imu.gyro differs between trials: \[rad/s\] of 2 in .*, \[rad/s\] of "
        r"1 in ",
    ):
        trials["imu.gyro"]
    with pytest.raises(BadInput, match="knee.angle differs between"):
        trials.table()


def test_folder_without_recordings_is_refused():
    with pytest.raises(BadInput, match=r"load\(\[\]\): name a recording"):
        runtime.load([])


def test_a_trial_without_a_tick_has_no_strides(tmp_path):
    trial = recorded(tmp_path / "none.mcap", ("knee.angle rad",), [])
    assert trial.strides("knee.angle", events=[0.0, 1.0]).shape == (0, 101) and trial.stride_times(
        "knee.angle", events=[0.0, 1.0]
    ).shape == (0, 2)


def test_the_strides_of_a_recorded_walk_are_those_between_its_heel_strikes(tmp_path):
    """Knee flexion of walking, at 101 points from one heel contact to the next, of either leg."""
    walk = np.genfromtxt(shared("gait/healthy_young.csv"), delimiter=",", names=True)
    time, sides = walk["time"], {"left": "lt", "right": "rt"}
    signals = [text for side in sides for text in (f"{side}/knee.position rad", f"{side}/foot.contact 1 bool")]
    values = [
        column
        for short in sides.values()
        for column in (np.radians(walk[f"knee_flexion_{short}_deg"]), walk[f"contact_{short}"] > 500)
    ]
    rows = np.column_stack((np.arange(len(time)), *values))
    trial = recorded(tmp_path / "walk.mcap", signals, rows.tolist())
    for number, side in enumerate(sides):
        angle, contact = values[2 * number], values[2 * number + 1]
        strikes = time[1:][contact[1:] & ~contact[:-1]]
        expected = [np.interp(np.linspace(*ends, 101), time, angle) for ends in zip(strikes[:-1], strikes[1:])]
        found = trial.strides(f"{side}/knee.position", events=f"{side}/foot.contact")
        assert len(found) == len(strikes) - 1 > 40 and np.abs(found - expected).max() < 1e-9
        assert trial.stride_times(f"{side}/knee.position", f"{side}/foot.contact") == pytest.approx(
            np.column_stack((strikes[:-1], strikes[1:]))
        )
        missed = np.delete(strikes, 10)  # one was not heard: a stride that lasts twice as long, and stands out
        lasting = np.diff(trial.stride_times(f"{side}/knee.position", missed)).ravel()
        assert np.flatnonzero(lasting > 1.5 * np.median(lasting)).tolist() == [9]
        assert len(trial.strides(f"{side}/knee.position", events=strikes[:1])) == 0
        # the last is not whole
        assert len(trial.strides(f"{side}/knee.position", events=[*strikes[-2:], time[-1] + 1.0])) == 1


def test_a_link_to_a_recording_that_was_moved_is_not_the_newest(tmp_path):
    path = tmp_path / "trial.mcap"
    path.touch()
    (tmp_path / "moved.mcap").symlink_to(tmp_path / "nowhere.mcap")
    (tmp_path / "loop.mcap").symlink_to(tmp_path / "loop.mcap")
    assert newest(tmp_path) == path

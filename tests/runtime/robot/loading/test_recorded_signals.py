"""The parameter `record` of a recorder: which signals a run records."""

from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

import runtime
from runtime.host.errors import BAD_INPUT, OK, BadInput
from tests.runtime.runs import finished, write

ROBOT = """
from blocks.actuators import CubeMars
from blocks.limiters import TorqueLimiter
from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler
from graph import Diagram, subsystem

def build():
    with Diagram("robot", rate=200) as diagram:
        for number, side in enumerate(("left", "right"), 1):
            with subsystem(side):
                knee = CubeMars("AK10-9-V2.0", bus="legs", can_id=number, name="knee")
                knee(torque_command=TorqueLimiter(limit=5.0)(0.1))
        CsvRecorder({record})
        PlotJuggler()
    return diagram
"""
SELECTED = ["left/knee.torque", "right/knee.position", "right/knee.torque"]


@pytest.fixture
def robot(tmp_path):
    return write(tmp_path, ROBOT.format(record='record="*/knee.torque, right/knee.position"'))


def recording(folder):
    [path] = (folder / "recordings").glob("*.mcap")
    return path


def test_only_selected_signals_are_in_the_files(robot, command_line):
    assert command_line(robot, "--fast", "--duration", "0.5")[0] == OK
    path = recording(command_line.folder)
    trial = runtime.load(path)
    assert sorted(trial.signals) == SELECTED and len(trial) == 100 and len(trial.frames) > 200
    header = path.with_suffix(".csv").read_text().splitlines()[0]
    assert header == "time [s],tick," + ",".join(
        f"{name} [{'rad' if 'position' in name else 'N*m'}]" for name in trial.signals
    )


def test_selected_values_are_those_of_a_complete_recording(robot, tmp_path):
    everything = runtime.run(write(tmp_path, ROBOT.format(record=""), "complete.py"), duration=0.5)
    some = runtime.run(robot, duration=0.5)
    assert sorted(some.signals) == SELECTED and len(everything.signals) > 10
    for path in SELECTED:
        assert some[path].tolist() == everything[path].tolist()


def test_selection_is_a_setting_and_is_replayed(robot, command_line):
    words = ("--set", "csv_recorder.record=left")
    assert command_line(robot, "--fast", "--duration", "0.5", *words)[0] == OK
    path = recording(command_line.folder)
    names = runtime.load(path).names
    assert "left/knee.position" in names and all(name.startswith("left/") for name in names)
    code, out, _ = command_line("replay", path)
    assert code == OK and f"all {len(runtime.load(path).signals)} signals" in out and "bit for bit" in out


def test_inputs_of_other_sinks_are_recorded(command_line):
    from tests.runtime.runs import KNEE_EXO

    code, out, _ = command_line(KNEE_EXO, "--fast", "--duration", "1", "--set", "csv_recorder.record=*/gate.y")
    assert code == OK and "no complete stride" in out
    names = set(runtime.load(recording(command_line.folder)).names)
    assert {"left/gate.y", "right/gate.y", "left/knee.position"} <= names
    assert "left/knee.current" not in names and "left/profile.torque" not in names


def test_a_selection_without_a_signal_is_rejected(tmp_path, command_line):
    robot = write(tmp_path, ROBOT.format(record='record="left/kne.torque"'))
    code, _, err = command_line(robot, "--fast", "--duration", "0.5")
    assert code == BAD_INPUT
    assert "csv_recorder: record: there is no signal 'left/kne.torque'; did you mean" in err


SLOW = "CsvRecorder(every=4)\n        CsvRecorder(record='*/knee.torque', file='fast')"


@pytest.fixture(scope="module")
def rates(tmp_path_factory):
    """A complete Trial, and the file and the recording of a robot with all but its torques at every fourth tick."""
    folder = tmp_path_factory.mktemp("rates")
    everything = runtime.run(write(folder, ROBOT.format(record=""), "complete.py"), duration=5.0)
    robot = write(folder, ROBOT.replace("CsvRecorder({record})", SLOW))
    assert finished(robot, "--fast", "--duration", "5", cwd=folder).returncode == OK
    return everything, robot, recording(folder)


def test_signals_of_a_lower_rate_are_the_samples_of_a_complete_recording(rates):
    everything, robot, path = rates
    trial, memory = runtime.load(path), runtime.run(robot, duration=5.0)
    assert trial.complete and len(trial) == 1000 and trial.names == everything.names
    for some in (trial, memory, runtime.load(path).between(1.0, 3.01)):
        for name in trial.names:
            every = 1 if name.endswith("knee.torque") else 4
            kept = np.flatnonzero(np.isin(everything.time, some.time) & (everything.tick % every == 0))
            assert some[name].tolist() == everything[name][kept].tolist() and some[name].dtype == everything[name].dtype
            assert some.time_of(name).tolist() == everything.time[kept].tolist()
    batches = np.concatenate([batch.rows for batch in trial.batches()])
    assert np.array_equal(batches[:, 2:], trial.rows, equal_nan=True)
    assert np.isnan(trial.column("left/knee.position")[1]) and not np.isnan(trial.column("left/knee.torque")).any()
    assert trial.resample(200)["left/knee.position"][8] == everything["left/knee.position"][8]


def test_lower_rates_are_separate_channels_of_a_smaller_file(rates):
    _, _, path = rates
    with open(path, "rb") as file:
        summary: Any = make_reader(file).get_summary()
    topics = {channel.topic: summary.statistics.channel_message_counts[id] for id, channel in summary.channels.items()}
    assert topics["/left"] == topics["/right"] == topics["/tickwork/tick"] == 1000
    assert topics["/left_every_4"] == topics["/right_every_4"] == 250
    lines = path.with_suffix(".csv").read_text().splitlines()
    fast = (path.parent / "fast.csv").read_text().splitlines()
    assert len(lines) == 251 and [line.split(",")[1] for line in lines[1:4]] == ["0", "4", "8"]
    assert len(fast) == 1001 and fast[0] == "time [s],tick,left/knee.torque [N*m],right/knee.torque [N*m]"
    assert len(lines[0].split(",")) == 2 + len(runtime.load(path).signals)


def test_recording_of_lower_rates_is_replayed_and_converted(rates, command_line):
    _, _, path = rates
    code, out, _ = command_line("replay", path)
    assert code == OK and f"all {len(runtime.load(path).signals)} signals" in out and "bit for bit" in out
    assert command_line("convert", path, "--to", "mcap,csv,sto", "-o", command_line.folder)[0] == OK
    copied = runtime.load(command_line.folder / path.name)
    assert np.array_equal(copied.rows, runtime.load(path).rows, equal_nan=True) and copied.complete
    cells = (command_line.folder / f"{path.stem}.csv").read_text().splitlines()[2].split(",")
    assert (
        cells.count("nan") == len(copied.signals) - 2
        and "nan" not in (command_line.folder / f"{path.stem}.sto").read_text()
    )


def test_cut_recording_of_lower_rates_is_a_prefix(rates, tmp_path):
    _, _, path = rates
    data, whole, part = path.read_bytes(), runtime.load(path), tmp_path / "cut.mcap"
    for end in (len(data) // 2, len(data) * 3 // 4, len(data) - 100):
        part.write_bytes(data[:end])
        trial = runtime.load(part)
        assert not trial.complete and 0 < len(trial) <= 1000
        assert np.array_equal(trial.rows, whole.rows[: len(trial)], equal_nan=True)
        samples = trial["left/knee.position"]
        assert len(samples) == (len(trial) + 3) // 4 and (samples == whole["left/knee.position"][: len(samples)]).all()


def test_recorder_that_is_alone_and_slower_records_no_other_samples(tmp_path):
    source = ROBOT.replace("CsvRecorder({record})", "CsvRecorder(record='left', every=50)")
    trial = runtime.run(write(tmp_path, source), duration=1.0)
    assert {trial.every(path) for path in trial.names} == {50} and len(trial) == 200
    assert len(trial["left/knee.position"]) == 4 and not any(name.startswith("right") for name in trial.names)


@pytest.mark.parametrize("every", ["0", "1.5", "True"])
def test_period_that_is_no_whole_number_of_ticks_is_refused(tmp_path, every):
    with pytest.raises(BadInput, match="every must be a whole number of ticks, 1 or more, got"):
        runtime.run(write(tmp_path, ROBOT.format(record=f"every={every}")), duration=0.5)

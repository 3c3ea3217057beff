"""The parameter `record` of a recorder: which signals a run records."""

import pytest

import runtime
from runtime.base.errors import BAD_INPUT, OK
from tests.runtime.runs import write

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


def test_inputs_of_other_sinks_are_recorded_as_well(command_line):
    from tests.runtime.runs import KNEE_EXO

    code, out, _ = command_line(KNEE_EXO, "--fast", "--duration", "1", "--set", "csv_recorder.record=*/damper.torque")
    assert code == OK and "no complete stride" in out
    names = set(runtime.load(recording(command_line.folder)).names)
    assert {"left/damper.torque", "right/damper.torque", "left/knee.position"} <= names
    assert "left/knee.current" not in names and "left/profile.torque" not in names


def test_name_without_a_signal_is_refused(tmp_path, command_line):
    robot = write(tmp_path, ROBOT.format(record='record="left/kne.torque"'))
    code, _, err = command_line(robot, "--fast", "--duration", "0.5")
    assert code == BAD_INPUT
    assert "csv_recorder: record: there is no signal 'left/kne.torque'; did you mean" in err

"""Pictures of recordings: what stands in them, read from their SVG, and where they go."""

import json
import re
import sys

import numpy as np
import pytest

import runtime
from runtime.errors import FAULT, OK
from runtime.recordings import pictures
from runtime.recordings.strides import bounds
from tests.runtime.recorder.running import CSV, columns, plan, record, row, sink
from tests.runtime.recordings.test_trial import walk
from tests.runtime.runs import KNEE_EXO, knee

WALK = ("left/imu.quaternion[0] 1", "left/imu.quaternion[1] 1", "left/imu.quaternion[2] 1", "left/imu.quaternion[3] 1",
        "left/gait.phase 1", "left/gait.walking 1 bool", "left/knee.fault 1 int", "left/knee.position rad")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("walk")
    record(plan(folder, sink(CSV, "csv", columns(*WALK)), stem="walk"), [row(*values) for values in walk(range(1000))])
    return folder / "walk.mcap"


def drawn(path):
    """The texts of an SVG: matplotlib writes them as comments beside their outlines."""
    return set(re.findall(r"<!-- (.*?) -->", open(path, encoding="utf-8").read()))


def test_signals_are_drawn_with_their_units_on_the_axes(command_line, recording):
    code, out, err = command_line("plot", recording, "left/knee.position", "left/gait.phase", "-o", "a.svg")
    assert (code, out, err) == (OK, "a.svg\n", "")
    assert {"[rad]", "time [s]", "left/knee.position", "left/gait.phase"} <= drawn("a.svg")           # which leg, too


def test_without_matplotlib_it_says_how_to_get_it(command_line, recording, monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert command_line.refused("plot", recording, "left/knee.position") == "a picture needs matplotlib: pip install matplotlib"


def test_with_none_named_each_subsystem_has_its_picture(command_line, tmp_path):
    assert command_line(KNEE_EXO, "--fast", "--duration", "5", "--record", tmp_path / "run")[0] == OK
    [path] = (tmp_path / "run").glob("*.mcap")
    code, out, err = command_line("plot", path, "--svg")
    left, right = out.split()
    assert (code, err) == (OK, "") and left.endswith("_left.svg") and right.endswith("_right.svg")
    assert {"[rad]", "[N·m]", "knee.torque", "knee.position", "limit"} <= drawn(left)
    again = command_line("plot", path, "--svg")[1].split()
    assert again == [name.replace(".svg", "-2.svg") for name in (left, right)]               # nothing is overwritten
    png = command_line("plot", path, "left/knee.torque")[1].strip()
    assert png.endswith("_plot.png") and open(png, "rb").read(8) == b"\x89PNG\r\n\x1a\n"


def test_a_fault_and_a_mark_stand_in_the_picture(command_line, tmp_path):
    path = knee(tmp_path, "return 1.0 if tick < 150 else math.nan")
    assert command_line(path, "--fast", "--duration", "2", "--record", tmp_path / "run")[0] == FAULT
    [file] = (tmp_path / "run").glob("*.mcap")
    command_line("plot", file, "knee.torque", "-o", "fault.svg")
    assert any(text.startswith("fault: ") and "at knee" in text for text in drawn("fault.svg"))
    [(at, words, colour)] = pictures.moments(runtime.load(file))
    assert at == 0.75 and colour == pictures.FAULT


def test_the_spells_of_a_fault_code_are_found():
    assert pictures.spells(np.array([0, 1, 1, 0, 0, 1], dtype=bool)) == [(1, 2), (5, 5)]
    assert pictures.spells(np.zeros(3, dtype=bool)) == []


def test_the_average_stride_has_angle_assistance_and_power_of_both_legs(command_line, tmp_path):
    assert command_line(KNEE_EXO, "--fast", "--duration", "10", "--record", tmp_path / "run")[0] == OK
    [path] = (tmp_path / "run").glob("*.mcap")
    code, out, err = command_line("plot", path, "--strides", "-o", "strides.svg")
    assert (code, out, err) == (OK, "strides.svg\n", "")
    assert {"left", "right", "angle [deg]", "torque [N·m]", "power [W]", "gait cycle [%]"} <= drawn("strides.svg")
    trial = runtime.load(path)
    for found, told in zip(pictures.legs(trial), (stride for stride in sidecar(path)["strides"])):
        assert (found["title"], found["strides"]) == (told["title"], told["strides"])
        assert found["stride_time"] == pytest.approx(told["stride_time"], abs=0.006)                 # between samples here, at one there
        assert (found["positive_work"], found["negative_work"]) == pytest.approx(work(trial, found["path"]), rel=0.01)
        assert np.allclose(found["curves"]["torque"]["mean"], told["curves"]["torque"]["mean"], atol=0.6)


def work(trial, stem):
    """J a stride, of every sample of the strides: what is drawn is made of 101 points of each."""
    power, found = trial[f"{stem}.velocity"] * trial[f"{stem}.torque"], []
    for first, last in bounds(trial, f"{stem}.position"):
        inside = power[(trial.time >= first) & (trial.time < last)] / 200
        found.append((inside[inside > 0].sum(), inside[inside < 0].sum()))
    return np.mean(found, axis=0)


def sidecar(path):
    return json.loads(path.with_suffix(".json").read_text())


def test_one_signal_over_the_gait_cycle(command_line, recording):
    code, out, err = command_line("plot", recording, "--strides", "left/knee.position", "-o", "one.svg")
    assert (code, err) == (OK, "") and {"[rad]", "gait cycle [%]"} <= drawn("one.svg")
    assert any(re.fullmatch(r"left/knee.position, \d strides", text) for text in drawn("one.svg"))


def test_what_cannot_be_drawn_is_told_in_one_line(command_line, recording, tmp_path):
    assert "has no signal 'left/knee.posiion': did you mean 'left/knee.position'?" in command_line.refused("plot", recording, "left/knee.posiion")
    assert command_line.refused("plot", recording, "-o", "a.jpg") == "-o a.jpg: a picture ends in .png or .svg"
    assert "holds no whole stride of a joint" in command_line.refused("plot", recording, "--strides")
    assert command_line.refused("plot", recording, "--events", "x") == "--events needs --strides"
    assert "No such file" in command_line.refused("plot", recording, "-o", tmp_path / "nowhere" / "a.png")
    assert "has 4 elements: name one" in command_line.refused("plot", recording, "--strides", "left/imu.quaternion")

"""An adult fitted to a recording: against a drawn adult, and against strides of a recorded one that it has not seen."""

import json

import numpy as np
import pytest

from blocks.wearer import Walker, fit, walking_speed
from blocks.wearer.adults import JOINTS
from blocks.wearer.stride import PHASES
from graph import Diagram, DiagramError
from tests.blocks.wearer.test_walker import walk
from tests.shared import shared

COLUMNS = {"hip": "hip_flexion", "knee": "knee_flexion", "ankle": "ankle_dorsiflexion"}


def peaks_of(person, stride_time):
    """Range in degrees, peak velocity and acceleration of each joint of a Walker with a stride time in s."""
    speed = walking_speed(stride_time, person=person)
    trace = walk(4.0, 500, speed=speed, person=person, variability=0.0)
    begin, end = (np.flatnonzero(np.diff(trace["left_phase"]) < -0.5) + 1)[1:3]
    time = (end - begin) / 500
    assert time == pytest.approx(stride_time, abs=0.01)
    at = np.interp(PHASES, trace["left_phase"][begin:end], np.arange(begin, end))
    curves = [np.interp(at, np.arange(len(trace["time"])), trace[f"left_{joint}_angle"]) for joint in JOINTS]
    return np.array([fit.figures(curve, time) for curve in curves])


@pytest.mark.parametrize("pace", [1.0, 0.8])
def test_fit_of_a_drawn_adult_has_the_peaks_of_that_adult(tmp_path, pace):
    """Also of one whose strides are short for their time: the same motion in 0.8 of it."""
    speed = walking_speed(1.1, person=4)
    trace = walk(12.0, 200, speed=speed, person=4)
    angles = [np.degrees(trace[f"{side}_{joint}_angle"]) for side in ("left", "right") for joint in JOINTS]
    contacts = [trace[f"{side}_contact"] for side in ("left", "right")]
    names = [f"{COLUMNS[joint]}_{side}_deg" for side in ("lt", "rt") for joint in JOINTS]
    table = np.column_stack([pace * trace["time"], *angles, *contacts])
    header = ",".join(["time", *names, "contact_lt", "contact_rt"])
    np.savetxt(tmp_path / "walk.csv", table, delimiter=",", header=header, comments="")
    assert fit.main([str(tmp_path / "walk.csv"), str(tmp_path / "adult.json")]) == 0
    fitted = str(tmp_path / "adult.json")
    assert peaks_of(fitted, pace * 1.1)[:, :2] == pytest.approx(peaks_of(4, 1.1)[:, :2] / [1.0, pace], rel=0.10)
    slow, usual = (peaks_of(person, 1.3) for person in (fitted, 0))
    assert np.abs(slow / usual - 1.0).max() > 0.03, "the adult differs from the average at other speeds as well"


@pytest.mark.soak
def test_peaks_of_the_strides_that_the_fit_has_not_seen_are_within_15_percent(tmp_path, capsys):
    """Fitted to 25 s of the young adult of Wiles 2023, compared with the mean of both legs in the other 25 s."""
    lines = shared("gait/healthy_young.csv").read_text().splitlines(keepends=True)
    for name, part in (("seen", lines[1:5001]), ("other", lines[5001:])):
        (tmp_path / f"{name}.csv").write_text("".join([lines[0], *part]))
    assert fit.main([str(tmp_path / "seen.csv"), str(tmp_path / "adult.json")]) == 0
    assert "difference of left and right (RMS): hip 2" in capsys.readouterr().out
    stride_time, legs = fit.strides(str(tmp_path / "other.csv"))
    recorded = np.mean([[fit.figures(c, stride_time) for c in np.median(leg, axis=0)] for leg in legs], axis=0)
    assert peaks_of(str(tmp_path / "adult.json"), stride_time) == pytest.approx(recorded, rel=0.15)


def test_files_that_are_no_fit_and_recordings_without_strides_are_rejected(tmp_path, capsys):
    (tmp_path / "adult.json").write_text(json.dumps({"angles": {"hip": [1.0]}}))
    with Diagram("walk", rate=200), pytest.raises(DiagramError, match="is not a fitted adult: make one with python -m"):
        Walker(person=str(tmp_path / "adult.json"))
    with Diagram("walk", rate=200), pytest.raises(DiagramError, match="No such file"):
        Walker(person=str(tmp_path / "none.json"))
    trace = walk(2.0, 200, speed=1.2)
    columns = [trace["time"], *(np.degrees(trace[f"left_{joint}_angle"]) for joint in JOINTS)]
    header = ",".join(["time", *(f"{COLUMNS[joint]}_lt_deg" for joint in JOINTS)])
    np.savetxt(tmp_path / "short.csv", np.column_stack(columns), delimiter=",", header=header, comments="")
    assert fit.main([str(tmp_path / "short.csv"), str(tmp_path / "adult.json")]) == 2
    assert "at least 5 strides of each leg are required" in capsys.readouterr().err
    assert fit.main([]) == 2 and "usage" in capsys.readouterr().err

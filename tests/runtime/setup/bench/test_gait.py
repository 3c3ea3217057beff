"""`bench gait`: its figures, compared with the goals, on the built-in walk and on a recording."""

import json

import pytest

from runtime.host.errors import BAD_INPUT, OK
from runtime.setup.bench import gait, gait_recordings
from tests.bench.goals import GOALS
from tests.shared import shared


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setattr(gait_recordings, "DURATION", 45.0)


def test_the_estimators_reach_their_goals_on_the_built_in_walk(command_line, short):
    code, out, err = command_line("bench", "gait", "--json")
    report = json.loads(out)
    goals = GOALS["gait"](report)
    assert (code, err) == (OK, "")
    assert [goal.what for goal in goals if not goal.reached] == []
    assert len(goals) == 15
    assert set(report["gait"][0]["estimators"]["contact: time"]) == set(gait.CONDITIONS)


@pytest.mark.soak
def test_the_estimators_reach_their_goals_on_a_recorded_person(command_line):
    code, out, _ = command_line("bench", "gait", "--json", str(shared("gait/healthy_young.csv")))
    report = json.loads(out)
    goals = GOALS["gait"](report)
    assert code == OK and [leg["leg"] for leg in report["gait"]] == ["left", "right"]
    assert [goal.what for goal in goals if not goal.reached] == []


def test_a_file_without_a_leg_is_rejected(command_line, tmp_path):
    (tmp_path / "walk.csv").write_text("time,knee_flexion_lt_deg\n" + "".join(f"{k / 100},1\n" for k in range(200)))
    code, _, err = command_line("bench", "gait", "walk.csv")
    assert code == BAD_INPUT and "walk.csv has no leg with a contact and an angle" in err
    (tmp_path / "empty.csv").write_text(
        "time,contact_lt,knee_flexion_lt_deg\n" + "".join(f"{k / 100},,1\n" for k in range(200))
    )
    code, _, err = command_line("bench", "gait", "empty.csv")
    assert code == BAD_INPUT and "empty.csv has no leg with a contact and an angle" in err
    (tmp_path / "back.csv").write_text(
        "time,contact_lt,knee_flexion_lt_deg\n" + "".join(f"{(k % 150) / 100},0,1\n" for k in range(200))
    )
    code, _, err = command_line("bench", "gait", "back.csv")
    assert code == BAD_INPUT and "back.csv: the time must increase, got 0 s after 1.49 s" in err
    code, _, err = command_line("bench", "gait", "--signal", "head=x")
    assert code == BAD_INPUT and "--signal head: expected left.thigh" in err


def test_missed_and_invented_strikes_are_counted():
    walk = gait.play(gait_recordings.built_in()[0], "steady", 100.0)
    exact = gait.errors(walk, walk.strikes, walk.phase)
    assert (exact["missed"], exact["invented"], exact["median_ms"], exact["phase_rms_percent"]) == (0, 0, 0.0, 0.0)
    shifted = gait.errors(walk, walk.strikes + 0.02, walk.phase + 0.1)
    assert shifted["median_ms"] == pytest.approx(20.0) and shifted["phase_rms_percent"] == pytest.approx(10.0)
    lost = gait.errors(walk, [*walk.strikes[:20], *walk.strikes[21:], walk.strikes[25] + 0.5], walk.phase)
    assert (lost["missed"], lost["invented"]) == (1, 1)

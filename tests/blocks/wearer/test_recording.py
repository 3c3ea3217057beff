"""Recorded motion of the walking adult."""

import numpy as np
import pytest

from blocks.wearer import Walker
from graph import Diagram, DiagramError
from tests.blocks.wearer.test_walker import walk
from tests.shared import shared

COLUMNS = ("hip_flexion", "knee_flexion", "ankle_dorsiflexion")


def written(path, seconds=12.0, rate=100, period=1.2, header=None, opensim=False):
    """A walk of sines: the left leg furthest in front at multiples of the period."""
    t = np.arange(round(seconds * rate)) / rate
    columns = [t]
    for shift in (0.0, 0.5):
        turn = 2.0 * np.pi * (t / period + shift)
        columns += [5 + 25 * np.cos(turn), 30 - 25 * np.cos(turn - 1.0), 5 * np.sin(turn)]
    names = [f"{column}_{side}_deg" for side in ("lt", "rt") for column in COLUMNS]
    if opensim:
        names = [f"{column}_{side}" for side in "lr" for column in ("hip_flexion", "knee_angle", "ankle_angle")]
    separator = "\t" if opensim else ","
    rows = (separator.join(f"{value:.9f}" for value in row) for row in zip(*columns))
    head = "walk\ninDegrees=yes\nendheader\n" if opensim else ""
    path.write_text(head + separator.join(["time", *names]) + "\n" + "\n".join(rows) + "\n")
    return str(path)


@pytest.mark.parametrize("opensim", [False, True])
def test_recording_is_played_with_smooth_derivatives_and_repeats(tmp_path, opensim):
    file = written(tmp_path / ("walk.mot" if opensim else "walk.csv"), opensim=opensim)
    trace = walk(25.0, recording=file)
    t = trace["time"]
    inside = t < 9.0
    hip = np.radians(5 + 25 * np.cos(2.0 * np.pi * t / 1.2))
    later = inside & (t > 0.4)
    assert np.abs(trace["left_hip_angle"] - hip)[later].max() < 0.002
    velocity, acceleration = trace["right_knee_velocity"], trace["right_knee_acceleration"]
    assert np.abs(np.gradient(trace["right_knee_angle"], t) - velocity)[1:-1].max() < 0.01
    assert np.abs(acceleration).max() < 1.5 * np.radians(25) * (2.0 * np.pi / 1.2) ** 2  # also at the seam
    strikes = np.flatnonzero(np.diff(trace["left_phase"][later]) < -0.5)
    assert np.diff(t[later][strikes]) == pytest.approx(1.2, abs=0.02)
    assert np.abs(hip[later][strikes] - hip.max()).max() < 0.05
    assert np.corrcoef(trace["left_ground_force[1]"][later], trace["right_ground_force[1]"][later])[0, 1] < -0.5


def test_recorded_adult_strikes_the_ground_where_the_contact_was_measured():
    file = shared("gait/healthy_young.csv")
    data = np.genfromtxt(file, delimiter=",", names=True)
    trace = walk(20.0, rate=200, recording=str(file))
    for side, short in (("left", "lt"), ("right", "rt")):
        for joint, column in zip(("hip", "knee", "ankle"), COLUMNS):
            error = np.degrees(trace[f"{side}_{joint}_angle"]) - data[f"{column}_{short}_deg"][:4000]
            assert np.abs(error[100:]).max() < 1.5
        strikes = np.flatnonzero(np.diff(data[f"contact_{short}"][:4000]) > 500) + 1
        error = (trace[f"{side}_phase"][strikes] + 0.5) % 1.0 - 0.5
        assert len(strikes) > 15 and np.abs(error).max() < 0.02


def test_strikes_without_contacts_are_where_the_foot_is_furthest_in_front(tmp_path):
    """Within 60 ms of the measured contact, in the mean over strides within 40 ms."""
    file = shared("gait/healthy_young.csv")
    data = np.genfromtxt(file, delimiter=",", names=True)
    names = [name for name in data.dtype.names or () if "contact" not in name]
    rows = [[f"{row[name]:.6f}" for name in names] for row in data[:4000]]
    copy = tmp_path / "walk.csv"
    copy.write_text("\n".join(",".join(each) for each in [names, *rows]) + "\n")
    trace = walk(15.0, rate=200, recording=str(copy))
    strikes = np.flatnonzero(np.diff(data["contact_lt"][:3000]) > 500) + 1
    error = 1.13 * ((trace["left_phase"][strikes[1:]] + 0.5) % 1.0 - 0.5)
    assert abs(error.mean()) < 0.04 and np.abs(error).max() < 0.06


def test_recorded_squats_have_both_feet_on_the_ground():
    trace = walk(10.0, rate=200, recording=str(shared("gait/series_squat_opencap.csv")))
    assert np.degrees(np.ptp(trace["left_knee_angle"])) > 70.0
    assert np.all(trace["left_contact"]) and np.all(trace["right_contact"])


@pytest.mark.parametrize(
    "text, message",
    [
        ("time,hip\n0,1\n", "has no column 'hip_flexion_lt_deg' or 'hip_flexion_l'"),
        ("time,hip\n0,a\n", "contains text between numbers"),
        ("time,hip\n0\n", "every row must have as many numbers as the header has names"),
        ("inDegrees=no\nendheader\ntime hip\n0 1\n", "is in radians: write it in degrees"),
    ],
)
def test_unusable_recording_is_rejected(tmp_path, text, message):
    file = tmp_path / "walk.csv"
    file.write_text(text)
    with Diagram("walk", rate=200), pytest.raises(DiagramError, match=message):
        Walker(recording=str(file))

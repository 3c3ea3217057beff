"""Recorded motion of the walking adult."""

from pathlib import Path

import numpy as np
import pytest

from blocks.wearer import Walker
from blocks.wearer.recording import samples
from graph import Diagram, DiagramError
from tests.blocks.wearer.test_walker import walk
from tests.shared import shared

COLUMNS = ("hip_flexion", "knee_flexion", "ankle_dorsiflexion")


HEADER = ",".join(["time", *(f"{column}_{side}_deg" for side in ("lt", "rt") for column in COLUMNS)])


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


@pytest.mark.parametrize("opensim, rate", [(False, 100), (True, 1000)])
def test_recording_is_played_with_smooth_derivatives_and_repeats(tmp_path, opensim, rate):
    file = written(tmp_path / ("walk.mot" if opensim else "walk.csv"), rate=rate, opensim=opensim)
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
    assert np.abs(hip[later][strikes] - hip.max()).max() < 0.12  # the leg reaches furthest before the strike
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


def test_strikes_without_contacts_follow_from_reach_and_rotation_of_the_foot(tmp_path):
    """Within 25 ms of the measured contact, in the mean over strides within 15 ms."""
    file = shared("gait/healthy_young.csv")
    data = np.genfromtxt(file, delimiter=",", names=True)
    names = [name for name in data.dtype.names or () if "contact" not in name]
    rows = [[f"{row[name]:.6f}" for name in names] for row in data[:4000]]
    copy = tmp_path / "walk.csv"
    copy.write_text("\n".join(",".join(each) for each in [names, *rows]) + "\n")
    trace = walk(15.0, rate=200, recording=str(copy))
    for side, short in (("left", "lt"), ("right", "rt")):
        strikes = np.flatnonzero(np.diff(data[f"contact_{short}"][:3000]) > 500) + 1
        error = 1.13 * ((trace[f"{side}_phase"][strikes[1:]] + 0.5) % 1.0 - 0.5)
        assert abs(error.mean()) < 0.015 and np.abs(error).max() < 0.025
        pitch = np.degrees(trace[f"{side}_thigh_pitch"]) - data[f"thigh_pitch_{short}_deg"][:3000]
        assert np.abs(pitch[100:]).mean() < 1.0  # the pelvis has the mean pitch of both recorded thighs


def test_recorded_torques_and_forces_are_played_and_the_other_leg_is_half_a_stride_later():
    file = shared("gait/series_walk_moments_moore2015.csv")
    data = np.genfromtxt(file, delimiter=",", names=True)
    trace = walk(2.0, rate=100, recording=str(file), mass=67.2)
    inside = slice(40, 200)
    for joint, column in (("hip", "hip_extensor"), ("knee", "knee_extensor"), ("ankle", "ankle_plantarflexor")):
        error = trace[f"right_{joint}_torque"] / 67.2 + data[f"{column}_moment_rt_Nm_kg"][:200]
        assert np.abs(error[inside]).max() < 1e-9
    for axis, column in enumerate(("grf_forward_rt_N_kg", "grf_vertical_rt_N_kg")):
        error = trace[f"right_ground_force[{axis}]"] / 67.2 - data[column][:200]
        assert np.abs(error[inside]).max() < 0.03  # N/kg: a negative vertical force is none
    apart = (trace["left_phase"] - trace["right_phase"]) % 1.0
    assert np.abs(apart - 0.5).max() < 1e-9
    assert trace["left_ankle_torque"].min() == pytest.approx(trace["right_ankle_torque"].min(), rel=0.02)


def test_contact_that_chatters_begins_one_stride(tmp_path):
    """The contact opens for 30 ms in the first 100 ms of each stance."""
    lines = Path(written(tmp_path / "walk.csv")).read_text().splitlines()
    times = np.arange(len(lines) - 1) / 100.0
    columns = []
    for shift in (0.0, 0.5):
        since = (times + 1.2 * shift) % 1.2
        columns.append((since < 0.7) & ~((since > 0.05) & (since < 0.085)))
    names = ["contact_lt,contact_rt", *(f"{int(a)},{int(b)}" for a, b in zip(*columns))]
    file = tmp_path / "chatter.csv"
    file.write_text("\n".join(",".join(pair) for pair in zip(lines, names)) + "\n")
    trace = walk(8.0, rate=100, recording=str(file))
    strikes = np.flatnonzero(np.diff(trace["left_phase"]) < -0.5) + 1
    assert np.diff(strikes) == pytest.approx(120, abs=1)
    assert np.abs((strikes + 60) % 120 - 60).max() <= 2


def test_hips_of_a_recorded_adult_move_over_the_loaded_foot(tmp_path):
    """One walk of sines: derivatives agree, and the ankle in stance stays within 8 cm while the hips move by 60 cm."""
    trace = walk(6.0, recording=written(tmp_path / "walk.csv"))
    t = trace["time"]
    for k, scale in ((0, 0.02), (1, 0.01)):
        position, velocity, acceleration = (trace[f"pelvis_motion[{n}]"] for n in (k, k + 2, k + 4))
        assert np.abs(np.gradient(position, t) - velocity)[2:-2].max() < scale
        assert np.abs(np.gradient(velocity, t) - acceleration)[2:-2].max() < 20 * scale
    strike = np.flatnonzero(np.diff(trace["left_phase"]) < -0.5)[1]
    stance = slice(strike + 60, strike + 240)
    assert np.ptp(trace["pelvis_motion[0]"][stance]) > 0.2
    assert np.ptp(trace["left_foot_motion[0]"][stance]) < 0.25 * np.ptp(trace["pelvis_motion[0]"][stance])
    assert trace["walking_speed"][strike] == pytest.approx(trace["pelvis_motion[2]"][1000:1600].mean(), abs=0.05)


def test_angles_of_a_walker_give_back_its_strides_hips_and_torques(tmp_path):
    """From the angles alone: strikes within 15 ms, hips within 5 mm and 0.1 m/s, torques within 0.06 N·m/kg (RMS)."""
    own = walk(10.0, rate=100, speed=1.2, seed=4)
    angles = [np.degrees(own[f"{s}_{j}_angle"]) for s in ("left", "right") for j in ("hip", "knee", "ankle")]
    file = tmp_path / "walk.csv"
    np.savetxt(file, np.column_stack([own["time"], *angles]), delimiter=",", header=HEADER, comments="")
    played = walk(7.0, rate=100, recording=str(file))
    inside = slice(60, 700)
    strikes = 60 + np.flatnonzero(np.diff(own["left_phase"][inside]) < -0.5) + 1
    error = (played["left_phase"][strikes] + 0.5) % 1.0 - 0.5
    assert len(strikes) >= 5 and 1.1 * np.abs(error).max() < 0.015
    for signal, limit in (
        ("pelvis_motion[1]", 0.005),
        ("pelvis_motion[2]", 0.1),
        ("left_thigh_pitch", np.radians(1.0)),
    ):
        assert np.sqrt(np.mean((played[signal] - own[signal][:700])[inside] ** 2)) < limit, signal
    for joint in ("hip", "knee", "ankle"):
        error = (played[f"left_{joint}_torque"] - own[f"left_{joint}_torque"][:700]) / 70.0
        assert np.sqrt(np.mean(error[inside] ** 2)) < 0.06


def test_recorded_squats_have_both_feet_on_the_ground_and_load_the_joints():
    trace = walk(10.0, rate=200, recording=str(shared("gait/series_squat_opencap.csv")))
    assert np.degrees(np.ptp(trace["left_knee_angle"])) > 70.0
    assert np.all(trace["left_contact"]) and np.all(trace["right_contact"])
    assert np.ptp(trace["pelvis_motion[1]"]) > 0.2 and np.abs(trace["walking_speed"]).max() < 1e-9
    deep = trace["left_knee_angle"] > 1.3
    assert -1.5 < trace["left_hip_torque"][deep].mean() / 70.0 < -0.7  # extension of each leg


@pytest.mark.parametrize(
    "text, message",
    [
        ("time,hip\n0,1\n", "has no column 'hip_flexion_lt_deg' or 'hip_flexion_l'"),
        (HEADER + "\n0,1,2,3,4,5,a\n", "line 2: column 'ankle_dorsiflexion_rt_deg' does not contain a number"),
        (HEADER + "\n0,1,2,3,4,5,6\n1,2\n", "line 3: column 'knee_flexion_lt_deg' does not contain a number"),
        (HEADER + "\n0,1,2,,4,5,6\n", "'ankle_dorsiflexion_lt_deg' has no value in 1 of 1 rows, first in line 2: fill"),
        (HEADER + "\n0,1,2,3,4,5,6\n", "at least 50 samples are required, got 1"),
        (
            "\n".join([HEADER, *(f"{0.01 * (k + 20 * (k > 30)):g},1,2,3,4,5,6" for k in range(60))]),
            "the time step after 0.3 s is 0.21 s, but the median step is 0.01 s: fill the gaps, or",
        ),
        ("inDegrees=no\nendheader\ntime hip\n0 1\n", "is in radians: write it in degrees"),
    ],
)
def test_unusable_recording_is_rejected(tmp_path, text, message):
    file = tmp_path / "walk.csv"
    file.write_text(text)
    with Diagram("walk", rate=200), pytest.raises(DiagramError, match=message):
        Walker(recording=str(file))


def test_a_file_that_was_written_again_is_read_again(tmp_path):
    written(tmp_path / "a.csv")
    before = samples(str(tmp_path / "a.csv"), 70.0, 1.7)
    before[:] = 0.0  # of the caller
    assert samples(str(tmp_path / "a.csv"), 70.0, 1.7).any()
    written(tmp_path / "a.csv", seconds=11.0)
    assert len(samples(str(tmp_path / "a.csv"), 70.0, 1.7)) < len(before)

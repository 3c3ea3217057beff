"""The walking adult against its own derivatives, against mechanics, and against recorded walking."""

import math

import numpy as np
import pytest

from blocks.sources import StepSource
from blocks.wearer import Walker
from graph import Diagram, DiagramError
from tests.blocks.running import run
from tests.shared import shared

JOINTS = ("hip", "knee", "ankle")
RATE = 500


def walk(seconds, rate=RATE, assistance=None, **parameters):
    """Outputs of a walker by name, over the ticks. assistance : {input: number, or function that makes a signal}"""
    with Diagram("walk", rate=rate) as diagram:
        torques = {name: value() if callable(value) else value for name, value in (assistance or {}).items()}
        Walker(name="w", **parameters)(**torques)
    recording = run(diagram, round(seconds * rate))
    assert recording.outcome.status == "ok", recording.outcome
    return {"time": recording.time} | {path[2:]: values for path, values in recording.signals.items()}


@pytest.fixture(scope="module")
def steady():
    return walk(4.0, speed=1.2, variability=0.0)


@pytest.fixture(scope="module")
def start_and_stop():
    return walk(14.0, speed="0.5:0 2.5:1.2 8:1.2 11:0", seed=3)


def test_velocities_and_accelerations_are_derivatives_also_while_the_speed_changes(start_and_stop):
    """Central differences of 4 ms: an error of the third derivative, 4000 rad/s³, times 2.7e-6 s²."""
    t = start_and_stop["time"]
    for joint in JOINTS:
        angle, velocity, acceleration = (
            start_and_stop[f"right_{joint}_{name}"] for name in ("angle", "velocity", "acceleration")
        )
        assert np.abs(np.gradient(angle, t) - velocity)[1:-1].max() < 0.015
        assert np.abs(np.gradient(velocity, t) - acceleration)[1:-1].max() < 0.4
        assert np.abs(np.diff(acceleration)).max() < 9.0  # no step: 4500 rad/s³


def test_walker_stands_still_before_and_after_walking(start_and_stop):
    t = start_and_stop["time"]
    for still in (t < 0.5, t > 11.1):
        for name in ("left_hip_velocity", "right_knee_velocity", "left_ankle_acceleration", "walking_speed"):
            assert np.abs(start_and_stop[name][still]).max() < 1e-9
        assert np.all(start_and_stop["left_contact"][still]) and np.all(start_and_stop["right_contact"][still])
        up = start_and_stop["left_ground_force[1]"] + start_and_stop["right_ground_force[1]"]
        assert up[still] == pytest.approx(70.0 * 9.80665, rel=1e-9)


def test_segments_form_one_chain(steady):
    """Ankle from the hip by the pitches, and its acceleration as the second derivative of its position."""
    t = steady["time"]
    thigh, shank = 0.245 * 1.7, 0.246 * 1.7
    x = (
        steady["pelvis_motion[0]"]
        + thigh * np.sin(steady["left_thigh_pitch"])
        + shank * np.sin(steady["left_shank_pitch"])
    )
    assert np.abs(steady["left_foot_motion[0]"] - x).max() < 1e-12
    for position, velocity, acceleration in ((0, 2, 4), (1, 3, 5), (6, 7, 8)):
        values = [steady[f"left_foot_motion[{k}]"] for k in (position, velocity, acceleration)]
        scale = np.abs(values[2]).max()
        assert np.abs(np.gradient(values[0], t) - values[1])[1:-1].max() < 0.001 * scale
        assert np.abs(np.gradient(values[1], t) - values[2])[1:-1].max() < 0.02 * scale
    assert steady["pelvis_motion[0]"][-1] == pytest.approx(1.2 * t[-1], abs=0.03)


def test_stance_foot_stays_on_the_ground(steady):
    """Slip of the heel while it bears the foot, and of the ball: below 2 cm. The sole is within 2 cm of the ground."""
    first = (steady["time"] > 1.0) & (steady["time"] < 2.1)
    for along, begin, end in ((-0.25, 0.03, 0.30), (0.47, 0.15, 0.50)):
        d, h, pitch = along * 0.152 * 1.7, 0.039 * 1.7, steady["left_foot_pitch"]
        x = steady["left_foot_motion[0]"] + d * np.cos(pitch) + h * np.sin(pitch)
        z = steady["left_foot_motion[1]"] + d * np.sin(pitch) - h * np.cos(pitch)
        loaded = first & (steady["left_phase"] > begin) & (steady["left_phase"] < end)
        assert np.ptp(x[loaded]) < 0.02 and np.abs(z[loaded]).max() < 0.02


@pytest.mark.parametrize("motion, speed, rise", [("stairs_up", 0.268, 0.086), ("stairs_down", 0.358, -0.125)])
def test_loaded_foot_on_stairs_keeps_its_level_and_the_next_one_is_a_step_away(motion, speed, rise):
    """In single support within 1 cm; from foot to foot by half of the hips' rise in a stride, within 5 mm."""
    trace = walk(4.0, rate=200, speed=speed, motion=motion, variability=0.0)
    levels = []
    for side in ("left", "right"):
        pitch, z = trace[f"{side}_foot_pitch"], trace[f"{side}_foot_motion[1]"]
        lower = np.min([z + 1.7 * (d * 0.152 * np.sin(pitch) - 0.039 * np.cos(pitch)) for d in (-0.25, 0.47)], axis=0)
        phase = trace[f"{side}_phase"]
        for strike in np.flatnonzero(np.diff(phase) < -0.5)[:1]:
            single = (np.arange(len(phase)) > strike) & (phase > 0.15) & (phase < 0.5)
            stance = lower[single & (np.cumsum(np.diff(phase, prepend=phase[0]) < -0.5) == 1)]
            assert np.ptp(stance) < 0.01
            levels.append((strike, stance.mean()))
    (first, low), (second, high) = sorted(levels)
    assert high - low == pytest.approx(rise, abs=0.005) and first < second
    slope, _ = np.polyfit(trace["pelvis_motion[0]"], trace["pelvis_motion[1]"], 1)
    assert slope * speed * (second - first) / 200 == pytest.approx(rise, abs=0.01)


def test_ground_bears_the_weight_over_a_stride(steady):
    stride = (steady["time"] > 1.0) & (steady["time"] <= 1.0 + 2 * 0.5484)
    for axis, mean in ((0, 0.0), (1, 70.0 * 9.80665)):
        force = steady[f"left_ground_force[{axis}]"] + steady[f"right_ground_force[{axis}]"]
        assert force[stride].mean() == pytest.approx(mean, abs=5.0)
    assert np.all(steady["left_ground_force[1]"][~steady["left_contact"].astype(bool)] < 0.031 * 70.0 * 9.80665)


@pytest.mark.parametrize("speed, largest", [(0.1, 1.05), (0.3, 1.12), (0.5, 1.2), (0.7, 1.3)])
def test_both_feet_bear_the_weight_also_in_the_long_double_support_of_slow_walking(speed, largest):
    trace = walk(16.0, speed=speed, variability=0.0)
    begins = np.flatnonzero(np.diff(trace["left_phase"]) < -0.5)
    strides = slice(begins[0], begins[-1])
    weights = (trace["left_ground_force[1]"] + trace["right_ground_force[1]"])[strides] / (70.0 * 9.80665)
    assert weights.mean() == pytest.approx(1.0, abs=0.005) and 0.9 < weights.min() and weights.max() < largest


def test_equal_seeds_repeat_and_deviations_are_as_stated():
    first, again, other = (walk(40.0, rate=200, seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(first["left_knee_angle"], again["left_knee_angle"])
    assert not np.array_equal(first["left_knee_angle"], other["left_knee_angle"])
    ranges, times = [], []
    for trace in (first, other):
        strikes = np.flatnonzero(np.diff(trace["left_phase"]) < -0.5) + 1
        times += list(np.diff(trace["time"][strikes]))
        ranges += [np.ptp(trace["left_knee_angle"][a:b]) for a, b in zip(strikes, strikes[1:])]
    assert len(times) > 65
    assert np.std(times) / np.mean(times) == pytest.approx(0.012, rel=0.35)
    assert np.std(ranges) / np.mean(ranges) == pytest.approx(0.014, rel=0.5)


def test_assistance_in_the_direction_of_the_moment_unloads_the_joint(steady):
    """Plantarflexion by 10 N·m in late stance: the muscles give less by that within 30 %, and the ankle moves on."""
    late = (steady["left_phase"] > 0.3) & (steady["left_phase"] < 0.55) & (steady["time"] > 1.0)
    assert steady["left_ankle_torque"][late].mean() < -60.0
    reliefs = []
    for adaptation in (0.0, 0.8):
        assisted = walk(
            4.0, speed=1.2, variability=0.0, adaptation=adaptation, assistance={"left_ankle_assistance": -10.0}
        )
        reliefs.append((assisted["left_ankle_torque"] - steady["left_ankle_torque"])[late].mean())
        if adaptation == 0.0:
            assert (assisted["left_ankle_angle"] - steady["left_ankle_angle"])[late].mean() < -0.005
    assert 1.0 < reliefs[0] < 13.0 and 7.0 < reliefs[1] < 13.0


@pytest.mark.parametrize("torque", [100.0, -100.0])
@pytest.mark.parametrize("joint", JOINTS)
def test_a_torque_that_never_ends_keeps_the_leg_within_its_ranges(joint, torque):
    """Steps of 5 ms: within 0.8 rad of the joint's range, and slower than 90 rad/s."""
    trace = walk(8.0, rate=200, assistance={f"left_{joint}_assistance": torque})
    for each, lower, upper in (("hip", -0.7, 2.2), ("knee", -0.15, 2.5), ("ankle", -1.0, 0.8)):
        angle = trace[f"left_{each}_angle"]
        assert lower - 0.8 < angle.min() and angle.max() < upper + 0.8
        assert np.abs(trace[f"left_{each}_velocity"]).max() < 90.0
    assert np.abs(trace["right_knee_angle"]).max() < 1.3


@pytest.mark.parametrize(
    "parameters", [{}, {"mass": 40.0, "height": 1.5}, {"mass": 120.0, "height": 2.0}, {"strength": 0.3}, {"speed": 1.9}]
)
def test_deviation_decays_within_four_seconds_of_a_push(parameters):
    """10 N·m at the knee until 0.1 s: the muscles regain the reference motion within 0.2°."""
    with Diagram("walk", rate=200) as diagram:
        push = StepSource(before=10.0, after=0.0, time=0.1, unit="N·m")()
        Walker(name="w", variability=0.0, **parameters)(left_knee_assistance=push)
        Walker(name="free", variability=0.0, **parameters)()
    recording = run(diagram, 1200)
    apart = [np.abs(recording[f"w.left_{j}_angle"] - recording[f"free.left_{j}_angle"]) for j in JOINTS]
    assert np.degrees(np.max(apart)) > 0.3 and np.degrees(np.max([each[800:] for each in apart])) < 0.2


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_assistance_that_is_not_finite_reaches_the_outputs(value):
    trace = walk(0.1, assistance={"right_knee_assistance": value})
    assert np.all(np.isfinite(trace["right_knee_angle"][:1])) and not np.any(np.isfinite(trace["right_knee_angle"][2:]))
    assert np.all(np.isnan(trace["right_knee_torque"][3:]))


@pytest.mark.parametrize(
    "parameters, message",
    [
        ({"speed": "0:0 2"}, 'the speed must be a number in m/s or times and speeds as in "0:0 2:1.2"'),
        ({"speed": "0:0 0:1"}, "the times of `speed` must increase"),
        ({"speed": 3.0}, r"the speed must be from 0 to 1.96 m/s for this body and motion: got 3.0"),
        ({"speed": math.nan}, "the speed must be"),
        ({"speed": "0:0 1:0 1.3:1.6"}, r"from 0 to 1.6 m/s in 0.3 s, .* up to 10 m/s²: .* Allow at least 0.51 s"),
        ({"motion": "run"}, "must be one of walk"),
    ],
)
def test_walker_rejects_speeds_that_it_has_no_motion_for(parameters, message):
    with Diagram("walk", rate=RATE), pytest.raises(DiagramError, match=message):
        Walker(**parameters)


@pytest.mark.soak
def test_norms_are_the_fit_of_the_measured_curves():
    shared("gait/walk_stairs_norms_adult_bovi2011.csv")
    from tests.blocks.wearer.fit_norms import NORMS, module

    assert module() == NORMS.read_text(encoding="utf-8")


def test_means_of_curves_with_another_foot_off_each_regain_the_peaks_of_one_curve():
    """Strides with one knee-like peak in stance and a sharper one at foot-off, which shifts by 2 % of the stride."""
    from tests.blocks.wearer.fit_norms import registered

    phases = np.arange(101) / 100.0

    def curve(shift):
        way = np.where(phases < 0.62, phases / 0.62, (1.0 - phases) / 0.38)
        at = phases - shift * way**2 * (3.0 - 2.0 * way)
        return 0.3 * np.sin(2.0 * np.pi * at) + np.exp(-0.5 * ((at - 0.62) / 0.05) ** 2)

    shifts = 0.02 * np.random.default_rng(0).normal(size=4000)
    mean = np.mean([curve(shift) for shift in shifts], axis=0)
    rows = [{"hip_mean": value, "hip_sd": "", "phase": "0"} for value in mean]
    aligned = np.array([row["hip_mean"] for row in registered(rows, {"foot_off_pct": 62.0, "foot_off_sd": 2.0})])
    assert np.abs(mean - curve(0.0)).max() > 0.05
    assert aligned == pytest.approx(curve(0.0), abs=0.012)
    assert np.abs(np.diff(aligned, 2)).max() == pytest.approx(np.abs(np.diff(curve(0.0), 2)).max(), rel=0.06)


def recorded(name):
    return np.genfromtxt(shared(f"gait/{name}.csv"), delimiter=",", names=True)


def test_curves_are_within_one_deviation_of_people_that_the_fit_has_not_seen(steady):
    """Mean over the stride of the distance from Pinzone's clinical centre, in its standard deviations."""
    norms = recorded("walk_norms_pinzone2014_centre1")
    first = (steady["time"] > 1.0) & (steady["time"] < 3.0)
    order = np.argsort(steady["left_phase"][first])
    phase = steady["left_phase"][first][order]

    def distance(values, column):
        at = np.interp(norms["gait_cycle_percent"] / 100.0, phase, values[first][order])
        return np.abs(at - norms[f"{column}_mean"]).mean() / norms[f"{column}_sd"].mean()

    moments = ("hip_extensor_moment_Nm_kg", "knee_extensor_moment_Nm_kg", "ankle_plantarflexor_moment_Nm_kg")
    angles = ("hip_flexion_deg", "knee_flexion_deg", "ankle_dorsiflexion_deg")
    for joint, angle, moment in zip(JOINTS, angles, moments):
        assert distance(np.degrees(steady[f"left_{joint}_angle"]), angle) < 1.0
        assert distance(-steady[f"left_{joint}_torque"] / 70.0, moment) < 1.0

"""Limbs and the people who move them, against closed forms and tables."""

import math

import numpy as np
import pytest

from blocks.models import KNEE_FLEXION, Limb, RecordedKnee, WalkingKnee
from graph import Diagram, DiagramError, deg
from tests.blocks.running import both_ways, by_hand, inside, player, run
from tests.shared import shared

RATE = 1000


def limb(seconds, inputs=None, rate=RATE, **parameters):
    """(t, position, velocity) of a limb, its inputs arrays or constants by name."""
    ticks = int(seconds * rate)
    given = {name: np.broadcast_to(np.asarray(value, dtype=float), ticks) for name, value in (inputs or {}).items()}
    found = inside(lambda: Limb(**parameters), rate=rate, ticks=ticks, **given)
    return np.arange(ticks) / rate, found["position"], found["velocity"]


FREE = {"stiffness": 0.0, "reflex": 0.0, "damping": 0.0}


def test_a_free_limb_under_a_constant_torque_accelerates_evenly():
    """Semi-implicit Euler gives ω exactly and θ half a step ahead: τ t dt / 2 I."""
    t, position, velocity = limb(1.0, {"torque": 2.0}, inertia=0.5, **FREE)
    assert np.abs(velocity - 4.0 * t).max() < 1e-12
    assert np.abs(position - (2.0 * t**2 + 2.0 * t / RATE)).max() < 1e-12


def test_free_limb_with_friction_reaches_final_speed():
    """ω = τ / d (1 − exp(−d t / I)), within Euler's d dt / 2 I of it."""
    t, _, velocity = limb(3.0, {"torque": 1.0}, inertia=0.1, damping=0.25, stiffness=0.0, reflex=0.0)
    assert np.abs(velocity - 4.0 * (1.0 - np.exp(-2.5 * t))).max() < 4.0 * 0.25 / (2 * 0.1 * RATE)


@pytest.mark.parametrize("stiffness, reflex, damping", [(50.0, 0.5, 0.2), (120.0, 8.0, 1.0), (20.0, 0.0, 0.0)])
def test_a_wearer_holds_a_limb_like_a_spring_with_a_damper(stiffness, reflex, damping):
    """Free response from 0.3 rad to an intention of 0.1 rad, within 0.7 % of its size."""
    inertia, start, target = 0.35, 0.3, 0.1
    t, position, _ = limb(
        2.0, {"angle": target}, inertia=inertia, stiffness=stiffness, reflex=reflex, damping=damping, start=start
    )
    natural, share = math.sqrt(stiffness / inertia), (reflex + damping) / (2.0 * math.sqrt(stiffness * inertia))
    assert share < 1.0
    damped = natural * math.sqrt(1.0 - share**2)
    wanted = target + (start - target) * np.exp(-share * natural * t) * (
        np.cos(damped * t) + share * natural / damped * np.sin(damped * t)
    )
    assert np.abs(position - wanted).max() < 0.007 * abs(start - target)


def test_limb_without_torque_follows_intended_motion():
    """The intention's own acceleration moves it: within 0.2° of a walking knee, at the rate of the plant."""
    with Diagram("walk", rate=RATE) as diagram:
        knee = WalkingKnee(name="knee")
        Limb(start=knee.at_start, name="limb")(angle=knee.angle, rate=knee.velocity, acceleration=knee.acceleration)
    recording = run(diagram, 3 * RATE)
    assert np.abs(recording["limb.position"] - recording["knee.angle"])[RATE:].max() < deg(0.2)


def test_a_steady_torque_moves_a_held_limb_by_torque_over_stiffness():
    _, position, velocity = limb(4.0, {"torque": 6.0}, stiffness=120.0)
    assert position[-1] == pytest.approx(6.0 / 120.0, abs=1e-9) and abs(velocity[-1]) < 1e-9


def test_a_straight_knee_is_stopped_by_its_ligaments():
    """Pushed with 5 N·m against 500 N·m/rad below −1°: it comes to rest 0.01 rad beyond, and is not pulled above."""
    _, position, _ = limb(4.0, {"torque": -5.0}, lower=deg(-1.0), stiffness=0.0, reflex=2.0)
    assert position[-1] == pytest.approx(deg(-1.0) - 0.01, abs=1e-6)
    _, position, _ = limb(1.0, {"torque": 1.0}, lower=deg(-1.0), **FREE)
    assert position[-1] == pytest.approx(0.5 / 0.35, rel=0.01)


def test_limb_starts_at_initial_angle_at_rest():
    with Diagram("start", rate=RATE):
        block = Limb(start=0.7)
    assert block.step() == (0.7, 0.0)
    block.update(torque=1.0)
    assert block.step()[1] != 0.0
    block.reset()
    assert block.step() == (0.7, 0.0)


def test_limb_outputs_current_state_and_may_close_a_loop():
    """Torque moves it a tick later: no direct feedthrough."""
    torque = np.zeros(10)
    torque[4] = 1.0
    found = both_ways(lambda: Limb(**FREE), rate=RATE, torque=torque)
    assert not np.any(found["velocity"][:5]) and found["velocity"][5] > 0.0


def test_nan_torque_of_a_limb_appears_in_its_outputs():
    found = both_ways(Limb, rate=RATE, torque=np.array([0.0, math.nan, 0.0, 0.0]))
    assert np.isnan(found["position"][2:]).all() and not np.isnan(found["position"][:2]).any()


@pytest.mark.parametrize(
    "parameters, said",
    [
        ({"inertia": 0.0}, "inertia: must be above 0.0 kg·m², got 0.0"),
        ({"damping": -1.0}, "damping: must be at least 0.0"),
        ({"stiffness": -1.0}, "stiffness: must be at least 0.0 N·m/rad"),
        ({"reflex": math.nan}, "reflex: NaN"),
        ({"ligament": -1.0}, "ligament: must be at least"),
    ],
)
def test_parameters_of_a_limb_are_refused(parameters, said):
    with pytest.raises(DiagramError, match=f"Limb: {said}"):
        Limb(**parameters)


def test_a_walking_knee_is_near_the_table_it_is_made_of():
    """Six harmonics of twenty values: within 1.5° everywhere; nine of them within 0.5°."""
    for harmonics, tolerance in ((6, 1.5), (9, 0.5)):
        found = inside(lambda: WalkingKnee(1.0, harmonics=harmonics), rate=200, ticks=200)
        assert np.abs(np.degrees(found["angle"][::10]) - KNEE_FLEXION).max() < tolerance


def test_a_walking_knee_flexes_a_little_in_stance_and_much_in_swing():
    angle = np.degrees(inside(lambda: WalkingKnee(1.0), rate=200, ticks=200)["angle"])
    assert 15.0 < angle[:80].max() < 22.0 and 0.05 < np.argmax(angle[:80]) / 200 < 0.25
    assert 58.0 < angle.max() < 66.0 and 0.68 < np.argmax(angle) / 200 < 0.78
    assert angle.min() > 0.0


@pytest.mark.parametrize("stride_time, start", [(1.1, 0.0), (0.8, 0.5), (1.7, 0.25)])
def test_velocity_and_acceleration_of_a_walking_knee_are_derivatives_of_its_angle(stride_time, start):
    """Central differences at 20 kHz, within 1e-5 of the largest."""
    found = both_ways(lambda: WalkingKnee(stride_time, start), rate=20000, ticks=2000)
    for value, derivative in (("angle", "velocity"), ("velocity", "acceleration")):
        difference = (found[value][2:] - found[value][:-2]) * 10000.0
        assert np.abs(difference - found[derivative][1:-1]).max() < 1e-5 * np.abs(found[derivative]).max()


def test_a_walking_knee_repeats_every_stride_and_the_other_leg_is_half_a_stride_away():
    left = inside(lambda: WalkingKnee(1.0), rate=200, ticks=1000)["angle"]
    right = inside(lambda: WalkingKnee(1.0, start=0.5), rate=200, ticks=1000)["angle"]
    assert np.abs(left[200:] - left[:-200]).max() < 1e-12 and np.abs(right[:-100] - left[100:]).max() < 1e-12
    for start in (0.0, 0.3, 0.5):
        knee = WalkingKnee(1.1, start)
        assert knee.step()[0] == pytest.approx(knee.at_start, abs=1e-12)


@pytest.mark.parametrize(
    "parameters, said",
    [
        ({"stride_time": 0.0}, "stride_time: must be above 0.0 s"),
        ({"harmonics": 0}, "harmonics: must be at least 1"),
        ({"harmonics": 10}, "harmonics: must be at most 9"),
        ({"start": math.nan}, "start: NaN"),
    ],
)
def test_parameters_of_a_walking_knee_are_refused(parameters, said):
    with pytest.raises(DiagramError, match=said):
        WalkingKnee(**parameters)


def write(path, header, rows):
    path.write_text(header + "\n" + "\n".join(",".join(map(str, row)) for row in rows) + "\n")
    return str(path)


def stride_file(path, seconds=10.0, rate=100.0, period=1.25):
    """A recording of a pure tone: 30° − 25° cos, so that every derivative is known."""
    t = np.arange(int(seconds * rate)) / rate
    angles = 30.0 - 25.0 * np.cos(2.0 * np.pi * t / period)
    return write(path, "time,other,knee", [(f"{a:.6f}", 0, f"{b:.9f}") for a, b in zip(t, angles)])


def test_recording_plays_at_recorded_speed_with_derivatives(tmp_path):
    """A tone of 1.25 s at 100 Hz, played at 1 kHz: linear between samples, 0.02° off at most; differences 0.5 % and 1 %
    off.
    """
    file = stride_file(tmp_path / "tone.csv")
    found = inside(lambda: RecordedKnee(file, "knee"), rate=1000, ticks=8000)
    t, turn = np.arange(8000) / 1000, 2.0 * np.pi / 1.25
    size = math.radians(25.0)
    inner = slice(100, None)
    assert np.abs(found["angle"] - (math.radians(30.0) - size * np.cos(turn * t)))[inner].max() < deg(0.02)
    assert np.abs(found["velocity"] - size * turn * np.sin(turn * t))[inner].max() < 0.005 * size * turn
    assert np.abs(found["acceleration"] - size * turn**2 * np.cos(turn * t))[inner].max() < 0.01 * size * turn**2


def test_a_recording_passes_through_its_samples_and_halfway_between_them(tmp_path):
    file = stride_file(tmp_path / "tone.csv")
    with Diagram("play", rate=200):
        knee = RecordedKnee(file, "knee")
    angle = by_hand(knee, 200)["angle"]
    assert np.abs(angle[::2] - knee.angles[:100]).max() < 1e-12
    assert np.abs(angle[1::2] - 0.5 * (knee.angles[:100] + knee.angles[1:101])).max() < 1e-12
    assert knee.at_start == angle[0] == knee.angles[0]


def test_a_repeated_recording_has_no_jump(tmp_path):
    """Cut in the last two seconds where it goes on as it began: a tone that does not fit its file runs on over the
    seam.
    """
    file = stride_file(tmp_path / "tone.csv", seconds=9.37)
    with Diagram("play", rate=100):
        knee = RecordedKnee(file, "knee")
    assert (len(knee.angles) - 1) % 125 == 0 and len(knee.angles) > 937 - 200
    angle = inside(lambda: RecordedKnee(file, "knee"), rate=100, ticks=3000)["angle"]
    wanted = math.radians(30.0) - math.radians(25.0) * np.cos(2.0 * np.pi * np.arange(3000) / 125.0)
    assert np.abs(angle - wanted).max() < deg(0.02)


def test_a_short_recording_is_played_whole(tmp_path):
    with Diagram("play", rate=100):
        assert len(RecordedKnee(stride_file(tmp_path / "short.csv", seconds=3.0), "knee").angles) == 300


def test_recording_may_be_a_spreadsheet_csv(tmp_path):
    """A byte order mark, blanks in the header, empty lines and Windows' line ends do no harm."""
    rows = [(f"{k / 100:.2f}", k % 50) for k in range(500)]
    plain, other = tmp_path / "plain.csv", tmp_path / "other.csv"
    write(plain, "time,knee", rows)
    other.write_bytes(
        "\ufefftime, knee \r\n".encode() + b"\r\n".join(f"{a},{b}".encode() for a, b in rows) + b"\r\n\r\n"
    )
    with Diagram("play", rate=100):
        assert np.array_equal(RecordedKnee(str(plain), "knee").angles, RecordedKnee(str(other), "knee").angles)


def test_times_that_were_rounded_to_milliseconds_are_evenly_spaced(tmp_path):
    """120 Hz: steps of 8 and 9 ms, which are 8.33 ms on average."""
    rows = [(f"{k / 120:.3f}", 30.0 - 25.0 * math.cos(2.0 * math.pi * k / 132)) for k in range(601)]
    with Diagram("play", rate=120):
        knee = RecordedKnee(write(tmp_path / "rounded.csv", "time,knee", rows), "knee")
    assert knee.rate == pytest.approx(120.0, rel=1e-3) and (len(knee.angles) - 1) % 132 == 0


GOOD = [(f"{k / 100:.2f}", k % 50) for k in range(200)]


def changed(line, row):
    rows = list(GOOD)
    rows[line - 2] = row
    return rows


@pytest.mark.parametrize(
    "header, rows, column, said",
    [
        ("time,knee", GOOD, "hip", "has no column 'hip'; it has time, knee"),
        ("t,knee", GOOD, "knee", "has no column 'time'; it has t, knee"),
        ("", [], "knee", "has no column 'time'; it has none"),
        ("time,knee", changed(7, ("0.05", "x")), "knee", "line 7: column 'time' or 'knee' does not contain a number"),
        ("time,knee", changed(9, ("0.07", "")), "knee", "line 9: column 'time' or 'knee'"),
        ("time,knee", changed(11, ("0.09",)), "knee", "line 11: column 'time' or 'knee'"),
        ("time,knee", changed(13, ("0.11", "nan")), "knee", "line 13: column 'time' or 'knee'"),
        ("time,knee", changed(15, ("inf", "3.0")), "knee", "line 15: column 'time' or 'knee'"),
        ("time,knee", GOOD[:99], "knee", "has 99 samples; at least 100 are required"),
        ("time,knee", [], "knee", "has 0 samples; at least 100 are required"),
        ("time,knee", GOOD[:50] + GOOD[60:], "knee", "evenly spaced in time, but 0.49 s is followed by 0.6 s"),
        ("time,knee", GOOD[:50] + GOOD[51:], "knee", "evenly spaced in time, but 0.49 s is followed by 0.51 s"),
        ("time,knee", GOOD[::-1], "knee", "evenly spaced in time, but 1.99 s is followed by 1.98 s"),
        ("time,knee", [("0.00", 1.0)] * 150, "knee", "evenly spaced in time, but 0 s is followed by 0 s"),
    ],
)
def test_invalid_file_is_reported(tmp_path, header, rows, column, said):
    file = write(tmp_path / "walk.csv", header, rows)
    with pytest.raises(DiagramError, match=said) as refused:
        RecordedKnee(file, column)
    assert "walk.csv" in str(refused.value) and __file__ in str(refused.value)


def test_missing_file_is_reported(tmp_path):
    with pytest.raises(DiagramError, match=r"walk\.csv: No such file"):
        RecordedKnee(str(tmp_path / "walk.csv"), "knee")
    with pytest.raises(DiagramError, match="Is a directory"):
        RecordedKnee(str(tmp_path), "knee")
    for content in (bytes(range(128, 256)) * 8, b"time,knee\n0.0,\0\n", b""):
        (tmp_path / "picture.csv").write_bytes(content)
        with pytest.raises(DiagramError, match=r"picture\.csv"):
            RecordedKnee(str(tmp_path / "picture.csv"), "knee")


def test_file_and_column_are_required():
    with pytest.raises(DiagramError, match="file is missing"):
        RecordedKnee()
    with pytest.raises(DiagramError, match="column is missing"):
        RecordedKnee("walk.csv")


@pytest.mark.parametrize("leg", ["lt", "rt"])
def test_a_recorded_walk_continues_over_the_seam(leg):
    """Strides, from one rise through 40° to the next, over two rounds of the file: 1.09 to 1.16 s, also the one with
    the seam in it.
    """
    file = str(shared("gait/healthy_young.csv"))
    found = inside(lambda: RecordedKnee(file, f"knee_flexion_{leg}_deg"), rate=200, ticks=19000)
    rises = np.flatnonzero((found["angle"][1:] > 0.7) & (found["angle"][:-1] <= 0.7))
    strides = np.diff(rises) / 200
    assert len(strides) > 80 and strides.min() > 1.09 and strides.max() < 1.16
    assert np.abs(np.diff(found["angle"])).max() < deg(3.0)
    assert np.abs(found["velocity"]).max() < 10.0, "rad/s"


def test_both_legs_of_a_recorded_walk_stay_in_phase():
    """Both are cut within 20 ms of each other, so that they are as far apart in the second round as in the first."""
    file = str(shared("gait/healthy_young.csv"))
    with Diagram("legs", rate=200):
        lengths = [len(RecordedKnee(file, f"knee_flexion_{leg}_deg").angles) for leg in ("lt", "rt")]
    assert abs(lengths[0] - lengths[1]) <= 4


def test_recorded_rate_is_taken_from_file_only():
    with pytest.raises(DiagramError, match="has no parameter 'rate'"):
        RecordedKnee("walk.csv", "knee", rate=100.0)


def test_a_wearer_moves_a_limb_in_a_diagram():
    """A recorded intention, a limb and a torque: the torque moves the knee the way it points."""
    with Diagram("wearer", rate=RATE) as diagram:
        knee = WalkingKnee()
        for name, torque in (("free", 0.0), ("helped", 5.0)):
            Limb(start=knee.at_start, name=name)(
                torque=player(np.full(2, torque), "N·m"),
                angle=knee.angle,
                rate=knee.velocity,
                acceleration=knee.acceleration,
            )
    recording = run(diagram, 1000)
    shift = (recording["helped.position"] - recording["free.position"])[500:]
    assert shift.min() > 0.9 * 5.0 / 120.0 and shift.max() < 1.1 * 5.0 / 120.0

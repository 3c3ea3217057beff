"""The knee exoskeleton, in virtual time: what its wearer's knees do, what it gives them, and that it stays where it
should.
"""

import numpy as np
import pytest

import runtime
from blocks.clock import Clock
from blocks.logic import Compare, Switch
from blocks.sources import Sine
from blocks.wearer import Walker
from graph import Diagram, compile
from runtime.robot.loading.file import build_plant, load
from tests.blocks.running import run
from tests.runtime.runs import KNEE_EXO, TORQUE_STEP
from tests.shared import shared

SIDES = ("left", "right")
LIMIT, SLEW = 12.0, 200.0  # N·m, N·m/s
FADE = 0.5  # s


def walk(seconds=12.0, rate=200.0, **settings):
    """(Recording, Diagram) of so many seconds, with settings as on the command line."""
    file, diagram = load(KNEE_EXO, [(name.replace("__", "."), str(value)) for name, value in settings.items()])
    diagram.rate = rate
    plant = build_plant(file, diagram)
    return run(diagram, round(seconds * rate), plant=plant, substeps=5, fade=FADE), diagram


@pytest.fixture(scope="module")
def walked():
    return walk()[0]


def steady(recording, path, since=5.0):
    return recording[path][recording.time >= since]


def lag(a, b, longest):
    """By how many samples b comes after a, from 0 to `longest`: the largest correlation."""
    a, b = a - a.mean(), b - b.mean()
    return max(range(longest), key=lambda shift: np.mean(a[: len(a) - longest] * b[shift : len(b) - longest + shift]))


def test_the_written_rig_file_is_readable():
    lines = KNEE_EXO.read_text().splitlines()
    assert len(lines) <= 80 and max(map(len, lines)) <= 140


def test_diagram_compiles_without_warning_and_natively():
    _, diagram = load(KNEE_EXO)
    schedule = compile(diagram)
    assert schedule.warnings == [] and schedule.gil_sections == 0 and schedule.rate == 200.0
    assert [
        (proof.path, proof.holds, proof.bounded_by) for proof in schedule.proofs if proof.port == "torque_command"
    ] == [(f"{side}/knee", True, f"{side}/torque_limiter") for side in SIDES]


def test_run_is_recorded_streamed_and_summarised():
    """Recorder and viewer take every port; each leg has its report."""
    _, diagram = load(KNEE_EXO)
    taken = {sink.block.path: len(sink.columns) for sink in compile(diagram).sinks}
    ports = sum(len(block.outputs) for block in diagram)
    assert taken == {"csv_recorder": ports, "plot_juggler": ports, "left/stride_report": 5, "right/stride_report": 5}


def test_run_ends_without_fault(walked):
    assert (walked.outcome.status, walked.outcome.unconfirmed, walked.outcome.unanswered) == ("ok", (), ())
    assert list(walked.tick) == list(range(2400))


@pytest.mark.parametrize("side", SIDES)
def test_the_recorded_knee_moves_in_a_human_range(walked, side):
    """Flexion of 60 to 70° in swing, nearly straight at heel strike, never beyond; angular velocity below 10 rad/s.
    (Winter 1991)
    """
    angle = np.degrees(steady(walked, f"{side}/knee.position"))
    assert -3.0 < angle.min() < 8.0 and 58.0 < angle.max() < 72.0
    velocity = steady(walked, f"{side}/knee.velocity")
    assert 4.0 < velocity.max() < 8.0 and -9.0 < velocity.min() < -4.0
    period = max(range(160, 280), key=lambda samples: np.corrcoef(angle[:-samples], angle[samples:])[0, 1])
    assert period == 220  # samples of 5 ms: a stride is 1.1 s


def test_the_legs_are_half_a_stride_apart(walked):
    left, right = (steady(walked, f"{side}/knee.position") for side in SIDES)
    assert lag(left, right, 220) == pytest.approx(110, abs=2)  # samples of 5 ms


@pytest.mark.parametrize("side", SIDES)
def test_the_torque_stays_inside_the_limiter(walked, side):
    """What is let through exactly, what is sent and what the drive gives to one code of torque."""
    assert np.max(np.abs(walked[f"{side}/torque_limiter.limited"])) <= LIMIT
    for port in ("torque_sent", "torque"):
        assert np.max(np.abs(walked[f"{side}/knee.{port}"])) <= LIMIT + TORQUE_STEP
    assert np.max(np.abs(walked[f"{side}/knee.torque"])) > 8.0  # it does help


@pytest.mark.parametrize("side", SIDES)
def test_the_torque_never_changes_faster_than_the_limiter_allows(walked, side):
    step = SLEW / 200.0
    assert np.max(np.abs(np.diff(walked[f"{side}/torque_limiter.limited"]))) <= step * (1.0 + 1e-12)
    assert np.max(np.abs(np.diff(walked[f"{side}/knee.torque_sent"]))) <= step + TORQUE_STEP


@pytest.mark.parametrize("side", SIDES)
def test_sent_torque_equals_the_limited_torque_after_fade_in(walked, side):
    share = np.minimum(walked.time / FADE, 1.0)
    sent = walked[f"{side}/knee.torque_sent"]
    assert np.max(np.abs(sent - share * walked[f"{side}/torque_limiter.limited"])) <= TORQUE_STEP
    # the drive gives what it was told a tick before
    np.testing.assert_array_equal(walked[f"{side}/knee.torque"][1:], sent[:-1])


@pytest.mark.parametrize("side", SIDES)
def test_assistance_acts_in_the_right_gait_phases(walked, side):
    """Extends the knee in mid-stance and bends it into swing, each in the direction of its motion."""
    phase, torque = (steady(walked, f"{side}/{path}") for path in ("gait_phase.phase", "knee.torque"))
    power = torque * steady(walked, f"{side}/knee.velocity")

    def between(low, high, what):
        return what[(phase > low) & (phase < high)].mean()

    assert between(0.20, 0.26, torque) < -7.0 and between(0.20, 0.26, power) > 5.0
    assert between(0.57, 0.63, torque) > 4.0 and between(0.57, 0.63, power) > 10.0  # W
    assert abs(between(0.38, 0.44, torque)) < 0.5 and abs(between(0.80, 0.98, torque)) < 0.5
    strides = (walked.time[-1] - 5.0) / 1.1
    assert power[power > 0.0].sum() / 200.0 / strides > 5.0  # J
    assert power[power < 0.0].sum() / 200.0 / strides > -0.1


def test_without_assistance_the_robot_is_transparent():
    none = walk(5.0, assistance=0)[0]
    for side in SIDES:
        assert not none[f"{side}/torque_limiter.limited"].any()


def test_no_assistance_before_first_stride_estimate(walked):
    """The first two strides are learned; until both legs agree, no torque acts."""
    unknown = walked["state.walking"] == 0.0
    assert 2.0 < np.count_nonzero(unknown) / 200.0 < 5.0
    for side in SIDES:
        assert unknown[walked[f"{side}/gait_phase.walking"] == 0.0].all()
        assert np.all(walked[f"{side}/gate.y"][unknown] == 0.0)


def stopping(robot):
    """A Walker that stops at 8 s, and squats from 10 s on."""
    with Diagram("wearer", rate=5 * robot.rate) as wearer:
        adult = Walker("0:1.2 7.2:1.2 8:0", name="walker")()
        for side in SIDES:
            drive = robot[f"{side}/knee"].emulator()
            bend = Sine(0.55, 0.5, -np.pi / 2.0, bias=0.55, unit="rad", name=f"{side}_bend")()
            speed = Sine(0.55 * np.pi, 0.5, 0.0, unit="rad/s", name=f"{side}_speed")()
            squats = Compare(">=", name=f"{side}_late")(Clock(name=f"{side}_clock")().time, 10.0)
            angle, velocity = (getattr(adult, f"{side}_knee_{name}") for name in ("angle", "velocity"))
            drive(position=Switch()(squats, bend, angle), velocity=Switch()(squats, speed, velocity))
    return wearer


def test_standing_and_squats_get_no_torque():
    trial = runtime.run(KNEE_EXO, 18.0, plant=stopping)
    moving = np.maximum(*(np.abs(trial[f"{side}/knee.velocity"]) for side in SIDES)) > 0.3
    still = trial.time[np.flatnonzero(moving & (trial.time < 10.0))[-1]]
    assert 7.0 < still < 9.5 and np.abs(trial["left/knee.torque_sent"][trial.time < 7.0]).max() > 5.0
    for side in SIDES:
        assert np.abs(trial[f"{side}/knee.torque_sent"][trial.time > still + 0.3]).max() <= TORQUE_STEP


def test_assistance_scales_only_the_profile(walked):
    half, none = walk(assistance=0.5)[0], walk(assistance=0)[0]
    for side in SIDES:
        full_peak, half_peak = (np.abs(steady(r, f"{side}/profile.torque")).max() for r in (walked, half))
        assert full_peak == pytest.approx(9.0, abs=0.05) and half_peak == pytest.approx(4.5, abs=0.05)
        assert np.all(none[f"{side}/profile.torque"] == 0.0)
        apart = np.degrees(steady(walked, f"{side}/knee.position") - steady(none, f"{side}/knee.position"))
        assert 0.5 < np.sqrt(np.mean(apart**2)) < 5.0  # it is felt, and nobody is thrown


def test_stride_frequency_is_estimated(walked):
    for recording, stride_time in ((walked, 1.1), (walk(stride_time=1.4)[0], 1.4)):
        for side in SIDES:
            frequency = steady(recording, f"{side}/gait_phase.frequency", 8.0)
            assert frequency.mean() == pytest.approx(1.0 / stride_time, rel=0.01)
            assert np.ptp(frequency) < 0.2 / stride_time


@pytest.mark.parametrize("rate", [100.0, 400.0])
def test_a_recorded_walk_is_the_same_at_another_rate(walked, rate):
    recording, _ = walk(rate=rate)
    assert recording.outcome.status == "ok"
    for side in SIDES:
        angle = np.interp(walked.time, recording.time, recording[f"{side}/knee.position"])
        assert np.degrees(np.max(np.abs(angle - walked[f"{side}/knee.position"]))) < 3.0
        assert np.max(np.abs(np.diff(recording[f"{side}/torque_limiter.limited"]))) <= SLEW / rate * (1.0 + 1e-12)


def test_a_recorded_walk_is_followed_in_phase():
    """Phase 0 is where the foot meets the ground, within 2 % of a stride at the median and 4 % at 95 %."""
    path = shared("gait/healthy_young.csv")
    recording, _ = walk(45.0, gait=path)
    measured = np.genfromtxt(path, delimiter=",", names=True)
    for side, short in (("left", "lt"), ("right", "rt")):
        angle, column = np.degrees(recording[f"{side}/knee.position"]), measured[f"knee_flexion_{short}_deg"][:9000]
        assert np.sqrt(np.mean((angle - column) ** 2)) < 4.0
        contact = measured[f"contact_{short}"][:9000] > 500.0
        strikes = np.flatnonzero(~contact[:-1] & contact[1:]) + 1
        strikes = strikes[strikes > 1000]
        error = (recording[f"{side}/gait_phase.phase"][strikes] + 0.5) % 1.0 - 0.5
        assert len(strikes) > 30 and np.median(np.abs(error)) < 0.02 and np.percentile(np.abs(error), 95) < 0.04
        assert np.all(steady(recording, f"{side}/gait_phase.walking") == 1.0)
        assert np.max(np.abs(recording[f"{side}/knee.torque"])) <= LIMIT + TORQUE_STEP

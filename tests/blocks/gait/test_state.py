"""Walking and standing, strides outside their envelope, and the torque that fades with them."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from blocks.gait import GaitState, KneeEvents, PhaseKalmanFilter, StrideEnvelope, TorqueGate
from blocks.wearer import Walker
from graph import Diagram
from runtime.session.simulate import simulate
from runtime.setup.bench.gait import play
from runtime.setup.bench.gait_recordings import built_in, legs
from tests.blocks.gait.walks import RATE
from tests.blocks.running import both_ways, inside, player
from tests.shared import shared


def gait_of(knees, ticks):
    """Run phase, state and a gated torque of 10 N·m from two knee angles and velocities, as signals of a diagram."""
    with Diagram("state", RATE) as diagram:
        signals = {}
        for side, (angle, velocity) in knees().items():
            strike = KneeEvents(name=f"{side}_events")(angle=angle, velocity=velocity).strike
            phase = PhaseKalmanFilter(name=f"{side}_phase")(angle=angle, velocity=velocity, strike=strike)
            signals |= {f"{side}_phase": phase.phase, f"{side}_walking": phase.walking, f"{side}_velocity": velocity}
            envelope = StrideEnvelope(name=f"{side}_envelope")
            envelope(phase=phase.phase, u=angle, walking=phase.walking)
        state = GaitState(motion="knee", name="state")(**signals)
        torque = player(np.full(2, 10.0), "N·m")
        TorqueGate(name="gate")(u=torque, enable=state.walking)
    return simulate(diagram, ticks / RATE)


def played(angles):
    """Knees of {side: angle over the ticks in rad}."""
    return lambda: {
        side: (player(angle, "rad"), player(np.gradient(angle, 1.0 / RATE), "rad/s")) for side, angle in angles.items()
    }


@pytest.fixture(scope="module")
def stopping():
    """A Walker that stops and starts again: its knees while it runs."""
    speed = "0:1.2 20:1.2 21:0 24:0 26:1.2 40:1.2"

    def knees():
        walker = Walker(speed=speed, name="walker")()
        return {
            "left": (walker.left_knee_angle, walker.left_knee_velocity),
            "right": (walker.right_knee_angle, walker.right_knee_velocity),
        }

    return gait_of(knees, int(40 * RATE))


@pytest.mark.hazard("H12a")
def test_the_torque_ends_within_300_ms_of_standing_still(stopping):
    speeds = [np.abs(stopping[f"walker.{side}_knee_velocity"]) for side in ("left", "right")]
    moving = np.maximum(*speeds) > 0.2
    stop = np.flatnonzero(moving & (stopping.time < 24.0))[-1] + 1
    assert 20.0 < stopping.time[stop] < 23.0
    still = (stopping.time > stopping.time[stop] + 0.3) & (stopping.time < 24.0)
    assert still.sum() > 100 and not stopping["gate.y"][still].any() and stopping["state.standing"][still].all()


def test_walking_is_certain_before_and_after_the_stop(stopping):
    for begin, end in ((10.0, 20.0), (32.0, 40.0)):
        chosen = (stopping.time > begin) & (stopping.time < end)
        assert stopping["state.walking"][chosen].all() and stopping["gate.y"][chosen].min() == 10.0
        assert stopping["state.confidence"][chosen].min() > 0.2
        assert stopping["left_envelope.inside"][(stopping.time > 10.0) & (stopping.time < 20.0)].all()


def test_slow_walking_is_not_standing():
    with Diagram("slow", 100) as diagram:
        walker = Walker(speed="0:0.3 14:0.3 15:0", name="walker")()
        signals = {}
        for side in ("left", "right"):
            signals |= {
                f"{side}_phase": getattr(walker, f"{side}_phase"),
                f"{side}_walking": True,
                f"{side}_velocity": getattr(walker, f"{side}_thigh_motion")[7],
            }
        GaitState(name="state")(**signals)
    trial = simulate(diagram, 17.0)
    late = (trial.time > 2.0) & (trial.time < 14.0)
    assert trial["state.walking"][late].all() and not trial["state.standing"][late].any()
    moving = np.abs([trial[f"walker.{side}_thigh_motion[7]"] for side in ("left", "right")]).max(axis=0) > 0.05
    still = trial.time[np.flatnonzero(moving)[-1]]
    assert 14.0 < still < 16.0 and trial["state.standing"][trial.time > still + 0.2].all()


def test_a_leg_that_swings_beside_one_that_stands_does_not_walk():
    """The phases are those of a network, which follow the swinging leg: half a stride apart."""
    time = np.arange(0.0, 16.0, 1.0 / RATE)
    swings = 2.5 * np.sin(2.0 * np.pi * time)
    other = np.where(time < 6.0, -swings, np.where(time < 12.0, 0.05, -swings))
    state = inside(
        lambda: GaitState(motion="knee"),
        left_phase=time % 1.0,
        right_phase=(time + 0.5) % 1.0,
        left_walking=np.ones(len(time)),
        right_walking=np.ones(len(time)),
        left_velocity=swings,
        right_velocity=other,
    )
    walking, standing = state["walking"] == 1.0, state["standing"] == 1.0
    assert walking[(time > 1.0) & (time < 7.4)].all() and not walking[(time > 7.6) & (time < 12.0)].any()
    assert walking[time > 12.5].all() and not standing.any()


@pytest.mark.hazard("H12e")
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_stumble_ends_walking_within_a_stride_until_a_regular_one(side):
    """The phase of one leg stands for a fifth of a stride, from 10.3 s on; from 20 s on both take longer strides."""
    time = np.arange(0.0, 30.0, 1.0 / RATE)
    turns = np.where(time < 20.0, time, 20.0 + (time - 20.0) / 1.15)
    phases = {"left": turns, "right": turns + 0.5}
    phases[side] = phases[side] - np.clip(time - 10.3, 0.0, 0.25)
    swing = 2.5 * np.sin(2.0 * np.pi * turns)
    signals = {f"{leg}_phase": phase % 1.0 for leg, phase in phases.items()}
    signals |= {f"{leg}_walking": np.ones(len(time)) for leg in phases}
    signals |= {"left_velocity": swing, "right_velocity": -swing, "left_shank_velocity": swing.clip(min=-0.5)}
    walking = inside(lambda: GaitState(tolerance=0.4), **signals)["walking"] == 1.0
    ended = time[np.flatnonzero(~walking & (time > 9.0))[0]]
    resumed = time[np.flatnonzero(~walking & (time > 9.0))[-1]]
    assert 10.35 < ended < 10.42 and 11.0 < resumed < 12.8
    assert walking[(time > 2.0) & (time < 10.3)].all() and walking[time > 13.0].all()


def test_uneven_strides_and_changes_of_speed_are_no_stumble():
    """Strikes of each leg with an error of their own: strides vary by 6 %. After 130 s the speed changes every 5 s."""
    random = np.random.default_rng(4)
    time, strikes = np.arange(0.0, 190.0, 1.0 / RATE), np.arange(0.0, 131.0)
    speed = np.where(time < 130.0, 1.0, np.array([1.0, 0.8, 1.2, 1.4, 0.9, 1.1])[(time // 5.0).astype(int) % 6])
    turns = np.cumsum(speed) / RATE
    phases = {}
    for side, begin in (("left", 0.0), ("right", -0.5)):
        at = begin + strikes + 0.0425 * np.clip(random.normal(size=len(strikes)), -2.0, 2.0)
        phases[side] = np.where(time < 129.0, np.interp(time, at, strikes), turns - begin)
        assert np.diff(at).std() == pytest.approx(0.06, abs=0.01)
    swing = 2.5 * np.sin(2.0 * np.pi * turns)
    signals = {f"{leg}_phase": phase % 1.0 for leg, phase in phases.items()}
    signals |= {f"{leg}_walking": np.ones(len(time)) for leg in phases}
    signals |= {"left_velocity": swing, "right_velocity": -swing}
    walking = inside(lambda: GaitState(motion="knee"), **signals)["walking"] == 1.0
    assert walking[(time > 5.0) & (time < 130.0)].mean() > 0.95 and walking[time > 132.0].all()


def test_an_uncertain_phase_gives_less_torque():
    uncertainty = np.repeat([0.05, 0.075, 0.1, 0.29, 0.02, np.nan, 0.02], 200)
    ones = np.ones(len(uncertainty))
    y = inside(TorqueGate, u=10.0 * ones, enable=ones, uncertainty=uncertainty)["y"]
    np.testing.assert_allclose(y[199:1000:200], [10.0, 5.0, 0.0, 0.0, 10.0], atol=1e-12)
    assert np.isnan(y[1000:1200]).all() and y[1200] == pytest.approx(10.0)


def strides(time):
    """Knee angle in rad of strides of 1.1 s."""
    harmonics = ((0.05, -0.36), (-0.27, 0.06), (-0.02, 0.07))
    waves = [(a, b, 2.0 * np.pi * k * time / 1.1) for k, (a, b) in enumerate(harmonics, 1)]
    return 0.42 + sum(a * np.cos(w) + b * np.sin(w) for a, b, w in waves)


def squats(time):
    """Knee angle in rad of squats of 1.6 s, to 1.5 rad."""
    return 0.75 * (1.0 - np.cos(2.0 * np.pi * time / 1.6))


@pytest.mark.hazard("H12b")
@pytest.mark.parametrize(
    "angle, lag, walks", [(strides, 0.55, True), (strides, 0.0, False), (strides, 0.15, False), (squats, 0.03, False)]
)
def test_knees_that_bend_together_are_not_walking(angle, lag, walks):
    """The left knee alone is taken for one that walks, if it moves as in strides."""
    time = np.arange(0.0, 20.0, 1.0 / RATE)
    trial = gait_of(played({"left": angle(time), "right": angle(time - lag)}), len(time))
    assert trial["left_phase.walking"].any() == (angle is strides)
    assert trial["state.walking"].any() == trial["gate.y"].any() == walks


def test_recorded_squats_are_not_walking():
    with open(shared("gait/series_squat_opencap.csv"), newline="") as file:
        rows = list(csv.DictReader(file))
    time = np.array([float(row["time"]) for row in rows])
    ticks = np.arange(0.0, time[-1], 1.0 / RATE)
    knees = {
        side: np.radians(np.interp(ticks, time, [float(row[f"knee_flexion_{column}_deg"]) for row in rows]))
        for side, column in (("left", "lt"), ("right", "rt"))
    }
    trial = gait_of(
        played({side: np.tile(np.concatenate((knee, knee[::-1])), 3) for side, knee in knees.items()}), 9000
    )
    assert not trial["state.walking"].any() and not trial["gate.y"].any()


def alarms(time, angle, strikes):
    """Times at which a leg left its envelope, or its phase was lost. The phase is estimated from the same angle."""
    strike = np.isin(np.arange(len(time)), np.round(strikes * RATE))
    phase = inside(PhaseKalmanFilter, angle=angle, velocity=np.gradient(angle, 1.0 / RATE), strike=strike)
    walking = phase["walking"] == 1.0
    outputs = inside(StrideEnvelope, phase=phase["phase"], u=angle, walking=walking)
    usual = walking & (outputs["inside"] == 1.0)
    return time[1:][usual[:-1] & ~usual[1:]]


def test_a_leg_that_is_caught_at_any_phase_leaves_its_envelope_within_200_ms():
    """Every fourth stride the thigh stays for 0.25 s where it is, a tenth of a stride later each time."""
    walk = play(built_in()[0], "steady", RATE)
    clean = walk.signals["thigh"]
    assert len(alarms(walk.time, clean, walk.strikes)) == 0
    caught, begins = clean.copy(), []
    for number, stride in enumerate(range(20, 57, 4)):
        begin, end = walk.strikes[stride : stride + 2]
        begins.append(begin + 0.1 * number * (end - begin))
        share = np.interp(walk.time - begins[-1], (-1e-9, 0.0, 0.25, 0.55), (0.0, 1.0, 1.0, 0.0))
        caught += share * (np.interp(begins[-1], walk.time, clean) - clean)
    far = walk.time[np.abs(caught - clean) > 0.26]  # rad, beyond which no envelope reaches
    left = alarms(walk.time, caught, walk.strikes)
    late = []
    for begin in begins:
        deviates = far[(far > begin) & (far < begin + 0.6)]
        if len(deviates):  # near its turning point the thigh hardly moves
            late.append(min(left[left > begin], default=np.inf) - deviates[0])
    assert len(late) == 7 and max(late) < 0.2


@pytest.mark.parametrize("mode, rest", [("zero", 0.0), ("damping", -2.0), ("hold", 8.0)])
def test_the_gate_fades_to_zero_damping_or_the_last_torque(mode, rest):
    enable = np.arange(600) < 400
    torque = np.where(enable, 8.0, 3.0)
    velocity = np.full(600, 2.0)
    outputs = both_ways(lambda: TorqueGate(mode=mode), u=torque, enable=enable, velocity=velocity)["y"]
    if mode == "zero":
        assert outputs[49] == pytest.approx(4.0) and outputs[99] == pytest.approx(8.0)
    assert outputs[399] == pytest.approx(8.0)
    assert outputs[420:] == pytest.approx(rest)


def test_a_gate_that_holds_a_torque_never_exceeds_it_by_rounding():
    for torque in np.random.default_rng(1).uniform(0.5, 1.0, 100):
        gate = TorqueGate(mode="hold")
        gate.dt = 0.005
        assert max(gate.step(torque, tick < 75, 0.0) for tick in range(150)) == torque


def test_a_phase_beyond_its_range_counts_as_its_fraction():
    phase = np.linspace(0.0, 6.0, 1200) % 1.0
    near, far = (
        inside(StrideEnvelope, phase=phase + turns, u=np.sin(phase), walking=np.ones(1200, bool))
        for turns in (0.0, 2.0)
    )
    assert far["deviation"] == pytest.approx(near["deviation"], abs=1e-6)
    envelope = StrideEnvelope()
    envelope.dt = 0.001
    for phase in (1.7e308, -1.7e308, 1e18, -0.5):
        assert envelope.step(phase, 1.0, True) == (True, 0.0)


def test_weight_that_shifts_from_leg_to_leg_is_standing():
    """Contacts alternate as in walking, and the thighs move with at most 0.2 rad/s."""
    phase = np.arange(2000) / 280.0 % 1.0
    walking, velocity = np.ones(2000, dtype=bool), np.sin(2.0 * np.pi * phase)
    velocity = np.where(np.arange(2000) < 1000, 2.0, 0.2) * velocity
    signals = {"left_phase": phase, "right_phase": (phase + 0.5) % 1.0, "left_walking": walking}
    signals |= {"right_walking": walking, "left_velocity": velocity, "right_velocity": -velocity}
    outputs = inside(GaitState, **signals)
    assert outputs["walking"][400:1000].all()
    assert outputs["standing"][1301:].all() and not outputs["walking"][1301:].any()


def test_both_legs_in_phase_are_unknown():
    phase = np.arange(2000) / 220.0 % 1.0
    walking, velocity = np.ones(2000, dtype=bool), np.sin(2.0 * np.pi * phase)
    signals = {"left_phase": phase, "left_walking": walking, "right_walking": walking}
    signals |= {"left_velocity": velocity, "right_velocity": velocity}
    assert not inside(GaitState, right_phase=phase, **signals)["walking"][200:].any()
    outputs = inside(GaitState, right_phase=(phase + 0.5) % 1.0, **signals)
    assert (outputs["state"][400:] == 2.0).all() and outputs["confidence"][400:].min() > 0.99


def directed(walk, sign=1.0, shanks=(), motion="thigh"):
    """Run a GaitState with both thighs or knees, and some shanks, while the phases say that the legs walk.

    walk : {side: Walk}; sign : 1 or -1, the order of time
    """
    count = len(walk["left"].time)
    phase = np.arange(count) / RATE / 1.1 % 1.0
    signals = {"left_phase": phase, "right_phase": (phase + 0.5) % 1.0}
    signals |= {f"{side}_walking": np.ones(count, dtype=bool) for side in walk}
    order = slice(None, None, int(sign))
    signals |= {f"{side}_velocity": sign * leg.signals[f"{motion}_velocity"][order] for side, leg in walk.items()}
    for side in shanks:
        signals[f"{side}_shank_velocity"] = sign * walk[side].signals["shank_velocity"][order]
    return inside(lambda: GaitState(motion=motion), **signals)


def walk_of(recording):
    """Return {side: Walk} of both legs of a recording, or of the built-in walk with its left leg as the right one."""
    if recording:
        return {leg.name: play(leg, "steady", RATE) for leg in legs(shared(recording), {})}
    leg = built_in()[0]
    half = round(0.5 * np.median(np.diff(play(leg, "steady", RATE).strikes)) * RATE)
    later = {name: np.roll(angle, half) for name, angle in leg.angles.items()}
    return {"left": play(leg, "steady", RATE), "right": play(replace(leg, angles=later), "steady", RATE)}


@pytest.mark.hazard("H12e")
@pytest.mark.parametrize(
    "motion, shanks, largest",
    [("thigh", (), -2.0), ("thigh", ("left", "right"), -2.0), ("thigh", ("left",), -2.0), ("knee", (), 1.0)],
)
@pytest.mark.parametrize("recording", ["", "gait/healthy_young.csv"])
def test_the_same_motion_backward_is_not_walking(recording, motion, shanks, largest):
    """By thighs, both shanks, the shank of one leg, or knees. largest : direction backward"""
    walk = walk_of(recording)
    late = slice(int(3.0 * RATE), int(-1.0 * RATE))
    forward, backward = (directed(walk, sign, shanks, motion) for sign in (1.0, -1.0))
    assert forward["walking"][late].all() and forward["direction"][late].min() > 1.5
    assert not backward["walking"][late].any() and backward["direction"][late].max() < largest
    assert (backward["confidence"][late] == 0.0).all()


@pytest.mark.hazard("H12e")
@pytest.mark.parametrize("shanks", [(), ("left", "right")])
@pytest.mark.parametrize("stride", [1.1, 2.0])
def test_steps_backward_after_a_walk_and_a_stand_are_not_walking_from_the_first_one_on(shanks, stride):
    """While the phases say at once that the legs walk; a walk forward begins within a stride. stride : s"""
    walk = walk_of("")
    own = np.median(np.diff(walk["left"].strikes))  # s
    ticks, stand = int(9.0 * RATE), int(1.5 * RATE)
    moved = np.arange(0.0, ticks) / RATE * own / stride
    for begin in own * (3.0 + np.arange(8) / 8.0):
        signals, sides = {}, {"left": 0.0, "right": 0.5}
        for kind, names in (("thigh", sides), ("shank", shanks)):
            for side in names:
                rate = walk[side].signals[f"{kind}_velocity"] * own / stride
                forward, again = (np.interp(at + moved, walk[side].time, rate) for at in (3.0, begin))
                backward = -np.interp(begin + moved[::-1], walk[side].time, rate)
                name = f"{side}_{'shank_' * (kind == 'shank')}velocity"
                signals[name] = np.concatenate((forward, np.zeros(stand), backward, np.zeros(stand), again))
        for side, apart in sides.items():
            signals[f"{side}_phase"] = (np.arange(len(signals["left_velocity"])) / RATE / stride + apart) % 1.0
            signals[f"{side}_walking"] = np.ones(len(signals["left_velocity"]), dtype=bool)
        walking = inside(GaitState, **signals)["walking"]
        parts = np.split(walking, np.cumsum([ticks, stand, ticks, stand]))
        assert parts[0][-1] and not parts[2].any()
        assert parts[4][int(stride * RATE) :].all()


@pytest.mark.parametrize("pause", [0.3, 0.6])
def test_a_walk_with_a_pause_in_each_step_is_a_walk_forward(pause):
    """As with sticks. The legs stand in each pause of so many s, but walk on at once."""
    walk = walk_of("")
    stride = np.median(np.diff(walk["left"].strikes))  # s
    clock = np.arange(0.0, 20.0, 1.0 / RATE)
    steps, since = np.divmod(clock, 0.5 * stride + pause)
    own = 0.5 * stride * steps + np.minimum(since, 0.5 * stride)
    moves = since < 0.5 * stride
    signals = {}
    for side, apart in (("left", 0.0), ("right", 0.5)):
        velocity = np.interp(3.0 + own, walk[side].time, walk[side].signals["thigh_velocity"])
        signals[f"{side}_velocity"] = np.where(moves, velocity, 0.0)
        signals[f"{side}_phase"] = (own / stride + apart) % 1.0
        signals[f"{side}_walking"] = np.ones(len(own), dtype=bool)
    state = inside(GaitState, **signals)
    later = clock > 10.0
    assert state["walking"][later & moves].mean() > 0.95
    assert state["standing"][later & (since > 0.5 * stride + 0.2)].all()


def test_the_first_stride_after_a_stumble_and_a_stop_is_not_the_usual_one():
    """At 8 s the phases are known as the left one begins, and for one tick the right one is 0.22 strides late."""
    walk = walk_of("")
    time = np.arange(0.0, 12.0, 1.0 / RATE)
    stride = np.median(np.diff(walk["left"].strikes))  # s
    left = ((time - 8.0) / stride) % 1.0
    right = left + 0.5 + 0.25 * ((time > 5.0) & (time < 5.3)) - 0.22 * (np.abs(time - 8.0) < 0.5 / RATE)
    known = (time < 5.4) | (time > 8.0 - 0.5 / RATE)
    signals = {"left_phase": left, "right_phase": right % 1.0, "left_walking": known, "right_walking": known}
    for side in ("left", "right"):
        signals[f"{side}_velocity"] = np.interp(time + 2.0, walk[side].time, walk[side].signals["thigh_velocity"])
    walking = inside(GaitState, **signals)["walking"]
    assert walking[(time > 3.0) & (time < 5.0)].all() and not walking[(time > 5.1) & (time < 8.0)].any()
    assert walking[time > 8.0 + 1.1 * stride].all()


@pytest.mark.hazard("H12e")
def test_steps_backward_after_a_short_stand_are_walking_for_less_than_a_third_of_a_stride():
    walk = walk_of("")
    own = np.median(np.diff(walk["left"].strikes))  # s
    moved = np.arange(0.0, 9.0, 1.0 / RATE)
    for begin in own * (3.0 + np.arange(8) / 8.0):
        signals, still = {}, np.zeros(int(0.4 * RATE))
        for side, apart in (("left", 0.0), ("right", 0.5)):
            rate = walk[side].signals["thigh_velocity"]
            forward = np.interp(begin - moved[::-1] % own, walk[side].time, rate)
            backward = -np.interp(begin - moved % own, walk[side].time, rate)
            signals[f"{side}_velocity"] = np.concatenate((forward, still, backward))
            count = len(signals[f"{side}_velocity"])
            signals[f"{side}_phase"] = (np.arange(count) / RATE / own + apart) % 1.0
            signals[f"{side}_walking"] = np.ones(count, dtype=bool)
        walking = inside(GaitState, **signals)["walking"][len(moved) + len(still) :]
        assert walking.sum() / RATE < 0.3 * own

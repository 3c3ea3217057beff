"""Walking and standing, strides outside their envelope, and the torque that fades with them."""

import csv

import numpy as np
import pytest

from blocks.gait import GaitState, KneeEvents, PhaseKalmanFilter, StrideEnvelope, TorqueGate
from blocks.wearer import Walker
from graph import Diagram
from runtime.session.simulate import simulate
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
        state = GaitState(name="state")(**signals)
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


def test_squats_are_not_walking():
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


def stumble(phase, angle, begin):
    """The swing of one stride interrupted at 75 % of it: the angle stays where it is, as with a caught foot."""
    caught = angle.copy()
    end = begin + int(0.25 * RATE)
    caught[begin:end] = caught[begin]
    return caught


def test_a_caught_foot_leaves_the_envelope_within_200_ms():
    stride = int(1.1 * RATE)
    phase = np.arange(30 * stride) / stride % 1.0
    random = np.random.default_rng(0)
    gain = np.repeat(1.0 + 0.03 * random.normal(size=30), stride)
    angle = gain * (0.6 - 0.5 * np.cos(2.0 * np.pi * phase) + 0.1 * np.sin(4.0 * np.pi * phase))
    begin = 25 * stride + int(0.75 * stride)
    clean = inside(StrideEnvelope, phase=phase, u=angle)
    assert clean["inside"].all()
    outputs = inside(StrideEnvelope, phase=phase, u=stumble(phase, angle, begin))
    left = np.flatnonzero(outputs["inside"] == 0.0)
    assert begin < left[0] <= begin + 0.2 * RATE
    assert outputs["inside"][left[0] + int(1.6 * RATE) :].all()


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


def test_both_legs_in_phase_are_unknown():
    phase = np.arange(2000) / 220.0 % 1.0
    walking, velocity = np.ones(2000, dtype=bool), np.sin(2.0 * np.pi * phase)
    signals = {"left_phase": phase, "left_walking": walking, "right_walking": walking}
    signals |= {"left_velocity": velocity, "right_velocity": velocity}
    assert not inside(GaitState, right_phase=phase, **signals)["walking"][200:].any()
    outputs = inside(GaitState, right_phase=(phase + 0.5) % 1.0, **signals)
    assert (outputs["state"][400:] == 2.0).all() and outputs["confidence"][400:].min() > 0.99

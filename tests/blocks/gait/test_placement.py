"""Sensors that are exchanged, upside down or turned, against a reference on both legs."""

import re

import numpy as np
import pytest

from blocks.gait import SegmentOrder, SegmentPosture, SensorPlacement
from diagrams.parts import STIFF_KNEE
from graph import Diagram
from runtime.setup.bench.gait import play
from runtime.setup.bench.gait_recordings import legs
from tests.blocks.gait.walks import RATE
from tests.blocks.running import player, run
from tests.shared import shared
from tests.soaking import soaked

# Gains from the rate of the left and of the right leg to the sensors of both, the status and what its text contains.
MISPLACED = {
    "exchanged": (((0.0, 1.0), (1.0, 0.0)), "kernel status 64", "thigh IMUs of left and right are exchanged"),
    "left upside down": (((-1.0, 0.0), (0.0, 1.0)), "kernel status 65", "the left one of the thigh IMUs moves against"),
    "right upside down": (((1.0, 0.0), (0.0, -1.0)), "kernel status 66", "the right one of the thigh IMUs moves"),
    "left turned": (((0.1, 0.0), (0.0, 1.0)), "kernel status 67", "the left one of the thigh IMUs does not move"),
    "right turned": (((1.0, 0.0), (0.0, 0.1)), "kernel status 68", "the right one of the thigh IMUs does not move"),
    "both upside down": (((-1.0, 0.0), (0.0, -1.0)), "kernel status 64", "exchanged"),
}


def compared(gains, opposite=False, enable=None):
    """Return the outcome and the agreement of a comparison of thighs with hips in recorded walking."""
    walk = [play(leg, "steady", RATE).signals for leg in legs(shared("gait/healthy_young.csv"), {})]
    rates = np.stack([signals["thigh_velocity"] for signals in walk])
    sensors = (-1.0 if opposite else 1.0) * np.array(gains) @ rates
    with Diagram("placement", RATE) as diagram:
        signals = {"left_reference": rates[0], "right_reference": rates[1], "left": sensors[0], "right": sensors[1]}
        inputs = {name: player(values, "rad/s") for name, values in signals.items()}
        if enable is not None:
            inputs["enable"] = player(np.full(2, enable), dtype=bool)
        SensorPlacement("thigh IMUs", "hip drives", opposite, name="monitor")(**inputs)
    return diagram["monitor"], run(diagram, int(20.0 * RATE))


@pytest.mark.hazard("H12f")
@pytest.mark.parametrize("opposite", soaked([False, True], but=[1]))
@pytest.mark.parametrize("gains, status, text", MISPLACED.values(), ids=list(MISPLACED))
def test_misplaced_sensors_are_a_fault_within_two_seconds_of_walking(gains, status, text, opposite):
    monitor, trial = compared(gains, opposite)
    assert trial.outcome.status == status and trial.time[-1] < 2.0
    assert text in monitor.fault_text(int(status.split()[-1]))


def test_correct_sensors_agree_and_a_disabled_comparison_reports_nothing():
    _, trial = compared(((1.0, 0.0), (0.0, 1.0)))
    assert trial.outcome.status == "ok" and trial["monitor.agreement"][200:].min() > 0.99
    _, trial = compared(MISPLACED["exchanged"][0], enable=False)
    assert trial.outcome.status == "ok" and trial["monitor.agreement"][200:].max() < -0.99


@pytest.mark.parametrize("sign, least, status", [(1.0, 0.8, "ok"), (-1.0, -0.3, "kernel status 64")])
def test_one_sensor_is_compared_with_one_reference(sign, least, status):
    [leg] = [leg for leg in legs(shared("gait/healthy_young.csv"), {}) if leg.name == "left"]
    rate = play(leg, "steady", RATE).signals["thigh_velocity"]
    with Diagram("placement", RATE) as diagram:
        monitor = SensorPlacement("ankle drives", "knees", one_leg=True, least=least, name="monitor")
        monitor(left=player(sign * rate, "rad/s"), left_reference=player(rate, "rad/s"))
    assert run(diagram, int(10.0 * RATE)).outcome.status == status
    assert "the ankle drives do not move as the knees" in monitor.fault_text(64)


@pytest.mark.hazard("H12f")
@pytest.mark.parametrize("stiff", [1.0, 0.6, 0.5, 0.4, 0.3])
@pytest.mark.parametrize("exchanged", [None, "left", "right"])
def test_a_thigh_that_turns_faster_than_its_shank_is_a_fault(exchanged, stiff):
    """Also beside a stiff left knee, which is none. stiff : its share of the range"""
    rates = {}
    for leg in legs(shared("gait/healthy_young.csv"), {}):
        signals = play(leg, "steady", RATE).signals
        pair = [signals["thigh_velocity"], signals["shank_velocity"]]
        if leg.name == "left" != exchanged:
            pair[1] = pair[0] - stiff * (pair[0] - pair[1])
        rates[f"{leg.name}_upper"], rates[f"{leg.name}_lower"] = pair[::-1] if leg.name == exchanged else pair
    with Diagram("order", RATE) as diagram:
        SegmentOrder(least=STIFF_KNEE, name="monitor")(
            **{name: player(values, "rad/s") for name, values in rates.items()}
        )
    trial = run(diagram, int(20.0 * RATE))
    if exchanged is None:
        assert trial.outcome.status == "ok"
    else:
        status = 64 + ("left", "right").index(exchanged)
        assert trial.outcome.status == f"kernel status {status}" and trial.time[-1] < 2.0
        assert f"thigh IMU of the {exchanged} leg" in diagram["monitor"].fault_text(status)


@pytest.mark.hazard("H12f")
@pytest.mark.parametrize("segment", soaked(["thigh", "shank"], but=[1]))
@pytest.mark.parametrize(
    "changed, status, text",
    [
        (None, "ok", ""),
        (("left",), "kernel status 66", "IMU of the left leg differs from that of the other leg by more than 15°"),
        (("right",), "kernel status 67", "IMU of the right leg differs"),
        (("left", "right"), "kernel status 64", "IMU of the left leg has a mean pitch outside"),
        ((15.0, 1.0), "kernel status 6[79]", "IMU of the right leg"),
        ((15.0, 11.0), "kernel status 6[79]", "IMU of the right leg"),
    ],
)
def test_a_sensor_that_is_turned_or_slips_is_a_fault(segment, changed, status, text):
    """Legs whose sensor is turned, by 20°, or by 60° on both; or (degrees, s) of a slip on the right."""
    walk = legs(shared("gait/healthy_young.csv"), {})
    pitches = {leg.name: play(leg, "steady", RATE).signals[segment] for leg in walk}
    for name in pitches:
        if changed and changed[0] in pitches:
            pitches[name] += np.radians(60.0 if len(changed) == 2 else 20.0) * (name in changed)
    if changed and changed[0] not in pitches:
        slip = np.interp(np.arange(len(pitches["right"])) / RATE - 20.0, (0.0, changed[1]), (0.0, changed[0]))
        pitches["right"] += np.radians(slip)
    with Diagram("posture", RATE) as diagram:
        inputs = {name: player(values, "rad") for name, values in pitches.items()}
        SegmentPosture(f"{segment} IMU", lowest=-0.79, highest=0.79, name="monitor")(**inputs)
    trial = run(diagram, int(45.0 * RATE))
    assert re.fullmatch(status, trial.outcome.status)
    if changed:
        assert text in diagram["monitor"].fault_text(int(trial.outcome.status.split()[-1]))
        assert trial.time[-1] < (5.0 if changed[0] in pitches else 24.0 + changed[1])


@pytest.mark.hazard("H12f")
@pytest.mark.parametrize("stride", [1.6, 2.0, 2.4])
@pytest.mark.parametrize("turned", [None, "left", "right"])
def test_a_turned_sensor_is_a_fault_in_long_strides_and_their_motion_is_not(turned, stride):
    """stride : s; the walk is compared from each eighth of its first stride on, with a shank turned by 20° or none."""
    walk = {leg.name: leg for leg in legs(shared("gait/healthy_young.csv"), {})}
    own = np.median(np.diff(play(walk["left"], "steady", RATE).strikes))  # s
    for begin in own * np.arange(8) / 8.0:
        with Diagram("posture", RATE) as diagram:
            inputs = {}
            for name, leg in walk.items():
                at = begin + np.arange(0.0, 20.0, 1.0 / RATE) * own / stride
                pitch = np.interp(at, leg.time - leg.time[0], leg.angles["shank"])
                inputs[name] = player(pitch + np.radians(20.0) * (name == turned), "rad")
            SegmentPosture("shank IMU", lowest=-0.79, highest=0.79, name="monitor")(**inputs)
        trial = run(diagram, int(19.0 * RATE))
        if turned:
            assert trial.outcome.status == f"kernel status {66 + (turned == 'right')}"
            assert trial.time[-1] < 3.0 * stride + 1.0
        else:
            assert trial.outcome.status == "ok", (begin, trial.outcome)


@pytest.mark.parametrize("pivoting", ["left", "right"])
def test_a_leg_that_pivots_on_its_foot_in_a_turn_is_no_wrong_order(pivoting):
    """Its shank turns a little, as in the turns of recorded adults, and its foot less, while the other leg steps."""
    rates = {}
    for leg in legs(shared("gait/healthy_young.csv"), {}):
        signals = play(leg, "steady", RATE).signals
        pair = [signals["thigh_velocity"], signals["shank_velocity"]]
        if leg.name == pivoting:
            pair = [0.4 * pair[0], 0.2 * pair[0]]
        rates[f"{leg.name}_upper"], rates[f"{leg.name}_lower"] = pair
    with Diagram("order", RATE) as diagram:
        SegmentOrder("shank IMU", "foot IMU", name="monitor")(
            **{name: player(values, "rad/s") for name, values in rates.items()}
        )
    assert run(diagram, int(20.0 * RATE)).outcome.status == "ok"


@pytest.mark.parametrize("time, status", [(0.52, "ok"), (1.0, "kernel status 65")])
def test_a_leg_that_moves_against_its_reference_in_one_step_is_no_fault(time, status):
    """As in the first steps of a turn. time : s before and after 10 s, so that the means disagree for 0.2 to 0.3 s"""
    walk = [play(leg, "steady", RATE).signals["thigh_velocity"] for leg in legs(shared("gait/healthy_young.csv"), {})]
    against = np.where(np.abs(np.arange(len(walk[0])) / RATE - 10.0) < time, -1.0, 1.0)
    signals = {"left_reference": walk[0], "right_reference": walk[1], "left": against * walk[0], "right": walk[1]}
    with Diagram("placement", RATE) as diagram:
        inputs = {name: player(values, "rad/s") for name, values in signals.items()}
        SensorPlacement("thigh IMUs", "insoles", name="monitor")(**inputs)
    assert run(diagram, int(20.0 * RATE)).outcome.status == status


@pytest.mark.parametrize("time, status", [(1.5, "ok"), (4.0, "kernel status 66")])
def test_a_posture_that_differs_for_a_step_is_no_fault(time, status):
    """time : s, for which one thigh is 25° further forward, as in the last step of a walk"""
    walk = {leg.name: leg for leg in legs(shared("gait/healthy_young.csv"), {})}
    pitches = {name: play(leg, "steady", RATE).signals["thigh"] for name, leg in walk.items()}
    pitches["left"] += np.radians(25.0) * (np.abs(np.arange(len(pitches["left"])) / RATE - 5.0) < 0.5 * time)
    with Diagram("posture", RATE) as diagram:
        SegmentPosture("thigh IMU", name="monitor")(**{name: player(each, "rad") for name, each in pitches.items()})
    assert run(diagram, int(20.0 * RATE)).outcome.status == status


@pytest.mark.parametrize("turned", [0.0, 20.0])
def test_a_walk_that_is_not_certain_for_a_moment_in_each_second_is_compared(turned):
    """turned : ° by which the left sensor is turned"""
    walk = {leg.name: play(leg, "steady", RATE).signals["thigh"] for leg in legs(shared("gait/healthy_young.csv"), {})}
    walk["left"] += np.radians(turned)
    with Diagram("posture", RATE) as diagram:
        inputs = {name: player(pitch, "rad") for name, pitch in walk.items()}
        enable = player(np.arange(20.0 * RATE) % RATE < 0.9 * RATE, dtype=bool)
        SegmentPosture("thigh IMU", name="monitor")(**inputs, enable=enable)
    trial = run(diagram, int(19.0 * RATE))
    assert trial.outcome.status == ("kernel status 66" if turned else "ok") and (not turned or trial.time[-1] < 4.0)

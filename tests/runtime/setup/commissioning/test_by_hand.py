"""The steps in which the operator moves a joint, on samples of drives with faults: each has its own name."""

import math
from collections import Counter
from types import SimpleNamespace

import pytest

from runtime.robot.rig.records import AGREES, DIFFERS, StepRecord
from runtime.setup.commissioning.guided import by_hand, passive
from runtime.setup.commissioning.guided.bench import Given, Sample
from tests.runtime.setup.commissioning.moved import block_of

ANGLE, PERIOD, SPEED = math.pi / 2.0, 0.01, 1.5  # rad, s, rad/s


def turned(seconds=3.0, position=1.0, velocity=1.0, bias=0.0, spikes=(), gaps=()):
    """Samples of a joint that turns by ANGLE. position, velocity : factors of the reading

    bias : rad/s of the velocity; spikes : s at which the position is wrong by 0.4 rad; gaps : (s, s) without replies
    """
    samples = []
    for index in range(round(seconds / PERIOD)):
        time = index * PERIOD
        angle = min(ANGLE, max(0.0, SPEED * (time - 0.5)))
        speed = SPEED * (0.0 < angle < ANGLE)
        if not any(begin <= time < end for begin, end in gaps):
            wrong = 0.4 * any(begin <= time < begin + 0.015 for begin in spikes)
            samples.append(
                Sample(time, position * angle + wrong, velocity * speed + bias, SimpleNamespace(position=0.0))
            )
    return samples


class Hand:
    """Stands for a Bench: the joint is turned by what its samples contain."""

    def __init__(self, block, samples):
        self.seen, self.queried = {block.path: samples}, Counter({block.path: 300})

    def until_entered(self, instruction):
        return self.seen

    def at_rest(self, block):
        self.queried.clear()  # as every other reading does
        return self.seen[block.path]


def result_of(samples, steps=None, kind="CubeMars", model="AK80-9", **parameters):
    block = block_of(kind, model, range=(-6.0, 6.0), **parameters)
    return by_hand.turn(Hand(block, samples), block, Given(ANGLE, steps=steps or {}))


CASES = {  # samples, finding
    "healthy": ({}, []),
    "a reply in 25 is late or lost": ({"gaps": [(each, each + 0.01) for each in (0.3, 0.7, 1.1)]}, []),
    "stuck position": ({"position": 0.0}, ["encoder"]),
    "no velocity": ({"velocity": 0.0}, ["no velocity"]),
    "no velocity, one quantum": ({"velocity": 0.0, "bias": 0.012}, ["no velocity"]),
    "velocity of the motor": ({"velocity": 9.0}, ["velocity range"]),
    "position against both": ({"position": -1.0}, ["direction", "sign of velocity"]),
    "spikes": ({"spikes": (0.6, 0.9, 1.2)}, ["noisy position"]),
    "plug": ({"gaps": [(0.7, 0.9)]}, ["lost replies"]),
}


@pytest.mark.parametrize("case", CASES)
def test_each_fault_of_a_reading_that_is_turned_by_hand_has_its_own_name(case):
    samples, findings = CASES[case]
    result = result_of(turned(**samples))
    assert [name for name, _ in result.findings] == findings, result
    assert "wire_velocity" not in result.cures or case == "velocity of the motor"


def test_a_velocity_that_was_wrong_at_rest_is_not_taken_for_another_range():
    steps = {"state": StepRecord("", DIFFERS, {"velocity": 0.5})}
    assert not result_of(turned(bias=0.5), steps).findings
    assert result_of(turned(bias=0.5)).cures


@pytest.mark.parametrize("offset, zero, wanted", [(0.1, -0.4, 0.3), (0.0, 0.0, None), (0.3, 0.0, -0.3)])
def test_an_offset_is_offered_for_the_direction_that_is_offered(offset, zero, wanted):
    steps = {"pose": StepRecord("", AGREES, {"zero": zero})}
    result = result_of(turned(position=-1.0, velocity=-1.0), steps, offset=offset)
    assert result.cures.get("invert") is True and result.cures.get("offset") == wanted
    if wanted is not None:  # the reading at zero was zero + offset before its sign changes
        assert -(zero + offset) - wanted == pytest.approx(0.0)


def at_rest(seconds=0.4, velocity=0.0, drift=0.0, **answer):
    answer = {"temperature": 30.0, "torque": 0.0, "enabled": False} | answer
    times = [index * PERIOD for index in range(round(seconds / PERIOD))]
    return [Sample(time, drift * time, velocity, SimpleNamespace(**answer)) for time in times]


REST = {  # samples, findings
    "healthy": ({}, []),
    "warm, with an offset of its current": ({"temperature": 65.0, "torque": 0.1, "velocity": 0.03}, []),
    "nothing but a position": ({"temperature": None, "torque": None, "enabled": None}, []),
    "code 0 of the temperature": ({"temperature": -40.0}, ["temperature"]),
    "hot": ({"temperature": 95.0}, ["temperature"]),
    "velocity": ({"velocity": 0.4}, ["velocity at rest"]),
    "a joint that sinks": ({"velocity": 0.15, "drift": 0.15}, []),
    "torque": ({"torque": -0.4}, ["torque at rest"]),
    "enabled": ({"enabled": True}, ["not disabled"]),
}


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("case", REST)
def test_a_reading_that_is_impossible_at_rest_is_named(case):
    samples, findings = REST[case]
    result = passive.Result()
    passive.compare_rest(result, block_of("CubeMars", "AK80-9"), at_rest(**samples))
    assert [name for name, _ in result.findings] == findings, result


@pytest.mark.parametrize("reports, found", [(50, False), (60, False), (100, True), (20, True)])
def test_a_rate_of_reports_that_is_not_declared_is_named(reports, found):
    result = passive.Result()
    passive.compare_reports(result, SimpleNamespace(report_rate=100.0), reports)
    assert [name for name, _ in result.findings] == ["report rate"] * found
    assert result.cures == ({"report_rate": reports / passive.REPORTS_TIME} if found else {})


@pytest.mark.parametrize("left, findings", [(0.0, []), (0.7, ["zero not set"])])
def test_a_drive_that_ignores_the_frame_that_sets_its_zero_is_named(monkeypatch, left, findings):
    monkeypatch.setattr(passive, "confirmed", lambda question: True)
    block = block_of("CubeMars", "AK80-9", zero_at_arming=True)
    samples = [sample for sample in turned(passive.ZERO_TIME, 0.0) if sample.time > 0.0]
    now = passive.time.monotonic()
    samples = [Sample(now + sample.time, left, 0.0, None) for sample in samples]
    bench = SimpleNamespace(
        at_rest=lambda block: samples,
        for_seconds=lambda seconds, drives: {block.path: samples},
        buses={block.bus: SimpleNamespace(send=lambda frame, why: None)},
    )
    result = passive.zero(bench, block, Given(ANGLE))
    assert [name for name, _ in result.findings] == findings, result

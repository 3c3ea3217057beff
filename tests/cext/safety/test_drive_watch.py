"""The watch over each actuator: its RMS torque in five modes, its temperature, each reported once and counted."""

import math

import numpy as np
import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars, RobStride
from blocks.models import Limb
from graph import Block, Diagram, DiagramError, Output
from tests.cext.rigs import Rig

RATE = 200
RATED = 9.0  # N·m, AK80-9; its peak is 18


class Asked(Block):
    """A torque of 15 N·m for the first second, 0 from then on."""

    torque = Output("N·m", range=(0.0, 15.0))

    def step(self, t):
        return 15.0 if t < 1.0 else 0.0


class Heat(Block):
    """A temperature that rises by 10 °C a second."""

    temperature = Output("°C")

    def step(self, t):
        return 60.0 + 10.0 * t


def watched(torque=None, temperature=30.0, seconds=2.0, **parameters):
    """(Rig after its run, Outcome) of a drive on a heavy limb, with a window of 1 s by default."""
    with Diagram("robot", rate=RATE) as robot:
        knee = CubeMars("AK80-9", name="knee", **{"limit": "peak", "rms_window": 1.0, **parameters})
        knee(torque_command=(Asked()() if torque is None else torque))
    with Diagram("plant", rate=2 * RATE) as plant:
        drive = EmulatedCubeMars.of(robot["knee"], name="drive")
        limb = Limb(inertia=10.0, damping=0.0, stiffness=0.0, reflex=0.0, name="limb")
        limb(torque=drive.torque)
        drive(
            position=limb.position, velocity=limb.velocity, temperature=Heat()() if temperature is None else temperature
        )
    rig = Rig(robot, plant)
    outcome = rig.run(round(seconds * RATE), fade=0.0)
    return rig, outcome


def reference_rms(torque, window):
    """Root mean square over the last `window` s, zeros before the begin."""
    squares = np.concatenate([[0.0], np.cumsum(np.square(torque) / RATE)])
    count = round(window * RATE)
    return np.sqrt([(squares[i + 1] - squares[max(0, i + 1 - count)]) / window for i in range(len(torque))])


def test_the_rms_torque_is_that_of_the_last_window_within_a_bucket():
    rig, outcome = watched(rms_mode="silent")
    assert outcome.status == "ok"
    rms, exact = rig["knee.rms_torque"], reference_rms(rig["knee.torque"], 1.0)
    longer = reference_rms(rig["knee.torque"], 1.0 + 2.0 / 64)
    assert np.all(rms >= exact - 1e-9) and np.all(rms <= longer * math.sqrt(1.0 + 2.0 / 64) + 1e-9)
    assert rms.max() == pytest.approx(15.0, abs=0.2) and rms[-1] < 3.0
    assert rig.control.reports.watched[0]["rms_ticks"] == 0 and rig.events == []


@pytest.mark.parametrize("window", [1e-6, 1e-3, 0.005])
def test_rms_torque_of_a_window_within_a_tick_is_the_torque(window):
    rig, outcome = watched(rms_mode="silent", rms_window=window, seconds=0.5)
    assert outcome.status == "ok"
    assert rig["knee.rms_torque"][2:] == pytest.approx(np.abs(rig["knee.torque"][2:]), rel=1e-9)


@pytest.mark.hazard("H11b")
def test_saturate_lowers_limit_to_rated_torque_near_rated_rms():
    rig, outcome = watched()
    assert outcome.status == "ok"
    sent, rms = rig["knee.torque_sent"], rig["knee.rms_torque"]
    assert sent[0] == pytest.approx(15.0, abs=0.01) and RATED < rms.max() < math.sqrt(2.0) * RATED
    assert np.abs(sent[(rms > RATED) & (rig.tick < RATE)] - RATED).max() < 0.01
    low = (rms > 0.9 * RATED) & (rig.tick < RATE)
    assert np.all(np.diff(sent[low]) <= 0.05), "it slides and does not chatter"
    [told] = rig.events
    assert told["device"] == "knee" and told["tick"] == rig.tick[rms > 0.9 * RATED][0]
    assert (
        told["what"]
        == "RMS torque over 1 s is above 90 % of the rated 9 N·m: the torque limit is reduced to the rated torque"
    )
    assert rig.control.reports.watched[0]["rms_ticks"] == int((rms > 0.9 * RATED).sum()) and rig["knee.limited"][-1] > 0


def test_throttle_reduces_torque_further():
    rig, outcome = watched(rms_mode="throttle")
    assert outcome.status == "ok" and rig["knee.rms_torque"].max() < 1.1 * RATED
    assert rig["knee.torque_sent"][rig.tick < RATE].min() < 0.6 * RATED


def test_warn_keeps_limit_and_is_reported_once():
    rig, outcome = watched(rms_mode="warn")
    assert outcome.status == "ok" and rig["knee.torque_sent"][RATE - 1] == pytest.approx(15.0, abs=0.01)
    assert [told["what"] for told in rig.events] == ["RMS torque over 1 s is above the rated 9 N·m"]
    assert rig.control.reports.watched[0]["rms_ticks"] == int((rig["knee.rms_torque"] > RATED).sum()) > 50


@pytest.mark.hazard("H11b")
def test_disable_ends_the_run_in_the_tick_that_passes_the_rated_rms():
    rig, outcome = watched(rms_mode="disable")
    assert (outcome.status, outcome.culprit) == ("rms torque", "knee")
    assert RATED * 0.97 < rig["knee.rms_torque"][-1] <= RATED and outcome.tick == rig.tick[-1] + 1


def test_limit_at_rated_torque_is_not_lowered_by_rms():
    rig, outcome = watched(torque=9.0, limit="rated")
    assert outcome.status == "ok" and rig["knee.limited"][-1] == 0 and rig.events == []
    assert rig["knee.torque_sent"].min() == pytest.approx(9.0, abs=0.01)


@pytest.mark.hazard("H11a")
def test_warming_drive_is_reported_derated_then_ends_run():
    rig, outcome = watched(torque=10.0, temperature=None, seconds=10.0, rms_mode="silent")
    heard = rig["knee.temperature"]
    assert (outcome.status, outcome.culprit) == ("too hot", "knee") and 98.0 < heard[-1] <= 100.0
    expected = np.clip((100.0 - heard) / 20.0, 0.0, 1.0) * 18.0
    assert np.abs(rig["knee.torque_sent"] - np.minimum(10.0, expected)).max() < 0.02
    assert [(told["what"], told["tick"]) for told in rig.events] == [
        ("temperature above 70 °C", rig.tick[heard >= 70.0][0]),
        (
            "temperature above 80 °C: the torque limit is reduced, and the run ends at 100 °C",
            rig.tick[heard >= 80.0][0],
        ),
    ]


def test_stiffness_and_damping_stay_within_the_remaining_limit():
    with Diagram("robot", rate=RATE) as robot:
        knee = CubeMars("AK80-9", name="knee", limit="peak")
        knee(position_command=1.0, stiffness_command=100.0)
    with Diagram("plant", rate=2 * RATE) as plant:
        drive = EmulatedCubeMars.of(robot["knee"], name="drive")
        drive(position=0.0, velocity=0.0, temperature=90.0)
    rig = Rig(robot, plant)
    rig.run(20, fade=0.0)
    # The rest of the 9 N·m is for what the joint may move meanwhile: 100 N·m/rad times ½ max_acceleration (3 periods)².
    assert (
        rig["knee.torque"][2:].max() == pytest.approx(9.0 * 100.0 / 105.6, abs=0.1) and rig["knee.torque"].max() <= 9.05
    )


def test_derating_lowers_current_in_modes_without_torque():
    with Diagram("robot", rate=RATE) as robot:
        knee = RobStride("RS02", name="knee", mode="current")
        knee(current_command=2.0)
    with Diagram("plant", rate=2 * RATE) as plant:
        robot["knee"].emulator(name="drive")(position=0.0, velocity=0.0, temperature=95.0)
    rig = Rig(robot, plant)
    assert rig.run(20, fade=0.0).status == "ok"
    assert rig["knee.current_sent"][-1] == pytest.approx(0.5, rel=0.05)


@pytest.mark.parametrize(
    "wrong",
    [{"warning_temperature": 90.0}, {"derating_temperature": 100.0}, {"rms_mode": "shout"}, {"rms_window": 0.0}],
)
def test_invalid_monitoring_parameters_are_rejected(wrong):
    with pytest.raises(DiagramError, match=next(iter(wrong))), Diagram("robot", rate=RATE):
        CubeMars("AK80-9", **wrong)(torque_command=0.0)

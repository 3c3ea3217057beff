"""The clock: a grid that keeps its phase, late and missed ticks, slow blocks after a skip. What is asserted is
structure, never speed.
"""

import time

import numpy as np
import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.clock import Clock
from blocks.discrete import UnitDelay
from blocks.mathematics import Gain
from cext.bus.replay_bus import ReplayClock
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, Input, Output, compile
from tests.cext.rigs import Rig, one_drive

pytestmark = pytest.mark.timing

RATE = 200
PERIOD = 1.0 / RATE


class Busy(Block):
    """Block the loop for `seconds` at the first tick from `at` on, and output the clock."""

    t = Output("s")
    tick = Output("1", dtype=int)
    passed = Output("s", "since the tick before")

    def __init__(self, at=None, seconds=0.0, **options):
        self.at, self.seconds = at, seconds
        super().__init__(**options)

    def reset(self):
        self.held = None

    def step(self, t, tick, dt):
        if self.at is not None and tick >= self.at and self.held is None:
            self.held = tick
            end = time.monotonic() + self.seconds
            while time.monotonic() < end:
                pass
        return t, tick, dt


class Count(Block):
    """Counts its steps and sums their reported elapsed time."""

    u = Input("any")
    steps = Output("1")
    time = Output("s")

    def reset(self):
        self.count, self.total = 0, 0.0

    def step(self, u, dt):
        self.count, self.total = self.count + 1, self.total + dt
        return self.count, self.total


def real_time(diagram, ticks):
    rig = Rig(diagram, virtual=False)
    began = time.monotonic()
    outcome = rig.run(ticks)
    return rig, outcome, time.monotonic() - began


@pytest.mark.hazard("H13a")
def test_ticks_and_missed_ticks_cover_the_grid():
    with Diagram("d", rate=RATE) as diagram:
        Busy(name="b")
    rig, outcome, passed = real_time(diagram, 100)
    statistics = rig.statistics()
    assert outcome.status == "ok" and statistics["ticks"] + statistics["missed"] == 100
    assert (
        rig.time.tolist() == [tick / RATE for tick in rig.tick] == rig["b.t"].tolist()
        and rig["b.tick"].tolist() == rig.tick.tolist()
    )
    assert sorted(set(rig.tick)) == rig.tick.tolist() and statistics["lateness"]["count"] == statistics["ticks"]
    assert 0.495 <= passed  # 100 grid points cannot pass faster than the grid


def test_a_long_block_makes_the_tick_jump_and_the_phase_is_kept():
    with Diagram("d", rate=RATE) as diagram:
        Busy(20, 0.0325, name="b")
    rig, outcome, _ = real_time(diagram, 60)
    statistics = rig.statistics()
    assert outcome.status == "ok" and statistics["ticks"] + statistics["missed"] == 60
    ticks, held = rig.tick.tolist(), diagram["b"].held
    # 32.5 ms are six whole periods and a half
    assert ticks[ticks.index(held) + 1] >= held + 6 and statistics["missed"] >= 5
    assert rig.time.tolist() == [tick / RATE for tick in ticks]
    dt = rig["b.passed"].tolist()
    assert dt == pytest.approx([(now - before) / RATE for before, now in zip([-1, *ticks], ticks)], rel=1e-12)
    # counted from the grid point that was awaited, not from the newest
    assert statistics["lateness"]["max"] >= 0.0325 - PERIOD - 1e-6
    assert statistics["execution"]["max"] >= 0.0325


def test_a_stall_counts_fully_in_lateness_and_period():
    with Diagram("d", rate=RATE) as diagram:
        Clock(name="clock")
        Busy(20, 0.0525, name="b")
    rig, _, _ = real_time(diagram, 60)
    statistics, held = rig.statistics(), diagram["b"].held
    after = int(np.flatnonzero(rig.tick == held)[0]) + 1
    wake = rig["clock.wake"]
    assert statistics["lateness"]["max_at_tick"] == statistics["period"]["max_at_tick"] == rig.tick[after]
    assert statistics["lateness"]["max"] == pytest.approx(wake[after] - (held + 1) * PERIOD, abs=1e-8)
    assert statistics["period"]["max"] == pytest.approx(wake[after] - wake[after - 1] - PERIOD, abs=1e-8)
    assert statistics["lateness"]["max"] >= 0.0525 - PERIOD - 1e-6 and rig["clock.lateness"][after] < PERIOD + 1e-6


def test_a_replayed_run_has_the_recorded_lateness():
    with Diagram("d", rate=RATE) as diagram:
        Gain(2.0, name="g")(1.0)
    ticks, late = [0, 1, 2, 13, 14], [10_000, 20_000, 30_000, 2_600_000, 40_000]
    blocks = iter([(ticks[:2], late[:2]), ([], []), (ticks[2:], late[2:])])
    clock = ReplayClock(lambda: (block := next(blocks, None)) is not None and (clock.give(*block) or True), True)
    again = Rig(diagram, replay=clock)
    assert again.run(-1).status == "ok" and again.tick.tolist() == ticks
    lateness = again.statistics()["lateness"]
    assert lateness["max"] == pytest.approx(0.0526) and lateness["max_at_tick"] == 13
    assert lateness["total"] == pytest.approx(sum(late) * 1e-9 + 10 * PERIOD)


def test_every_grid_point_is_counted_when_the_run_ends_inside_a_skip():
    with Diagram("d", rate=RATE) as diagram:
        Busy(5, 0.05, name="b")
    rig, outcome, _ = real_time(diagram, 10)
    statistics = rig.statistics()
    assert statistics["ticks"] + statistics["missed"] == 10 and statistics["missed"] >= 4
    assert outcome.tick == rig.tick[-1] == diagram["b"].held


@pytest.mark.hazard("H13a")
def test_a_stall_is_not_followed_by_a_burst():
    with Diagram("d", rate=RATE) as diagram:
        Busy(10, 0.1, name="b")
    rig, _, _ = real_time(diagram, 50)
    assert len(rig.tick) <= 50 - 19  # what was missed is not made up for


def test_slow_block_keeps_its_period_after_skipped_ticks():
    with Diagram("d", rate=RATE) as diagram:
        busy = Busy(20, 0.0325, name="b")
        Count(every=4, name="slow")(busy.t)
    rig, _, _ = real_time(diagram, 60)
    expected = 0
    before = -1
    for tick, steps in zip(rig.tick.tolist(), rig["slow.steps"].tolist()):
        expected += before < 0 or tick // 4 != before // 4
        before = tick
        assert steps == expected
    assert rig["slow.time"][-1] == pytest.approx((rig.tick[-1] // 4 + 1) * 4 / RATE, rel=1e-9)


def test_plant_advances_during_missed_ticks():
    class Ramp(Block):
        """An angle that goes with time."""

        angle = Output("rad")

        def step(self, t):
            return 0.1 * t

    with Diagram("robot", rate=RATE) as robot:
        knee = CubeMars("AK10-9-V2.0", can_id=1, name="knee", timeout=0.0)
        knee(torque_command=0.0)
        Busy(10, 0.0525, name="b")
    with Diagram("plant", rate=2 * RATE) as plant:
        EmulatedCubeMars.of(robot["knee"], name="knee")(position=Ramp(name="ramp").angle, velocity=0.0)
    rig = Rig(robot, plant, virtual=False)
    assert rig.run(60).status == "ok" and rig.statistics()["missed"] >= 9
    arming = PERIOD
    for asked, angle in zip(rig.tick, rig["knee.position"][1:]):  # each answer is to the command of the tick before
        assert angle == pytest.approx(0.1 * (asked * PERIOD + arming), abs=25.0 / 65535)


@pytest.mark.parametrize("every", [1, 2, 3, 5, 7])
def test_a_slow_block_holds_its_output_in_between(every):
    with Diagram("d", rate=RATE) as diagram:
        fast = Count(name="fast")(1.0)
        Gain(every=every, name="held")(fast.steps)
        Count(every=every, name="slow")(fast.steps)
        UnitDelay(every=every, name="delay")(fast.steps)
    rig = Rig(diagram)
    rig.run(40)
    ticks = range(40)
    assert rig["held.y"].tolist() == [1 + tick - tick % every for tick in ticks]
    assert rig["slow.steps"].tolist() == [1 + tick // every for tick in ticks]
    assert rig["delay.y"].tolist() == [0.0 if tick < every else 1 + tick - tick % every - every for tick in ticks]
    assert rig["slow.time"].tolist() == pytest.approx([(1 + tick // every) * every / RATE for tick in ticks])


def test_virtual_time_has_no_lateness_and_misses_nothing():
    with Diagram("d", rate=RATE) as diagram:
        Busy(20, 0.03, name="b")
    rig = Rig(diagram)
    rig.run(60)
    statistics = rig.statistics()
    assert (statistics["ticks"], statistics["missed"], statistics["lateness"]["max"]) == (60, 0, 0.0)


@pytest.mark.parametrize("rate", [3, 60, 333.3, 1000 / 7, 44100])
def test_the_grid_of_an_odd_rate_does_not_drift(rate):
    with Diagram("d", rate=rate) as diagram:
        Busy(name="b")
    rig = Rig(diagram)
    rig.run(1000)
    assert rig.time.tolist() == [tick / rate for tick in range(1000)] == rig["b.t"].tolist()
    assert rig["b.passed"].tolist() == [1 / rate] * 1000


def test_a_run_needs_no_shared_state():
    with Diagram("d", rate=RATE) as diagram:
        Count(name="c")(1.0)
    program = Program(compile(diagram))
    assert Executor(program, RATE, virtual=True).run(30).tick == 29 and diagram["c"].count == 30
    assert Executor(program, RATE).run(5).status == "ok"


def test_a_robot_in_real_time_arms_runs_and_stops_on_its_grid():
    rig = one_drive(lambda knee: 1.0, virtual=False, timeout=0.0)  # a machine that stalls is no silent drive
    outcome = rig.run(40)
    statistics = rig.statistics()
    assert outcome.status == "ok" and outcome.unconfirmed == () and statistics["ticks"] + statistics["missed"] == 40
    assert len(rig.commands()) == statistics["ticks"]
    for sent in (True, False):  # each by itself: replies have the times of the plant, which a late machine is behind
        times = [frame.time for frame in rig.frames if frame.sent == sent]
        assert times == sorted(times) and len(times) > 10


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf"), 2e9])
def test_an_impossible_rate_is_rejected(rate):
    schedule = compile(Diagram("d", rate=1))
    with pytest.raises(ValueError, match="the rate must be above 0 Hz"):
        Executor(Program(schedule), rate)


def test_a_plant_slower_than_its_robot_is_refused():
    schedule = compile(Diagram("d", rate=1))
    with pytest.raises(ValueError, match="integer multiple"):
        Executor(Program(schedule), 1.0, plant=Program(schedule), substeps=0)


def test_a_ring_that_cannot_hold_two_rows_is_refused():
    class Wide(Block):
        """Many numbers."""

        y = Output("1", shape=(300,))

        def step(self):
            return [0.0] * 300

    with Diagram("d", rate=10) as diagram:
        Wide()
    with pytest.raises(ValueError, match="a ring of 4096 bytes cannot hold two rows of 302 numbers"):
        Rig(diagram, shared=4096)

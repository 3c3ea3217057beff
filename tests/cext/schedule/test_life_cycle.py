"""A run from arming to the safe stop, in frames: who must answer, where blocks start, how authority fades in, what a
fence lets through.
"""

import math

import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.actuators.mit_frames import DISABLE, ENABLE, NOTHING
from blocks.controllers import Impedance
from blocks.filters import Butterworth
from blocks.limiters import SlewRate, TorqueLimiter
from blocks.mathematics import Gain
from graph import Block, Diagram, Input, Output
from tests.cext.rigs import STOP, Rig, ends_in_the_safe_stop, one_drive, plant_of


def test_a_run_arms_runs_and_stops_in_frames():
    rig = one_drive(lambda knee: TorqueLimiter(limit=5.0)(Impedance()(knee.position, knee.velocity, 0.3)))
    outcome = rig.run(100)
    assert (outcome.status, outcome.tick, outcome.signal, outcome.culprit, outcome.error) == ("ok", 99, 0, None, None)
    assert outcome.unconfirmed == outcome.unanswered == () and not outcome.faulted
    sent = rig.sent()
    assert sent[:2] == [ENABLE, NOTHING] and sent[-2:] == STOP
    assert len(sent) == 2 + 100 + 4 and all(data not in (ENABLE, DISABLE) for data in sent[2:-4])
    assert ends_in_the_safe_stop(rig)
    statistics = rig.statistics()
    assert (statistics["ticks"], statistics["missed"], statistics["dropped"], statistics["last_tick"]) == (
        100,
        0,
        0,
        99,
    )
    assert statistics["frames"]["sent"] == len(rig.sent()) == statistics["frames"]["received"]
    assert statistics["frames"]["foreign"] == statistics["frames"]["malformed"] == 0


def test_every_row_has_its_tick_and_its_time():
    rig = one_drive(lambda knee: 0.0)
    rig.run(150)
    assert rig.tick.tolist() == list(range(150)) and rig.time.tolist() == [tick / 200 for tick in range(150)]


def test_frame_times_never_decrease():
    rig = one_drive(lambda knee: 0.0)
    rig.run(50)
    times = [frame.time for frame in rig.frames]
    assert times == sorted(times) and times[0] == 0


def test_a_run_of_no_ticks_arms_and_stops():
    rig = one_drive(lambda knee: 0.0)
    outcome = rig.run(0)
    assert outcome.status == "ok" and outcome.tick == -1 and rig.sent() == [ENABLE, NOTHING, *STOP, *STOP]


def test_a_rig_may_be_run_again_and_does_the_same():
    rig = one_drive(lambda knee: TorqueLimiter(limit=5.0, slew=40.0)(Impedance()(knee.position, knee.velocity, 0.3)))
    rig.run(80)
    first, frames = {path: values.tolist() for path, values in rig.signals.items()}, rig.frames
    rig.run(80)
    assert {path: values.tolist() for path, values in rig.signals.items()} == first and rig.frames == frames


def test_reply_to_earlier_run_is_ignored():
    rig = one_drive(lambda knee: 0.0, plant=False)
    reply = bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0])
    rig.buses["can"].device.send(1, reply)
    assert rig.run(5).status == "ok"
    rig.buses["can"].device.send(1, reply, time=10**9)
    assert rig.run(5).status == "no answer"


@pytest.mark.hazard("H3a")
def test_the_fade_in_is_visible_in_the_sent_torque():
    rig = one_drive(lambda knee: 10.0)
    rig.run(300, fade=0.5)
    share = [min(tick / 100, 1.0) for tick in range(300)]
    assert rig["knee.torque_sent"] == pytest.approx([10.0 * s for s in share], abs=2 * 65.0 / 4095)
    rig.run(10, fade=0.0)
    assert rig["knee.torque_sent"] == pytest.approx([10.0] * 10, abs=2 * 65.0 / 4095)


def test_a_silent_drive_is_named_and_no_drive_moves():
    with Diagram("robot", rate=200) as robot:
        for can_id, name in ((1, "left"), (2, "right")):
            CubeMars("AK10-9-V2.0", can_id=can_id, name=name)(torque_command=10.0)
    with Diagram("plant", rate=200) as plant:
        EmulatedCubeMars.of(robot["left"], name="left")(0.0, 0.0)
    rig = Rig(robot, plant)
    outcome = rig.run(100, arming_timeout=0.1)
    assert (outcome.status, outcome.tick, outcome.unanswered) == ("no answer", -1, ("right",)) and outcome.faulted
    assert outcome.unconfirmed == ("right",)
    for can_id in (1, 2):
        assert set(rig.sent(can_id)) == {ENABLE, NOTHING, DISABLE}
        assert ends_in_the_safe_stop(rig, can_id)
    assert rig.sent(1).count(ENABLE) == 1 and rig.sent(2).count(ENABLE) == 22  # only who is silent is asked again
    times = [frame.time for frame in rig.frames]
    assert times == sorted(times) and rig.statistics()["ticks"] == 0


def test_two_drives_on_two_buses_arm_and_stop_independently():
    with Diagram("robot", rate=200) as robot:
        for bus in ("left", "right"):
            CubeMars("AK10-9-V2.0", bus=bus, can_id=7, name=f"{bus}_knee")(
                torque_command=2.0 if bus == "left" else -2.0
            )
    rig = Rig(robot, plant_of(robot))
    assert rig.run(50).status == "ok"
    for number, sign in ((0, 1.0), (1, -1.0)):
        sent = [frame.data for frame in rig.frames if frame.sent and frame.bus == number]
        assert sent[:2] == [ENABLE, NOTHING] and sent[-4:] == 2 * STOP and len(sent) == 56
        assert math.copysign(1.0, rig[("left" if number == 0 else "right") + "_knee.torque_sent"][-1]) == sign


def test_blocks_start_at_the_present_measurement_and_those_without_a_steady_state_start_afresh():
    class Counter(Block):
        """Counts its steps."""

        u = Input("any")
        y = Output("any")

        def reset(self):
            self.count = 0

        def step(self, u):
            self.count += 1
            return u + 0.0 * self.count

    with Diagram("robot", rate=200) as robot:
        knee = CubeMars("AK10-9-V2.0", can_id=1, name="knee")
        before = Counter(name="before")
        filtered = Butterworth(cutoff=5.0, name="filter")(before(knee.position))
        behind = Counter(name="behind")(SlewRate(0.1, name="slew")(filtered))
        limited = TorqueLimiter(limit=5.0, slew=1.0, name="limiter")(Gain(1.0, unit="N·m/rad")(behind))
        knee(torque_command=limited)
    with Diagram("plant", rate=200) as plant:
        EmulatedCubeMars.of(robot["knee"], name="knee")(1.0, 0.0)
    rig = Rig(robot, plant)
    rig.run(20)
    position = rig["knee.position"][0]
    assert rig["filter.y"] == pytest.approx([position] * 20, rel=1e-12) and rig["slew.y"] == pytest.approx(
        [position] * 20, rel=1e-12
    )
    # from zero, a slew a tick
    assert rig["limiter.limited"] == pytest.approx([(tick + 1) / 200 for tick in range(20)], rel=1e-9)
    assert robot["before"].count == robot["behind"].count == 20


@pytest.mark.parametrize(
    "times", [{"fade": math.nan}, {"fade": -1.0}, {"arming_timeout": math.nan}, {"stopping_timeout": -0.1}]
)
def test_times_of_a_run_are_zero_or_more(times):
    rig = one_drive(lambda knee: 1.0)
    with pytest.raises(ValueError, match="times of a run must be 0 s or more"):
        rig.run(10, **times)


def test_run_accepts_infinite_arming_timeout():
    rig = one_drive(lambda knee: 1.0)
    assert rig.run(10, arming_timeout=math.inf, fade=math.inf).status == "ok"
    assert abs(rig["knee.torque_sent"]).max() < 0.04


class RaisesFence(Block):
    """Does what a guardian would: raises the fence from outside."""

    u = Input("N·m")
    y = Output("N·m", range=(-5.0, 5.0))

    def step(self, u, tick):
        if tick == 30:
            self.shared.raise_fence()
        return 5.0


def test_behind_a_fence_no_command_is_sent_and_the_run_ends_in_the_safe_stop():
    rig = one_drive(lambda knee: RaisesFence(name="guardian")(knee.torque))
    rig.schedule.python_blocks[0].shared = rig.shared
    outcome = rig.run(100)
    assert (outcome.status, outcome.tick) == ("fenced", 30)
    assert len(rig.commands()) == 30 and ends_in_the_safe_stop(rig)


def test_fence_raised_before_first_run_blocks_all_frames():
    rig = one_drive(lambda knee: 1.0)
    rig.shared.raise_fence()
    outcome = rig.run(10)
    assert (outcome.status, outcome.tick) == ("fenced", -1) and set(rig.sent()) == set(STOP)


def test_a_fence_raised_while_arming_blocks_enable_frames():
    class Guardian(Block):
        """In the plant, where it runs while the robot arms."""

        y = Output("1")

        def step(self, tick):
            if tick == 3:
                self.shared.raise_fence()
            return 0.0

    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=1.0)
    with Diagram("plant", rate=200) as plant:
        Guardian(name="guardian")
    rig = Rig(robot, plant)
    plant["guardian"].shared = rig.shared
    outcome = rig.run(100)
    assert (outcome.status, outcome.tick) == ("fenced", -1)
    assert rig.sent() == [ENABLE, NOTHING] * 4 + STOP * (len(rig.sent()[8:]) // 2)

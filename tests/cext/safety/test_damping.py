"""The safe stop of a joint that must not drop its wearer: damped for a bounded time, then disabled like any other."""

import math

import numpy as np
import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.actuators.mit_frames import ENABLE
from blocks.limiters import TorqueLimiter
from blocks.models import Limb
from blocks.safety import Rearm
from graph import Block, Diagram, DiagramError, Input, Output, compile
from tests.blocks.actuators import reference
from tests.cext.rigs import STOP, Rig, one_drive, plant_of

AK10_9 = reference.ranges(velocity=50.0, torque=65.0)


class Trip(Block):
    """Passes its input, and raises at a tick."""

    u = Input("N·m")
    y = Output("N·m", range=(-10.0, 10.0))

    def step(self, u, tick):
        if tick == 40:
            raise RuntimeError("tripped")
        return u


def damp(robot, **parameters):
    return CubeMars("AK10-9-V2.0", **{"can_id": 1, "name": "knee", "safe_stop": "damp", **parameters})


def after(last, rig, can_id):
    """(s since the first of them, data) of every frame to one drive behind that of the last tick, at `last` ns."""
    frames = [frame for frame in rig.frames if frame.sent and frame.id == can_id and frame.time > last]
    return [((frame.time - frames[0].time) * 1e-9, frame.data) for frame in frames]


def two_drives():
    with Diagram("robot", rate=200) as robot:
        knee = damp(robot, can_id=1, name="knee", stop_damping=2.0, stop_time=0.3)
        hip = CubeMars("AK10-9-V2.0", can_id=2, name="hip")
        torque = TorqueLimiter(limit=10.0, slew=math.inf)(Trip(name="trip")(5.0))
        knee(torque_command=torque)
        hip(torque_command=torque)
    return robot


def test_one_drive_is_damped_for_its_time_and_then_disabled_while_the_other_is_disabled_at_once():
    rig = Rig(two_drives(), plant_of(two_drives()))
    outcome = rig.run(100, fade=0.0)
    assert (outcome.status, outcome.culprit, outcome.unconfirmed) == ("exception", "trip", ())
    last = max(frame.time for frame in rig.frames if frame.sent and frame.data not in STOP and frame.id == 2)
    knee, hip = after(last, rig, 1), after(last, rig, 2)
    assert [data for _, data in hip[:2]] == STOP
    damped = [(time, data) for time, data in knee if data not in STOP]
    said = [reference.read_command(AK10_9, data) for _, data in damped]
    assert (
        max(each["damping"] for each in said) == pytest.approx(2.0, abs=5.0 / 4095)
        and min(each["damping"] for each in said) > 0.0
    )
    for each in said:
        assert each["stiffness"] == 0.0
        assert each["velocity"] == pytest.approx(0.0, abs=100.0 / 4095) and each["torque"] == pytest.approx(
            0.0, abs=130.0 / 4095
        )
    times = [time for time, _ in damped]
    assert np.diff(times) == pytest.approx(0.002, abs=1e-9) and times[-1] == pytest.approx(0.3 - 0.002, abs=1e-9)
    assert [data for _, data in knee[len(damped) : len(damped) + 2]] == STOP and knee[len(damped)][0] == pytest.approx(
        0.3, abs=1e-9
    )
    assert rig.shared.fenced and rig.shared.state == "safe"


def test_a_damped_limb_stops_and_a_disabled_one_continues_to_swing():
    speeds = {}
    for how in ("damp", "disable"):
        with Diagram("robot", rate=200) as robot:
            knee = CubeMars("AK10-9-V2.0", can_id=1, name="knee", safe_stop=how, stop_damping=2.0, stop_time=0.5)
            knee(torque_command=TorqueLimiter(limit=10.0, slew=math.inf)(Trip(name="trip")(5.0)))
        with Diagram("plant", rate=1000) as plant:
            drive = EmulatedCubeMars.of(robot["knee"], name="drive")
            limb = Limb(inertia=0.2, damping=0.0, stiffness=0.0, reflex=0.0, name="limb")
            limb(torque=drive.torque)
            drive(position=limb.position, velocity=limb.velocity)
        rig = Rig(robot, plant)
        rig.run(100, fade=0.0)
        replies = [frame.data for frame in rig.frames if not frame.sent and frame.id == 1]
        speeds[how] = [reference.read_reply(AK10_9, data)[2] for data in replies]
    assert max(np.abs(speeds["disable"])) > 3.0 and abs(speeds["disable"][-1]) > 3.0
    assert max(np.abs(speeds["damp"])) > 3.0 and abs(speeds["damp"][-1]) < 0.1  # I / B = 0.1 s, and 0.5 s of it


def test_a_run_that_was_never_under_torque_is_not_damped():
    rig = one_drive(lambda knee: 0.0, plant=False, safe_stop="damp")
    assert rig.run(10).status == "no answer"
    assert set(rig.sent()) == {ENABLE, *STOP}


def test_a_run_that_ends_with_its_first_tick_was_under_torque_and_is_damped():
    rig = one_drive(lambda knee: 1.0, safe_stop="damp", stop_damping=2.0, stop_time=0.1)
    assert rig.run(1, fade=0.0).status == "ok"
    assert len([data for data in rig.sent() if data not in (ENABLE, *STOP)]) == 1 + 50  # every 2 ms


def test_drive_waiting_to_rearm_is_not_damped_again_at_run_end():
    class Never(Block):
        asked = Output("1", dtype=bool)

        def step(self):
            return False

    with Diagram("robot", rate=200) as robot:
        damp(robot, stop_time=0.1)(torque_command=TorqueLimiter(limit=10.0, slew=math.inf)(Trip(name="trip")(5.0)))
        Rearm(name="again")(Never(name="never")())
    rig = Rig(robot, plant_of(robot))
    outcome = rig.run(100, fade=0.0, rearm=[rig.schedule.inputs["again"]["request"]], notify=lambda *arguments: None)
    assert outcome.status == "exception" and rig.tick[-1] == 99
    last = max(frame.time for frame in rig.frames if frame.sent and frame.data == rig.commands()[0])
    assert rig.shared.first_tick + 39 * 5_000_000 == last
    damped = [frame.time - last for frame in rig.frames if frame.sent and frame.time > last and frame.data not in STOP]
    assert len(damped) == 50 and max(damped) < 0.12e9
    times = [frame.time for frame in rig.frames if frame.sent]
    assert times == sorted(times)


def test_damping_ends_on_time_without_replies():
    rig = one_drive(lambda knee: 0.0, virtual=False, safe_stop="damp", stop_time=0.1)
    rig.executor.run(10, stopping_timeout=0.1)
    assert rig.shared.state == "safe"


@pytest.mark.parametrize(
    "wrong", [{"safe_stop": "brake"}, {"stop_damping": 0.0}, {"stop_damping": 5.1}, {"stop_time": 6.0}]
)
def test_invalid_safe_stop_parameters_are_rejected(wrong):
    with pytest.raises(DiagramError, match=next(iter(wrong))), Diagram("robot", rate=200):
        CubeMars("AK10-9-V2.0", **wrong)(torque_command=0.0)


def test_a_schedule_carries_the_frames_of_the_stop_by_speed():
    with Diagram("robot", rate=200) as robot:
        damp(robot, stop_damping=5.0, limit=10.0)(torque_command=0.0)
    [device] = compile(robot).devices
    stop = device.damp
    assert (stop.duration, stop.round, stop.limit, stop.acceleration) == (1.0, 0.002, 10.0, 500.0)
    assert stop.bands[0] == (2.0, ((1, False, bytes.fromhex("7fff7ff000fff7ff")),)) and stop.bands[-1][0] == math.inf
    for speed, [(_, _, data)] in stop.bands:
        damping = reference.read_command(AK10_9, data)["damping"]
        assert 10.0 - 5.0 / 4095 * min(speed, 50.0) <= damping * min(speed, 50.0) <= 10.0


def test_a_bus_that_cannot_carry_a_round_in_2_ms_has_longer_ones():
    with Diagram("robot", rate=100) as robot:
        for number in range(1, 9):
            damp(robot, can_id=number, name=f"drive{number}")(torque_command=0.0)
    rounds = [device.damp.round for device in compile(robot).devices]
    # s: eight commands and replies of up to 135 bits, at 80 %
    assert rounds == [pytest.approx(16 * 135 * 1e-6 / 0.8)] * 8

"""Zero of a drive, set by a program: never under torque, confirmed by the drive, and without a false fault. In virtual
time, on in-memory buses.
"""

import math

import numpy as np
import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride, RobStrideMIT
from blocks.actuators.mit_frames import DISABLE, SET_ZERO
from blocks.limiters import TorqueLimiter
from graph import Block, Diagram, Output
from tests.cext.rigs import Rig

RATE = 200
REST = 0.7  # rad, of the joint before it is zeroed
FRAME = 151  # tick of the plant that receives the frame of a request in tick 150


class Script(Block):
    """A number in each tick. values : function of the tick"""

    value = Output("N·m")

    def __init__(self, values, **options):
        self.values = values
        super().__init__(**options)

    def step(self, tick):
        return self.values(tick)


class Pressed(Block):
    """True in some ticks."""

    pressed = Output("1", dtype=bool)

    def __init__(self, ticks, **options):
        self.ticks = ticks
        super().__init__(**options)

    def step(self, tick):
        return tick in self.ticks


class Joint(Block):
    """In the plant: a joint whose angle is a function of the plant's tick, with the rate of its change."""

    position, velocity = Output("rad"), Output("rad/s")

    def __init__(self, angle, **options):
        self.angle = angle
        super().__init__(**options)

    def step(self, tick):
        return self.angle(tick), (self.angle(tick + 1) - self.angle(tick)) * RATE


def cubemars(**parameters):
    return CubeMars("AK80-9", can_id=1, name="knee", **parameters)


def held(tick):
    return REST


def zeroing(drive=cubemars, *, presses=(), torque=lambda tick: 0.0, angle=held, lost=(), silent=(), **parameters):
    """A Rig with one drive.

    presses : ticks in which its input `zero` is true; None leaves it unconnected
    lost, silent : ticks of the plant in which all frames are lost, or the replies only
    """
    with Diagram("robot", rate=RATE) as robot:
        knee = drive(**parameters)
        command = {next(iter(knee.inputs)): 0.0} if "torque_command" not in knee.inputs else {}
        if not command:
            command = {"torque_command": TorqueLimiter(limit=4.0)(Script(torque, name="law")())}
        if presses is not None:
            command["zero"] = Pressed(set(presses), name="button")()
        knee(**command)
    with Diagram("plant", rate=RATE) as plant:
        motor = knee.emulator(name="motor")
        joint = Joint(angle, name="joint")()
        motor(
            position=joint.position,
            velocity=joint.velocity,
            dropped=Pressed(lost, name="lost")(),
            silent=Pressed(silent, name="silent")(),
        )
    return Rig(robot, plant)


def events(rig):
    return [(event["event"], event["what"]) for event in rig.events if "what" in event]


def sent_zeros(rig):
    return sum(data == SET_ZERO for data in rig.sent())


def test_zero_is_refused_while_torque_flows():
    rig = zeroing(presses={150}, torque=lambda tick: 2.0)
    assert rig.run(200).status == "ok"
    assert sent_zeros(rig) == 0 and rig.control.reports.zeros == {"knee": (0, 1)}
    assert events(rig) == [("warning", "the zero was not set: it can be set after 0.1 s of zero torque and rest")]
    assert rig["knee.position"][-1] == pytest.approx(REST, abs=1e-3)


def test_zero_is_refused_for_a_tenth_of_a_second_after_the_torque():
    law = lambda tick: 2.0 if tick < 150 else 0.0  # noqa: E731
    early, late = zeroing(presses={165}, torque=law), zeroing(presses={175}, torque=law)
    assert early.run(200).status == late.run(200).status == "ok"
    assert early.control.reports.zeros == {"knee": (0, 1)} and late.control.reports.zeros == {"knee": (1, 0)}


def test_zero_is_refused_while_the_joint_moves():
    rig = zeroing(presses={150}, angle=lambda tick: REST + 0.002 * tick)
    assert rig.run(200).status == "ok"
    assert sent_zeros(rig) == 0 and rig.control.reports.zeros == {"knee": (0, 1)}


def test_zero_under_a_stiffness_at_its_own_angle_is_refused():
    """A law that outputs no torque here would output one after the angle has jumped."""
    with Diagram("robot", rate=RATE) as robot:
        knee = cubemars()
        knee(position_command=REST, stiffness_command=10.0, zero=Pressed({150}, name="button")())
    with Diagram("plant", rate=RATE) as plant:
        motor = knee.emulator(name="motor")
        motor(position=REST, velocity=0.0)
    rig = Rig(robot, plant)
    assert rig.run(200).status == "ok"
    assert sent_zeros(rig) == 0 and rig.control.reports.zeros == {"knee": (0, 1)}


def test_angle_jumps_without_a_fault_and_commands_fade_in():
    rig = zeroing(presses={150}, torque=lambda tick: 2.0 if tick > 150 else 0.0, range=(-0.1, 1.0))
    assert rig.run(300).status == "ok"
    assert sent_zeros(rig) == 1 and rig.control.reports.zeros == {"knee": (1, 0)}
    assert events(rig) == [("zero", "the present position of the drive is its zero")]
    position, torque = rig["knee.position"], rig["knee.torque_sent"]
    assert position[150] == pytest.approx(REST, abs=1e-3)
    assert np.abs(position[152:]).max() < 1e-3
    assert torque[151] == pytest.approx(0.0, abs=0.01)  # no torque from the frame to the confirmation
    assert torque[201] == pytest.approx(1.0, abs=0.05) and torque[260] == pytest.approx(2.0, abs=0.01)
    assert np.diff(torque[151:252]).max() < 0.05  # over half a second, in steps of a hundredth


def test_request_that_is_true_from_the_start_is_none():
    rig = zeroing(presses=range(200))
    assert rig.run(200).status == "ok"
    assert rig.control.reports.zeros == {} and sent_zeros(rig) == 0


def test_zero_that_the_wire_loses_is_sent_again():
    rig = zeroing(presses={150}, lost={FRAME - 1})
    assert rig.run(250).status == "ok"
    assert sent_zeros(rig) == 2 and rig.control.reports.zeros == {"knee": (1, 0)}
    assert np.abs(rig["knee.position"][-20:]).max() < 1e-3


def test_joint_that_moves_through_zero_does_not_confirm_a_lost_frame():
    swing = lambda tick: max(REST - max(0, tick - FRAME - 10) / RATE, -0.3)  # noqa: E731
    rig = zeroing(presses={150}, lost={FRAME - 1}, angle=swing)
    outcome = rig.run(700)
    assert (outcome.status, outcome.culprit) == ("implausible", "knee")
    assert sent_zeros(rig) == 1 and rig.control.reports.zeros == {} and events(rig) == []


def test_drive_may_be_silent_for_a_second_after_its_zero():
    rig = zeroing(presses={150}, silent=range(FRAME, FRAME + 200))
    assert rig.run(600).status == "ok"
    assert rig.control.reports.zeros == {"knee": (1, 0)}


def test_drive_that_stays_silent_after_its_zero_ends_the_run():
    rig = zeroing(presses={150}, silent=range(FRAME, 2000))
    outcome = rig.run(1000)
    assert (outcome.status, outcome.culprit) == ("silent", "knee")
    assert 2.0 < (outcome.tick - 150) / RATE < 2.1


def test_zero_of_one_drive_leaves_the_other_under_torque():
    with Diagram("robot", rate=RATE) as robot:
        left, right = (CubeMars("AK80-9", can_id=i, name=name) for i, name in ((1, "left"), (2, "right")))
        left(torque_command=0.0, zero=Pressed({150}, name="button")())
        right(torque_command=3.0)
    with Diagram("plant", rate=RATE) as plant:
        for knee in (left, right):
            knee.emulator(name=f"{knee.path}_motor")(position=REST, velocity=0.0)
    rig = Rig(robot, plant)
    assert rig.run(300).status == "ok"
    assert SET_ZERO in rig.sent(1) and SET_ZERO not in rig.sent(2)
    assert np.abs(rig["left.position"][-1]) < 1e-3 and rig["right.position"][-1] == pytest.approx(REST, abs=1e-3)
    assert (rig["right.torque_sent"][140:] > 2.9).all()


def test_arming_sets_the_zero_before_the_first_tick():
    rig = zeroing(zero_at_arming=True, presses=None, torque=lambda tick: 2.0, range=(-0.5, 0.5))
    assert rig.run(200).status == "ok"
    assert np.abs(rig["knee.position"]).max() < 1e-3 and rig.control.reports.zeros == {"knee": (1, 0)}
    before = rig.sent()[: rig.sent().index(SET_ZERO)]
    assert before.count(DISABLE) >= 20 and set(before) == {DISABLE}  # 0.1 s at rest, and disabled


def test_arming_waits_until_the_joint_is_at_rest():
    rig = zeroing(zero_at_arming=True, presses=None, angle=lambda tick: REST + 0.002 * min(tick, 300))
    assert rig.run(100).status == "ok"
    assert rig.control.reports.zeros == {"knee": (1, 0)} and np.abs(rig["knee.position"]).max() < 1e-3


def test_arming_fails_if_the_joint_keeps_moving():
    rig = zeroing(zero_at_arming=True, presses=None, angle=lambda tick: 0.002 * tick)
    outcome = rig.run(100)
    assert (outcome.status, outcome.unanswered) == ("no answer", ("knee",))
    assert rig.control.reports.unzeroed == ["knee"] and sent_zeros(rig) == 0


def test_range_must_contain_the_angle_after_zeroing():
    with pytest.raises(Exception, match=r"zero_at_arming sets the joint to -offset, -0.5 rad, which is outside its"):
        cubemars(zero_at_arming=True, offset=0.5, range=(0.0, 1.0))


def robstride(**parameters):
    return RobStride("RS02", can_id=1, name="knee", **parameters)


def robstride_mit(**parameters):
    return RobStrideMIT("RS02", can_id=1, name="knee", **parameters)


def cybergear(**parameters):
    return RobStride("CyberGear", can_id=1, name="knee", **parameters)


def v3(**parameters):
    return CubeMarsV3("AK10-9-V3.0", can_id=1, name="knee", **parameters)


def servo(**parameters):
    return CubeMarsServo("AK80-9", can_id=1, name="knee", **parameters)


@pytest.mark.parametrize("drive", [robstride, robstride_mit, cybergear, v3, servo], ids=lambda drive: drive.__name__)
@pytest.mark.parametrize("at_arming", [True, False])
@pytest.mark.parametrize("offset", [0.0, -0.3])
def test_every_family_sets_its_zero(drive, at_arming, offset):
    presses = None if at_arming else {60}
    rig = zeroing(drive, presses=presses, zero_at_arming=at_arming, offset=offset)
    assert rig.run(100).status == "ok"
    assert rig.control.reports.zeros == {"knee": (1, 0)}
    assert rig["knee.position"][-1] == pytest.approx(-offset, abs=2e-3)


@pytest.mark.parametrize(
    "make", [lambda: CubeMarsServo("AK80-9", mode="velocity"), lambda: RobStride("RS02", mode="csp")]
)
def test_drive_whose_torque_is_unknown_has_no_input_for_its_zero(make):
    with Diagram("robot", rate=RATE):
        assert "zero" not in make().inputs


def test_drive_that_ignores_the_frame_keeps_its_zero():
    """Every frame that sets the zero is lost, and the others are not: the drive does not execute it."""
    rig = zeroing(presses={150}, lost={FRAME - 1 + 20 * i for i in range(30)}, torque=lambda tick: 2.0 * (tick > 150))
    assert rig.run(700).status == "ok"
    assert rig.control.reports.zeros == {"knee": (0, 1)} and sent_zeros(rig) == 20
    assert events(rig) == [("warning", "the drive has not confirmed its zero; the earlier one is in force")]
    assert np.abs(rig["knee.torque_sent"][150:550]).max() < 0.01 and rig["knee.torque_sent"][-1] > 1.9
    assert rig["knee.position"][-1] == pytest.approx(REST, abs=1e-3)


def test_drive_that_reads_neither_its_old_position_nor_zero_is_a_fault():
    rig = zeroing(presses={150}, silent=range(FRAME, FRAME + 20), angle=lambda tick: REST + 0.3 * (tick > FRAME + 5))
    outcome = rig.run(700)
    assert (outcome.status, outcome.culprit) == ("implausible", "knee")
    assert sent_zeros(rig) == 1 and (outcome.tick - 150) / RATE == pytest.approx(2.0, abs=0.01)


def test_zero_is_not_set_while_the_run_waits_to_be_armed_again():
    rig = zeroing(presses={130}, torque=lambda tick: math.nan if tick == 100 else 0.0)
    assert rig.run(200, rearm=[]).status == "not finite"
    assert sent_zeros(rig) == 0 and rig.control.reports.zeros == {"knee": (0, 1)}

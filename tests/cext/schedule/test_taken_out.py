"""One drive is taken out of a run and armed again, while the other goes on. In virtual time, on in-memory buses."""

import math

import numpy as np
import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride, RobStrideMIT
from blocks.actuators.mit_frames import DISABLE, ENABLE, NOTHING
from blocks.limiters import TorqueLimiter
from cext.schedule.mailbox_writer import Writer
from graph import Block, Diagram, Output
from tests.cext.rigs import Rig
from tests.cext.schedule.test_zeroing import Joint, Pressed, Script

RATE = 200
FADE = RATE // 2  # ticks


class Bit(Block):
    """In the plant: the fault that the drive reports. code : function of the tick"""

    code = Output("1", dtype=int)

    def __init__(self, code, **options):
        self.value = code
        super().__init__(**options)

    def step(self, tick):
        return self.value(tick)


class Robot(Rig):
    """Two drives under 2 N·m, of which `left` is taken out and armed again.

    script : {tick: value of left.disabled that another process requests}
    drive : class, model and parameters of `left`
    presses : ticks in which its input `disable` is true
    plant : inputs of its emulated drive
    """

    def __init__(
        self,
        script,
        drive=(CubeMars, "AK80-9"),
        *,
        presses=(),
        torque=lambda tick: 2.0,
        right=None,
        angle=None,
        **plant,
    ):
        kind, model, *parameters = drive
        parameters = parameters[0] if parameters else {}
        with Diagram("robot", rate=RATE) as robot:
            left = kind(model, can_id=1, name="left", **parameters)
            other = CubeMars("AK80-9", can_id=2, bus="right", name="right")
            torques = Script(right or (lambda tick: 2.0), name="right_law")()
            other(torque_command=TorqueLimiter(limit=4.0, slew=math.inf, name="right_limiter")(torques))
            self.law = Script(lambda tick: self.act(tick, torque), name="law")
            command = TorqueLimiter(limit=4.0, slew=math.inf)(self.law())
            name = next(iter(left.inputs)) if "torque_command" not in left.inputs else "torque_command"
            left(**{name: command if name == "torque_command" else 0.5}, disable=Pressed(presses, name="button")())
        with Diagram("plant", rate=RATE) as wearer:
            for knee in (left, other):
                motor = knee.emulator(name=f"{knee.path}_motor")
                joint = Joint(angle or (lambda tick: 0.3), name=f"{knee.path}_joint")()
                inputs = plant if knee is left else {}
                motor(
                    position=joint.position,
                    velocity=joint.velocity,
                    **{port: Pressed(ticks, name=port)() for port, ticks in inputs.items() if port != "fault"},
                    **{port: Bit(code, name=port)() for port, code in inputs.items() if port == "fault"},
                )
        super().__init__(robot, wearer)
        self.script, self.writer = script, Writer(self.shared)
        self.index = [live.path for live in self.schedule.live].index("left.disabled")

    def act(self, tick, torque):
        if tick in self.script:
            assert self.writer.set([(self.index, self.script[tick])]) is not None
        return torque(tick)

    def to_left(self, since, until):
        """Data of the frames to `left` that ticks from `since` to before `until` have sent."""
        first = next(frame.time for frame in self.frames if frame.sent and frame.data not in (ENABLE, NOTHING))
        begin, end = (first + round((tick - 1) / RATE * 1e9) for tick in (since, until))
        return [
            frame.data for frame in self.frames if frame.sent and frame.id & 0xFF == 1 and begin <= frame.time < end
        ]

    def what(self):
        return [event["what"] for event in self.events if "what" in event]


OUT = "taken out; left.disabled=false arms it again"
BACK = "armed again; its commands fade in"
UNCONFIRMED = "has not confirmed that it is disabled; disable is repeated. Cut its power"
REFUSED = (
    "not armed again: it does not reply, it reports a fault, or the angle of its joint is out of range or ambiguous"
)


def test_drive_is_taken_out_and_armed_again_while_the_other_goes_on():
    robot = Robot({200: 1, 300: 0})
    assert robot.run(500).status == "ok"
    assert robot.what() == [OUT, BACK] and robot.control.reports.switched == {"left": (1, 1)}
    active, torque = robot["left.active"], robot["left.torque"]
    assert active[:202].all() and not active[203:301].any() and active[310:].all()
    assert torque[150] > 1.9 and np.abs(torque[204:301]).max() < 0.01
    back = 301 + int(np.argmax(active[301:] > 0.5))
    assert torque[back + FADE // 2] == pytest.approx(1.0, abs=0.05) and torque[back + FADE + 5] > 1.9
    assert np.diff(torque[back:]).max() < 0.05
    assert (robot["right.torque"][150:] > 1.9).all() and robot["right.active"].all()


def test_drive_that_is_out_gets_only_zero_torque_and_disable():
    robot = Robot({200: 1, 300: 0})
    robot.run(500)
    assert robot.shared.out == 0
    assert set(robot.to_left(202, 300)) == {NOTHING, DISABLE} and set(robot.to_left(250, 300)) == {DISABLE}
    assert robot.to_left(301, 310).count(ENABLE) >= 1


def test_silence_and_fault_bit_of_a_drive_that_is_out_are_no_fault():
    robot = Robot({200: 1}, silent=range(210, 600), fault=lambda tick: 3 if tick > 205 else 0)
    assert robot.run(600).status == "ok"
    assert 1 <= len(robot.to_left(320, 520)) <= 3  # twice a second while it is silent


def test_nan_command_of_a_drive_that_is_out_is_no_fault():
    robot = Robot({200: 1}, torque=lambda tick: math.nan if tick > 210 else 2.0)
    assert robot.run(300).status == "ok"


def test_input_takes_the_drive_out_and_only_an_operator_arms_it_again():
    robot = Robot({400: 0}, presses=range(200, 250))
    assert robot.run(600).status == "ok"
    active = robot["left.active"]
    assert not active[202:400].any() and active[410:].all()


def test_drive_stays_out_while_its_input_is_true():
    robot = Robot({300: 0}, presses=range(200, 1000))
    assert robot.run(500).status == "ok"
    assert not robot["left.active"][202:].any() and robot.what() == [OUT]


def test_drive_that_does_not_reply_stays_out_after_a_second():
    robot = Robot({200: 1, 300: 0}, silent=range(250, 1000))
    assert robot.run(700).status == "ok"
    assert robot.what() == [OUT, REFUSED, UNCONFIRMED] and not robot["left.active"][202:].any()
    assert ENABLE not in robot.to_left(300, 700), "it does not reply as a disabled drive, so it is not enabled"


def test_drive_with_a_fault_or_out_of_range_stays_out():
    faulty = Robot({200: 1, 300: 0}, fault=lambda tick: 3 if tick > 250 else 0)
    bent = Robot({200: 1, 300: 0}, (CubeMars, "AK80-9", {"range": (0.0, 0.5)}), angle=lambda t: 0.3 + 0.4 * (t > 250))
    for robot in (faulty, bent):
        assert robot.run(700).status == "ok"
        assert robot.what() == [OUT, REFUSED]


def test_joint_whose_angle_is_ambiguous_after_a_loss_of_power_stays_out():
    """A drive that replied all the time has kept its power, and thus its angle."""
    for silent, what in ((range(0), BACK), (range(210, 260), REFUSED)):
        robot, asked = Robot({200: 1, 300: 0}, silent=silent), []
        assert robot.run(700, may_return=asked.append).status == "ok"
        assert robot.what() == [OUT, what] and set(asked) == ({"left"} if silent else set())


def test_drive_with_a_damped_stop_is_damped_first():
    robot = Robot({200: 1}, (CubeMars, "AK80-9", {"safe_stop": "damp", "stop_time": 0.5}))
    assert robot.run(500).status == "ok"
    damping = set(robot.to_left(205, 295))
    assert damping and not damping & {NOTHING, DISABLE}
    assert set(robot.to_left(350, 400)) == {DISABLE}
    assert robot.shared.out == 1 << [device.name for device in robot.schedule.devices].index("left")


def test_guardian_damps_a_drive_that_was_taken_out_only_until_its_damping_ends():
    robot = Robot({200: 1}, (CubeMars, "AK80-9", {"safe_stop": "damp", "stop_time": 0.5}))
    assert robot.run(250).status == "ok" and robot.shared.out == 0


def test_damping_of_a_drive_stays_inside_its_limit_until_a_late_next_frame():
    speed, acceleration, limit = 4.0, 500.0, 9.0  # rad/s, rad/s², N·m
    drive = CubeMars, "AK80-9", {"safe_stop": "damp", "stop_damping": 3.0}
    robot = Robot({200: 1}, drive, torque=lambda tick: 0.0, angle=lambda tick: speed * (tick - 300) / RATE)
    assert robot.run(300).status == "ok"
    codes = {data[5] << 4 | data[6] >> 4 for data in robot.to_left(210, 300)}
    damping = 5.0 * max(codes) / 0xFFF
    assert 0.3 < damping <= limit / (speed + acceleration * 3 / RATE)  # age of the speed, and two periods


@pytest.mark.parametrize(
    "drive",
    [
        (CubeMarsV3, "AK10-9-V3.0"),
        (CubeMarsServo, "AK80-9"),
        (CubeMarsServo, "AK80-9", {"mode": "velocity"}),
        (RobStride, "RS02"),
        (RobStride, "RS02", {"mode": "csp"}),
        (RobStride, "CyberGear"),
        (RobStrideMIT, "RS02"),
    ],
    ids=lambda drive: f"{drive[0].__name__}-{drive[1]}",
)
def test_every_family_returns(drive):
    robot = Robot({200: 1, 300: 0}, drive)
    assert robot.run(500).status == "ok"
    assert robot.what() == [OUT, BACK] and robot["left.active"][-1]
    assert np.abs(robot["left.torque"][210:300]).max() < 0.01


def test_drive_that_is_disabled_from_the_start_is_not_waited_for():
    robot = Robot({100: 0}, (CubeMars, "AK80-9", {"disabled": True}), silent=range(80))
    assert robot.run(300).status == "ok"
    assert not robot["left.active"][:100].any() and robot["left.active"][-1]
    assert ENABLE not in robot.to_left(0, 95)


@pytest.mark.parametrize("kind, model", [(CubeMars, "AK80-9"), (RobStride, "RS02"), (CubeMarsServo, "AK80-9")])
def test_drive_that_is_out_is_disabled_in_each_round_of_arming_and_confirms_in_the_run(kind, model):
    robot = Robot({}, (kind, model, {"disabled": True}))
    assert robot.run(50, answered=lambda: None).status == "ok" and robot.what() == []
    left = robot.schedule.devices[0]
    disable = [bytes(data) for _, _, data in left.disable]
    arming = {}
    for frame in robot.frames:
        if frame.sent and frame.bus == left.bus and frame.time < robot.shared.first_tick:
            arming.setdefault(frame.time, []).append(frame.data)
    rounds = {frame.time for frame in robot.frames if frame.sent and frame.id == 2}
    assert {*arming} == {time for time in rounds if time < robot.shared.first_tick} and len(arming) >= 2
    assert all(sent == disable for sent in arming.values()), arming
    zeros = [bytes(data) for _, _, data in left.zero]
    late, end = (robot.shared.first_tick + tick * 1_000_000_000 // RATE for tick in (20, 50))
    sent = [frame for frame in robot.frames if frame.sent and frame.bus == left.bus and frame.time < end]
    assert {frame.data for frame in sent if frame.time < late} <= {*zeros, *disable}, "until it has confirmed"
    assert {frame.data for frame in sent if frame.time >= late} == {*disable}


def test_drive_that_is_out_stays_out_when_the_run_is_armed_again():
    def law(tick):
        if tick == 400:
            robot.writer.confirm(robot.shared.question)
        return math.nan if tick == 350 else 2.0

    robot = Robot({100: 1, 200: 0, 250: 1}, torque=lambda tick: 2.0, right=law)
    outcome = robot.run(700, rearm=[], fade=0.0)
    assert outcome.status == "ok" and [fault.culprit for fault in outcome.faults] == ["right"]
    assert not robot["left.active"][260:].any() and robot["right.torque"][-1] > 1.9
    assert robot.control.reports.switched == {"left": (2, 1)}
    assert set(robot.to_left(380, 400)) == {DISABLE}, "it had confirmed before"
    assert set(robot.to_left(401, 420)) == {NOTHING, DISABLE}, "a confirmation is newer than the arming"
    assert set(robot.to_left(440, 460)) == {DISABLE}


def test_replayed_changes_send_the_same_frames():
    recorded = Robot({200: 1, 300: 0})
    recorded.run(500)
    replayed = Robot({})
    replayed.control.live.follow(
        [(change.tick, change.index, change.value, change.slew) for change in recorded.changes]
    )
    replayed.run(500)
    assert replayed.sent() == recorded.sent() and replayed.sent(2) == recorded.sent(2)

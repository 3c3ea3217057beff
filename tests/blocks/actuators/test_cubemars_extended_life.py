"""CubeMars boards in extended frames on the bus: arming, closed loops, what confirms the safe stop, and everything that
can be wrong.
"""

import math
import time

import numpy as np
import pytest

from blocks.actuators import CubeMarsServo, CubeMarsV3, EmulatedCubeMarsServo, EmulatedCubeMarsV3
from blocks.models import Limb
from blocks.safety import Rearm
from blocks.sources import Sine
from cext.memory.shared_state import SharedState
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, DiagramError, Input, Output, compile
from tests.blocks.actuators import cubemars_reference as reference
from tests.blocks.actuators.test_cubemars_closed_loop import second_order
from tests.blocks.actuators.test_robstride_closed_loop import During, Witness, joint, played
from tests.blocks.actuators.wire import EXTENDED
from tests.cext.rigs import Rig

RATE, SUBSTEPS, INERTIA = 500, 20, 0.05
RATES = [0.0, 500.0]
MOUNTINGS = [
    ("AK80-9-V3.0", {}),
    ("AK10-9-V3.0", {"invert": True}),
    ("AK70-9", {"invert": True, "offset": -0.4, "gear_ratio": 3.0}),
]
COMMANDS = {
    "duty": ("duty_command", 0.05),
    "current": ("current_command", 1.0),
    "current_brake": ("current_brake_command", 1.0),
    "velocity": ("velocity_command", 1.5),
    "position": ("position_command", 0.5),
    "position_velocity": ("position_command", 0.5),
}


def in_order(recording):
    outcome, frames = recording.outcome, recording.statistics["frames"]
    assert (outcome.status, outcome.unconfirmed, outcome.unanswered) == ("ok", (), ()), outcome
    assert (frames["foreign"], frames["malformed"]) == (0, 0) and recording["drive.fault"].max() == 0


# Closed loops


@pytest.mark.parametrize("model, mounting", MOUNTINGS)
@pytest.mark.parametrize("report_rate", RATES)
def test_a_position_loop_in_the_drive_answers_as_a_second_order_system(model, mounting, report_rate):
    """Within 2 % of the step, and a code of the report, 0.1°: codes of stiffness and damping, and Euler's error at 10
    kHz.
    """
    target, stiffness, damping = 0.2, 20.0, 0.4
    commands = {"position_command": target, "stiffness_command": stiffness, "damping_command": damping}
    recording, drive = played(CubeMarsV3, model, commands=commands, limit="peak", report_rate=report_rate, **mounting)
    in_order(recording)
    wanted = second_order(recording.time[:-1], target, stiffness, damping, INERTIA)
    slack = (
        0.02 * target
        + 2 * drive.scales[0]
        + target * (drive.wire[2] / 4095 / stiffness + drive.wire[3] / 4095 / damping)
    )
    assert np.abs(recording["drive.position"][1:] - wanted).max() < slack


@pytest.mark.parametrize("model, mounting", MOUNTINGS)
def test_torque_accelerates_free_inertia_and_is_measured_as_current(model, mounting):
    recording, drive = played(CubeMarsV3, model, 150, {"torque_command": 2.0}, max_velocity=100.0, **mounting)
    in_order(recording)
    t, step = recording.time[:-1], 1.0 / (RATE * SUBSTEPS)
    given = 2.0 * drive.wire[4] / 4095 + 0.01 * drive.scales[2]  # a code of torque, and one of current
    assert np.abs(recording["drive.torque"][2:] - 2.0).max() < given
    assert np.abs(recording["drive.torque"] - recording["drive.current"] * drive.scales[2]).max() < 1e-9
    slack = given * t[-1] ** 2 / 2 / INERTIA + 40 * t[-1] * step + drive.scales[0]
    assert np.abs(recording["drive.position"][1:] - t**2 / INERTIA).max() < slack


def test_closed_loop_torque_under_hard_motion_stays_within_the_limit():
    with Diagram("robot", rate=RATE) as robot:
        drive = CubeMarsV3("AK80-9-V3.0", name="drive", limit=4.0, report_rate=500.0)
        drive(position_command=Sine(amplitude=1.5, frequency=2.0)(), stiffness_command=200.0, damping_command=2.0)
    rig = Rig(robot, joint(robot))
    assert rig.run(1000).status == "ok" and rig["drive.limited"][-1] > 100
    # within a period velocity changes, unknown to the bound
    assert 3.0 < np.abs(rig["drive.torque"]).max() <= 4.0 * 1.1


@pytest.mark.parametrize(
    "model, mounting", [*MOUNTINGS, ("AK80-64", {"offset": 0.3}), ("AK70-10", {"invert": True, "gear_ratio": 2.0})]
)
@pytest.mark.parametrize("mode", COMMANDS)
def test_every_servo_mode_follows_its_command(mode, model, mounting):
    name, command = COMMANDS[mode]
    # a free joint under a current is soon faster than any drive can report
    ticks = 60 if mode == "current" else 2 * RATE
    recording, drive = played(
        CubeMarsServo,
        model,
        ticks,
        {name: command},
        mode=mode,
        report_rate=500.0,
        velocity_limit=2.0,
        max_velocity=1e4,
        **mounting,
    )
    in_order(recording)
    position, velocity, torque, current = (
        recording[f"drive.{out}"] for out in ("position", "velocity", "torque", "current")
    )
    if mode == "current":
        assert np.abs(current[5:] - 1.0).max() <= 0.01 and np.abs(torque - current * drive.scales[2]).max() < 1e-9
        t = recording.time[20]
        assert velocity[21] == pytest.approx(torque[20] * t / INERTIA, rel=0.02, abs=2 * drive.scales[1])
    elif mode == "current_brake":
        assert np.abs(position - position[0]).max() <= drive.scales[0] + 1e-9
    elif mode == "velocity":
        assert velocity[-1] == pytest.approx(1.5, abs=0.01)
    elif mode == "duty":
        assert 0.0 < velocity[-1] <= 1.05 * 0.05 * drive.spec.wire_velocity
    else:
        assert position[-1] == pytest.approx(0.5, abs=2 * drive.scales[0] + 1e-3)
        if mode == "position_velocity":
            assert (
                velocity.max() < 2.0 * 1.02
                and np.diff(velocity[1:]).max() * RATE < 10.0 * 1.3 + 2 * drive.scales[1] * RATE
            )


@pytest.mark.parametrize("brake, stands", [(0.0, False), (2.0, True)])
def test_a_brake_slows_a_joint_and_holds_it_up_to_its_torque(brake, stands):
    """A spring of 5 N·m/rad, bent by 0.5 rad, against 1.89 N·m: it swings with 5 rad/s, or creeps as the emulated brake
    gives way.
    """
    with Diagram("robot", rate=RATE) as robot:
        drive = CubeMarsServo("AK80-9", name="drive", mode="current_brake", report_rate=500.0)
        drive(current_brake_command=brake)
    with Diagram("plant", rate=RATE * SUBSTEPS) as plant:
        emulated, limb = drive.emulator(), Limb(inertia=INERTIA, damping=0.0, stiffness=5.0, reflex=0.0, start=0.5)
        limb(torque=emulated.torque)
        emulated(position=limb.position, velocity=limb.velocity)
    rig = Rig(robot, plant)
    assert rig.run(500).status == "ok"
    late = rig["drive.velocity"][-100:]
    assert (np.abs(late).max() < 0.25) == stands and np.ptp(rig["drive.position"]) > 0.05


# Arming and the safe stop


def flagged(frames):
    return [(identifier | (EXTENDED if extended else 0), data) for identifier, extended, data in frames]


CASES = [
    (CubeMarsV3, "AK80-9-V3.0", {}),
    (CubeMarsV3, "AK80-9-V3.0", {"enter": True}),
    (CubeMarsV3, "AK80-9-V3.0", {"report_rate": 100.0}),
    (CubeMarsV3, "AK80-9-V3.0", {"safe_stop": "damp", "stop_time": 0.1}),
    (CubeMarsServo, "AK80-9", {}),
    (CubeMarsServo, "AK80-9-V3.0", {}),
    (CubeMarsServo, "AK80-9-V3.0", {"report_rate": 0.0}),
    (CubeMarsServo, "AK80-9", {"safe_stop": "brake", "stop_time": 0.1, "mode": "velocity"}),
]


@pytest.mark.parametrize("kind, model, parameters", CASES)
def test_arming_and_the_safe_stop_are_the_frames_of_the_manual_and_are_confirmed(kind, model, parameters):
    with Diagram("robot", rate=200) as robot:
        drive = kind(model, name="drive", can_id=9, **parameters)
        drive(**{"torque_command" if kind is CubeMarsV3 else next(iter(drive.inputs)): 0.5})
    with Diagram("plant", rate=1000) as plant:
        emulated, limb, witness = drive.emulator(), Limb(inertia=0.1, damping=0.5, stiffness=0.0, reflex=0.0), Witness()
        limb(torque=emulated.torque)
        emulated(position=limb.position, velocity=limb.velocity)
        witness(enabled=emulated.enabled, torque=emulated.torque)
    rig = Rig(robot, plant)
    outcome = rig.run(100)
    assert (outcome.status, outcome.unanswered, outcome.unconfirmed) == ("ok", (), ())
    sent = [(frame.id, frame.data) for frame in rig.frames if frame.sent]
    first = flagged(drive.enable_frames()) + flagged(drive.zero_frames())
    asked = flagged(drive.ask_frames()) * bool(drive.report_rate)  # while its reports are counted
    begin = next(place for place, frame in enumerate(sent) if frame not in asked or frame == first[0])
    assert sent[begin:][: len(first)] == first and bool(drive.enable_frames()) == parameters.get("enter", False)
    stop = flagged(drive.zero_frames()) + flagged(drive.disable_frames())
    assert sent[-len(stop) :] == stop
    if drive.spec.generation == 3:
        assert stop[-1] == (EXTENDED | 15 << 8 | 9, b"") and not witness.seen[-1][1]
    else:
        assert stop == [(EXTENDED | 1 << 8 | 9, bytes(4))] * 2
    assert witness.seen[-1][2] == pytest.approx(0.0, abs=1e-6) and any(torque > 0.01 for _, _, torque in witness.seen)
    damped = drive.damped_stop()
    damping = [frame for _, frames in damped.bands for frame in flagged(frames)] if damped is not None else []
    if damping:
        assert sum(frame in damping for frame in sent) >= 18
        assert min(place for place, frame in enumerate(sent) if frame in damping) < sent.index(stop[0], len(sent) // 2)
    if parameters.get("safe_stop") == "brake":
        assert damping == [(EXTENDED | 2 << 8 | 9, (1000).to_bytes(4, "big"))]


def test_emulated_damping_acts_at_the_joint_only():
    for ratio in (1.0, 2.0):
        drive = CubeMarsV3("AK60-6-V3.0", safe_stop="damp", stop_damping=2.0, gear_ratio=ratio)
        [(_, _, data)] = drive.damped_stop().bands[0][1]
        understood = reference.read_force(reference.ranges(drive.spec), data)
        assert (
            understood["damping"] * ratio**2 == pytest.approx(2.0, abs=5.0 / 4095 * ratio**2)
            and understood["stiffness"] == 0.0
        )
        assert all(abs(understood[name]) < 2 * limit / 4095 for name, limit in (("velocity", 60.0), ("torque", 12.0)))


class Chatter(Block):
    """In the plant: a drive that reports a constant current every other step and records received frames."""

    y = Output("1")

    def __init__(self, current, error=0, can_id=1, **options):
        self.frame, self.end, self.heard = reference.status(can_id, current=current, error=error), None, 0
        super().__init__(**options)

    def step(self, tick):
        self.heard += len(self.end.receive())
        identifier, data = self.frame
        if tick % 2 == 0:
            self.end.send(identifier & 0x1FFFFFFF, data, True, tick * 1_000_000)
        return 0.0


@pytest.mark.parametrize(
    "kind, model, current, error, confirmed",
    [
        # 2.5 % of 9 N·m, at 0.57 N·m/A, and a code; and the answer to the disable
        (CubeMarsV3, "AK80-9-V3.0", 0, 0x77, True),
        (CubeMarsV3, "AK80-9-V3.0", 40, 0x77, True),
        (CubeMarsV3, "AK80-9-V3.0", -41, 0x77, False),
        (CubeMarsV3, "AK80-9-V3.0", 900, 0x77, False),
        (CubeMarsV3, "AK80-9-V3.0", 0, 0, False),
        # at 0.95 N·m/A; a board V2 answers no disable
        (CubeMarsServo, "AK80-9", 24, 0, True),
        (CubeMarsServo, "AK80-9", -24, 0, True),
        (CubeMarsServo, "AK80-9", 26, 0, False),
        (CubeMarsServo, "AK80-9", -900, 0, False),
        (CubeMarsServo, "AK80-9", 900, 0x77, False),
    ],
)
def test_only_a_drive_at_rest_confirms_the_safe_stop(kind, model, current, error, confirmed):
    """All of them have answered arming, and none is silent; the one that still draws a current is stopped repeatedly
    for 200 ms.
    """
    with Diagram("robot", rate=200) as robot:
        drive = kind(model, name="drive", report_rate=500.0)
        drive(**{"torque_command" if kind is CubeMarsV3 else "current_command": 0.0})
    with Diagram("plant", rate=1000) as plant:
        chatter = Chatter(current, error, name="chatter")
        Keep()(chatter.y)
    robot_rig = with_chatter(robot, plant, chatter)
    outcome = robot_rig.run(2)
    assert outcome.unconfirmed == (() if confirmed else ("drive",))
    makes_torque = error == 0x77 and current == 900  # which ends arming before its time is up
    assert outcome.unanswered == (("drive",) if error == 0x77 and not makes_torque else ())
    assert outcome.status == ("uncommanded torque" if makes_torque else "no answer" if error == 0x77 else "ok")
    rounds = (
        sum(frame.sent and frame.id == EXTENDED | 15 << 8 | 1 for frame in robot_rig.frames)
        if kind is CubeMarsV3
        else None
    )
    assert rounds is None or (rounds <= 3 if confirmed else rounds >= 40)


class Keep(Block):
    """Sink for a signal, so that its source is connected."""

    u = Input("1")

    def step(self, u):
        pass


def with_chatter(robot, plant, chatter):
    """A rig whose plant is no emulated drive: the block has the bus's other end."""
    rig = Rig(robot)
    chatter.end = rig.buses["can"].device
    rig.plant = Program(compile(plant), [])
    rig.executor = Executor(
        rig.control, rig.schedule.rate, plant=rig.plant, substeps=5, shared=rig.shared, virtual=True
    )
    return rig


# What can be wrong


@pytest.mark.parametrize("kind, model", [(CubeMarsV3, "AK80-9-V3.0"), (CubeMarsServo, "AK80-9")])
def test_a_drive_that_does_not_report_is_not_armed(kind, model):
    with Diagram("robot", rate=200) as robot:
        drive = kind(model, name="drive")
        drive(**{"torque_command" if kind is CubeMarsV3 else "current_command": 0.0})
    outcome = Rig(robot).run(10, arming_timeout=0.1)
    assert (outcome.status, outcome.unanswered) == ("no answer", ("drive",))


FAULTS = [
    ({"fault": lambda: Code(3)()}, "device fault"),
    ({"silent": lambda: During(0.2)()}, "silent"),
    ({"power_lost": lambda: During(0.2)()}, "silent"),
    ({"power_lost": lambda: During(0.2, 0.25)()}, "silent"),
    ({"power_lost": lambda: During(0.2, 0.204)()}, "device fault"),
    ({"dropped": lambda: Lost()()}, "silent"),
]


class Code(Block):
    """An error from 0.2 s on."""

    y = Output("1", dtype=int)

    def __init__(self, code, **options):
        self.code = code
        super().__init__(**options)

    def step(self, t):
        return self.code if t >= 0.2 else 0


class Lost(Block):
    """Every frame, from 0.2 s on."""

    y = Output("1")

    def step(self, t):
        return 1.0 if t >= 0.2 else 0.0


@pytest.mark.parametrize("wires, status", FAULTS)
@pytest.mark.parametrize(
    "kind, model, parameters",
    [
        (CubeMarsV3, "AK80-9-V3.0", {}),
        (CubeMarsV3, "AK80-9-V3.0", {"report_rate": 200.0}),
        (CubeMarsServo, "AK80-9", {}),
        (CubeMarsServo, "AK80-9-V3.0", {"mode": "velocity"}),
    ],
)
def test_a_drive_with_a_fault_ends_the_run(kind, model, parameters, wires, status):
    name = "torque_command" if kind is CubeMarsV3 else f"{parameters.get('mode', 'current')}_command"
    recording, drive = played(kind, model, 500, {name: 0.3}, plant=wires, **parameters)
    assert (recording.outcome.status, recording.outcome.culprit) == (status, "drive")
    armed = 4.0 / drive.report_rate if drive.report_rate else 0.0  # s, in which its reports are counted
    armed += 0.05 * (
        drive.spec.generation == 3 and drive.report_rate > 0.0
    )  # and a last answer to the disable may come
    assert 0.19 - armed < recording.time[-1] < 0.26


@pytest.mark.parametrize("report_rate", [0.0, 200.0])
def test_power_cycled_drive_is_reported_and_disabled(report_rate):
    """It would obey the next command: it needs no enable. What it says of its power ends the run, in the tick that
    hears it.
    """
    with Diagram("robot", rate=200) as robot:
        drive = CubeMarsV3("AK80-9-V3.0", name="drive", report_rate=report_rate)
        drive(torque_command=1.0)
    with Diagram("plant", rate=1000) as plant:
        emulated, witness = drive.emulator(), Witness()
        emulated(position=0.0, velocity=0.0, power_lost=During(0.2, 0.204)())
        witness(enabled=emulated.enabled, torque=emulated.torque)
    rig = Rig(robot, plant)
    outcome = rig.run(200)
    assert (outcome.status, outcome.culprit) == ("device fault", "drive")
    said = next(frame for frame in rig.frames if frame.id == reference.identifier(0x2C, 1))
    later = [(frame.id & 0xFF00) >> 8 for frame in rig.frames if frame.sent and frame.time > said.time + 5_000_000]
    assert set(later[1:]) <= {8, 15} and later[-1] == 15 and len(later) <= 4
    assert witness.seen[-1][1:] == (False, 0.0)


def test_occasionally_lost_frames_do_not_end_a_run():
    with Diagram("robot", rate=RATE) as robot:
        CubeMarsV3("AK80-9-V3.0", name="drive")(torque_command=0.01)
    with Diagram("plant", rate=RATE * SUBSTEPS) as plant:
        robot["drive"].emulator()(position=0.0, velocity=0.0, dropped=0.05)
    rig = Rig(robot, plant)
    assert rig.run(1000).status == "ok" and 0.004 < rig["drive.age"].max() < 0.05


def strange(kind, model, frame, guard=30.0):
    """A run in which a foreign frame arrives at tick 20."""
    shared = SharedState(1 << 20)
    shared.look_after(time.monotonic_ns())
    with Diagram("robot", rate=200) as robot:
        drive = kind(model, name="drive")
        source = Then(lambda: rig.buses["can"].device.send(frame[0] & 0x1FFFFFFF, frame[1], bool(frame[0] & EXTENDED)))
        source.outputs = {"y": Output("N·m" if kind is CubeMarsV3 else "A", range=(0.0, 0.2)).named("y")}
        drive(**{"torque_command" if kind is CubeMarsV3 else "current_command": source()})
    rig = Rig(robot, joint_of(drive), shared=shared, guard=guard)
    return rig.run(60)


class Then(Block):
    """0.1; does something at tick 20."""

    y = Output("any", range=(0.0, 0.2))

    def __init__(self, action, **options):
        self.action = action
        super().__init__(**options)

    def step(self, tick):
        if tick == 20:
            self.action()
        return 0.1


def joint_of(drive):
    with Diagram("plant", rate=1000) as plant:
        emulated = drive.emulator()
        emulated(position=0.0, velocity=0.0)
    return plant


@pytest.mark.parametrize("kind, model", [(CubeMarsV3, "AK80-9-V3.0"), (CubeMarsServo, "AK80-9")])
@pytest.mark.parametrize("number, length", [(0, 4), (1, 4), (3, 4), (5, 1), (6, 8), (8, 8), (15, 0), (16, 8)])
def test_a_foreign_command_with_any_content_is_a_fault(kind, model, number, length):
    outcome = strange(kind, model, (reference.identifier(number, 1), bytes(length)))
    assert (outcome.status, outcome.culprit, outcome.tick) == ("foreign command", "drive", 21)


@pytest.mark.parametrize(
    "frame",
    [(reference.identifier(8, 2), bytes(8)), (1, bytes(8)), reference.status(2), (EXTENDED | 0x01000801, bytes(8))],
)
def test_frame_for_other_device_is_not_a_command(frame):
    assert strange(CubeMarsV3, "AK80-9-V3.0", frame).status == "ok"


def test_two_drives_on_a_bus_need_different_ids():
    def two(first, second):
        with Diagram("robot", rate=200) as robot:
            CubeMarsV3("AK80-9-V3.0", can_id=first, name="one")(torque_command=0.5)
            CubeMarsServo("AK70-10", can_id=second, name="other")(current_command=-1.0)
        with Diagram("plant", rate=1000) as plant:
            for index, name in enumerate(("one", "other")):
                robot[name].emulator(name=name)(position=float(index), velocity=0.0)
        return Rig(robot, plant)

    with pytest.raises(DiagramError, match="one.*other|other.*one"):
        two(3, 3)
    rig = two(3, 4)
    assert rig.run(50, fade=0.0).status == "ok" and rig.statistics()["frames"]["foreign"] == 0
    assert rig["one.position"][-1] == pytest.approx(0.0, abs=1e-3) and rig["other.position"][-1] == pytest.approx(
        1.0, abs=2e-3
    )
    assert rig["one.torque"][-1] == pytest.approx(0.5, abs=0.02) and rig["other.current"][-1] == pytest.approx(
        -1.0, abs=0.011
    )


class Asks(Block):
    """True in one tick."""

    asked = Output("1", dtype=bool)

    def step(self, tick):
        return tick == 80


class Nan(Block):
    """0.5; NaN in tick 40."""

    y = Output("N·m", range=(0.0, 0.5))

    def step(self, tick):
        return math.nan if tick == 40 else 0.5


@pytest.mark.parametrize("report_rate", [0.0, 200.0])
def test_a_run_that_waits_behind_a_fault_may_be_armed_again(report_rate):
    """While it waits the drive is disabled in each tick, and what it answers to that, 0x77, is no fault."""
    with Diagram("robot", rate=200) as robot:
        CubeMarsV3("AK80-9-V3.0", name="drive", report_rate=report_rate)(torque_command=Nan()())
        Rearm(name="again")(Asks()())
    rig = Rig(robot, joint_of(robot["drive"]))
    outcome = rig.run(150, fade=0.0, rearm=[rig.schedule.inputs["again"]["request"]])
    assert (outcome.status, outcome.tick) == ("ok", 149) and [fault.status for fault in outcome.faults] == [
        "not finite"
    ]
    assert any(frame.data[7:] == b"\x77" for frame in rig.frames if not frame.sent)
    assert rig["drive.torque"][-1] == pytest.approx(0.5, abs=0.02)
    told = rig.tick[rig["drive.fault"] != 0]  # of the stop itself, which was still commanded when it began
    assert len(told) == 0 or told.max() < 46


# The emulated boards


@pytest.mark.parametrize("kind, model", [(EmulatedCubeMarsV3, "AK80-9-V3.0"), (EmulatedCubeMarsServo, "AK80-9")])
def test_emulated_drive_steps_manually_and_is_passive_before_first_command(kind, model):
    drive = kind(model, gear_ratio=2.0)
    drive.dt = 0.005
    for position, fault in ((0.0, 0), (1.0, 1), (-3.0, 0)):
        assert drive.step(position=position, velocity=1.0, fault=fault) == (0.0, False)

"""Life cycle of a RobStride drive on the bus, from arming to the safe stop, and foreign commands."""

import time
from types import SimpleNamespace
from typing import Any

import pytest

from blocks.actuators import (
    CubeMars,
    EmulatedCubeMars,
    EmulatedRobStride,
    EmulatedRobStrideMIT,
    RobStride,
    RobStrideMIT,
)
from blocks.limiters import TorqueLimiter
from blocks.models import Limb
from blocks.safety import Rearm
from cext.memory.shared_state import SharedState
from graph import Block, Diagram, Input, Output, Param, compile
from runtime.record.report.fault import two_devices
from tests.blocks.actuators import robstride_reference as reference
from tests.blocks.actuators.test_robstride_mit_faults import Ask, Broken
from tests.cext.rigs import Rig

MODES = {
    "operation": "torque_command",
    "position": "position_command",
    "csp": "position_command",
    "velocity": "velocity_command",
    "current": "current_command",
}


class Then(Block):
    """0.1; calls something at one tick."""

    u = Input("any")
    y = Output("any", range=(0.0, 0.2))

    def __init__(self, tick, action, unit, **options):
        self.when, self.action = tick, action
        super().__init__(**options)
        self.outputs = {"y": Output(unit, range=(0.0, 0.2)).named("y")}

    def step(self, u, tick):
        if tick == self.when:
            self.action()
        return 0.1


class Watcher(Block):
    """Notes whether a drive is enabled."""

    enabled = Input("1", dtype=bool)

    def reset(self):
        self.seen = []

    def step(self, enabled):
        self.seen.append(bool(enabled))


def lived(action=lambda: None, tick=20, *, kind=RobStride, substeps=5, guard=30.0, **parameters):
    """(rig, drive, watcher): one drive under a guardian that has just looked. action : called in a tick"""
    shared = SharedState(1 << 20)
    shared.look_after(time.monotonic_ns())
    with Diagram("robot", rate=200) as robot:
        drive = kind("RS03", name="drive", **parameters)
        name = "torque_command" if "torque_command" in drive.inputs else next(iter(drive.inputs))
        drive(**{name: Then(tick, action, drive.inputs[name].unit, name="then")(drive.position)})
    with Diagram("plant", rate=200 * substeps) as plant:
        emulated, watcher = drive.emulator(), Watcher()
        limb = Limb(inertia=0.1, damping=0.5, stiffness=0.0, reflex=0.0)
        limb(torque=emulated.torque)
        emulated(position=limb.position, velocity=limb.velocity)
        watcher(emulated.enabled)
    return Rig(robot, plant, shared=shared, guard=guard), drive, watcher


def flagged(frames):
    return [(identifier | (reference.EXTENDED if extended else 0), data) for identifier, extended, data in frames]


@pytest.mark.parametrize("substeps", [1, 2, 5])
@pytest.mark.parametrize("mode", MODES)
def test_arming_configures_and_enables_and_safe_stop_disables(mode, substeps):
    """Also where answers come so slowly, four a step, that arming repeats itself: what it repeated is no fault
    afterwards.
    """
    rig, drive, watcher = lived(mode=mode, substeps=substeps)
    outcome = rig.run(60)
    assert (outcome.status, outcome.unanswered) == ("ok", ()) and rig["drive.fault"].max() == 0
    sent = [(frame.id, frame.data) for frame in rig.frames if frame.sent]
    batch = flagged(drive.set_up_frames()) + flagged(drive.ask_frames())
    assert sent[: len(batch)] == batch
    enabled = sent.index(flagged(drive.enable_frames())[0])
    assert sent[enabled + 1] == flagged(drive.zero_frames())[0]
    stop = flagged(drive.zero_frames()) + flagged(drive.disable_frames())
    assert sent[-len(stop) :] == stop
    assert any(watcher.seen) and not watcher.seen[-1]
    if substeps > 1:
        assert outcome.unconfirmed == ()


@pytest.mark.parametrize("kind", [1, 3, 4, 6, 7, 18])
def test_a_foreign_command_is_a_fault_at_any_torque(kind):
    """Operation control has its torque in the identifier: it need not be a frame that we ever send."""
    rig, _, watcher = lived(
        lambda: rig.buses["can"].device.send(reference.identifier(kind, 0x4321, 127) & 0x1FFFFFFF, bytes(8), True)
    )
    outcome = rig.run(200)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("foreign command", "drive", 21) and not watcher.seen[-1]


@pytest.mark.parametrize(
    "identifier, extended",
    [
        (reference.identifier(1, 0x4321, 126), True),
        (reference.identifier(17, 0xFD, 127), True),
        (reference.identifier(0, 0xFD, 127), True),
        (127, False),
    ],
)
def test_frame_for_other_device_is_not_a_command(identifier, extended):
    rig, _, _ = lived(lambda: rig.buses["can"].device.send(identifier & 0x1FFFFFFF, bytes(8), extended))
    assert rig.run(50).status == "ok"


def test_without_a_guardian_a_foreign_command_is_only_counted():
    rig, _, _ = lived(
        lambda: rig.buses["can"].device.send(reference.identifier(1, 1, 127) & 0x1FFFFFFF, bytes(8), True), guard=0.0
    )
    assert rig.run(50).status == "ok" and rig.statistics()["frames"]["foreign"] == 1


def test_foreign_command_in_mit_mode_is_a_fault():
    rig, _, _ = lived(lambda: rig.buses["can"].device.send(127, bytes(8)), kind=RobStrideMIT)
    assert rig.run(200).status == "foreign command"


class Fault(Block):
    """`code` from 0.1 s on."""

    code = Param(0, "1", "of the fault")
    y = Output("1", dtype=int)

    def step(self, t):
        return self.code if t >= 0.1 else 0


@pytest.mark.parametrize("code", [1, 1 << 5, 256 << 14, 256 << 31])
def test_a_drive_that_reports_a_fault_ends_the_run(code):
    """In its feedback, or in a report of its own."""
    with Diagram("robot", rate=200) as robot:
        drive = RobStride("RS03", name="drive")
        drive(torque_command=0.1)
    with Diagram("plant", rate=1000) as plant:
        emulated = drive.emulator()
        emulated(position=0.0, velocity=0.0, fault=Fault(code)())
    rig = Rig(robot, plant)
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit) == ("device fault", "drive") and 19 <= outcome.tick <= 22


def test_two_protocols_share_a_bus_without_interference():
    with Diagram("robot", rate=200) as robot:
        drives = [
            RobStride("RS03", can_id=3, name="hip"),
            RobStride("CyberGear", can_id=4, name="knee"),
            RobStrideMIT("RS02", can_id=3, name="ankle"),
        ]
        for index, drive in enumerate(drives):
            drive(torque_command=0.1 * (index + 1))
    with Diagram("plant", rate=1000) as plant:
        for index, drive in enumerate(drives):
            emulated = drive.emulator(name=f"{drive.path}_drive")
            emulated(position=float(index), velocity=0.0)
    rig = Rig(robot, plant)
    assert rig.run(50, fade=0.0).status == "ok" and rig.statistics()["frames"]["foreign"] == 0
    for index, drive in enumerate(drives):
        assert abs(rig[f"{drive.path}.position"][-1] - index) < 1e-3
        assert abs(rig[f"{drive.path}.torque"][-1] - 0.1 * (index + 1)) < 0.02


def test_resends_to_silent_drive_respect_bus_capacity():
    """Ten frames of settings go out in every tenth round, a stop in each: twice what a tick takes, not 8 times."""
    with Diagram("robot", rate=200) as robot:
        drive = RobStride("RS03", name="drive")
        drive(torque_command=0.1)
    rig = Rig(robot)
    outcome = rig.run(10, arming_timeout=0.2)
    assert (outcome.status, outcome.unanswered) == ("no answer", ("drive",))
    kinds = [frame.id >> 24 & 31 for frame in rig.frames if frame.sent]
    before = [frame.id >> 24 & 31 for frame in rig.frames if frame.sent and frame.time <= 0.2e9]
    assert 40 <= before.count(4) - before.count(17) // 5 <= 43 and len(drive.set_up_frames()) == 10
    assert 4 <= before.count(17) // 5 <= 6
    assert kinds[:11] == [4, 18, 18, 18, 0, 17, 17, 17, 17, 17, 4] and kinds[-1] == 4 and 3 not in kinds


class Outage(Block):
    """True from 0.2 s to 0.25 s."""

    y = Output("1", dtype=bool)

    def step(self, t):
        return 0.2 <= t < 0.25


@pytest.mark.parametrize("kind, model", [(CubeMars, "AK80-9"), (RobStrideMIT, "RS02"), (RobStride, "RS02")])
def test_power_cycled_drive_has_no_torque_until_rearmed(kind, model):
    """Protocols without a mode bit cannot report the state; the drive is disabled all the same."""
    with Diagram("robot", rate=200) as robot:
        drive = kind(model, name="drive")
        drive(torque_command=0.1)
    with Diagram("plant", rate=1000) as plant:
        emulated, watcher = drive.emulator(), Watcher()
        emulated(position=0.0, velocity=0.0, power_lost=Outage()())
        watcher(emulated.enabled)
    rig = Rig(robot, plant)
    outcome = rig.run(100)
    assert outcome.status == ("device fault" if kind is RobStride else "ok")
    assert (
        any(watcher.seen[:150])
        and not any(watcher.seen[201:])
        and rig["drive.torque"][-1] == pytest.approx(0.0, abs=0.02)
    )


@pytest.mark.parametrize("model", ["RS02", "CyberGear"])
def test_a_drive_that_waits_disabled_can_be_armed_again(model):
    """It has not stopped by itself: the run disabled it, and keeps it disabled until the operator arms it."""
    with Diagram("robot", rate=200) as robot:
        drive = RobStride(model, name="drive")
        drive(torque_command=TorqueLimiter(limit=0.1)(Broken(name="law")()))
        Rearm(name="again")(Ask(name="ask")())
    with Diagram("plant", rate=1000) as plant:
        drive.emulator()(position=0.0, velocity=0.0)
    rig, told = Rig(robot, plant), []
    rearm = [rig.schedule.inputs["again"]["request"]]
    outcome = rig.run(400, fade=0.0, rearm=rearm, notify=lambda what, outcome: told.append(what))
    assert (outcome.status, told) == ("ok", ["fault", "rearm"])
    assert not rig["drive.fault"].any() and rig["drive.torque"][-1] == pytest.approx(0.1, abs=0.01)


class Exchange(Block):
    """True from 0.4 s to 0.55 s: the drive has no power."""

    y = Output("1", dtype=bool)

    def step(self, t):
        return 0.4 <= t < 0.55


@pytest.mark.hazard("H1o")
@pytest.mark.parametrize(
    "expected, other, statuses",
    [
        ("A", "B", ["not finite", "two devices"]),
        ("A", "A", ["not finite", "ok"]),
        ("", "B", ["not finite", "ok"]),
        ("B", "B", ["two devices"]),
    ],
    ids=["other unit", "same unit", "no record", "other unit from the start"],
)
def test_another_drive_is_not_armed_in_the_place_of_the_one_that_was_compared(expected, other, statuses):
    """The drive is exchanged while the run waits after a fault. Without a record any drive may be armed."""
    with Diagram("robot", rate=200) as robot:
        drive = RobStride("RS02", name="drive")
        drive(torque_command=TorqueLimiter(limit=0.1)(Broken(name="law")()))
        Rearm(name="again")(Ask(name="ask")())
    with Diagram("plant", rate=1000) as plant:
        emulated, watcher = drive.emulator(unique="A" * 16, name="unit"), Watcher()
        emulated(position=0.0, velocity=0.0, power_lost=Exchange()())
        watcher(emulated.enabled)
    if expected:
        drive.unique = drive.unit_memory(expected * 16)["unique"]
    rig = Rig(robot, plant)
    first = compile(plant).items["unit"]["identity"][0]
    seen = []

    def exchange(what, outcome):
        if what == "fault":
            rig.plant.values[first : first + 8] = list(bytes.fromhex(other * 16))
            seen.append(len(watcher.seen))

    outcome = rig.run(400, fade=0.0, rearm=[rig.schedule.inputs["again"]["request"]], notify=exchange)
    assert [fault.status for fault in outcome.faults] + [outcome.status] == statuses
    assert any(watcher.seen[: (seen or [None])[0]]) == (expected != "B")
    assert any(watcher.seen[(seen or [0])[0] + 5 :]) == (outcome.status == "ok")
    case: Any = SimpleNamespace(block=drive, program=rig.control, result=SimpleNamespace(schedule=rig.schedule))
    assert ("another unit than the recorded one, or" in two_devices(case)) == bool(expected)


@pytest.mark.parametrize(
    "kind, model", [(EmulatedCubeMars, "AK80-9"), (EmulatedRobStride, "RS03"), (EmulatedRobStrideMIT, "RS03")]
)
def test_emulated_drive_steps_manually_and_is_passive_before_first_command(kind, model):
    drive = kind(model, gear_ratio=2.0)
    for position, fault in ((0.0, 0), (1.0, 1), (-3.0, 0)):
        assert drive.step(position=position, velocity=1.0, fault=fault) == (0.0, False)

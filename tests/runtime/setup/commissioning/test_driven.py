"""The steps of `commission` under torque, in virtual time: every drive that is healthy agrees, each fault is named."""

import math
from types import SimpleNamespace

import pytest

from blocks import actuators
from cext.schedule.outcome import STATUS, Outcome
from graph import Block, Diagram, Input, Output, Param
from runtime.robot.rig.records import AGREES, DIFFERS, OPEN, StepRecord
from runtime.setup.commissioning.guided import driven
from runtime.setup.commissioning.guided.bench import Given as Asked
from runtime.setup.commissioning.guided.bench import Result
from tests.cext.imposed import Given
from tests.cext.rigs import Rig
from tests.soaking import soaked

LEVER = 0.2  # m
HEALTHY = {  # block, model, parameters
    "MIT mode": ("CubeMars", "AK80-9", {}),
    "MIT mode, error mask": ("CubeMars", "AK40-10", {}),
    "MIT mode, 6 bytes": ("CubeMars", "AK80-9", {"reply": 6}),
    "servo mode": ("CubeMarsServo", "AK60-6-V1.1", {}),
    "servo mode at 500 Hz": ("CubeMarsServo", "AK80-9", {"report_rate": 500.0}),
    "servo mode at 50 Hz": ("CubeMarsServo", "AK80-9", {"report_rate": 50.0}),
    "servo mode of a V3.0 board": ("CubeMarsServo", "AK80-9-V3.0", {"report_rate": 0.0}),
    "V3.0 board": ("CubeMarsV3", "AK80-9-V3.0", {}),
    "V3.0 board that reports": ("CubeMarsV3", "AK80-9-V3.0", {"report_rate": 500.0}),
    "V3.0 board that is entered": ("CubeMarsV3", "AK80-9-V3.0", {"enter": True}),
    "RobStride": ("RobStride", "RS02", {}),
    "CyberGear": ("RobStride", "CyberGear", {}),
    "RobStride in MIT mode": ("RobStrideMIT", "RS04", {}),
    "inverted": ("RobStride", "RS02", {"invert": True, "offset": 0.3}),
}


class Hanging(Block):
    """Joint from which a lever hangs, with Coulomb friction. `most`: the largest torque of the drive so far, N·m."""

    moment = Param(0.1, "kg·m", "mass × length")
    length = Param(0.2, "m")
    start = Param(0.0, "rad", "from where it swings at the beginning")
    friction = Param(0.0, "N·m")
    torque = Input("N·m")
    position = Output("rad")
    velocity = Output("rad/s")

    def reset(self):
        self.at, self.speed, self.most = self.start, 0.0, 0.0

    def step(self):
        return self.at, self.speed

    def update(self, torque):
        lever, inertia = driven.GRAVITY * self.moment, 1.3 * self.moment * self.length
        damping = 0.15 * math.sqrt(lever * inertia)
        free = self.speed + (torque - lever * math.sin(self.at) - damping * self.speed) / inertia * self.dt
        self.speed = math.copysign(max(0.0, abs(free) - self.friction * self.dt / inertia), free)
        self.at += self.speed * self.dt
        self.most = max(self.most, abs(torque))


def block_of(kind, model, parameters):
    """A drive of a robot."""
    with Diagram("bench", rate=200):
        return getattr(actuators, kind)(model, can_id=1, range=(-6.0, 6.0), name="knee", **parameters)


def carried_out(block, fades=(), start=0.0, friction=0.0, **faults):
    """(Result of the torque step, largest torque) of an emulated drive.

    fades : (s, s) in which no reply arrives; start : rad, from where the lever swings; friction : of the rated torque
    """
    moment = 1.2 * driven.USED_SHARE * driven.rated_of(block) / driven.STEEPEST / driven.GRAVITY
    lever = driven.Lever(moment / LEVER, LEVER)
    robot, probe = driven.lever_diagram(block, lever, 0.0)
    with Diagram("plant", rate=2000) as plant:
        arm = Hanging(moment=moment, length=LEVER, start=start, friction=friction * driven.rated_of(block))
        drive = robot["joint"].emulator(name="drive", **faults)
        silent = Given(lambda t: any(begin <= t < end for begin, end in fades), unit="1", dtype=bool)
        arm(drive.torque)
        drive(position=arm.position, velocity=arm.velocity, silent=silent())
    outcome = Rig(robot, plant).run(math.ceil(probe.duration * driven.RATE))
    assert probe.ended, (outcome.status, outcome.tick)
    return driven.torque_of(block, lever, probe), arm.most


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("drive", soaked(HEALTHY, but=[0, 7, 10, 13]))
def test_the_torque_of_a_healthy_drive_agrees_though_replies_are_missing_for_100_ms(drive):
    block = block_of(*HEALTHY[drive])
    result, most = carried_out(block, fades=[(1.0, 1.1), (7.0, 7.1)])
    assert not result.findings and result.measured["ratio"] == pytest.approx(1.0, abs=0.06), result
    assert 0.02 * driven.rated_of(block) < most <= 0.05 * driven.rated_of(block)


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("start", [-1.2, -0.9, 0.9, 1.2])
def test_a_lever_that_still_swings_does_not_show_the_torque_of_the_drive(start):
    result, most = carried_out(block := block_of(*HEALTHY["MIT mode"]), start=start)
    assert not result.findings and result.measured["ratio"] == pytest.approx(1.0, abs=0.06), result
    assert result.measured["commanded"] > 0.02 * driven.rated_of(block) and most <= 0.05 * driven.rated_of(block)


FAULTS = {  # block, model, faults of the emulator, the finding
    "weak": ("RobStride", "RS02", {"torque_scale": 0.8}, "torque constant"),
    "strong": ("CubeMars", "AK80-9", {"torque_scale": 1.2}, "torque constant"),
    "weak without a published rating": ("CubeMarsV3", "AK10-9-V3.0", {"torque_scale": 0.8}, "torque constant"),
    "range": ("CubeMars", "AK80-9", {"wire_torque": 72.0}, "torque constant"),
    "against": ("CubeMars", "AK80-9", {"torque_scale": -1.0}, "sign of torque"),
    "ampere": ("CubeMarsServo", "AK60-6-V1.1", {"torque_scale": 0.7}, "torque constant"),
    "dead": ("CubeMarsV3", "AK80-9-V3.0", {"torque_scale": 0.01}, "no torque"),
}


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("fault", FAULTS)
def test_another_torque_than_was_commanded_is_named_before_5_percent_of_rated(fault):
    kind, model, faults, finding = FAULTS[fault]
    block = block_of(kind, model, {})
    result, most = carried_out(block, **faults)
    assert [name for name, _ in result.findings] == [finding], result
    assert 0.0 < most <= 0.05 * driven.rated_of(block)


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize(
    "friction, verdict", [(0.0, AGREES), (0.005, AGREES), (0.01, AGREES), (0.02, OPEN), (0.03, OPEN), (0.04, OPEN)]
)
def test_friction_is_not_taken_for_another_torque_constant(friction, verdict):
    result, _ = carried_out(block := block_of(*HEALTHY["MIT mode"]), friction=friction)
    assert result.verdict == verdict and not result.findings, result
    seen = result.measured.get("friction", 0.0) / driven.rated_of(block)
    assert 0.3 * friction <= seen <= 1.5 * friction, result.says  # of a lever that is held, at least


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize("friction", [0.005, 0.01])
def test_another_torque_constant_is_named_beside_friction(friction):
    result, _ = carried_out(block_of(*HEALTHY["RobStride"]), friction=friction, torque_scale=0.8)
    assert [name for name, _ in result.findings] == ["torque constant"], result


def test_a_joint_that_does_not_move_has_no_torque_or_more_friction():
    result, most = carried_out(block := block_of(*HEALTHY["RobStride"]), friction=0.06)
    assert [name for name, _ in result.findings] == ["no torque"] and "friction" in result.findings[0][1], result
    assert 0.0 < most <= 0.05 * driven.rated_of(block)


@pytest.mark.parametrize("status, verdict", [("unguarded", OPEN), ("overrun", OPEN), ("not following", DIFFERS)])
def test_a_fault_of_the_computer_is_not_a_finding_on_the_drive(status, verdict):
    run = SimpleNamespace(outcome=Outcome(status, "knee", 891, 0, None, (), ()), report=["FAULT at tick 891"])
    assert driven.failed(Result(), block_of(*HEALTHY["servo mode"]), run).verdict == verdict
    assert set(driven.OF_COMPUTER) <= set(STATUS.values())


@pytest.mark.parametrize("status, stopped", [("device fault", True), ("ok", False)])
def test_a_drive_that_reports_its_time_out_as_a_fault_has_stopped(status, stopped):
    """The fault ends the run at the first reply, before a reading shows that the lever falls."""
    rows = [(phase, 0.53, 0.04, 0.04, 0.0) for phase in ("held", "after")]
    run = SimpleNamespace(outcome=Outcome(status, "joint", 955, 0, None, (), ()), report=["reported fault: time-out"])
    assert driven.has_stopped(SimpleNamespace(rows=rows), run, driven.Lever(1.0, LEVER)) == stopped
    assert driven.FAULTED in STATUS.values()


def test_the_longest_restart_that_a_drive_accepts_bounds_that_of_a_run():
    board = block_of("CubeMarsV3", "AK80-9-V3.0", {"restart_time": 0.012})
    board.parameters = board.parameters | {"restart_time": Param(0.0, "s", max=0.5, fixed=True).named("restart_time")}
    diagram, _ = driven.lever_diagram(board, driven.Lever(1.0, LEVER), 0.9)
    assert diagram["joint"].restart_time == 0.5


def test_a_lever_that_friction_holds_does_not_show_whether_a_drive_stops():
    torque = StepRecord("", OPEN, {"friction": 0.2})
    given = Asked(1.0, steps={"torque": torque}, lever=driven.Lever(1.0, LEVER))
    result = driven.silence(None, block_of(*HEALTHY["RobStride"]), given)
    assert result.verdict == OPEN and "friction" in result.says[0]

"""RobStride drives, their emulators and a limb, through the wire and back, in every mode, against closed forms."""

import math

import numpy as np
import pytest

from blocks.actuators import CubeMars, RobStride, RobStrideMIT
from blocks.limiters import TorqueLimiter
from blocks.models import Limb
from blocks.sources import Sine
from graph import Block, Diagram, Input, Output, Param
from tests.blocks.actuators.test_cubemars_closed_loop import second_order
from tests.blocks.running import run


class During(Block):
    """True from `start` to `stop`."""

    start = Param(0.2, "s", "when it begins")
    stop = Param(math.inf, "s", "when it ends")
    y = Output("1", "whether it is", dtype=bool)

    def step(self, t):
        return self.start <= t < self.stop


class Since(Block):
    """`value` from 0.2 s on, 0 before."""

    value = Param(1.0, "1", "then")
    unit = Param("1", "1", "of the output", dtype=str)

    def configure(self):
        self.outputs = {"y": Output(self.unit, "the value").named("y")}

    def step(self, t):
        return self.value if t >= 0.2 else 0.0


class Witness(Block):
    """Notes (t, enabled, torque) of a drive."""

    enabled = Input("1", "of the drive", dtype=bool)
    torque = Input("N·m", "of the drive")

    def reset(self):
        self.seen = []

    def step(self, enabled, torque, t):
        self.seen.append((t, enabled, torque))


RATE, SUBSTEPS, INERTIA = 500, 20, 0.05
EVERYTHING = [
    ("RS03", {}),
    ("RS00", {"invert": True}),
    ("CyberGear", {"offset": 0.3}),
    ("EL05", {"invert": True, "offset": -0.4, "gear_ratio": 3.0}),
]


def joint(robot, *, inertia=INERTIA, start=0.0, **wires):
    """The plant of one joint: the drive on a free inertia. wires : faults of the drive, by name, as functions that make
    a signal.
    """
    with Diagram("joint", rate=RATE * SUBSTEPS) as plant:
        emulated = robot["drive"].emulator()
        limb = Limb(inertia=inertia, damping=0.0, stiffness=0.0, reflex=0.0, start=start)
        limb(torque=emulated.torque)
        emulated(position=limb.position, velocity=limb.velocity, **{name: make() for name, make in wires.items()})
    return plant


def played(kind, model, ticks=RATE, commands=None, plant=None, **parameters):
    with Diagram("loop", rate=RATE) as robot:
        drive = kind(model, name="drive", **parameters)
        drive(**(commands or {"torque_command": 0.0}))
    return run(robot, ticks, plant=joint(robot, **(plant or {})), substeps=SUBSTEPS), drive


def in_order(recording):
    outcome, frames = recording.outcome, recording.statistics["frames"]
    assert (outcome.status, outcome.unconfirmed, outcome.unanswered) == ("ok", (), ()), outcome
    assert (frames["foreign"], frames["malformed"]) == (0, 0) and recording["drive.fault"].max() == 0


@pytest.mark.parametrize("model, mounting", EVERYTHING)
@pytest.mark.parametrize("kind", [RobStride, RobStrideMIT])
def test_a_position_loop_in_the_drive_answers_as_a_second_order_system(kind, model, mounting):
    """Within two codes of position and 1.5 % of the step: codes of stiffness and damping, and Euler's error at 10
    kHz.
    """
    if (kind, model) == (RobStrideMIT, "CyberGear"):
        model = "RS02"
    target, stiffness, damping = 0.2, 20.0, 0.4
    commands = {"position_command": target, "stiffness_command": stiffness, "damping_command": damping}
    recording, drive = played(kind, model, commands=commands, limit="peak", **mounting)
    in_order(recording)
    wanted = second_order(recording.time[:-1], target, stiffness, damping, INERTIA)
    codes = 65535 if kind is RobStride else 4095
    slack = (
        0.015 * target
        + 4 * drive.wire[0] / 65535
        + target * (drive.wire[2] / codes / stiffness + drive.wire[3] / codes / damping)
    )
    assert np.abs(recording["drive.position"][1:] - wanted).max() < slack


@pytest.mark.parametrize("model, mounting", EVERYTHING)
def test_constant_torque_accelerates_free_inertia_and_is_measured(model, mounting):
    recording, drive = played(RobStride, model, 150, {"torque_command": 0.5}, **mounting)
    in_order(recording)
    t, step = recording.time[:-1], 1.0 / (RATE * SUBSTEPS)
    code = 2 * drive.wire[4] / 65535
    assert np.abs(recording["drive.torque"][2:] - 0.5).max() < 2 * code
    error = recording["drive.position"][1:] - 0.5 * t**2 / (2.0 * INERTIA)
    assert np.abs(error).max() < 0.01 * t[-1] ** 2 + 10.0 * t[-1] * step + code * 10


@pytest.mark.parametrize("model, mounting", EVERYTHING)
@pytest.mark.parametrize("mode", ["position", "csp"])
def test_position_modes_reach_setpoint_within_velocity_limit(model, mounting, mode):
    if model == "CyberGear" and mode == "csp":
        return
    recording, drive = played(
        RobStride, model, 2 * RATE, {"position_command": 0.5}, mode=mode, velocity_limit=1.0, limit="peak", **mounting
    )
    in_order(recording)
    assert abs(recording["drive.position"][-1] - 0.5) < 0.005 and recording["drive.velocity"].max() < 1.0 + 0.02
    assert abs(recording["drive.position"][RATE // 4] - 0.25) < 0.07, "on its way at 1 rad/s"
    assert recording["drive.position_sent"][-1] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("model, mounting", EVERYTHING)
def test_velocity_and_current_modes_follow_setpoint(model, mounting):
    recording, drive = played(RobStride, model, commands={"velocity_command": -1.5}, mode="velocity", **mounting)
    in_order(recording)
    assert abs(recording["drive.velocity"][-1] + 1.5) < 0.01
    recording, drive = played(RobStride, model, 100, {"current_command": 0.4}, mode="current", **mounting)
    in_order(recording)
    wanted = 0.4 * drive.spec.torque_constant * drive.gear_ratio
    assert abs(recording["drive.torque"][-1] - wanted) < 3 * drive.wire[4] / 65535
    assert recording["drive.current_sent"][-1] == pytest.approx(0.4)


@pytest.mark.parametrize("mode, command", [("csp", {"position_command": 3.0}), ("velocity", {"velocity_command": 2.0})])
def test_torque_in_other_modes_fades_in_within_limit(mode, command):
    """Of the current: rated, so N·m within the rated torque and a code; and in the first half of the fade, within half
    of it.
    """
    with Diagram("fade", rate=RATE) as robot:
        RobStride("RS03", name="drive", mode=mode)(**command)
    recording = run(robot, 250, plant=joint(robot, inertia=20.0), substeps=SUBSTEPS, fade=0.5)
    torque, share = recording["drive.torque"], np.minimum(recording.time / 0.5, 1.0)
    in_order(recording)
    assert torque.max() > 5.0 and np.all(np.abs(torque[1:]) <= 20.0 * share[:-1] + 0.01)


def test_swapping_the_actuator_keeps_the_joint_position():
    """The same knee with three boards: positions under a torque that swings agree within 2 % of their range.

    A code of torque in twelve bits, truncated, is 0.09 rad of 4.2 after a second on this inertia.
    """
    paths = {}
    for kind, model in ((CubeMars, "AK80-9"), (RobStride, "RS02"), (RobStrideMIT, "RS02")):
        with Diagram("swap", rate=RATE) as robot:
            kind(model, name="drive")(torque_command=TorqueLimiter(limit=5.0)(Sine(2.0, 1.5)()))
        paths[kind] = run(robot, RATE, plant=joint(robot), substeps=SUBSTEPS)["drive.position"]
    assert all(np.abs(path - paths[RobStride]).max() < 0.02 * np.ptp(path) for path in paths.values())


def test_requested_reports_arrive_and_safe_stop_disables_them():
    recording, drive = played(RobStride, "RS02", 200, {"torque_command": 0.1}, active_reporting=True)
    in_order(recording)
    frames = recording.statistics["frames"]
    assert frames["received"] - frames["sent"] >= 35, "one every 10 ms for 0.4 s, beside the replies"
    assert [identifier >> 24 for identifier, _, _ in drive.disable_frames()] == [4, 24]


@pytest.mark.parametrize("mode", ["operation", "csp", "velocity", "current"])
def test_arming_enables_the_drive_once_and_the_safe_stop_leaves_it_disabled(mode):
    name = {"operation": "torque", "csp": "position"}.get(mode, mode)
    with Diagram("life", rate=RATE) as robot:
        RobStride("RS03", name="drive", mode=mode)(**{f"{name}_command": 0.1})
    with Diagram("plant", rate=RATE) as plant:  # one answer a tick at most fits: arming takes some rounds
        emulated = robot["drive"].emulator()
        emulated(position=0.0, velocity=0.0)
    recording = run(robot, 50, plant=plant)
    assert (recording.outcome.status, recording.outcome.unanswered) == ("ok", ()) and recording[
        "drive.fault"
    ].max() == 0


# Faults, ended by the robot

WRONG = {
    "silent": (lambda: During()(), "silent"),
    "power_lost": (lambda: During()(), "silent"),
    "dropped": (lambda: Since(1.0)(), "silent"),
    "delay": (lambda: Since(0.3, "s")(), "silent"),
    "temperature": (lambda: Since(500.0, "°C")(), "device fault"),
}


@pytest.mark.parametrize(
    "kind, model", [(RobStride, "RS03"), (RobStride, "CyberGear"), (RobStrideMIT, "RS03"), (CubeMars, "AK80-9")]
)
@pytest.mark.parametrize("fault", WRONG)
def test_drive_faults_end_run_and_torque(kind, model, fault):
    make, status = WRONG[fault]
    if kind is not RobStride and fault == "temperature":
        return  # the first has no fault to tell, of the other no temperature is known
    recording, drive = played(kind, model, 500, {"torque_command": 0.2}, plant={fault: make})
    assert (recording.outcome.status, recording.outcome.culprit) == (status, "drive")
    assert 0.19 < recording.time[-1] < 0.45


@pytest.mark.parametrize("fault", ["wrong_id"])
@pytest.mark.parametrize("kind, model", [(RobStride, "RS03"), (RobStrideMIT, "RS03"), (CubeMars, "AK80-9")])
def test_a_reply_with_another_id_does_not_count_as_a_reply(kind, model, fault):
    recording, drive = played(kind, model, 10, plant={"wrong_id": lambda: 9})
    assert recording.outcome.status == "no answer" and recording.outcome.unanswered == ("drive",)


@pytest.mark.parametrize("kind, model", [(RobStride, "RS03"), (RobStrideMIT, "RS03"), (CubeMars, "AK80-9")])
def test_stuck_encoder_reports_no_motion(kind, model):
    with Diagram("loop", rate=RATE) as robot:
        kind(model, name="drive")(torque_command=0.5)
    recording = run(robot, 200, plant=joint(robot, stuck_encoder=lambda: During()()), substeps=SUBSTEPS)
    late = recording["drive.position"][120:]
    assert recording.outcome.status == "ok" and np.ptp(late) == 0.0 and late[0] > 0.1
    assert np.abs(recording["drive.velocity"][120:]).max() < 0.02


@pytest.mark.parametrize("kind, model", [(RobStride, "RS03"), (RobStrideMIT, "RS03"), (CubeMars, "AK80-9")])
def test_occasionally_lost_frames_do_not_end_a_run(kind, model):
    recording, drive = played(kind, model, 1000, {"torque_command": 0.01}, plant={"dropped": lambda: 0.05})
    assert recording.outcome.status == "ok" and 0.004 < recording["drive.age"].max() < 0.05
    frames = recording.statistics["frames"]
    assert 40 < frames["sent"] - frames["received"] < 250, "a twentieth on either way"


def test_late_replies_are_as_old_as_they_are_late():
    recording, _ = played(RobStride, "RS03", 300, {"torque_command": 0.2}, plant={"delay": lambda: 0.02})
    ok, _ = played(RobStride, "RS03", 300, {"torque_command": 0.2})
    assert recording.outcome.status == ok.outcome.status == "ok"
    assert np.abs(recording["drive.position"][100:] - ok["drive.position"][90:-10]).max() < 0.03


@pytest.mark.hazard("H4c")
@pytest.mark.parametrize("back", [0.03, 0.06])
def test_power_cycled_drive_is_not_reenabled(back):
    """It answers again before its silence ends the run, and is found stopped."""
    recording, _ = played(
        RobStride, "RS03", 500, {"torque_command": 0.5}, plant={"power_lost": lambda: During(0.2, 0.2 + back)()}
    )
    assert (recording.outcome.status, recording.outcome.culprit) == ("device fault", "drive")
    assert recording.time[-1] < 0.2 + back + 0.05
    speed = recording["drive.velocity"]
    assert abs(speed[-1] - speed[recording.time < 0.2][-1]) < 0.1, "it turned on by itself, without torque"


def test_drive_stops_when_commands_cease():
    """The run ends without a stop, as if the control process and the guardian were killed. 0x7028 is 0.1 s."""
    with Diagram("robot", rate=RATE) as robot:
        RobStride("RS03", name="drive", timeout=0.0)(torque_command=0.5)
    with Diagram("plant", rate=RATE * SUBSTEPS) as plant:
        emulated = robot["drive"].emulator()
        limb = Limb(inertia=INERTIA, damping=0.0, stiffness=0.0, reflex=0.0)
        limb(torque=emulated.torque)
        emulated(position=limb.position, velocity=limb.velocity, dropped=Since(1.0)())
        witness = Witness()
        witness(enabled=emulated.enabled, torque=emulated.torque)
    recording = run(robot, 300, plant=plant, substeps=SUBSTEPS)
    assert recording.outcome.status == "ok" and recording["drive.age"][-1] > 0.3
    assert recording.outcome.unconfirmed == ("drive",), "nothing of the stop came through"
    pushing = [t for t, enabled, torque in witness.seen if enabled and torque != 0.0]
    assert 0.29 < pushing[-1] <= 0.3 + 1e-9, "0.1 s after the last frame that reached it"
    assert all(torque == 0.0 and not enabled for t, enabled, torque in witness.seen if t > 0.3 + 1e-9)

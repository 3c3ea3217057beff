"""The safe stop over wires, in virtual time: what is sent, when it ends, and which drives confirm."""

import json
import math

import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3
from cext.safety.thresholds import STOP_LIMIT, STOP_ROUND
from graph import Diagram, compile
from runtime.guardian import plan
from runtime.guardian.process import decoded
from runtime.guardian.stop import SafeStop
from tests.blocks.actuators import reference
from tests.played_drive import PlayedDrive, never_gains

ALL = 0xFFFFFFFF


class Log:
    """A wire that keeps what is sent. working : whether frames go out"""

    def __init__(self, working=True):
        self.sent, self.working = [], working

    def send(self, identifier, data):
        self.sent.append((identifier, data))
        return self.working


def device(name, bus, identifier, begin=b"", damp_time=0.0, bands=None, velocity=None, number=0):
    """As the guardian has it. bands : (speed, data) of its damping"""
    damp = damp_time and {
        "duration": damp_time,
        "round": 0.002,
        "acceleration": 500.0,
        "velocity": velocity,
        "bands": [(speed, [(identifier, data)]) for speed, data in bands or [(math.inf, b"damp")]],
    }
    return {
        "name": name,
        "number": number,
        "bus": bus,
        "zero": [(identifier, b"zero")],
        "disable": [(identifier, b"disable")],
        "damp": damp or None,
        "replies": [(identifier + 0x100, ALL, begin.hex())],
    }


@pytest.fixture
def legs():
    """Two devices on a bus, one on another."""
    wires = {0: Log(), 1: Log()}
    return SafeStop([device("left", 0, 1), device("right", 0, 2), device("hip", 1, 1, b"\1")], wires, 0), wires


def test_stop_is_sent_to_all_drives_at_once_and_every_round(legs):
    stop, wires = legs
    stop.step(0)
    assert wires[0].sent == [(1, b"zero"), (1, b"disable"), (2, b"zero"), (2, b"disable")]
    assert wires[1].sent == [(1, b"zero"), (1, b"disable")]
    stop.step(STOP_ROUND - 1)
    assert len(wires[0].sent) == 4
    stop.step(STOP_ROUND)
    assert len(wires[0].sent) == 8 and stop.report()["sent"] == 12


def test_drive_that_acknowledges_both_frames_is_confirmed(legs):
    stop, wires = legs
    stop.step(0)
    stop.receive(0, 0x101, b"", 1)
    stop.step(STOP_ROUND)  # one answer is not enough, and counts no more
    stop.receive(0, 0x101, b"", STOP_ROUND + 1)
    assert stop.report()["confirmed"] == []
    stop.receive(0, 0x101, b"", STOP_ROUND + 2)
    assert stop.report()["confirmed"] == ["left"]
    stop.step(2 * STOP_ROUND)
    assert wires[0].sent[8:] == [(2, b"zero"), (2, b"disable")]


def test_times_start_at_the_beginning_of_the_section():
    wire, began = Log(), 1_000_000_000
    stop = SafeStop([device("knee", 0, 1, damp_time=0.01), device("hip", 0, 2)], {0: wire}, began)
    stop.step(began)
    assert wire.sent == [(1, b"damp"), (2, b"zero"), (2, b"disable")]
    stop.step(began + 10_000_000)
    assert wire.sent[3:] == [(1, b"zero"), (1, b"disable"), (2, b"zero"), (2, b"disable")]
    stop.step(began + 209_000_000)
    assert not stop.over
    stop.step(began + 210_000_000)
    assert stop.over and stop.report()["took"] == pytest.approx(0.21, abs=1e-9)


@pytest.mark.parametrize("empty", ["zero", "disable"])
def test_drive_with_one_stop_frame_is_stopped_with_it(empty):
    wire = Log()
    stop = SafeStop([device("knee", 0, 1) | {empty: []}], {0: wire}, 0)
    stop.step(0)
    assert wire.sent == [(1, b"disable" if empty == "zero" else b"zero")] and not stop.over


def test_replies_in_the_first_round_of_a_stop_confirm_nothing(legs):
    stop, wires = legs
    stop.step(0)
    for _ in range(4):
        stop.receive(0, 0x101, b"", 1)
    assert stop.report()["confirmed"] == []
    stop.step(STOP_ROUND)
    assert wires[0].sent[4:6] == [(1, b"zero"), (1, b"disable")]


def test_one_reply_confirms_only_one_device():
    wire = Log()
    stop = SafeStop([device("left", 0, 1), device("twin", 0, 1)], {0: wire}, 0)
    stop.step(0)
    stop.step(STOP_ROUND)
    for _ in range(2):
        stop.receive(0, 0x101, b"", STOP_ROUND + 1)
    assert stop.report()["confirmed"] == ["left"] and not stop.over


@pytest.mark.hazard("H9d")
def test_stop_ends_when_all_drives_confirm(legs):
    stop, _ = legs
    stop.step(0)
    stop.step(STOP_ROUND)
    for bus, identifier, data in ((0, 0x102, b""), (0, 0x101, b""), (1, 0x101, b"\1!")):
        stop.receive(bus, identifier, data, STOP_ROUND + 1_000_000)
        assert not stop.over
        stop.receive(bus, identifier, data, STOP_ROUND + 2_000_000)
    assert stop.over and stop.report() == {
        "confirmed": ["left", "right", "hip"],
        "unconfirmed": [],
        "sent": 12,
        "took": 0.007,
    }


@pytest.mark.hazard("H9d")
def test_a_stop_times_out_and_reports_missing_drives(legs):
    stop, wires = legs
    for now in range(0, STOP_LIMIT + 1, 1_000_000):
        stop.step(now)
    assert stop.over and stop.report()["unconfirmed"] == ["left", "right", "hip"] and stop.report()["took"] == 0.2
    assert len(wires[1].sent) == 2 * STOP_LIMIT // STOP_ROUND
    stop.step(2 * STOP_LIMIT)
    assert len(wires[1].sent) == 2 * STOP_LIMIT // STOP_ROUND


@pytest.mark.parametrize(
    "bus, identifier, data",
    [
        (0, 0x101, b"\1"),  # from another bus
        (1, 0x201, b"\1"),  # from another id
        (1, 0x101, b"\2"),  # it begins otherwise, as a command does
        (1, 0x101, b""),
        (1, 0x80000101, b"\1"),  # extended
    ],
)
def test_frame_that_is_not_a_reply_confirms_nothing(legs, bus, identifier, data):
    stop, _ = legs
    stop.step(0)
    for _ in range(4):
        stop.receive(bus, identifier, data, 1)
    assert "hip" not in stop.report()["confirmed"]


def test_drive_is_damped_for_its_time_then_disabled():
    wire = Log()
    stop = SafeStop([device("knee", 0, 1, damp_time=0.3), device("hip", 0, 2)], {0: wire}, 0)
    for now in range(0, 300_000_000, 1_000_000):
        stop.step(now)
        stop.receive(0, 0x101, b"", now + 1)  # it answers, which confirms nothing while it is damped
        stop.receive(0, 0x101, b"", now + 2)
    assert {frame for frame in wire.sent if frame[0] == 1} == {(1, b"damp")} and wire.sent.count((1, b"damp")) == 150
    assert wire.sent.count((2, b"disable")) == 60 and stop.report()["unconfirmed"] == ["knee", "hip"]
    stop.step(300_000_000)
    assert wire.sent[-4:-2] == [(1, b"zero"), (1, b"disable")]
    for now in (300_000_001, 300_000_002):  # to its damping, perhaps
        stop.receive(0, 0x101, b"", now)
    assert stop.report()["confirmed"] == []
    stop.step(300_000_000 + STOP_ROUND)
    for now in (300_000_001 + STOP_ROUND, 300_000_002 + STOP_ROUND):
        stop.receive(0, 0x101, b"", now)
    assert stop.report()["confirmed"] == ["knee"] and stop.report()["unconfirmed"] == ["hip"]
    stop.step(500_000_000)
    assert stop.over


def test_a_drive_that_was_never_under_torque_is_not_damped():
    wire = Log()
    SafeStop([device("knee", 0, 1, damp_time=0.3)], {0: wire}, 0, moving=False).step(0)
    assert wire.sent == [(1, b"zero"), (1, b"disable")]


def test_a_drive_that_was_taken_out_is_not_damped_again():
    wire = Log()
    drives = [device("knee", 0, 1, damp_time=0.3, number=5), device("hip", 0, 2, damp_time=0.3, number=6)]
    SafeStop(drives, {0: wire}, 0, out=1 << 6).step(0)
    assert wire.sent == [(1, b"damp"), (2, b"zero"), (2, b"disable")]


def test_a_blocked_bus_does_not_prevent_the_stop_on_other_buses():
    wires = {0: Log(working=False), 1: Log()}
    stop = SafeStop([device("left", 0, 1), device("hip", 1, 1), device("gone", 2, 1)], wires, 0)
    stop.step(0)
    assert len(wires[0].sent) == 2 and len(wires[1].sent) == 2 and stop.report()["sent"] == 2


def test_devices_without_stop_frames_are_not_awaited():
    stop = SafeStop([device("imu", 0, 1) | {"zero": [], "disable": []}], {0: Log()}, 0)
    stop.step(0)
    assert stop.over


@pytest.mark.parametrize(
    "kind, model, disable",
    [(CubeMarsV3, "AK80-9-V3.0", (0x80000F05, b"")), (CubeMarsServo, "AK80-9", (0x80000105, bytes(4)))],
)
def test_a_report_without_current_confirms_the_stop(kind, model, disable):
    """The plan as the guardian gets it, in JSON. A report of a current from before the stop is not a reply to
    it.
    """
    with Diagram("robot", rate=200) as robot:
        drive = kind(model, can_id=5, name="knee")
        drive(**{"torque_command" if kind is CubeMarsV3 else "current_command": 0.0})
    schedule = compile(robot)
    [device] = map(decoded, json.loads(json.dumps(plan([], schedule, robot, None)))["devices"])
    wire = Log()
    stop = SafeStop([device], {0: wire}, 0)
    stop.step(0)
    assert wire.sent[-1] == disable
    for data in ("0123456703e81e00", "0123456700201e00", "01234567ffdf1e00"):  # 10, 0.32 and -0.33 A
        stop.receive(0, 0x80002905, bytes.fromhex(data), 1000)
        stop.receive(0, 0x80002906, bytes(8), 1000)
        assert not stop.over
    stop.step(STOP_ROUND)
    assert len(wire.sent) == 4
    stop.receive(0, 0x80002905, bytes.fromhex("01234567001f1e00"), STOP_ROUND + 1000)
    assert stop.over and stop.report()["confirmed"] == ["knee"]


SPEED = {"frames": [[0x101, ALL, "01"]], "first": 8, "bits": 16, "low": -65.536, "high": 65.534, "signed": True}


def speed_of(velocity):
    """A reply with a velocity in units of 2 mrad/s."""
    return b"\1" + round(velocity / 0.002).to_bytes(2, "big", signed=True)


@pytest.mark.parametrize(
    "velocity, age, expected",
    [
        (0.5, 0, b"strong"),
        (-0.5, 0, b"strong"),  # 500 rad/s² for two rounds of 2 ms are 2 rad/s
        (1.1, 0, b"weak"),
        (-1.1, 0, b"weak"),
        (0.5, 2_000_000, b"weak"),
        (0.5, 20_000_000, b"slow"),
        (40.0, 0, b"slow"),
        (-40.0, 0, b"slow"),
    ],
)
def test_stop_damping_uses_the_newest_speed_and_its_largest_change(velocity, age, expected):
    wire = Log()
    bands = [(3.0, b"strong"), (6.0, b"weak"), (math.inf, b"slow")]
    stop = SafeStop([device("knee", 0, 1, damp_time=1.0, bands=bands, velocity=SPEED)], {0: wire}, 0)
    stop.step(0)
    assert wire.sent == [(1, b"slow")]  # there is no velocity yet
    stop.receive(1, 0x101, speed_of(0.0), 2_000_000)  # of another bus, of another drive, too short: none of these
    stop.receive(0, 0x102, speed_of(0.0), 2_000_000)
    stop.receive(0, 0x101, b"\1\0", 2_000_000)
    stop.receive(0, 0x101, b"\2\0\0", 2_000_000)
    stop.step(2_000_000)
    assert wire.sent == [(1, b"slow")] * 2
    stop.receive(0, 0x101, speed_of(velocity), 4_000_000 - 1)
    stop.step(4_000_000 - 1 + age)
    assert wire.sent[2:] == [(1, expected)] if age else wire.sent[2:] == []
    stop.step(4_000_000 + age)
    assert wire.sent[2] == (1, expected)


def test_a_reply_that_is_read_late_counts_as_old_as_it_can_be():
    """After the guardian was away for 20 ms: the reply it finds may be of any moment since its last look."""
    wire, bands = Log(), [(10.0, b"strong"), (math.inf, b"slow")]
    stop = SafeStop([device("knee", 0, 1, damp_time=1.0, bands=bands, velocity=SPEED)], {0: wire}, 0)
    stop.receive(0, 0x101, speed_of(0.0), 20_000_000, since=20_000_000 - 1_000_000)
    stop.step(20_000_000)
    stop.receive(0, 0x101, speed_of(0.0), 40_000_000, since=20_000_000)
    stop.step(40_000_000)
    assert wire.sent == [(1, b"strong"), (1, b"slow")]


def test_a_limb_at_8_rad_per_s_is_damped_inside_the_limit_by_the_guardian():
    """The plan as the guardian gets it, and a drive that is played from the bytes: AK80-9, limit 5 N·m, stop_damping 1,
    0.35 kg·m².
    """
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK80-9", can_id=1, name="knee", limit=5.0, safe_stop="damp", stop_damping=1.0)(torque_command=0.0)
    [device] = map(decoded, json.loads(json.dumps(plan([], compile(robot), robot, None)))["devices"])
    for jitter in (0, 700_000):  # ns by which it comes late
        drive = PlayedDrive(reference.ranges(velocity=50.0, torque=18.0))
        wire = Answering(drive)
        stop = SafeStop([device], {0: wire}, 0)
        for now in range(0, 1_300_000_000, 1_000_000):
            wire.now = now + jitter * (now // 1_000_000 % 3 == 0)
            stop.step(wire.now)
            drive.advance(wire.now + 300_000)
            for identifier, data in wire.replies:
                stop.receive(0, identifier, data, wire.now + 300_000)
            wire.replies.clear()
        assert stop.over and stop.report()["unconfirmed"] == []
        assert drive.worst() <= 5.0 + 36.0 / 4095 and never_gains(drive.log)
        assert drive.half_time() < 0.6


class Answering(Log):
    """A wire with a played drive at its end."""

    def __init__(self, drive):
        super().__init__()
        self.drive, self.now, self.replies = drive, 0, []

    def send(self, identifier, data):
        self.replies.append((identifier, self.drive.hear(data, self.now + 100_000)))
        return super().send(identifier, data)

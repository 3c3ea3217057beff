"""The safe stop over wires, in virtual time: what is sent, when it ends, and which drives confirm."""

import json
import math
import os
import time

import pytest

from blocks.actuators import CubeMars
from cext.safety.thresholds import STOP_LIMIT, STOP_ROUND
from graph import Diagram, compile
from runtime.robot.guardian import plan
from runtime.robot.guardian.process import decoded
from runtime.robot.guardian.relay import Relay
from runtime.robot.guardian.stop import SafeStop
from tests.blocks.actuators import reference
from tests.own_drives import FAMILIES, OwnDrive
from tests.played_drive import PlayedDrive, never_gains
from tests.soaking import soaked

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
        "transit": 0.0,
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
        "unanswered": 0,
        "stop_reply": {
            "frames": [(identifier + 0x100, ALL, begin.hex())],
            "unasked": [],
            "length": 0,
            "torque": None,
            "rest": 0.0,
            "disabled": (0, 0),
            "enabled": None,
            "echo": (),
            "reports": False,
        },
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


def test_drive_that_answers_both_frames_and_is_silent_then_is_confirmed(legs):
    stop, wires = legs
    stop.step(0)
    stop.receive(0, 0x101, b"", 1)
    stop.step(STOP_ROUND)  # one answer is not enough, and counts no more
    stop.receive(0, 0x101, b"", STOP_ROUND + 1)
    stop.receive(0, 0x101, b"", STOP_ROUND + 2)
    stop.step(2 * STOP_ROUND)  # nothing is sent to it, and it sends nothing
    assert stop.report()["confirmed"] == [] and wires[0].sent[8:] == [(2, b"zero"), (2, b"disable")]
    stop.step(3 * STOP_ROUND)
    assert stop.report()["confirmed"] == ["left"] and stop.report()["after"] == {"left": 0.015}
    assert wires[0].sent[10:] == [(2, b"zero"), (2, b"disable")]


def test_replies_to_one_round_are_not_enough_where_a_gap_between_bursts_cannot_be_seen(legs):
    """A foreign node that sends two frames every 20 ms, behind an adapter that delivers them in bursts."""
    stop, _ = legs
    for now in range(0, STOP_LIMIT, 1_000_000):
        stop.step(now)
        for _ in range(2 * (now % 20_000_000 == 6_000_000)):
            stop.receive(0, 0x101, b"", now)
    assert stop.report()["confirmed"] == []


def test_drive_that_goes_on_sending_while_nothing_is_asked_is_not_confirmed(legs):
    stop, _ = legs
    for now in range(0, STOP_LIMIT, 1_000_000):
        stop.step(now)
        if now % 2_500_000 < 1_000_000:
            stop.receive(0, 0x101, b"", now)
    assert stop.report()["confirmed"] == []


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
    for round in range(4):
        stop.step(round * STOP_ROUND)
        for _ in range(2 * (round <= 1)):
            stop.receive(0, 0x101, b"", round * STOP_ROUND + 1)
    assert stop.report()["confirmed"] == ["left"] and not stop.over


@pytest.mark.hazard("H9d")
def test_stop_ends_when_all_drives_confirm(legs):
    stop, _ = legs
    for began in (0, STOP_ROUND):
        stop.step(began)
        for bus, identifier, data in ((0, 0x102, b""), (0, 0x101, b""), (1, 0x101, b"\1!")):
            stop.receive(bus, identifier, data, began + 1_000_000)
            stop.receive(bus, identifier, data, began + 2_000_000)
    stop.step(2 * STOP_ROUND)
    assert not stop.over
    stop.step(3 * STOP_ROUND)
    assert stop.over and stop.report() == {
        "confirmed": ["left", "right", "hip"],
        "unconfirmed": [],
        "after": {"left": 0.015, "right": 0.015, "hip": 0.015},
        "due": 0.2,
        "sent": 12,
        "took": pytest.approx(0.015),
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


@pytest.mark.hazard("H9d")
def test_after_that_frames_go_on_at_a_falling_rate():
    wire = Log()
    stop = SafeStop([device("knee", 0, 1)], {0: wire}, 0, lasts=10_000_000_000)
    times = []
    for now in range(0, 5_000_000_000, 1_000_000):
        before = len(wire.sent)
        stop.step(now)
        times += [now / 1e9] * (len(wire.sent) > before)
    assert stop.is_due(STOP_LIMIT) and not stop.over
    gaps = [round(later - earlier, 3) for earlier, later in zip(times, times[1:])]
    assert gaps[:40] == [0.005] * 40
    assert gaps[40:46] == [0.01, 0.02, 0.04, 0.08, 0.16, 0.2] and set(gaps[46:]) == {0.2}


def test_the_time_to_the_next_frame_ends_with_the_stop(legs):
    stop, _ = legs
    assert stop.milliseconds(0, 10**9) == 0
    stop.step(0)
    assert stop.milliseconds(1, 10**9) == stop.milliseconds(0, 10**9) == STOP_ROUND / 1e6
    assert stop.milliseconds(1, 2_000_000) == 2
    assert stop.milliseconds(STOP_ROUND + 1, 10**9) == 0
    stop.step(STOP_LIMIT - 1_000_000)
    assert stop.milliseconds(STOP_LIMIT - 1_000_000, 10**9) == 1


@pytest.mark.parametrize("away", [0.15, 1.0, 5.0])
def test_a_drive_whose_bus_returns_late_is_stopped_and_confirmed(away):
    wire = Log(working=False)
    stop = SafeStop([device("knee", 0, 1)], {0: wire}, 0, lasts=10_000_000_000)
    for now in range(0, 10_000_000_000, 1_000_000):
        wire.working = now >= away * 1e9
        before = len(wire.sent)
        stop.step(now)
        for _ in wire.sent[before:] if wire.working else ():
            stop.receive(0, 0x101, b"", now + 500_000)
        if stop.over:
            break
    assert stop.report()["confirmed"] == ["knee"] and away < stop.report()["after"]["knee"] < away + 0.61


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
    stop.step(300_000_000 + 2 * STOP_ROUND)
    assert stop.report()["confirmed"] == []
    stop.step(300_000_000 + 3 * STOP_ROUND)
    assert stop.report()["confirmed"] == ["knee"] and stop.report()["unconfirmed"] == ["hip"]
    stop.step(500_000_000)
    assert stop.over


def test_the_relay_of_a_drive_is_held_in_each_round_of_its_damping_and_not_after_it():
    reader, line = os.pipe()
    relay = Relay({"descriptor": line, "gpio": False, "frames": ["01", "00"], "hold": 60.0}, time.monotonic_ns())
    stop = SafeStop([device("knee", 0, 1, damp_time=0.3)], {0: Log()}, 0, relays=[relay])
    for now in range(0, 600_000_000, 1_000_000):
        stop.step(now)
    os.close(line)
    assert os.read(reader, 1000) == b"\1\0" * 30  # 60 rounds of 5 ms
    os.close(reader)


def test_a_drive_that_was_never_under_torque_is_not_damped():
    wire = Log()
    SafeStop([device("knee", 0, 1, damp_time=0.3)], {0: wire}, 0, moving=False).step(0)
    assert wire.sent == [(1, b"zero"), (1, b"disable")]


def test_a_stop_is_due_after_the_longest_of_its_dampings():
    stop = SafeStop([device("knee", 0, 1, damp_time=0.1), device("hip", 0, 2, damp_time=0.3)], {0: Log()}, 0)
    assert stop.report()["due"] == 0.5 and not stop.is_due(499_999_999) and stop.is_due(500_000_000)


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


class Answered(Log):
    """A wire with an OwnDrive at its end. late : ns that its frames are under way"""

    def __init__(self, drive, late=0):
        super().__init__()
        self.drive, self.late, self.now, self.replies = drive, late, 0, []

    def send(self, identifier, data):
        bare, extended = identifier & 0x1FFFFFFF, bool(identifier & 0x80000000)
        self.add(self.drive.hear(bare, extended, data, self.now))
        return super().send(identifier, data)

    def add(self, frames):
        self.replies += [(self.now + self.late, frame) for frame in frames]


def stop_of(name, drive, late=0):
    """The guardian's stop of a drive that was under torque, in steps of a millisecond. Returns the SafeStop."""
    family = FAMILIES[name]
    with Diagram("robot", rate=200) as robot:
        family.block(family.model, can_id=1, name="knee", **family.options)(**{family.names[0]: 0.0})
    [device] = map(decoded, json.loads(json.dumps(plan([], compile(robot), None)))["devices"])
    drive.obey("enable")
    drive.obey("command")
    wire = Answered(drive, late)
    stop = SafeStop([device], {0: wire}, 0)
    for wire.now in range(0, 2 * STOP_LIMIT, 1_000_000):
        wire.add(drive.advance(wire.now))
        for due, frame in [entry for entry in wire.replies if entry[0] <= wire.now]:
            wire.replies.remove((due, frame))
            stop.receive(0, frame.identifier | 0x80000000 * frame.extended, frame.data, wire.now)
        stop.step(wire.now)
    return stop


@pytest.mark.parametrize("hold", soaked([0.5, 2.0, 5.0], but=[0, 2]))
@pytest.mark.parametrize("times", soaked([0, 1, 2, 5, 10], but=[0, 2, 4]))
@pytest.mark.parametrize("name", FAMILIES)
def test_a_drive_that_keeps_its_torque_is_not_confirmed(name, times, hold):
    """It misses the stop and reports by itself at a multiple of 200 Hz; or, at 0, answers the stop and ignores it."""
    drive = OwnDrive(FAMILIES[name], hold=hold, misses_stop=times > 0, reports=200.0 * (times or name == "servo"))
    stop = stop_of(name, drive)
    assert drive.torque == hold and stop.over and stop.report()["unconfirmed"] == ["knee"]


@pytest.mark.parametrize("times", [1, 2, 5, 10])
@pytest.mark.parametrize("name", [name for name in FAMILIES if name != "servo"])
def test_reports_of_no_torque_of_a_drive_that_misses_the_stop_confirm_nothing(name, times):
    drive = OwnDrive(FAMILIES[name], hold=5.0, reported=0.0, misses_stop=True, reports=200.0 * times)
    assert stop_of(name, drive).report()["unconfirmed"] == ["knee"]


@pytest.mark.parametrize("before", [False, True], ids=["after", "before"])
@pytest.mark.parametrize("name", FAMILIES)
def test_a_healthy_drive_confirms_within_four_rounds(name, before):
    drive = OwnDrive(FAMILIES[name], before=before, reports=200.0 * (name == "servo"))
    report = stop_of(name, drive).report()
    assert drive.torque == 0.0 and report["confirmed"] == ["knee"] and report["took"] <= 4 * STOP_ROUND * 1e-9 + 0.02


@pytest.mark.parametrize("late", [0.008, 0.016, 0.030])
@pytest.mark.parametrize("name", FAMILIES)
def test_a_healthy_drive_with_late_replies_confirms_within_the_limit(name, late):
    drive = OwnDrive(FAMILIES[name], reports=200.0 * (name == "servo"))
    assert stop_of(name, drive, round(late * 1e9)).report()["confirmed"] == ["knee"]


SPEED = {
    "frames": [[0x101, ALL, "01"]],
    "first": 8,
    "bits": 16,
    "low": -65.536,
    "high": 65.534,
    "signed": True,
    "little_endian": False,
}


def test_a_drive_that_gives_torque_after_its_confirmation_is_not_confirmed_until_it_does_so_again():
    knee = device("knee", 0, 1)
    knee["stop_reply"] |= {"torque": SPEED, "rest": 1.0}  # the field of a speed serves as one of torque
    stop = SafeStop([knee, device("hip", 0, 2)], {0: Log()}, 0, lasts=10 * STOP_LIMIT)

    def go(begin, rounds):
        for number in range(begin, begin + rounds):
            before = len(stop.wires[0].sent)
            stop.step(number * STOP_ROUND)
            for _ in stop.wires[0].sent[before:].count((1, b"disable")) * (1, 2):
                stop.receive(0, 0x101, speed_of(0.0), number * STOP_ROUND + 1)

    go(0, 4)
    assert stop.report()["after"] == {"knee": 0.015} and stop.report()["took"] == pytest.approx(0.015)
    stop.receive(0, 0x101, speed_of(5.0), 4 * STOP_ROUND - 1)
    go(4, 1)
    assert stop.report()["confirmed"] == [] and stop.report()["after"] == {}
    go(5, 20)
    assert stop.report()["confirmed"] == ["knee"] and 0.02 < stop.report()["after"]["knee"] < 0.12


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
    [device] = map(decoded, json.loads(json.dumps(plan([], compile(robot), None)))["devices"])
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

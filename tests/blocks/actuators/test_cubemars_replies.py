"""Replies of a CubeMars drive that are not as expected: other lengths, and another id in byte 0."""

import math
import time

import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.actuators.mit_frames import DISABLE, ENABLE, NOTHING
from cext.memory.shared_state import SharedState
from graph import Block, Diagram, Output
from tests.blocks.actuators import reference
from tests.blocks.actuators.wire import FOREIGN, MALFORMED, TAKEN, Wired
from tests.cext.rigs import Rig, plant_of

AK80_9 = reference.ranges(50.0, 18.0)
STATE = {"position": 1.25, "velocity": -3.0, "torque": 4.5, "temperature": 41.0, "error": 5}


def reply(can_id=1, **state):
    return reference.reply(AK80_9, can_id, **{**STATE, **state})


@pytest.mark.parametrize("length", [6, 7])
@pytest.mark.parametrize("identifier", [0, 1])
def test_a_short_reply_has_motion_and_no_temperature_and_no_error(length, identifier):
    wired = Wired(CubeMars, "AK80-9", can_id=1, reply=length)
    data = (reply()[:6] + b"\x30")[:length]  # byte 6 of seven is a voltage
    assert wired.hear(identifier, data) == TAKEN
    for name, step in (("position", 25.0 / 65535), ("velocity", 100.0 / 4095), ("torque", 36.0 / 4095)):
        assert abs(wired[name] - STATE[name]) <= step, name
    assert math.isnan(wired["temperature"]) and wired["fault"] == 0.0


@pytest.mark.parametrize("expected", [6, 7, 8])
@pytest.mark.parametrize("length", range(10))
def test_only_the_given_length_is_read(expected, length):
    wired = Wired(CubeMars, "AK80-9", can_id=1, reply=expected)
    before = wired.arena.copy()
    answer = wired.hear(1, (reply() + b"\0\0")[:length])
    assert answer == (TAKEN if length == expected else MALFORMED)
    assert length == expected or wired.arena.tobytes() == before.tobytes()
    assert wired.hear(2, reply()[:expected]) == FOREIGN


@pytest.mark.parametrize("length", [6, 7, 8])
def test_the_emulated_drive_replies_with_the_configured_length(length):
    wired = Wired(EmulatedCubeMars, "AK80-9", can_id=1, reply=length)
    wired["position"] = 1.25
    assert wired.hear(1, ENABLE) == TAKEN and wired.hear(1, NOTHING) == TAKEN
    wired.step(position=1.25, velocity=0.0, temperature=41.0)
    frames = wired.say()
    assert [len(data) for _, data in frames] == [length] * 2
    assert [data[6:] for _, data in frames] == [{6: b"", 7: b"\x30", 8: bytes([81, 0])}[length]] * 2


def robot(**parameters):
    with Diagram("robot", rate=200) as diagram:
        CubeMars("AK80-9", can_id=1, name="knee", **parameters)(torque_command=0.5)
    return diagram


@pytest.mark.parametrize("length", [6, 7])
def test_short_replies_are_decoded_if_reply_parameter_selects_them(length):
    walk = robot(reply=length)
    rig = Rig(walk, plant_of(walk))
    assert rig.run(50, fade=0.0).status == "ok" and rig["knee.torque"][-1] == pytest.approx(0.5, abs=0.02)
    assert all(math.isnan(x) for x in rig["knee.temperature"]) and rig["knee.fault"].max() == 0


@pytest.mark.parametrize("length", [6, 7])
def test_replies_of_another_length_are_counted_and_reported(length):
    walk = robot()
    rig = Rig(walk, plant_of(walk, reply=length))
    outcome = rig.run(50, arming_timeout=0.5)
    assert (outcome.status, outcome.unanswered) == ("no answer", ("knee",))
    ((lengths, _),) = rig.control.reports.malformed.values()
    assert list(lengths) == [length] and lengths[length] == rig.statistics()["frames"]["malformed"] > 100
    words = walk["knee"].malformed_in_words(*rig.control.reports.malformed["knee"])
    assert words == f"{lengths[length]} replies of {length} bytes from id 1: set reply={length}"


def guarded(walk, plant=None):
    """A rig whose guardian is active: other controllers are then a fault."""
    shared = SharedState(1 << 20)
    shared.look_after(time.monotonic_ns())
    return Rig(walk, plant, shared=shared, guard=30.0)


class Renamed(Block):
    """In the plant: a drive of CAN id 1 that answers each frame with what `answers(tick)` gives."""

    y = Output("1")

    def configure(self):
        self.answers, self.end = None, None

    def step(self, tick):
        for _ in self.end.receive():
            for data in self.answers(tick):
                self.end.send(1, data, time=round(tick * self.dt * 1e9))
        return 0.0


def answering(answers):
    walk = robot()
    with Diagram("plant", rate=200) as plant:
        drive = Renamed(name="drive")
    rig = guarded(walk, plant)
    drive.answers, drive.end = answers, rig.buses["can"].device
    return rig, walk["knee"]


def test_a_reply_with_another_id_is_not_a_foreign_command():
    rig, knee = answering(lambda tick: [reply(5, error=0)])
    outcome = rig.run(50, arming_timeout=0.5)
    assert (outcome.status, outcome.unanswered) == ("no answer", ("knee",))
    lengths, first = rig.control.reports.malformed["knee"]
    assert first == 5 and knee.malformed_in_words(lengths, first).startswith(
        f"{lengths[8]} replies from id 1 with id 5 in byte 0"
    )


def test_a_drive_that_changes_its_id_times_out():
    rig, _ = answering(lambda tick: [reply(1 if tick < 60 else 5, torque=0.3, error=0)])
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit) == ("silent", "knee") and rig.control.reports.malformed["knee"][1] == 5


COMMAND = bytes.fromhex("8000800000000800")  # of another controller: as a reply, of id 128
HELD = reply(1, torque=0.0, error=0)  # of a drive without torque


@pytest.mark.parametrize("answers", [[COMMAND, HELD], [HELD, COMMAND]])
def test_foreign_command_is_detected_before_and_after_reply(answers):
    rig, _ = answering(lambda tick: answers if tick == 30 else [HELD])
    outcome = rig.run(60)
    assert (outcome.status, outcome.culprit) == ("foreign command", "knee") and 25 <= outcome.tick <= 31


@pytest.mark.parametrize("data", [ENABLE, DISABLE, NOTHING])
def test_sent_frames_are_never_decoded_as_replies(data):
    rig = guarded(robot(timeout=0.0))
    rig.buses["can"].device.send(1, data)
    assert rig.run(5).status == "foreign command"


def test_foreign_command_before_first_reply_is_a_fault_on_that_reply():
    rig = guarded(robot(timeout=0.0))
    rig.buses["can"].device.send(1, COMMAND)
    rig.buses["can"].device.send(1, reply(1, error=0))
    assert rig.run(5).status == "foreign command"

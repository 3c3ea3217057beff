"""A CubeMars drive in a running diagram, with a third party at the other end of its bus."""

import math

import numpy as np
import pytest

from blocks.actuators import CubeMars
from blocks.actuators.mit_frames import DISABLE, NOTHING
from blocks.discrete import UnitDelay
from blocks.filters import Butterworth
from blocks.limiters import Saturation, SlewRate, TorqueLimiter
from blocks.mathematics import Gain, Product, Sum
from blocks.sources import StepSource
from graph import Diagram
from tests.blocks.actuators import reference
from tests.blocks.actuators.station import Script, Station, wire
from tests.blocks.actuators.wire import ERROR_FRAME, EXTENDED, REMOTE
from tests.blocks.running import run

AK80_9 = reference.ranges(50.0, 18.0)
QUIET = {"position": 0.0, "velocity": 0.0, "torque": 0.0, "temperature": 25.0, "error": 0}


def answer(can_id, **state):
    return reference.reply(AK80_9, can_id, **{**QUIET, **state})


def alone(ticks, commands=(), script=(), fade=0.0, first=None, **parameters):
    """One drive and the station: (recording, station). Replies to arming wait on the bus; the drive is never missed."""
    with Diagram("alone", rate=200) as diagram:
        drive = CubeMars("AK80-9", bus="can", limit="peak", name="drive", **{"can_id": 1, "timeout": 0.0, **parameters})
        station = Station()
        if commands:
            source = Script()
            wire(drive, source)
            source.commands = dict(commands)
        else:
            drive(torque_command=0.0)
    station.script = dict(script)

    def before(buses):
        station.end = buses["can"].device
        station.end.send(drive.can_id, answer(drive.can_id, **(first or {})))

    recording = run(diagram, ticks, fade=fade, before=before)
    station.rest = [frame[:3] for frame in station.end.receive()]
    return recording, station


def random_commands(count, seed=1):
    random = np.random.default_rng(seed)
    half = {"position": 12.5, "velocity": 50.0, "torque": 18.0, "stiffness": 500.0, "damping": 5.0}
    signed = ("position", "velocity", "torque")
    return [{n: float(random.uniform(-h if n in signed else 0.0, h)) for n, h in half.items()} for _ in range(count)]


def test_the_bus_carries_one_frame_a_tick_with_the_bytes_of_the_reference_then_zero_torque_and_disable():
    # a spring would be held inside the limit
    commands = [{**command, "stiffness": 0.0, "damping": 0.0} for command in random_commands(200)]
    recording, station = alone(200, list(enumerate(commands)), can_id=7)
    assert recording.outcome.status == "ok"
    frames = station.heard + [(200, *frame) for frame in station.rest[:1]]
    assert [frame[:3] for frame in frames] == [(tick, 7, False) for tick in range(1, 201)]
    assert [frame[3] for frame in frames] == [reference.command(AK80_9, **command) for command in commands]
    stop = station.rest[1:]
    assert stop[:2] == [(7, False, NOTHING), (7, False, DISABLE)] and stop == stop[:2] * (len(stop) // 2)


def test_torque_sent_equals_encoded_torque_also_during_fade_in():
    for gains in (0.0, 1.0):  # with a spring or a damper the limit may have them sent as torque
        commands = [
            {**drawn, "stiffness": gains * drawn["stiffness"], "damping": gains * drawn["damping"]}
            for drawn in random_commands(100)
        ]
        recording, station = alone(100, list(enumerate(commands)), fade=0.25)
        frames = station.heard + [(100, *station.rest[0])]
        sent = [reference.read_command(AK80_9, data)["torque"] for _, _, _, data in frames]
        assert np.abs(recording["drive.torque_sent"] - sent).max() < 1e-12 * 18.0
        share = np.minimum(recording.time / 0.25, 1.0)
        assert np.all(np.abs(sent) <= share * 18.0 + 36.0 / 4095) and abs(sent[0]) < 36.0 / 4095
        assert gains or np.abs(sent - share * recording["script.torque"]).max() < 36.0 / 4095


@pytest.mark.parametrize("field", ["position", "velocity", "torque", "stiffness", "damping"])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_ends_the_run_before_its_frame(field, bad):
    recording, station = alone(20, {5: {field: bad}})
    assert (
        recording.outcome.status == "not finite"
        and recording.outcome.culprit == "drive"
        and recording.outcome.tick == 5
    )
    assert [frame[0] for frame in station.heard] == [1, 2, 3, 4, 5] and {frame[3] for frame in station.heard} == {
        NOTHING
    }
    assert [data for _, _, data in station.rest[:2]] == [NOTHING, DISABLE] and {
        data for _, _, data in station.rest
    } == {NOTHING, DISABLE}


def test_an_output_outside_its_declared_range_ends_the_run_before_the_frame():
    recording, station = alone(20, {5: {"torque": 18.0001}})
    assert (
        recording.outcome.status == "out of limits"
        and recording.outcome.culprit == "drive"
        and recording.outcome.tick == 5
    )
    assert {frame[3] for frame in station.heard} == {NOTHING} and {data for _, _, data in station.rest} == {
        NOTHING,
        DISABLE,
    }


BETWEEN = {
    "torque limiter": lambda u: TorqueLimiter(limit=9.0, slew=50.0)(u),
    "saturation": lambda u: Saturation(lower=-9.0, upper=9.0)(u),
    "slew rate": lambda u: TorqueLimiter(limit=9.0)(SlewRate(rate=100.0)(u)),
    "filter": lambda u: TorqueLimiter(limit=9.0)(Butterworth(order=3, cutoff=20.0)(u)),
    "gain, sum and limiter": lambda u: TorqueLimiter(limit=9.0)(Sum("+-")(Gain(0.5)(u), u)),
    "delay": lambda u: TorqueLimiter(limit=9.0)(UnitDelay()(u)),
    "product and limiter": lambda u: TorqueLimiter(limit=9.0)(Product()(u, StepSource(0.0, 0.0)())),
}


@pytest.mark.parametrize("between", BETWEEN)
def test_nan_is_a_fault_also_after_a_limiter(between):
    with Diagram("behind", rate=200) as diagram:
        drive, source, station = CubeMars("AK80-9", name="drive", timeout=0.0), Script(), Station()
        drive(torque_command=BETWEEN[between](source.torque))
    source.commands = {7: {"torque": math.nan}}

    def before(buses):
        station.end = buses["can"].device
        station.end.send(1, answer(1))

    recording = run(diagram, 30, before=before)
    assert recording.outcome.status == "not finite" and recording.outcome.culprit == "drive"
    assert recording.outcome.tick == (8 if between == "delay" else 7)
    for _, _, _, data in station.heard:
        assert abs(reference.read_command(AK80_9, data)["torque"]) < 36.0 / 4095
    assert {frame[2] for frame in station.end.receive()} == {NOTHING, DISABLE}


HEARD = {"position": 1.25, "velocity": -7.5, "torque": 3.0, "temperature": 41.0}
AT = {"position": HEARD["position"]}  # the angle from arming on: a jump would end the run
OTHER = answer(1, position=-5.0, velocity=20.0, torque=-9.0, temperature=90, error=0)

NOT_FOR_US = {
    "another drive's reply": (2, answer(2, **HEARD)),
    "another drive's reply through id 0": (0, answer(2, **HEARD)),
    "a reply in an extended frame": (1 | EXTENDED, OTHER),
    "a reply in an extended frame from id 0": (0 | EXTENDED, OTHER),
    "a remote frame": (1 | REMOTE, OTHER),
    "an error frame": (1 | ERROR_FRAME, OTHER),
    "an error frame of id 0": (0 | ERROR_FRAME, OTHER),
    "an empty frame from id 0": (0, b""),
    "a servo status frame": (0x2901 | EXTENDED, OTHER),
    "another standard id": (0x101, OTHER),
    "the highest standard id": (0x7FF, OTHER),
}
BROKEN = {
    "an empty frame": (1, b""),
    "one byte": (1, OTHER[:1]),
    "six bytes, as the first firmware of MIT": (1, OTHER[:6]),
    "seven bytes from id 0": (0, OTHER[:7]),
    "seven bytes": (1, OTHER[:7]),
    "nine bytes": (1, OTHER + b"\0"),
    "a frame of CAN FD": (1, OTHER * 8),
    "another motor in the first byte": (1, answer(2, **HEARD)),
    "no motor in the first byte": (1, bytes(8)),
}


@pytest.mark.parametrize("what", [*NOT_FOR_US, *BROKEN])
def test_frames_that_are_not_replies_change_nothing_and_are_counted(what):
    frame = (NOT_FOR_US | BROKEN)[what]
    recording, _ = alone(12, script={3: [(1, answer(1, **HEARD))], 6: [frame, frame]}, first=AT)
    assert recording.outcome.status == "ok"
    before, after = ({name: recording[f"drive.{name}"][tick] for name in HEARD} for tick in (6, 11))
    assert before == after and abs(after["position"] - 1.25) < 25.0 / 65535 and after["temperature"] == 41.0
    assert recording["drive.fault"].max() == 0
    frames = recording.statistics["frames"]
    # the answer to arming, the reply, and the two; what a controller reports of itself is not received
    assert frames["received"] == (2 if "error frame" in what else 4)
    counts = (0, 0) if "error frame" in what else (2, 0) if what in NOT_FOR_US else (0, 2)
    assert (frames["foreign"], frames["malformed"]) == counts
    age = recording["drive.age"]
    assert age[11] == pytest.approx(age[6] + 5 / 200), "what is no reply does not make the feedback young"


@pytest.mark.parametrize("identifier", [0, 42])
def test_reply_is_accepted_from_id_0_and_drive_id(identifier):
    recording, _ = alone(6, script={2: [(identifier, answer(42, **HEARD))]}, can_id=42, first=AT)
    assert recording["drive.velocity"][2] != recording["drive.velocity"][3] and recording["drive.age"][2] > 0.0
    for name, step in (
        ("position", 25.0 / 65535),
        ("velocity", 100.0 / 4095),
        ("torque", 36.0 / 4095),
        ("temperature", 1e-9),
    ):
        assert abs(recording[f"drive.{name}"][3] - HEARD[name]) < step
    assert recording.statistics["frames"]["foreign"] == recording.statistics["frames"]["malformed"] == 0


@pytest.mark.parametrize("invert, offset", [(False, 0.0), (True, 0.0), (False, 0.4), (True, 0.4), (True, -2.0)])
def test_feedback_follows_invert_and_offset(invert, offset):
    """Joint position = ± motor position - offset; joint velocity and torque = ± the motor's."""
    recording, _ = alone(6, script={2: [(1, answer(1, **HEARD))]}, invert=invert, offset=offset, first=AT)
    sign = -1.0 if invert else 1.0
    assert abs(recording["drive.position"][3] - (sign * HEARD["position"] - offset)) < 25.0 / 65535
    assert abs(recording["drive.velocity"][3] - sign * HEARD["velocity"]) < 100.0 / 4095
    assert abs(recording["drive.torque"][3] - sign * HEARD["torque"]) < 36.0 / 4095


def test_two_drives_share_a_bus_without_interference():
    """Replies of both in every order, from their own ids and from 0: each block decodes its own motor, always the
    newest.
    """
    random = np.random.default_rng(2)
    script, newest = {}, {3: [], 4: []}
    for tick in range(100):
        frames = []
        for _ in range(random.integers(1, 5)):
            can_id = int(random.choice([3, 4]))
            position = float(random.uniform(1.0, 1.01)) * (1 if can_id == 3 else -1)  # as motion is
            frames.append(
                (
                    int(random.choice([0, can_id])),
                    answer(can_id, position=position, torque=can_id * (1 if can_id == 3 else -1)),
                    can_id,
                    position,
                )
            )
        script[tick] = [frame[:2] for frame in frames]
        for can_id in newest:
            mine = [position for *_, owner, position in frames if owner == can_id]
            newest[can_id].append(
                mine[-1] if mine else newest[can_id][-1] if newest[can_id] else 1.0 if can_id == 3 else -1.0
            )
    with Diagram("two", rate=200) as diagram:
        station = Station()
        drives = {
            can_id: CubeMars("AK80-9", can_id=can_id, name=f"drive{can_id}", timeout=0.0, invert=can_id == 4)
            for can_id in newest
        }
        for can_id, drive in drives.items():
            drive(torque_command=float(can_id), position_command=can_id / 10)
    station.script = script

    def before(buses):
        station.end = buses["can"].device
        for can_id in drives:
            station.end.send(can_id, answer(can_id, position=1.0 if can_id == 3 else -1.0))

    recording = run(diagram, 101, before=before)
    assert recording.outcome.status == "ok" and recording.statistics["frames"]["foreign"] == 0
    for can_id, positions in newest.items():
        sign = -1.0 if can_id == 4 else 1.0
        assert np.abs(recording[f"drive{can_id}.position"][1:] - sign * np.array(positions)).max() < 25.0 / 65535
    heard = {frame[:2] for frame in station.heard}  # some of them twice, as replies are missing
    assert heard == {(tick, can_id) for tick in range(1, 101) for can_id in (3, 4)}
    for _, can_id, _, data in station.heard:
        understood, sign = reference.read_command(AK80_9, data), -1.0 if can_id == 4 else 1.0
        assert (
            abs(understood["torque"] - sign * can_id) < 36.0 / 4095
            and abs(understood["position"] - sign * can_id / 10) < 25.0 / 65535
        )


def test_the_same_id_on_two_buses_is_two_drives():
    with Diagram("two buses", rate=200) as diagram:
        stations = {bus: Station(name=f"at_{bus}") for bus in ("left", "right")}
        for bus in stations:
            CubeMars("AK80-9", bus=bus, can_id=1, name=bus, timeout=0.0)(torque_command=0.0)
            stations[bus].script = {2: [(1, answer(1, position=0.01 if bus == "left" else -0.01))]}

    def before(buses):
        for bus, station in stations.items():
            station.end = buses[bus].device
            station.end.send(1, answer(1))

    recording = run(diagram, 6, before=before)
    assert (
        abs(recording["left.position"][3] - 0.01) < 25.0 / 65535
        and abs(recording["right.position"][3] + 0.01) < 25.0 / 65535
    )


def test_a_fault_in_the_error_byte_ends_the_run_in_the_safe_stop():
    for code in range(1, 8):
        recording, station = alone(20, script={4: [(1, answer(1, error=code))]})
        assert (recording.outcome.status, recording.outcome.culprit, recording.outcome.tick) == (
            "device fault",
            "drive",
            5,
        )
        assert {data for _, _, data in station.rest[-2:]} == {NOTHING, DISABLE} and len(station.heard) == 4


def test_a_silent_drive_ends_the_run_once_its_timeout_has_passed():
    script = {tick: [(1, answer(1))] for tick in range(10)}
    recording, _ = alone(100, script=script, timeout=0.1)
    assert (recording.outcome.status, recording.outcome.culprit) == ("silent", "drive")
    assert recording.outcome.tick == 9 + 21 and recording["drive.age"].max() == pytest.approx(0.1)

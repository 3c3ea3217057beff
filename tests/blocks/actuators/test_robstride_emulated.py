"""The emulated RobStride drive: accepted frames, torque, replies and state lost on power loss."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.actuators import EmulatedRobStride, EmulatedRobStrideMIT
from blocks.actuators.robstride import frames, mit
from blocks.actuators.robstride.models import MODELS
from tests.blocks.actuators import reference as mit_reference
from tests.blocks.actuators import robstride_reference as reference
from tests.blocks.actuators.wire import EXTENDED, FOREIGN, MALFORMED, NOT_FINITE, REMOTE, TAKEN, Wired
from tests.soaking import soaked

RANGES = {name: reference.ranges(model) for name, model in MODELS.items()}
ENABLE, STOP, CLEAR = (
    (reference.identifier(3, 0xFD, 127), bytes(8)),
    (reference.identifier(4, 0xFD, 127), bytes(8)),
    (reference.identifier(4, 0xFD, 127), b"\1" + bytes(7)),
)
ZERO = {"position": 0.0, "velocity": 0.0, "stiffness": 0.0, "damping": 0.0, "torque": 0.0}


def emulated(model="RS03", **parameters):
    wired = Wired(EmulatedRobStride, model, **parameters)
    wired["temperature"] = 30.0
    return wired


def command(model="RS03", **fields):
    return reference.command(RANGES[model], 127, **{**ZERO, **fields})


def torque(wired, **state):
    wired.step(**state)
    return wired["torque"]


def write(wired, index, value):
    assert wired.hear(*reference.write(index, value, 127, layout=frames.WHOLE.get(index, "<f"))) == TAKEN


def read(wired, index):
    """A parameter through the wire, as a float, and as the four bytes."""
    drain(wired)
    assert wired.hear(reference.identifier(17, 0xFD, 127), struct.pack("<HxxI", index, 0)) == TAKEN
    ((identifier, data),) = drain(wired)
    assert identifier == reference.identifier(17, 127, 0xFD) and struct.unpack("<H", data[:2])[0] == index
    return struct.unpack("<f", data[4:])[0], data[4:]


def drain(wired):
    """Frames that are due now."""
    said = []
    while now := wired.say():
        said += now
    return said


def test_drive_is_silent_until_first_command():
    wired = emulated()
    assert wired.say() == [] and wired.say() == []


@given(
    data=st.data(),
    model=st.sampled_from(sorted(MODELS)),
    can_id=st.integers(1, 127),
    host=st.integers(128, 255),
    temperature=st.integers(-40, 75),
)
def test_every_frame_has_one_answer_and_it_is_the_references_byte_for_byte(data, model, can_id, host, temperature):
    wired, ranges = emulated(model, can_id=can_id), RANGES[model]
    given = {name: data.draw(st.floats(*ranges[name]), label=name) for name in ("position", "velocity")}
    asked = [reference.identifier(kind, host, can_id) for kind in (4, 3, 18, 4)]
    for identifier in asked:
        assert wired.hear(identifier, bytes(8)) == TAKEN
    wired.step(**given, temperature=temperature)
    wanted = reference.reply(ranges, can_id, **given, temperature=temperature, mode=0, host=host)
    nearly = any(
        abs(exact - round(exact)) < 1e-9
        for exact in (mit_reference.exact_code(given[name], *ranges[name], 16) for name in given)
    )
    said = drain(wired)
    assert len(said) == 4 and (set(said) == {wanted} or nearly)


def test_drive_produces_torque_only_between_enable_and_stop():
    wired, push = emulated(), command(torque=5.0)
    wired.hear(*push)
    assert torque(wired) == 0.0 and wired["enabled"] == 0.0
    wired.hear(*ENABLE)
    assert torque(wired) == 0.0 and wired["enabled"] == 1.0, "what was commanded before is forgotten"
    wired.hear(*push)
    assert abs(torque(wired) - 5.0) < 120.0 / 65535
    wired.hear(*STOP)
    assert torque(wired) == 0.0 and wired["enabled"] == 0.0
    wired.hear(*push)
    assert torque(wired) == 0.0
    wired.hear(*ENABLE)
    assert torque(wired) == 0.0, "enabling again does not take up an old command"


@pytest.mark.parametrize("model", soaked(MODELS, but=[2, 9]))
@given(data=st.data())
def test_torque_follows_manual_law_up_to_limits(model, data):
    """t = kp (p_des − p) + kd (v_des − v) + t_ff, of what it understood; within 1e-9 of the sum of its terms."""
    wired, ranges = emulated(model), RANGES[model]
    fields = {name: data.draw(st.floats(*ranges[name]), label=name) for name in ZERO}
    frame = command(model, **fields)
    heard = reference.read_command(ranges, frame)
    position, velocity = data.draw(st.floats(-12.0, 12.0)), data.draw(st.floats(-15.0, 15.0))
    limit = data.draw(st.floats(0.5, 200.0))
    write(wired, 0x700B, limit)
    wired.hear(*ENABLE)
    wired.hear(*frame)
    terms = (
        heard["stiffness"] * (heard["position"] - position),
        heard["damping"] * (heard["velocity"] - velocity),
        heard["torque"],
    )
    most = min(MODELS[model].peak, struct.unpack("<f", struct.pack("<f", limit))[0])
    wanted = min(max(sum(terms), -most), most)
    assert abs(torque(wired, position=position, velocity=velocity) - wanted) <= 1e-9 * sum(map(abs, terms))
    assert wired["torque"] in wired.block.output_range()["torque"]


def test_run_mode_changes_only_while_stopped():
    wired = emulated()
    write(wired, 0x7005, 3)
    assert read(wired, 0x7005)[1] == b"\3\0\0\0"
    wired.hear(*ENABLE)
    write(wired, 0x7005, 2)
    assert read(wired, 0x7005)[1] == b"\3\0\0\0"
    wired.hear(*STOP)
    write(wired, 0x7005, 5)
    write(wired, 0x7005, 4)
    write(wired, 0x7005, 9)
    assert read(wired, 0x7005)[1] == b"\5\0\0\0", "4 and 9 are no modes"


def test_written_parameters_read_back_and_measured_ones_are_read_only():
    wired = emulated("RS02", gear_ratio=2.0)
    for index, value in ((0x700B, 6.5), (0x7016, -1.25), (0x7017, 3.5), (0x7018, 7.0), (0x701E, 12.5), (0x7022, 4.0)):
        write(wired, index, value)
        assert read(wired, index)[0] == value
    write(wired, 0x7028, 2_000_000)
    assert read(wired, 0x7028)[1] == struct.pack("<I", 100_000), "5 s is the longest"
    write(wired, 0x700B, math.nan)
    assert read(wired, 0x700B)[0] == 6.5
    wired.step(position=0.5, velocity=-1.5)
    for index, value in ((0x7019, 1.0), (0x701B, -3.0), (0x701C, 0.0)):
        assert read(wired, index)[0] == (48.0 if index == 0x701C else value), "at the motor"
        write(wired, index, 99.0)
        assert read(wired, index)[0] != 99.0
    wired.hear(reference.identifier(17, 0xFD, 127), struct.pack("<HxxI", 0x3000, 0))
    ((identifier, _),) = drain(wired)
    assert identifier == reference.identifier(17, 1 << 8 | 127, 0xFD), "it does not know that one"


@pytest.mark.parametrize(
    "index, value, mode, wanted",
    [
        (0x7006, 3.0, 3, 3.0 * 2.36 / math.sqrt(2.0)),
        (0x7006, -1000.0, 3, -60.0),
        (0x700A, 1.0, 2, 5.0),
        (0x700A, 1000.0, 2, 10.0 * 2.36 / math.sqrt(2.0)),
        (0x7016, 0.01, 5, 30.0 * 0.01 * 5.0),
        (0x7016, 9.0, 5, 0.5 * 5.0),
        (0x7016, -9.0, 1, -0.25 * 5.0),
    ],
)
def test_other_modes_follow_their_documented_laws(index, value, mode, wanted):
    """At rest at zero: A times the constant; 5 N·m·s/rad of speed; 30 rad/s a radian, no faster than 0.5 (CSP) or 0.25
    (PP) rad/s.
    """
    wired = emulated("RS03")
    for parameter, number in ((0x7005, mode), (0x7017, 0.5), (0x7024, 0.25), (0x7018, 10.0)):
        write(wired, parameter, number)
    wired.hear(*ENABLE)
    write(wired, index, value)
    assert torque(wired) == pytest.approx(wanted, rel=1e-6)
    write(wired, 0x700B, 0.125)
    assert torque(wired) == math.copysign(0.125, wanted), "limit_torque holds in every mode"
    if mode != 3:
        write(wired, 0x700B, 60.0)
        write(wired, 0x7018, 0.0)
        assert torque(wired) == 0.0, "limit_cur of nothing is no torque"


def test_commands_start_from_the_present_position():
    wired = emulated("RS03")
    for index, number in ((0x7005, 5), (0x7017, 5.0), (0x7016, 3.0)):
        write(wired, index, number)
    wired.step(position=-1.0)
    wired.hear(*ENABLE)
    assert torque(wired, position=-1.0) == pytest.approx(0.0, abs=1e-4)


def test_faults_stay_until_they_are_cleared_and_stop_the_drive():
    wired = emulated()
    wired.hear(*ENABLE)
    wired.hear(*command(torque=5.0))
    assert torque(wired, fault=4) == 0.0 and wired["enabled"] == 0.0
    assert {reference.read_reply(RANGES["RS03"], said)[2:4] for said in drain(wired)} == {(0, 4)}
    wired.step(fault=0)
    wired.hear(*ENABLE)
    assert torque(wired) == 0.0 and reference.read_reply(RANGES["RS03"], drain(wired)[0])[3] == 4
    wired.hear(*STOP)
    wired.hear(*ENABLE)
    assert torque(wired) == 0.0 and wired["enabled"] == 0.0, "a stop alone clears nothing"
    wired.hear(*CLEAR)
    wired.step()
    wired.hear(*ENABLE)
    wired.step()
    assert wired["enabled"] == 1.0


def test_a_hot_drive_protects_itself_at_the_temperature_of_its_model():
    for model, found in MODELS.items():
        wired = emulated(model)
        wired.hear(*ENABLE)
        wired.step(temperature=found.too_hot - 0.1)
        assert wired["enabled"] == 1.0
        wired.step(temperature=found.too_hot)
        assert wired["enabled"] == 0.0 and reference.read_reply(RANGES[model], drain(wired)[0])[3] == 4


def test_type_21_faults_are_reported_when_set_and_cleared():
    wired = emulated()
    wired.step(fault=256 << 14)
    assert drain(wired) == [(reference.identifier(21, 127, 0xFD), struct.pack("<II", 1 << 14, 0))]
    wired.step()
    assert drain(wired) == []
    wired.step(fault=0)
    assert drain(wired) == [(reference.identifier(21, 127, 0xFD), bytes(8))]


def test_report_interval_defaults_to_10_ms_and_is_configurable():
    for scan, period in ((0, 0.01), (1, 0.01), (3, 0.02)):
        wired, said = emulated(), []
        wired.hear(*reference.write(0x7026, scan, 127, layout="<Hxx"))
        wired.hear(*(lambda f: (f[0] | EXTENDED, f[2]))(frames.reports(True, 127, 0xFD)))
        for tick in range(200):
            wired.arena[0] = tick * 0.001
            wired.step()
            said += [(tick, i >> 24 & 31) for i, _ in drain(wired)]
        times = [tick for tick, kind in said if kind == 24]
        assert times == [round(k * period * 1000) for k in range(len(times))] and len(times) == round(0.2 / period)
        wired.hear(*(lambda f: (f[0] | EXTENDED, f[2]))(frames.reports(False, 127, 0xFD)))
        wired.arena[0] = 1.0
        assert drain(wired) == []


def test_drive_stops_after_its_command_timeout():
    wired = emulated()
    write(wired, 0x7028, 2000)
    wired.hear(*ENABLE)
    wired.hear(*command(torque=5.0))
    for now, runs in ((0.0, True), (0.1, True), (0.1001, False), (0.2, False)):
        wired.arena[0] = now
        assert (torque(wired) != 0.0) == runs and wired["enabled"] == runs
    wired.hear(*command(torque=5.0))
    assert torque(wired) == 0.0, "it does not start again by itself"


def test_set_zero_makes_the_present_position_zero():
    wired = emulated()
    wired.step(position=2.0)
    wired.hear(reference.identifier(6, 0xFD, 127), b"\1" + bytes(7))
    wired.step(position=2.5)
    assert abs(reference.read_reply(RANGES["RS03"], drain(wired)[0])[4] - 0.5) < 2 * 12.57 / 65535


@pytest.mark.parametrize(
    "identifier, data, answer",
    [
        (reference.identifier(3, 0xFD, 126), bytes(8), FOREIGN),
        (ENABLE[0] & ~EXTENDED, bytes(8), FOREIGN),
        (ENABLE[0] | REMOTE, bytes(8), FOREIGN),
        (reference.identifier(22, 0xFD, 127), bytes(8), FOREIGN),
        (127, bytes(8), FOREIGN),
        (ENABLE[0], bytes(7), MALFORMED),
        (ENABLE[0], b"", MALFORMED),
        (ENABLE[0], bytes(9), MALFORMED),
    ],
)
def test_foreign_or_malformed_frames_are_ignored_without_reply(identifier, data, answer):
    wired = emulated()
    before = wired.arena.copy()
    assert wired.hear(identifier, data) == answer
    assert wired.arena.tobytes() == before.tobytes() and wired.say() == []


@given(
    identifier=st.integers(0, 2**32 - 1),
    kind=st.integers(0, 31),
    data=st.binary(max_size=64),
    length=st.integers(0, 255),
    to_us=st.booleans(),
)
def test_no_frame_causes_torque_in_a_stopped_drive_or_beyond_the_peak(identifier, kind, data, length, to_us):
    wired = Wired.again(BASE)
    if to_us:
        identifier = reference.identifier(kind, identifier >> 8 & 0xFFFF, 127)
    for enabled in (False, True):
        if enabled:
            wired.hear(*ENABLE)
        wired.hear(identifier, data, length)
        got = torque(wired)
        assert math.isfinite(got) and abs(got) <= 60.0 and (enabled or got == 0.0 or (to_us and kind == 3))
        assert all(frame[0] & EXTENDED for frame in drain(wired))


BASE = emulated()


@pytest.mark.parametrize("port", ["position", "velocity"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_diverged_plant_sends_no_reply(port, bad):
    for wired, frame in ((emulated(), ENABLE), (Wired(EmulatedRobStrideMIT, "RS03"), (127, mit.ENABLE))):
        wired.hear(*frame)
        assert wired.say(**{port: bad}) == NOT_FINITE


# The MIT protocol


def test_in_mit_mode_replies_come_from_the_host_id_without_a_fault():
    limits = RANGES["RS03"]
    wired = Wired(EmulatedRobStrideMIT, "RS03", can_id=3, host_id=0xFB)
    wired["temperature"] = 41.5
    push = mit_reference.command(limits, **{**ZERO, "torque": 5.0})
    wired.hear(3, push)
    assert torque(wired) == 0.0
    wired.hear(3, mit.OPERATION)
    wired.hear(3, mit.ENABLE)
    wired.hear(3, push)
    assert abs(torque(wired) - 5.0) < 120.0 / 4095
    said = drain(wired)
    assert {identifier for identifier, _ in said} == {0xFB} and {data[0] for _, data in said} == {3} and len(said) == 4
    assert struct.unpack(">h", said[-1][1][6:])[0] == 415
    assert abs(mit_reference.read_reply(limits, said[-1][1])[3] - 5.0) < 2 * 120.0 / 4095
    wired.hear(3, mit.DISABLE)
    assert torque(wired) == 0.0
    wired.hear(3, mit.ENABLE)
    assert torque(wired) == 0.0
    wired.hear(3, push)
    assert (
        torque(wired) != 0.0
        and torque(wired, fault=1) == 0.0
        and torque(wired, fault=0) == 0.0
        and wired["enabled"] == 0.0
    )


@pytest.mark.parametrize("tail", ["fffd", "fffe", "fffb", "fff8", "fff9", "01fa", "02fd", "0301", "02fc"])
def test_set_up_frames_are_not_foreign_commands(tail):
    wired = Wired(EmulatedRobStrideMIT, "RS03")
    wired.hear(127, mit.ENABLE)
    wired.hear(127, bytes([255] * 6) + bytes.fromhex(tail))
    assert torque(wired) == 0.0

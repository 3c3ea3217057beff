"""The emulated drive: accepted frames, torque and replies, byte for byte."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.actuators import EmulatedCubeMars
from blocks.actuators.cubemars.models import MODELS
from blocks.actuators.mit_frames import DISABLE, ENABLE, NOTHING, SET_ZERO
from graph import DiagramError
from tests.blocks.actuators import reference
from tests.blocks.actuators.wire import EXTENDED, FOREIGN, MALFORMED, NOT_FINITE, REMOTE, TAKEN, Wired
from tests.soaking import soaked

RANGES = {
    name: reference.ranges(model.wire_velocity, model.wire_torque, model.wire_position)
    for name, model in MODELS.items()
}
STILL = {"position": 0.0, "velocity": 0.0, "temperature": 30.0, "fault": 0}


def emulated(model="AK80-9", **parameters):
    wired = Wired(EmulatedCubeMars, model, **{"can_id": 1, **parameters})
    for name, value in STILL.items():
        wired[name] = value
    return wired


def command(model="AK80-9", **fields):
    return reference.command(
        RANGES[model], **{**dict.fromkeys(("position", "velocity", "stiffness", "damping", "torque"), 0.0), **fields}
    )


def torque(wired, **state):
    wired.step(**state)
    return wired["torque"]


def test_drive_is_silent_until_first_command():
    wired = emulated()
    assert wired.say() == [] and wired.say() == []


@pytest.mark.parametrize("spoken", [ENABLE, DISABLE, SET_ZERO, NOTHING], ids=["enable", "disable", "zero", "command"])
def test_every_frame_has_one_answer(spoken):
    wired = emulated(can_id=9)
    for count in (1, 2, 3, 4):
        for _ in range(count):
            assert wired.hear(9, spoken) == TAKEN
        replies = wired.say()
        assert [identifier for identifier, _ in replies] == [9] * count and len({data for _, data in replies}) == 1
        assert wired.say() == []


@given(
    data=st.data(),
    model=st.sampled_from(sorted(MODELS)),
    can_id=st.integers(1, 255),
    temperature=st.integers(-40, 215),
    error=st.integers(0, 255),
)
def test_reply_matches_reference_bytes(data, model, can_id, temperature, error):
    ranges, wired = RANGES[model], emulated(model, can_id=can_id)
    given = {name: data.draw(st.floats(*ranges[name]), label=name) for name in ("position", "velocity")}
    wired.hear(can_id, NOTHING)
    ((identifier, sent),) = wired.say(**given, temperature=temperature, fault=error)
    wanted = reference.reply(ranges, can_id, **given, torque=0.0, temperature=temperature, error=error)
    nearly = any(
        abs(exact - round(exact)) < 1e-9
        for exact in (reference.exact_code(given[name], *ranges[name], reference.BITS[name]) for name in given)
    )
    assert identifier == can_id and (sent == wanted or nearly), (sent.hex(), wanted.hex())


@pytest.mark.parametrize("model", MODELS)
def test_reply_saturates_at_range_ends(model):
    wired = emulated(model)
    for share, code in ((-1.5, "0000"), (1.5, "ffff")):
        wired.hear(1, NOTHING)
        ((_, data),) = wired.say(
            position=share * MODELS[model].wire_position,
            velocity=share * MODELS[model].wire_velocity,
            temperature=share * 1000.0,
        )
        assert data[1:3].hex() == code and data[3:5].hex()[:3] == code[:3] and data[6] == (0 if share < 0.0 else 255)


def test_drive_produces_torque_only_while_enabled():
    wired, push = emulated(), command(torque=5.0)
    wired.hear(1, push)
    assert torque(wired) == 0.0 and wired["enabled"] == 0.0
    wired.hear(1, ENABLE)
    assert torque(wired) == 0.0 and wired["enabled"] == 1.0, "what was commanded before is forgotten"
    wired.hear(1, push)
    assert abs(torque(wired) - 5.0) < 36.0 / 4095
    wired.hear(1, DISABLE)
    assert torque(wired) == 0.0 and wired["enabled"] == 0.0
    wired.hear(1, push)
    assert torque(wired) == 0.0
    wired.hear(1, ENABLE)
    assert torque(wired) == 0.0, "enabling again does not take up an old command"


def test_a_second_enable_has_no_effect():
    wired = emulated()
    wired.hear(1, ENABLE)
    wired.hear(1, command(torque=5.0))
    before = torque(wired)
    wired.hear(1, ENABLE)
    assert torque(wired) == before != 0.0


def test_drive_with_fault_has_no_torque_and_reports_it():
    wired = emulated()
    wired.hear(1, ENABLE)
    wired.hear(1, command(torque=5.0))
    assert torque(wired, fault=3) == 0.0
    replies = wired.say()
    assert [data[7] for _, data in replies] == [3, 3] and {data[3:6].hex() for _, data in replies} == {"7ff7ff"}
    assert torque(wired, fault=0) > 4.9


@pytest.mark.parametrize("model", soaked(MODELS, but=[1, 8]))
@pytest.mark.parametrize("invert, offset", [(False, 0.0), (True, 0.3)])
@given(data=st.data())
def test_torque_follows_manual_law_up_to_peak(model, invert, offset, data):
    """t = kp (p_des − p) + kd (v_des − v) + t_ff, of what it understood; within 1e-9 of the sum of its terms."""
    wired, sign = emulated(model, invert=invert, offset=offset), -1.0 if invert else 1.0
    ranges = RANGES[model]
    fields = {name: data.draw(st.floats(*ranges[name]), label=name) for name, _ in reference.FIELDS}
    sent = reference.command(ranges, **fields)
    heard = reference.read_command(ranges, sent)
    position, velocity = data.draw(st.floats(-12.0, 12.0)), data.draw(st.floats(-40.0, 40.0))
    wired.hear(1, ENABLE)
    if sent[:7] == ENABLE[:7] and 0xFC <= sent[7] <= 0xFE:
        return  # the one command that a drive takes for another
    wired.hear(1, sent)
    terms = (
        heard["stiffness"] * (heard["position"] - sign * (position + offset)),
        heard["damping"] * (heard["velocity"] - sign * velocity),
        heard["torque"],
    )
    peak = MODELS[model].peak
    wanted = sign * min(max(sum(terms), -peak), peak)
    assert abs(torque(wired, position=position, velocity=velocity) - wanted) <= 1e-9 * sum(map(abs, terms))
    assert abs(wired["torque"]) <= peak and wired["torque"] in wired.block.output_range()["torque"]


def test_peak_torque_may_be_lowered_but_must_be_positive():
    wired = emulated(peak=2.5)
    wired.hear(1, ENABLE)
    for commanded, expected in ((18.0, 2.5), (-18.0, -2.5)):
        wired.hear(1, command(torque=commanded))
        assert torque(wired) == expected
    with pytest.raises(DiagramError, match="peak: must be above 0.0 N·m, got 0.0"):
        EmulatedCubeMars("AK80-9", peak=0.0)


def test_set_zero_makes_the_present_position_zero_for_commands_and_answers():
    wired = emulated()
    wired.hear(1, ENABLE)
    wired["position"] = 2.0
    wired.hear(1, SET_ZERO)
    wired.say()
    wired.hear(1, command(position=1.0, stiffness=10.0))
    assert abs(torque(wired, position=2.0) - 10.0) < 0.2  # one code of stiffness is 0.12
    ((_, data),) = wired.say(position=2.5)
    assert abs(reference.read_reply(RANGES["AK80-9"], data)[1] - 0.5) < 25.0 / 65535


@pytest.mark.parametrize(
    "identifier, data, answer",
    [
        (2, ENABLE, FOREIGN),
        (0, ENABLE, FOREIGN),
        (1 | EXTENDED, ENABLE, FOREIGN),
        (1 | REMOTE, ENABLE, FOREIGN),
        (0x101, ENABLE, FOREIGN),
        (1, ENABLE[:7], MALFORMED),
        (1, b"", MALFORMED),
        (1, ENABLE + b"\0", MALFORMED),
    ],
)
def test_foreign_or_malformed_frames_are_ignored_without_reply(identifier, data, answer):
    wired = emulated()
    before = wired.arena.copy()
    assert wired.hear(identifier, data) == answer
    assert wired.arena.tobytes() == before.tobytes() and wired.say() == []


@pytest.mark.parametrize("last", [0xF8, 0xF9, 0xFA, 0xFB, 0xFF, 0x00])
def test_only_three_frames_of_all_ones_are_special(last):
    wired = emulated()
    wired.hear(1, ENABLE)
    wired.hear(1, bytes([255] * 7 + [last]))
    assert wired["enabled"] == 0.0 and torque(wired) == 18.0, "a command at the top of every range, and still enabled"
    assert wired["enabled"] == 1.0


@pytest.mark.parametrize("port", ["position", "velocity"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_diverged_plant_sends_no_reply(port, bad):
    """A code cannot represent NaN: the run ends with a fault that names the emulated drive, instead of −12.5 rad."""
    wired = emulated()
    wired.hear(1, NOTHING)
    assert wired.say(**{port: bad}) == NOT_FINITE

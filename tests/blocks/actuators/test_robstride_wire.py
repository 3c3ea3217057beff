"""The bytes of RobStride's private protocol against the slow reference: every field, over its whole range, for every
model.
"""

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.actuators import RobStride
from blocks.actuators.robstride import frames
from blocks.actuators.robstride.models import MODELS
from tests.blocks.actuators import robstride_reference as reference
from tests.blocks.actuators.reference import exact_code, value
from tests.blocks.actuators.wire import (
    AUTHORITY,
    EXTENDED,
    FOREIGN,
    MALFORMED,
    NOT_FINITE,
    OUT_OF_LIMITS,
    REMOTE,
    TAKEN,
    Wired,
)
from tests.soaking import soaked

FIELDS = ("position", "velocity", "stiffness", "damping", "torque")
NOTED, COMMANDED, IDLE = 2, 3, 7  # cext/abi.pxd
WRITTEN = {"position": 0x7016, "csp": 0x7016, "velocity": 0x700A, "current": 0x7006}


def drive(model, **parameters):
    """A drive whose limits are as wide as its wire: the encoding is tested beyond what a motor may be asked."""
    wired = Wired(RobStride, model, **parameters)
    wired["limits"] = [*wired["wire"], math.inf, 1.0]
    return wired


DRIVES = {name: drive(name) for name in MODELS}
RANGES = {name: reference.ranges(model) for name, model in MODELS.items()}
models = pytest.mark.parametrize("model", MODELS)
few = pytest.mark.parametrize("model", soaked(MODELS, but=[0, 8]))


def say(wired, **fields):
    """The one frame for a command; fields that are not given are zero."""
    (frame,) = wired.say(**{f"{name}_command": fields.get(name, 0.0) for name in FIELDS})
    return frame


def same_codes(frame, ranges, fields):
    """Codes are the reference's; where the exact code is within 1e-9 of a whole number, rounding in doubles may fall on
    its other side.
    """
    for name, code in reference.codes_of(frame).items():
        exact = exact_code(fields[name], *ranges[name], 16)
        assert code == int(exact) or abs(exact - round(exact)) < 1e-9 and abs(code - exact) < 1.0 + 1e-9, (
            name,
            fields[name],
        )


@given(data=st.data(), model=st.sampled_from(sorted(MODELS)))
def test_commands_encode_as_reference_and_decode_within_one_code(data, model):
    ranges = RANGES[model]
    fields = {name: data.draw(st.floats(*ranges[name]), label=name) for name in FIELDS}
    frame = say(DRIVES[model], **fields)
    assert frame[0] & 0xFF == 127 and frame[0] >> 24 == 0x81
    same_codes(frame, ranges, fields)
    for name, x in reference.read_command(ranges, frame).items():
        low, high = ranges[name]
        assert -1e-9 <= fields[name] - x <= (high - low) / 65535 * (1.0 + 1e-9), name


@few
def test_every_code_is_that_of_the_middle_of_its_interval(model):
    """Every field at once, each on its own way through the codes: all of them in nine models."""
    wired, ranges = DRIVES[model], RANGES[model]
    for k in range(sorted(MODELS).index(model), 65535, len(MODELS)):
        codes = {name: (k * factor + factor) % 65535 for name, factor in zip(FIELDS, (1, 11, 13, 17, 19))}
        fields = {
            name: low + (code + 0.5) * (high - low) / 65535
            for name, code in codes.items()
            for low, high in [ranges[name]]
        }
        assert reference.codes_of(say(wired, **fields)) == codes


@models
def test_both_ends_of_every_range_have_the_first_and_the_last_code_and_beyond_nothing_wraps(model):
    ranges, wired = RANGES[model], drive(model)
    for end, expected in ((0, 0), (1, 65535)):
        assert set(reference.codes_of(say(wired, **{name: ranges[name][end] for name in FIELDS})).values()) == {
            expected
        }
    # no command reaches the wire like this: the last line of defence alone
    wired["limits"] = [*(wired["wire"] * 1e6), math.inf, 1.0]
    for name in FIELDS:
        low, high = ranges[name]
        for x in (math.nextafter(high, math.inf), high * 1.0001, high * 2.0, high * 1e5):
            assert reference.codes_of(say(wired, **{name: x}))[name] == 65535, (name, x)
        for x in () if low == 0.0 else (math.nextafter(low, -math.inf), low * 1.0001, low * 2.0, low * 1e5):
            assert reference.codes_of(say(wired, **{name: x}))[name] == 0, (name, x)


@models
def test_zero_command_equals_the_zero_frame_of_arming(model):
    wired = DRIVES[model]
    ((identifier, extended, data),) = wired.block.zero_frames()
    assert extended and say(wired) == (identifier | EXTENDED, data)
    understood = reference.read_command(RANGES[model], (identifier | EXTENDED, data))
    assert understood["stiffness"] == understood["damping"] == 0.0
    assert abs(understood["torque"]) <= MODELS[model].wire_torque / 65535 * (1.0 + 1e-9), "half a code"


@models
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_is_refused_and_makes_no_frame(model, bad):
    for name in FIELDS:
        wired = drive(model)
        assert wired.say(**{f"{name}_command": bad}) == NOT_FINITE
        assert bytes(wired.frames[0].data) == bytes(64) and wired.frames[0].id == 0 and wired["torque_sent"] == 0.0


@pytest.mark.hazard("H1b")
@models
def test_a_command_past_its_limit_is_refused_and_makes_no_frame(model):
    wired, found = Wired(RobStride, model), MODELS[model]
    wire = [found.wire_position, found.wire_velocity, found.wire_stiffness, found.wire_damping]
    assert wired["limits"].tolist() == [*wire, found.rated, found.rated, 1.0]
    for name, limit in zip(FIELDS, wired["limits"]):
        low = 0.0 if name in ("stiffness", "damping") else -limit
        for x in (low, limit):
            assert len(wired.say(**{f"{name}_command": x})) == 1
        for x in (math.nextafter(low, -math.inf), math.nextafter(limit, math.inf), 1e300, -1e300):
            assert wired.say(**{f"{name}_command": x}) == OUT_OF_LIMITS
        wired[f"{name}_command"] = 0.0


@given(
    data=st.data(),
    model=st.sampled_from(sorted(MODELS)),
    invert=st.booleans(),
    offset=st.floats(-3.0, 3.0),
    ratio=st.floats(0.5, 4.0),
    authority=st.floats(0.0, 1.0),
)
def test_invert_offset_gear_and_fade_in_apply_before_encoding(data, model, invert, offset, ratio, authority):
    """At the motor: ± (joint position + offset) r, velocity r, torque / r, stiffness / r², damping / r²; within one
    code.
    """
    wired = Wired(RobStride, model, invert=invert, offset=offset, limit="peak", gear_ratio=ratio)
    wired.arena[AUTHORITY] = authority
    wired["limits"] = [*wired["limits"][:5], math.inf, 1.0]
    fields = {
        name: data.draw(st.floats(0.0 if name in ("stiffness", "damping") else -limit, limit), label=name)
        for name, limit in zip(FIELDS, wired["limits"])
    }
    sign = -1.0 if invert else 1.0
    at_motor = {
        "position": sign * (fields["position"] + offset) * ratio,
        "velocity": sign * fields["velocity"] * ratio,
        "torque": sign * authority * fields["torque"] / ratio,
        "stiffness": authority * fields["stiffness"] / ratio**2,
        "damping": authority * fields["damping"] / ratio**2,
    }
    frame = say(wired, **fields)
    for name, x in reference.read_command(RANGES[model], frame).items():
        low, high = RANGES[model][name]
        assert -1e-9 * high <= at_motor[name] - x <= (high - low) / 65535 + 1e-9 * high, name
    sent = reference.read_command(RANGES[model], frame)["torque"]
    assert abs(wired["torque_sent"] - sign * sent * ratio) < 1e-9 * MODELS[model].wire_torque * ratio


@given(
    data=st.data(),
    model=st.sampled_from(sorted(MODELS)),
    temperature=st.integers(-400, 1500),
    faults=st.integers(0, 63),
)
def test_a_reply_is_decoded_as_the_reference_does(data, model, temperature, faults):
    """Within 1e-12 of the range: doubles against exact fractions."""
    wired, ranges = DRIVES[model], RANGES[model]
    codes = [data.draw(st.integers(0, 65535)) for _ in range(3)]
    identifier = reference.identifier(2, 2 << 14 | faults << 8 | 127, 0xFD)
    assert wired.hear(identifier, struct.pack(">3Hh", *codes, temperature)) == TAKEN
    for name, code in zip(("position", "velocity", "torque"), codes):
        assert abs(wired[name] - value(code, *ranges[name], 16)) < 1e-12 * ranges[name][1]
        assert wired[name] in wired.block.output_range()[name]
    assert abs(wired["temperature"] - temperature / 10) < 1e-9 and wired["fault"] == faults


def oracle(mode, fields, found, *, invert, offset, ratio, share, limit_current):
    """The frames of the modes in which parameters are written, by hand."""
    sign, command = -1.0 if invert else 1.0, fields
    if mode == "current":
        return [reference.write(0x7006, sign * share * command, 127)]
    shift = offset if mode in ("position", "csp") else 0.0
    return [
        reference.write(WRITTEN[mode], sign * (command + shift) * ratio, 127),
        reference.write(0x7018, share * limit_current, 127),
    ]


@given(
    data=st.data(),
    model=st.sampled_from(sorted(set(MODELS) - {"CyberGear"})),
    mode=st.sampled_from(sorted(WRITTEN)),
    invert=st.booleans(),
    offset=st.floats(-2.0, 2.0),
    ratio=st.floats(0.5, 3.0),
    share=st.floats(0.0, 1.0),
)
def test_other_modes_write_the_command_and_the_current_limit(data, model, mode, invert, offset, ratio, share):
    """To the byte, but for the last bit of a float, where two products may round apart."""
    found = MODELS[model]
    wired = Wired(RobStride, model, mode=mode, invert=invert, offset=offset, gear_ratio=ratio)
    wired.arena[AUTHORITY] = share
    (name, *_), limit = wired.block.inputs, float(wired["limits"][0])
    x = data.draw(st.floats(-limit, limit))
    current = min(found.rated * math.sqrt(2.0) / found.rms_constant, found.rated_current)
    wanted = oracle(mode, x, found, invert=invert, offset=offset, ratio=ratio, share=share, limit_current=current)
    got = wired.say(**{name: x})
    assert [(i, d[:4]) for i, d in got] == [(i, d[:4]) for i, d in wanted]
    for (_, mine), (_, theirs) in zip(got, wanted):
        a, b = (struct.unpack("<f", d[4:])[0] for d in (mine, theirs))
        assert a == b or abs(a - b) <= 1.2e-7 * abs(b)
    sent = wired[name.replace("_command", "_sent")]
    assert sent in wired.block.output_range()[name.replace("_command", "_sent")]
    assert abs(sent - (share * x if mode == "current" else x)) < 1e-6 * (abs(x) + abs(offset)) + 1e-30
    for bad in (math.nan, math.inf, -math.inf):
        assert wired.say(**{name: bad}) == NOT_FINITE
    for beyond in (math.nextafter(limit, math.inf), -1e300, 1e300):
        assert wired.say(**{name: beyond}) == OUT_OF_LIMITS


@pytest.mark.parametrize("mode", ["operation", *WRITTEN])
@pytest.mark.parametrize("share", [math.nan, -0.1, 1.0001])
def test_invalid_gain_scale_makes_no_frame(mode, share):
    wired = Wired(RobStride, "RS03", mode=mode)
    wired.arena[AUTHORITY] = share
    assert wired.say() == OUT_OF_LIMITS


@pytest.mark.parametrize("has_run", [True, False])
def test_a_drive_that_is_not_enabled_is_a_fault_only_under_torque(has_run):
    """During arming and while a run waits to be armed again, the run itself has disabled it."""
    ranges = RANGES["RS03"]
    wired = Wired(RobStride, "RS03")
    stopped, running = reference.reply(ranges, 127, mode=0), reference.reply(ranges, 127, mode=2)
    if has_run:
        wired.hear(*running)
    for authority, fault in ((0.0, 0), (1.0, 64), (0.0, 0)):
        wired.arena[AUTHORITY] = authority
        for _ in range(20):
            assert wired.hear(*stopped) == IDLE
        assert wired["fault"] == fault


def test_a_drive_that_stops_by_itself_is_a_fault_after_the_replies_to_arming():
    ranges = RANGES["RS03"]
    wired = Wired(RobStride, "RS03")
    stopped, running = reference.reply(ranges, 127, mode=0), reference.reply(ranges, 127, mode=2)
    assert wired.hear(*stopped) == IDLE and wired["fault"] == 0 and abs(wired["temperature"] - 25.0) < 1e-9
    assert wired.hear(*reference.reply(ranges, 127, mode=0, faults=4)) == IDLE and wired["fault"] == 4
    assert wired.hear(*running) == TAKEN and wired["fault"] == 0
    for _ in range(12):
        assert wired.hear(*stopped) == IDLE and wired["fault"] == 0, (
            "replies to frames of arming may still be under way"
        )
    assert wired.hear(*stopped) == IDLE and wired["fault"] == 64 and frames.names(64) == ["has stopped by itself"]
    assert wired.hear(*running) == TAKEN and wired["fault"] == 0


def test_fault_reports_are_decoded_in_both_address_orders_and_latched():
    for field, target in ((127, 0xFD), (0xFD, 127)):
        wired = Wired(RobStride, "RS03")
        assert wired.hear(reference.identifier(21, field, target), struct.pack("<II", 1 << 14, 1)) == NOTED
        assert wired["fault"] == 1 << 22 and wired["warning"] == 1 and frames.names(wired["fault"]) == ["stalled"]
        assert wired.hear(*reference.reply(RANGES["RS03"], 127, faults=1)) == TAKEN and wired["fault"] == 1 | 1 << 22
        assert (
            wired.hear(reference.identifier(21, field, target), bytes(8)) == NOTED
            and wired["fault"] == 1
            and wired["warning"] == 0
        )
    assert wired.hear(reference.identifier(21, 126, 0xFD), struct.pack("<II", 1, 1)) == FOREIGN and wired["fault"] == 1


def test_unsolicited_report_is_a_measurement_not_a_reply():
    wired = Wired(RobStride, "RS02")
    assert wired.hear(*reference.reply(RANGES["RS02"], 127, position=1.25, kind=24)) == NOTED
    assert abs(wired["position"] - 1.25) < 2 * 12.57 / 65535


def test_encodable_temperatures_lie_in_proved_range():
    wired = Wired(RobStride, "RS02")
    for code in (-32768, 32767):
        wired.hear(*reference.reply(RANGES["RS02"], 127, temperature=code / 10.0))
        assert (
            wired["temperature"] in wired.block.output_range()["temperature"]
            and abs(wired["temperature"] - code / 10.0) < 1e-9
        )


def test_foreign_commands_are_distinguished_from_harmless_frames():
    wired = Wired(RobStride, "RS03", can_id=5)
    for kind in (1, 3, 4, 6, 7, 18):
        assert wired.hear(reference.identifier(kind, 0x1234, 5), bytes(8)) == COMMANDED
        assert wired.hear(reference.identifier(kind, 0x1234, 6), bytes(8)) == FOREIGN
    for kind in (0, 17):
        assert wired.hear(reference.identifier(kind, 0xFD, 5), bytes(8)) == FOREIGN


ANY_FRAME = {
    "identifier": st.one_of(
        st.integers(0, 2**32 - 1),
        st.integers(0, 2**29 - 1).map(lambda i: i | EXTENDED),
        st.builds(
            lambda kind, bits: reference.identifier(kind, bits << 8 | 127, 0xFD),
            st.integers(0, 31),
            st.integers(0, 255),
        ),
    ),
    "data": st.binary(max_size=64),
    "length": st.integers(0, 255),
}


def leaves_all_else_alone(identifier, data, length):
    """What is not taken changes nothing; what is changes feedback and state alone; and feedback stays within its
    promise.
    """
    wired = Wired.again(DRIVES["RS04"])
    before = wired.arena.copy()
    answer = wired.hear(identifier, data, length)
    assert answer in (FOREIGN, TAKEN, NOTED, COMMANDED, IDLE, MALFORMED)
    mine = np.zeros(len(before), bool)
    for name in ("position", "velocity", "torque", "temperature", "fault", "warning", "state", "read_back"):
        mine[wired.place[name]] = True
    changed = wired.arena != before
    assert not (changed & ~mine).any()
    if answer in (TAKEN, NOTED, IDLE):
        assert length == 8 and identifier & EXTENDED and not identifier & (REMOTE | 0x20000000)
        promised = wired.block.output_range()
        assert all(
            wired[name] in promised[name]
            for name in ("position", "velocity", "torque", "temperature", "fault", "warning")
        )
    else:
        assert not changed.any()


@given(**ANY_FRAME)
def test_random_frames_write_only_outputs_of_the_drive(identifier, data, length):
    leaves_all_else_alone(identifier, data, length)

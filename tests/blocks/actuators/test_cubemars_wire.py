"""The bytes of MIT mode against the slow reference: every field, over its whole range, for every model."""

import ctypes
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.actuators import CubeMars
from blocks.actuators.cubemars.models import MODELS
from tests.blocks.actuators import reference
from tests.blocks.actuators.wire import AUTHORITY, NOT_FINITE, OUT_OF_LIMITS, TAKEN, Wired
from tests.soaking import soaked

FIELDS = tuple(name for name, _ in reference.FIELDS)


def drive(model, **parameters):
    """A drive whose limits are as wide as its wire: the encoding is tested beyond what a motor may be asked."""
    wired = Wired(CubeMars, model, **{"can_id": 1, "errors": "code", **parameters})
    wired["limits"] = [*wired["wire"], math.inf, 1.0]
    return wired


DRIVES = {name: drive(name) for name in MODELS}
RANGES = {
    name: reference.ranges(model.wire_velocity, model.wire_torque, model.wire_position)
    for name, model in MODELS.items()
}
models = pytest.mark.parametrize("model", MODELS)
few = pytest.mark.parametrize("model", soaked(MODELS, but=[0, 8]))


def half_ranges(model):
    return MODELS[model].wire_position, MODELS[model].wire_velocity


def say(wired, **fields):
    """The data of the one frame for a command; fields that are not given are zero."""
    ctypes.memset(wired.frames, 0xFF, ctypes.sizeof(wired.frames))
    ((identifier, data),) = wired.say(**{f"{name}_command": fields.get(name, 0.0) for name in FIELDS})
    assert wired.frames[0].flags == 0 and not any(wired.frames[0].data[8:]), (
        "nothing of CAN FD, and nothing of what stood there"
    )
    assert identifier == wired["can_id"]
    return data


def same_codes(data, ranges, fields):
    """Codes are the reference's; where the exact code is within 1e-9 of a whole number, rounding in doubles may fall on
    its other side.
    """
    for name, code in reference.codes_of(data).items():
        exact = reference.exact_code(fields[name], *ranges[name], reference.BITS[name])
        assert code == int(exact) or abs(exact - round(exact)) < 1e-9 and abs(code - exact) < 1.0 + 1e-9, (
            name,
            fields[name],
        )


@few
def test_every_12_bit_code_is_that_of_the_middle_of_its_interval(model):
    ranges = RANGES[model]
    for k in range(4095):
        codes = {
            "velocity": k,
            "stiffness": (k * 7 + 1) % 4095,
            "damping": (k * 11 + 2) % 4095,
            "torque": (k * 13 + 3) % 4095,
        }
        fields = {
            name: low + (code + 0.5) * (high - low) / 4095
            for name, code in codes.items()
            for low, high in [ranges[name]]
        }
        assert reference.codes_of(say(DRIVES[model], **fields)) == {"position": 0x7FFF, **codes}


def test_every_position_code_is_that_of_the_middle_of_its_interval():
    wired = DRIVES["AK80-9"]
    for code in range(65535):
        wired["position_command"] = -12.5 + (code + 0.5) * 25.0 / 65535
        assert wired.native_encode(*wired.of_encode, wired.frames) == 1
        data = wired.frames[0].data
        assert data[0] << 8 | data[1] == code


@given(data=st.data(), model=st.sampled_from(sorted(MODELS)))
def test_any_command_inside_its_ranges_has_the_codes_of_the_reference(data, model):
    fields = {name: data.draw(st.floats(*RANGES[model][name]), label=name) for name in FIELDS}
    same_codes(say(DRIVES[model], **fields), RANGES[model], fields)


@models
def test_both_ends_of_every_range_have_the_first_and_the_last_code(model):
    ranges = RANGES[model]
    for end, expected in ((0, "00" * 8), (1, "ff" * 8)):
        fields = {name: ranges[name][end] for name in FIELDS}
        assert say(DRIVES[model], **fields).hex() == expected == reference.command(ranges, **fields).hex()
    for name, bits in reference.FIELDS:
        low, high = ranges[name]
        for x, code in (
            (low, 0),
            (math.nextafter(low, high), 0),
            (high, 2**bits - 1),
            (math.nextafter(high, low), 2**bits - 2),
        ):
            assert abs(reference.codes_of(say(DRIVES[model], **{name: x}))[name] - code) <= (x not in (low, high)), (
                name,
                x,
            )


@models
def test_zero_command_has_the_codes_just_below_the_middle(model):
    for zero in (0.0, -0.0, 5e-324, -5e-324):
        assert say(DRIVES[model], **dict.fromkeys(("position", "velocity", "torque"), zero)).hex() == "7fff7ff0000007ff"


@models
def test_a_value_beyond_its_range_saturates_and_never_wraps(model):
    wired = drive(model)
    # no command reaches the wire like this: the last line of defence alone
    wired["limits"] = [*(wired["wire"] * 1e6), math.inf, 1.0]
    for name, bits in reference.FIELDS:
        low, high = RANGES[model][name]
        for x in (math.nextafter(high, math.inf), high * 1.0001, high + 1.0, high * 2.0, high * 1e5):
            assert reference.codes_of(say(wired, **{name: x}))[name] == 2**bits - 1, (name, x)
        for x in () if low == 0.0 else (math.nextafter(low, -math.inf), low * 1.0001, low - 1.0, low * 2.0, low * 1e5):
            assert reference.codes_of(say(wired, **{name: x}))[name] == 0, (name, x)


@models
@pytest.mark.parametrize("bad", [math.nan, -math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_is_refused_and_makes_no_frame(model, bad):
    for name in FIELDS:
        wired = drive(model)
        assert wired.say(**{f"{name}_command": bad}) == NOT_FINITE
        assert bytes(wired.frames[0].data) == bytes(64) and wired["torque_sent"] == 0.0


@pytest.mark.hazard("H1b")
@models
def test_a_command_past_its_limit_is_refused_and_makes_no_frame(model):
    wired = Wired(CubeMars, model, can_id=1)
    rated = min(MODELS[model].rated, MODELS[model].wire_torque)
    assert wired["limits"].tolist() == [*half_ranges(model)[:2], 500.0, 5.0, rated, rated, 1.0]
    for name, limit in zip(FIELDS, wired["limits"]):
        low = 0.0 if name in ("stiffness", "damping") else -limit
        for x in (low, limit):
            assert len(wired.say(**{f"{name}_command": x})) == 1
        for x in (math.nextafter(low, -math.inf), math.nextafter(limit, math.inf), 1e300, -1e300):
            assert wired.say(**{f"{name}_command": x}) == OUT_OF_LIMITS
        wired[f"{name}_command"] = 0.0


@models
def test_no_command_reads_as_enable_disable_or_zero(model):
    """With all else at the top, the last three torque codes but one would make FF FF FF FF FF FF FF FC, FD, FE."""
    ranges = RANGES[model]
    top = {name: ranges[name][1] for name in FIELDS}
    low, high = ranges["torque"]
    for code, tail in ((0xFFB, "fffffb"), (0xFFC, "fffffc"), (0xFFD, "fffffd"), (0xFFE, "fffffe"), (0xFFF, "ffffff")):
        torque = min(low + (code + 0.5) * (high - low) / 4095, high)
        data = say(DRIVES[model], **{**top, "torque": torque})
        assert data.hex() == ("fffe" if 0xFFC <= code <= 0xFFE else "ffff") + "ffffff" + tail
        assert reference.codes_of(data)["torque"] == code


@few
def test_every_code_of_a_reply_is_decoded_as_the_reference_does(model):
    """Within 1e-12 of the range: doubles against exact fractions."""
    wired, ranges = drive(model), RANGES[model]
    may = wired.block.output_range()
    for k in range(4096):
        v, t, p = k, (k * 7 + 5) % 4096, (k * 16 + k % 16) % 65536
        data = bytes([1, p >> 8, p & 255, v >> 4, (v & 15) << 4 | t >> 8, t & 255, k % 256, (k * 3) % 256])
        assert wired.hear(1, data) == TAKEN
        _, position, velocity, torque, temperature, error = reference.read_reply(ranges, data)
        assert abs(wired["position"] - position) < 1e-12 * 25.0
        assert abs(wired["velocity"] - velocity) < 1e-12 * MODELS[model].wire_velocity
        assert abs(wired["torque"] - torque) < 1e-12 * MODELS[model].wire_torque
        assert wired["temperature"] == temperature == data[6] - 40.0 and wired["fault"] == error == data[7]
        for name in ("position", "velocity", "torque", "temperature", "fault"):
            assert wired[name] in may[name]


def test_the_ends_of_a_reply_are_the_ends_of_the_ranges_exactly():
    for model, wired in ((name, drive(name)) for name in MODELS):
        for code, end in ((0x00, 0), (0xFF, 1)):
            assert wired.hear(1, bytes([1] + [code] * 5 + [40, 0])) == TAKEN
            for name in ("position", "velocity", "torque"):
                assert wired[name] == RANGES[model][name][end], (model, name)


@given(
    data=st.data(),
    model=st.sampled_from(sorted(MODELS)),
    invert=st.booleans(),
    offset=st.floats(-6.0, 6.0),
    authority=st.floats(0.0, 1.0),
)
def test_invert_offset_and_fade_in_apply_before_encoding(data, model, invert, offset, authority):
    """Motor position = ± (joint position + offset), velocity and torque = ± the joint's; what fades in is torque,
    stiffness and damping.
    """
    wired = Wired(CubeMars, model, can_id=9, invert=invert, offset=offset, limit="peak")
    wired.arena[AUTHORITY] = authority
    wired["limits"] = [*wired["limits"][:5], math.inf, 1.0]
    fields = {
        name: data.draw(st.floats(0.0 if name in ("stiffness", "damping") else -limit, limit), label=name)
        for name, limit in zip(FIELDS, wired["limits"])
    }
    sign = -1.0 if invert else 1.0
    at_motor = {
        "position": sign * (fields["position"] + offset),
        "velocity": sign * fields["velocity"],
        "torque": sign * authority * fields["torque"],
        "stiffness": authority * fields["stiffness"],
        "damping": authority * fields["damping"],
    }
    sent = say(wired, **fields)
    same_codes(sent, RANGES[model], at_motor)
    understood = reference.read_command(RANGES[model], sent)
    assert abs(wired["torque_sent"] - sign * understood["torque"]) < 1e-12 * MODELS[model].wire_torque


def test_a_torque_of_the_whole_limit_is_not_counted_as_limited_and_one_above_it_is():
    wired, limit = drive("AK80-9"), 7.0
    wired["limits"] = [*wired["wire"], limit, 1.0]
    for torque, counted in ((limit, 0), (-limit, 0), (math.nextafter(limit, math.inf), 1), (-1.01 * limit, 2)):
        say(wired, torque=torque)
        assert wired["limited"] == counted


def test_a_fade_in_share_outside_0_to_1_makes_no_frame():
    wired = drive("AK80-9")
    for share in (math.nan, -1e-9, 1.0000001, math.inf):
        wired.arena[AUTHORITY] = share
        assert wired.say(torque_command=1.0) == OUT_OF_LIMITS


@models
@pytest.mark.parametrize("invert", [False, True])
@pytest.mark.parametrize("offset", [0.0, 0.7, -0.7])
def test_command_and_reply_have_same_sign(model, invert, offset):
    """A motor that follows its command reports the joint where the diagram wanted it, within one step of each
    code.
    """
    wired = drive(model, invert=invert, offset=offset)
    for share in (-0.9, -0.3, 0.0, 0.3, 0.9):
        wanted = {
            "position": 11.0 * share,
            "velocity": share * MODELS[model].wire_velocity,
            "torque": share * MODELS[model].wire_torque,
        }
        sent = reference.codes_of(say(wired, **wanted))
        p, v, t = (sent[name] for name in ("position", "velocity", "torque"))
        assert wired.hear(0, bytes([1, p >> 8, p & 255, v >> 4, (v & 15) << 4 | t >> 8, t & 255, 65, 0])) == TAKEN
        for name, x in wanted.items():
            low, high = RANGES[model][name]
            assert abs(wired[name] - x) <= (high - low) / (2 ** reference.BITS[name] - 1) + 1e-12
        assert wired["torque"] == pytest.approx(wired["torque_sent"], abs=1e-12) and wired["temperature"] == 25.0

"""The bytes of servo mode, mode by mode: scales, limits, truncation, the fade, and what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.actuators import CubeMarsServo
from blocks.actuators.cubemars import frames, models, models_v3
from graph import Diagram, DiagramError, compile
from tests.blocks.actuators import cubemars_reference as reference
from tests.blocks.actuators.wire import AUTHORITY, EXTENDED, FOREIGN, MALFORMED, NOT_FINITE, OUT_OF_LIMITS, TAKEN, Wired

NOTED, COMMANDED, IDLE = 2, 3, 7  # cext/abi.pxd
MODES = tuple(reference.KINDS)
MODELS = {**models.MODELS, **models_v3.MODELS}
GIVEN = {"AK80-8-V3.0": {"limit": 10.0}}  # what nobody has published
SLOW = {"velocity_limit": 1.0, "acceleration": 5.0}  # which every model can be told

wired = {}


def drive(model, mode, **parameters):
    """A fresh one; those without parameters of their own are compiled once."""
    key = (model, mode, *sorted(parameters.items()))
    if key not in wired:
        wired[key] = Wired(CubeMarsServo, model, mode=mode, can_id=7, **{**GIVEN.get(model, {}), **SLOW, **parameters})
    return Wired.again(wired[key])


def value_of(data):
    return int.from_bytes(data[:4], "big", signed=True)


@given(
    data=st.data(),
    model=st.sampled_from(sorted(MODELS)),
    mode=st.sampled_from(MODES),
    invert=st.booleans(),
    offset=st.sampled_from([0.0, 0.4, -1.3]),
    ratio=st.sampled_from([1.0, 2.0, 0.7]),
)
def test_a_command_equals_the_references_truncated_towards_zero(data, model, mode, invert, offset, ratio):
    """The whole number is the exact one without its fraction; where doubles round across a whole number, the next
    one.
    """
    limit = {} if model in GIVEN else {"limit": "peak"}
    one = drive(model, mode, invert=invert, offset=offset, gear_ratio=ratio, **limit)
    name, *_ = one.block.inputs
    x = data.draw(st.floats(*one["limits"][:2]), label=name)
    [(identifier, said)] = one.say(**{name: x})
    assert identifier == EXTENDED | reference.KINDS[mode] << 8 | 7 and len(said) == (
        8 if mode == "position_velocity" else 4
    )
    exact = reference.servo_code(mode, MODELS[model], x, sign=-1 if invert else 1, offset=offset, ratio=ratio)
    assert (
        value_of(said) == int(exact)
        or abs(float(exact) - round(exact)) < 1e-6
        and abs(value_of(said) - float(exact)) < 1.0 + 1e-6
    )
    sent, unit = one[one.block.sent_name], one["written"][1]
    assert abs(sent - x) < 1.0 / unit + 1e-9 and sent in one.block.output_range()[one.block.sent_name]
    if mode in ("current", "current_brake", "duty", "velocity"):
        assert abs(sent) <= abs(x) * (1.0 + 1e-9), "never more than commanded"


@pytest.mark.parametrize("model", MODELS)
def test_the_current_is_at_most_that_of_the_torque_limit(model):
    """Rated torque over gear, torque constant and a gear behind; at most √2 times the store's RMS current, and 60 A,
    which the frame ends at.
    """
    for ratio in (1.0, 3.0):
        one = drive(model, "current", gear_ratio=ratio)
        constant = MODELS[model].torque_constant
        torque = GIVEN.get(model, {}).get("limit") or MODELS[model].rated * ratio
        rated = MODELS[model].rated_current or math.inf
        assert (
            one["limits"][1]
            == -one["limits"][0]
            == pytest.approx(min(torque / constant / ratio, rated, 60.0), rel=1e-12)
        )
        [(_, said)] = one.say(current_command=one["limits"][1])
        assert value_of(said) / 1000 * constant * ratio <= torque * (1 + 1e-12)
    assert drive(model, "current_brake")["limits"][0] == 0.0, "a brake has no direction"


def test_custom_torque_constant_keeps_current_within_motor_limit():
    """The store's 10.3 and 22.3 A of AK80-9 are RMS: 14.57 and 31.54 A of amplitude."""
    for limit, most in (("rated", 14.566), ("peak", 31.537), (9.5, 31.537)):
        assert drive("AK80-9", "current", torque_constant=0.2, limit=limit)["limits"][1] == pytest.approx(
            most, abs=1e-3
        )
    assert drive("AK80-9", "current", limit="rated")["limits"][1] == pytest.approx(9.524, abs=1e-3), (
        "the torque's where that is less"
    )


@pytest.mark.parametrize("mode", MODES)
def test_command_beyond_limit_or_nan_makes_no_frame(mode):
    one = drive("AK80-9", mode)
    (name, *_), (low, high, _) = one.block.inputs, one["limits"]
    for x in (low, high):
        assert len(one.say(**{name: x})) == 1
    for x in (math.nextafter(low, -math.inf), math.nextafter(high, math.inf), 1e300, -1e300):
        assert one.say(**{name: x}) == OUT_OF_LIMITS
    for x in (math.nan, math.inf, -math.inf):
        assert one.say(**{name: x}) == NOT_FINITE
    one[name] = 0.0
    for share in (math.nan, -0.1, 1.0001):
        one.arena[AUTHORITY] = share
        assert one.say() == OUT_OF_LIMITS
    one.arena[AUTHORITY], one["limits"] = 1.0, [low, high, math.nan]
    assert one.say() == OUT_OF_LIMITS


@pytest.mark.parametrize("mode", MODES)
@given(
    x=st.floats(allow_nan=False, allow_infinity=False),
    limit=st.floats(0.0, 1e300),
    position=st.floats(-60.0, 60.0),
    share=st.floats(0.0, 1.0),
)
def test_codes_never_wrap_even_with_a_corrupt_limit(mode, x, limit, position, share):
    one = drive("AK80-64", mode)
    name, *_ = one.block.inputs
    one["limits"], one["position"], one.arena[AUTHORITY] = [-limit, limit, 1.0], position, share
    said = one.say(**{name: x})
    if said == OUT_OF_LIMITS:
        return
    code, most = value_of(said[0][1]), one["written"][2]
    assert abs(code) <= most
    if mode in ("duty", "current", "velocity") and x != 0.0:
        assert code * x >= 0.0


@pytest.mark.parametrize("mode", MODES)
def test_commands_fade_in_and_positions_start_from_the_present_one(mode):
    one = drive("AK70-10", mode, offset=0.2)
    (name, *_), command = one.block.inputs, one["limits"][1] / 2
    one["position"] = 0.75
    for share in (0.0, 0.25, 1.0):
        one.arena[AUTHORITY] = share
        one.say(**{name: command})
        wanted = 0.75 + share * (command - 0.75) if name == "position_command" else share * command
        assert one[one.block.sent_name] == pytest.approx(wanted, abs=1.01 / one["written"][1])


@pytest.mark.parametrize("mode", ["current", "current_brake"])
def test_derating_by_watch_reduces_current(mode):
    one = drive("AK80-9", mode)
    one["limits"] = [*one["limits"][:2], 0.5]
    [(_, said)] = one.say(**{f"{mode}_command": 4.0})
    assert value_of(said) == 2000 and one.block.watched().law_limit == ("limits", 2)


@pytest.mark.parametrize("model", MODELS)
def test_position_moves_encode_speed_and_acceleration_in_tenths_within_limits(model):
    one = drive(model, "position_velocity")
    [(_, said)] = one.say(position_command=0.1)
    speed, acceleration = (int.from_bytes(said[i : i + 2], "big", signed=True) for i in (4, 6))
    turns = float(reference.turns(MODELS[model]))
    assert 0 < speed == int(turns * SLOW["velocity_limit"] / 10) and 0 < acceleration == int(
        turns * SLOW["acceleration"] / 10
    )


def test_an_example_of_the_manual_is_reproduced():
    """1000° at 10000 and 10000: 00989680 03E8 03E8; -4 A: FFFFF060; 5000: 00001388; 0.2: 00004E20; 600°: 005B8D80."""
    turns = float(reference.turns(MODELS["AK80-9"]))
    one = drive("AK80-9", "position_velocity", velocity_limit=10_000.1 / turns, acceleration=10_000.1 / turns)
    assert one.say(position_command=math.radians(1000.0) + 1e-12)[0][1].hex() == "0098968003e803e8"
    assert drive("AK80-9", "current").say(current_command=-4.0)[0][1].hex() == "fffff060"
    assert (
        drive("AK80-9", "velocity", velocity_limit=30.0).say(velocity_command=5000.001 / turns)[0][1].hex()
        == "00001388"
    )
    assert drive("AK80-9", "duty", duty_limit=0.5).say(duty_command=0.2)[0][1].hex() == "00004e20"
    assert drive("AK80-9", "position").say(position_command=math.radians(600.0) + 1e-12)[0][1].hex() == "005b8d80"
    assert frames.origin(104) == (0x568, True, b"\0") and frames.origin(104, permanent=True)[2] == b"\1"


@given(
    model=st.sampled_from(sorted(MODELS)),
    mode=st.sampled_from(MODES),
    codes=st.tuples(*[st.integers(-32768, 32767)] * 3),
    temperature=st.integers(-128, 127),
    error=st.integers(0, 255),
    invert=st.booleans(),
)
def test_a_status_is_decoded_as_by_the_reference(model, mode, codes, temperature, error, invert):
    one = drive(model, mode, invert=invert, offset=0.4)
    one.arena[AUTHORITY] = 0.0
    frame = reference.status(7, *codes, temperature, error)
    assert one.hear(*frame) == (IDLE if error == 0x77 else TAKEN)
    constant = MODELS[model].torque_constant
    wanted = reference.read_status(MODELS[model], constant, frame[1], sign=-1 if invert else 1, offset=0.4)
    promised = one.block.output_range()
    for name, x in zip(("position", "velocity", "current", "torque", "temperature"), wanted):
        assert abs(one[name] - x) <= 1e-11 * (1.0 + abs(x)) and one[name] in promised[name], name
    assert one["fault"] == (0 if error == 0x77 else error)


@given(
    identifier=st.one_of(
        st.integers(0, 2**32 - 1),
        st.integers(0, 2**29 - 1).map(lambda i: i | EXTENDED),
        st.integers(0, 0x3F).map(lambda kind: reference.identifier(kind, 7)),
    ),
    data=st.binary(max_size=64),
    length=st.integers(0, 255),
    mode=st.sampled_from(MODES),
)
def test_any_frame_changes_only_the_feedback(identifier, data, length, mode):
    one = drive("AK80-9", mode)
    before = one.arena.copy()
    answer = one.hear(identifier, data, length)
    assert answer in (FOREIGN, TAKEN, NOTED, COMMANDED, IDLE, MALFORMED)
    mine = np.zeros(len(before), bool)
    for name in ("position", "velocity", "torque", "current", "temperature", "fault", "notice"):
        mine[one.place[name]] = True
    assert not ((one.arena != before) & ~mine).any()


@pytest.mark.parametrize(
    "model, parameters, said",
    [
        ("AK80-8 V3.0", {}, r"rated and peak torque of AK80-8-V3\.0 are not published: pass limit= in N·m"),
        ("AK80-8 V3.0", {"limit": 64.0}, "within the range of AK80-8-V3.0, 63.414 N·m, got 64"),
        ("AK80-9", {"report_rate": 0.0}, "does not answer commands in servo mode: pass the report_rate"),
        ("AK80-9", {"report_rate": 15.0}, "timeout 0.1 s is shorter than two reports at report_rate 15 Hz"),
        (
            "AK80-9",
            {"mode": "velocity", "velocity_limit": 60.0},
            "velocity_limit 60 rad/s is outside the drive's range at the joint, ±55.4",
        ),
        (
            "AK80-64",
            {"mode": "position_velocity", "acceleration": 30.0},
            "acceleration must be between .* 25.5, .*AK80-64 .* got 30",
        ),
        ("AK80-9", {"mode": "torque"}, "mode: "),
        ("AK80-9", {"range": (0.0, 90.0)}, r"must be within ±55.85 rad, .* write \[0, 1.571\]"),
        ("AK80-9", {"range": (2.0, 1.0)}, "range must be the lowest and the highest angle"),
        (
            "AK80-9",
            {"mode": "velocity", "rms_mode": "saturate"},
            "'saturate' requires a current mode, but the mode is velocity",
        ),
        ("AK80-9", {"safe_stop": "damp"}, "safe_stop: "),
        (
            "AK80-9",
            {"safe_stop": "brake", "stop_current": 20.0},
            "stop_current must be at most the current of the limit, 9.524 A, got 20",
        ),
        ("AK10-9", {}, r"CubeMarsV3\('AK10-9-V3\.0'\).*CubeMars\('AK10-9-V2\.0'\).*CubeMarsServo"),
        ("XM430", {}, "'XM430' is not a CubeMars model"),
        ("AK80-9", {"limit": "most"}, "limit must be 'rated', 'peak' or a torque"),
        ("AK80-9", {"duty_limit": 1.5, "mode": "duty"}, "duty_limit: "),
    ],
)
def test_invalid_parameters_are_refused_with_reason(model, parameters, said):
    with pytest.raises(DiagramError, match=said):
        CubeMarsServo(model, **parameters)


@pytest.mark.parametrize("mode", MODES)
def test_a_command_that_is_not_proved_does_not_compile(mode):
    with Diagram("unproved", rate=200) as diagram:
        one = CubeMarsServo("AK80-9", mode=mode, name="one")
        name, *_ = one.inputs
        one(**{name: one.limits[1] * 1.001})
    with pytest.raises(DiagramError, match=f"one.*{name}"):
        compile(diagram)

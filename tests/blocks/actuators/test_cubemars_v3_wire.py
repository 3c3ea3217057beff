"""The bytes of V3.0 boards in force control: each field over its whole range, what is refused, what is heard, and what
a person feels.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.actuators import CubeMarsV3
from blocks.actuators.cubemars import models_v3
from blocks.actuators.mit_frames import ENABLE
from tests.blocks.actuators import cubemars_reference as reference
from tests.blocks.actuators.observer import worst
from tests.blocks.actuators.reference import exact_code
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

MODELS = {name: model for name, model in models_v3.MODELS.items() if not name.startswith("AKA")}  # with known ranges
NOTED, COMMANDED, IDLE = 2, 3, 7  # cext/abi.pxd
PERIOD, PERIOD_SLOT = 0.005, 3
FIELDS = ("position", "velocity", "stiffness", "damping", "torque")
RANGES = {name: reference.ranges(model) for name, model in MODELS.items()}


def wired(model, **parameters):
    """One whose law is not limited, where the fields are tried one by one."""
    limit = "peak" if MODELS[model].peak else MODELS[model].wire_torque * parameters.get("gear_ratio", 1.0)
    new = Wired(CubeMarsV3, model, **{"can_id": 7, "limit": limit, **parameters})
    new.arena[PERIOD_SLOT] = PERIOD
    return new


DRIVES = {name: wired(name) for name in MODELS}


def unlimited(model):
    new = Wired.again(DRIVES[model])
    new.arena[PERIOD_SLOT] = PERIOD
    new["limits"] = [*new["limits"][:5], 1e9, 1.0]
    return new


@given(data=st.data(), model=st.sampled_from(sorted(MODELS)))
def test_command_matches_reference_bytes_and_setpoint_within_one_code(data, model):
    drive, ranges = unlimited(model), RANGES[model]
    fields = {
        name: data.draw(st.floats(0.0 if name in ("stiffness", "damping") else -top, top), label=name)
        for name, top in zip(FIELDS, drive["limits"])
    }
    [(identifier, said)] = drive.say(**{f"{name}_command": x for name, x in fields.items()})
    assert identifier == EXTENDED | 0x807 and len(said) == 8
    nearly = any(
        abs(exact - round(exact)) < 1e-9
        for exact in (exact_code(fields[name], *ranges[name], reference.BITS[name]) for name in fields)
    )
    assert said == reference.force(ranges, **fields) or nearly or said[4] == 0xFE
    for name, x in reference.read_force(ranges, said).items():
        low, high = ranges[name]
        assert -1e-9 * high <= fields[name] - x <= (high - low) / (2 ** reference.BITS[name] - 1) * (1 + 1e-9) + 1e-9, (
            name
        )


@pytest.mark.parametrize("model", MODELS)
def test_every_field_saturates_at_its_ends_and_never_wraps(model):
    drive = unlimited(model)
    peak = drive["limits"][4] / MODELS[model].wire_torque
    for sign in (-1.0, 1.0):
        position, velocity, stiffness, damping, torque = (sign * x for x in drive["limits"][:5])
        [(_, said)] = drive.say(
            position_command=position,
            velocity_command=velocity,
            torque_command=torque,
            stiffness_command=max(stiffness, 0.0),
            damping_command=max(damping, 0.0),
        )
        codes = reference.force_codes(said)
        ends = {"position": 0xFFFF, "velocity": 0xFFF, "stiffness": 0xFFF, "damping": 0xFFF}
        assert {name: codes[name] for name in ends} == {
            name: end if sign > 0.0 else 0 for name, end in ends.items()
        } or said[4] == 0xFE
        assert abs(codes["torque"] - (1.0 + sign * peak) * 4095 / 2) <= 1.0


@pytest.mark.parametrize("invert", [False, True])
def test_a_mirrored_drive_is_commanded_mirrored(invert):
    drive = wired("AK70-9", invert=invert, offset=0.3)
    [(_, said)] = drive.say(position_command=0.5, velocity_command=2.0, torque_command=3.0)
    codes, (top, fastest, *_, strongest) = reference.force_codes(said), drive["wire"]
    sign = -1.0 if invert else 1.0
    for name, x, end, bits in (
        ("position", 0.8, top, 16),
        ("velocity", 2.0, fastest, 12),
        ("torque", 3.0, strongest, 12),
    ):
        assert abs(codes[name] - (1.0 + sign * x / end) * (2**bits - 1) / 2) <= 1.0, name


def test_the_largest_command_is_not_the_enable_frame_of_other_boards():
    drive = unlimited("AK80-9-V3.0")  # whose wire ends where its limit does
    limits = drive["limits"]
    [(_, said)] = drive.say(**{f"{name}_command": x for name, x in zip(FIELDS, limits)})
    assert said != ENABLE and said[:7] != ENABLE[:7]
    assert reference.force_codes(said) == {
        "stiffness": 0xFFF,
        "damping": 0xFFF,
        "position": 0xFFFE,
        "velocity": 0xFFF,
        "torque": 0xFFF,
    }


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_non_finite_command_makes_no_frame(field, bad):
    drive = Wired.again(DRIVES["AK70-9"])
    assert drive.say(**{f"{field}_command": bad}) == NOT_FINITE and drive["torque_sent"] == 0.0


@pytest.mark.parametrize("model", MODELS)
def test_a_command_past_its_limit_makes_no_frame(model):
    drive = unlimited(model)
    for name, top in zip(FIELDS, drive["limits"]):
        for x in (math.nextafter(top, math.inf), -math.nextafter(top, math.inf), 1e300):
            assert drive.say(**{f"{name}_command": x}) == OUT_OF_LIMITS, name
        drive[f"{name}_command"] = 0.0
    for share in (math.nan, -0.1, 1.0001):
        drive.arena[AUTHORITY] = share
        assert drive.say() == OUT_OF_LIMITS


@given(
    data=st.data(),
    model=st.sampled_from(sorted(MODELS)),
    invert=st.booleans(),
    offset=st.floats(-2.0, 2.0),
    ratio=st.floats(0.5, 3.0),
    codes=st.tuples(*[st.integers(-32768, 32767)] * 3),
    temperature=st.integers(-128, 127),
    error=st.integers(0, 255),
)
def test_a_status_is_decoded_as_by_the_reference(data, model, invert, offset, ratio, codes, temperature, error):
    """Within 1e-12 of the range. Every value is inside what the block promises; 0x77 is no error of a drive that is not
    commanded.
    """
    drive, found = wired(model, invert=invert, offset=offset, gear_ratio=ratio), MODELS[model]
    drive.arena[AUTHORITY] = 0.0
    frame = reference.status(7, *codes, temperature, error)
    assert drive.hear(*frame) == (IDLE if error == 0x77 else TAKEN)
    wanted = reference.read_status(
        found, found.torque_constant, frame[1], sign=-1 if invert else 1, offset=offset, ratio=ratio
    )
    promised = drive.block.output_range()
    for name, x in zip(("position", "velocity", "current", "torque", "temperature"), wanted):
        assert abs(drive[name] - x) <= 1e-11 * (1.0 + abs(x)) and drive[name] in promised[name], name
    assert drive["fault"] == (0 if error == 0x77 else error)


def test_status_range_exceeds_command_range():
    """± 3276.8° against ± 12.56 rad; and the reverse of a joint that turned too far is reported unchanged."""
    drive = Wired.again(DRIVES["AK10-9-V3.0"])
    drive.hear(*reference.status(7, position=-32768))
    assert (
        drive["position"] == pytest.approx(-math.radians(3276.8))
        and drive.block.command_limits()["position_command"].high == 12.56
    )


@pytest.mark.parametrize(
    "frame, answer",
    [
        (reference.status(8), FOREIGN),
        ((0x2907, bytes(8)), FOREIGN),
        ((EXTENDED | REMOTE | 0x2907, bytes(8)), FOREIGN),
        ((reference.identifier(0x29, 7), bytes(7)), MALFORMED),
        ((reference.identifier(0x29, 7), b""), MALFORMED),
        ((reference.identifier(0x29, 7), bytes(12)), MALFORMED),
        ((reference.identifier(0x2A, 7), bytes(4)), NOTED),
        ((reference.identifier(0x2C, 7), b"\xfa\xfb\xfc\xfd"), NOTED),
        ((reference.identifier(0x2C, 7), bytes(8)), MALFORMED),
        ((reference.identifier(0x2B, 7), bytes(8)), FOREIGN),
        ((reference.identifier(0x129, 7), bytes(8)), FOREIGN),
        ((EXTENDED | 0x290107, bytes(8)), FOREIGN),
        ((0x807, bytes(8)), FOREIGN),
        *(((reference.identifier(kind, 7), bytes(8)), COMMANDED) for kind in (0, 1, 2, 3, 4, 5, 6, 8, 15, 16)),
    ],
)
def test_frames_without_status_change_no_measurement(frame, answer):
    drive = Wired.again(DRIVES["AK70-9"])
    drive.arena[AUTHORITY] = 0.0
    before = drive.arena.copy()
    assert drive.hear(*frame) == answer and drive.arena.tobytes() == before.tobytes()


def test_commanded_drive_that_reports_disable_or_power_loss_faults_until_rearmed():
    for notice, frame in (
        (0x77, reference.status(7, error=0x77)),
        (0x2C, (reference.identifier(0x2C, 7), b"\xfa\xfb\xfc\xfd")),
    ):
        drive = Wired.again(DRIVES["AK70-9"])
        assert drive.hear(*frame) in (IDLE, NOTED) and drive["fault"] == notice
        assert drive.hear(*reference.status(7)) == TAKEN and drive["fault"] == notice, (
            "the next status does not hide it"
        )
        drive.hear(*reference.status(7, error=3))
        assert drive["fault"] == 3
        drive.arena[AUTHORITY] = 0.0
        assert drive.hear(*frame) in (IDLE, NOTED) and drive.hear(*reference.status(7)) == TAKEN and drive["fault"] == 0
        assert "disabled" in drive.block.fault_in_words(0x77) and "power" in drive.block.fault_in_words(0x2C)


@given(
    identifier=st.one_of(
        st.integers(0, 2**32 - 1),
        st.integers(0, 2**29 - 1).map(lambda i: i | EXTENDED),
        st.integers(0, 0x3F).map(lambda kind: reference.identifier(kind, 7)),
    ),
    data=st.binary(max_size=64),
    length=st.integers(0, 255),
)
def test_any_frame_changes_only_the_feedback(identifier, data, length):
    drive = Wired.again(DRIVES["AKE90-8"])
    before = drive.arena.copy()
    answer = drive.hear(identifier, data, length)
    assert answer in (FOREIGN, TAKEN, NOTED, COMMANDED, IDLE, MALFORMED)
    mine = np.zeros(len(before), bool)
    for name in ("position", "velocity", "torque", "current", "temperature", "fault", "notice"):
        mine[drive.place[name]] = True
    assert not ((drive.arena != before) & ~mine).any()
    if answer in (TAKEN, IDLE):
        assert length == 8 and identifier == reference.identifier(0x29, 7)
        promised = drive.block.output_range()
        assert all(
            drive[name] in promised[name]
            for name in ("position", "velocity", "torque", "current", "temperature", "fault")
        )


@given(data=st.data(), model=st.sampled_from(sorted(MODELS)), share=st.sampled_from([1.0, 0.3, 0.05]))
def test_the_law_stays_within_the_limit_over_every_motion_until_a_late_frame(data, model, share):
    """Of the received feedback, which is coarser than a command: the joint is within one of its codes."""
    drive = Wired.again(DRIVES[model])
    drive.arena[PERIOD_SLOT] = PERIOD
    most = share * drive["limits"][4]
    drive["limits"] = [*drive["limits"][:4], most, most, 1.0]
    true_position = data.draw(st.floats(-14.0, 14.0), label="position")
    true_velocity = data.draw(st.floats(-drive["wire"][1], drive["wire"][1]), label="velocity")
    scales = drive["scales"]
    drive.hear(
        *reference.status(7, position=round(true_position / scales[0]), velocity=round(true_velocity / scales[1]))
    )
    age = drive["age"] = data.draw(st.floats(0.0, 2.0 * PERIOD), label="age")
    commands = {
        name: data.draw(st.floats(*((0.0, top) if name in ("stiffness", "damping") else (-top, top))), label=name)
        for name, top in zip(FIELDS, drive["limits"])
    }
    [(_, said)] = drive.say(**{f"{name}_command": x for name, x in commands.items()})
    understood = reference.read_force(RANGES[model], said)
    largest = worst(
        [understood[name] for name in FIELDS], true_position, true_velocity, age, PERIOD, drive["max_acceleration"]
    )
    assert largest <= most + 2.0 * MODELS[model].wire_torque / 4095


@pytest.mark.parametrize("age, kept", [(2.0 * PERIOD, True), (2.1 * PERIOD, False), (math.nan, False)])
def test_stiffness_is_zero_with_reports_slower_than_every_second_tick(age, kept):
    drive = Wired.again(DRIVES["AK80-9-V3.0"])
    drive.arena[PERIOD_SLOT] = PERIOD
    drive["age"] = age
    [(_, said)] = drive.say(stiffness_command=20.0, damping_command=1.0, torque_command=3.0)
    understood = reference.read_force(RANGES["AK80-9-V3.0"], said)
    assert (understood["stiffness"] > 19.0) == kept and drive["limited"] == (not kept)
    assert understood["torque"] == pytest.approx(3.0, abs=36.0 / 4095)

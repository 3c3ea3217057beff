"""The emulated boards in extended frames: what they hear, what torque they give, when they report, and what, byte for
byte.
"""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.actuators import EmulatedCubeMarsServo, EmulatedCubeMarsV3
from blocks.actuators.cubemars import models
from blocks.actuators.cubemars.models_v3 import MODELS
from blocks.actuators.mit_frames import ENABLE
from tests.blocks.actuators import cubemars_reference as reference
from tests.blocks.actuators.wire import EXTENDED, FOREIGN, MALFORMED, NOT_FINITE, REMOTE, TAKEN, Wired

STILL = {"position": 0.0, "velocity": 0.0, "temperature": 30.0, "fault": 0}
V3, MIT = "AK80-9-V3.0", "AK80-9"
DT = 2  # slot of cext/abi.pxd

kept = {}


def board(kind=EmulatedCubeMarsV3, model=V3, **parameters):
    """A fresh one, healthy, still, with 1 kHz; those without parameters of their own answer each command."""
    default = {} if kind is EmulatedCubeMarsServo and model == MIT else {"report_rate": 0.0}
    key = (kind, model, *sorted(parameters.items()))
    if key not in kept:
        kept[key] = Wired(kind, model, can_id=7, **{**default, **parameters})
    wired = Wired.again(kept[key])
    for name, value in STILL.items():
        wired[name] = value
    wired.arena[DT] = 0.001
    return wired


def told(wired, kind, data):
    assert wired.hear(reference.identifier(kind, 7), data) == TAKEN


def force(model=V3, **fields):
    return reference.force(
        reference.ranges(MODELS[model]),
        **{**dict.fromkeys(("position", "velocity", "stiffness", "damping", "torque"), 0.0), **fields},
    )


def torque(wired, **state):
    wired.step(**state)
    return wired["torque"]


@given(
    model=st.sampled_from(sorted(MODELS)),
    position=st.floats(-100.0, 100.0),
    velocity=st.floats(-300.0, 300.0),
    temperature=st.integers(-200, 200),
    error=st.integers(0, 255),
    invert=st.booleans(),
)
def test_report_matches_reference_bytes_and_saturates(model, position, velocity, temperature, error, invert):
    wired, found = board(model=model, invert=invert), MODELS[model]
    told(wired, 8, force(model))
    [(identifier, data)] = wired.say(position=position, velocity=velocity, temperature=temperature, fault=error)
    sign = -1.0 if invert else 1.0
    exact = (sign * math.degrees(position) * 10, sign * velocity * float(reference.turns(found)) / 10)
    codes = [min(max(math.floor(x + 0.5), -32768), 32767) for x in exact]
    wanted = reference.status(7, *codes, 0, min(max(temperature, -128), 127), error)
    nearly = any(abs(x + 0.5 - round(x + 0.5)) < 1e-6 for x in exact)
    assert identifier == wanted[0] and (data == wanted[1] or nearly), (data.hex(), wanted[1].hex())


def test_a_report_has_the_current_of_its_torque():
    wired = board(invert=True)
    told(wired, 8, force(torque=-5.0))
    assert torque(wired) == pytest.approx(5.0, abs=36.0 / 4095)
    [(_, data)] = wired.say()
    assert struct.unpack(">h", data[4:6])[0] / 100 == pytest.approx(-wired["torque"] / 0.5701, abs=0.0051)


def test_drive_replies_to_each_command_or_reports_periodically():
    wired = board()
    assert wired.say() == []
    for count in (1, 3):
        for _ in range(count):
            told(wired, 8, force())
        assert len(wired.say()) == count and wired.say() == []
    wired = board(report_rate=200.0)
    reports = []
    for tick in range(100):
        wired.arena[0] = tick / 1000
        told(wired, 8, force())
        wired.step()
        reports += [tick] * len(wired.say())
    assert reports == list(range(0, 100, 5))


def test_emulated_force_control_needs_no_enable_unless_configured():
    wired = board()
    assert torque(wired) == 0.0 and wired["enabled"] == 0.0
    told(wired, 8, force(torque=5.0))
    assert torque(wired) == pytest.approx(5.0, abs=0.01) and wired["enabled"] == 1.0
    told(wired, 8, ENABLE)
    assert torque(wired) > 17.9, "to a board that does not know it, enable is everything at its top"
    wired = board(enter=True)
    told(wired, 8, force(torque=5.0))
    assert torque(wired) == 0.0
    told(wired, 8, ENABLE)
    assert torque(wired) == 0.0 and wired["enabled"] == 1.0
    told(wired, 8, force(torque=5.0))
    assert torque(wired) == pytest.approx(5.0, abs=0.01)


def test_a_disable_removes_the_torque_and_only_the_next_report_confirms_it():
    wired = board()
    told(wired, 8, force(torque=5.0))
    wired.step()
    wired.say()
    told(wired, 15, b"")
    assert torque(wired) == 0.0 and wired["enabled"] == 0.0
    assert [data[7] for _, data in wired.say()] == [0x77]
    told(wired, 1, bytes(4))
    assert [data[7] for _, data in wired.say()] == [0]


@given(
    data=st.data(),
    model=st.sampled_from(sorted(MODELS)),
    position=st.floats(-12.0, 12.0),
    velocity=st.floats(-20.0, 20.0),
)
def test_torque_follows_manual_law_up_to_peak(data, model, position, velocity):
    wired, ranges = board(model=model), reference.ranges(MODELS[model])
    fields = {name: data.draw(st.floats(*ranges[name]), label=name) for name, _ in reference.FORCE}
    sent = reference.force(ranges, **fields)
    heard = reference.read_force(ranges, sent)
    told(wired, 8, sent)
    terms = (
        heard["stiffness"] * (heard["position"] - position),
        heard["damping"] * (heard["velocity"] - velocity),
        heard["torque"],
    )
    peak = wired["peak"]
    assert abs(torque(wired, position=position, velocity=velocity) - min(max(sum(terms), -peak), peak)) <= 1e-9 * sum(
        map(abs, terms)
    )


@pytest.mark.parametrize(
    "kind, model", [(EmulatedCubeMarsV3, V3), (EmulatedCubeMarsServo, MIT), (EmulatedCubeMarsServo, V3)]
)
def test_servo_mode_gives_the_torque_of_its_commands(kind, model):
    wired = board(kind, model)
    constant = MODELS[model].torque_constant if model == V3 else models.MODELS[model].torque_constant
    told(wired, 1, struct.pack(">i", -4000))
    assert torque(wired) == pytest.approx(-4.0 * constant)
    told(wired, 2, struct.pack(">i", 2000))
    for velocity in (100.0, -100.0):
        assert torque(wired, velocity=velocity) == pytest.approx(math.copysign(2.0 * constant, -velocity))
    assert torque(wired, velocity=0.0) == 0.0
    told(wired, 3, struct.pack(">i", 5000))
    turns = 30.0 / math.pi * 9 * 21
    assert (
        torque(wired, velocity=5000 / turns) == pytest.approx(0.0, abs=1e-9)
        and torque(wired, velocity=4900 / turns) > 0.0
    )
    told(wired, 4, struct.pack(">i", 900_000))
    assert (
        torque(wired, position=math.pi / 2, velocity=0.0) == pytest.approx(0.0, abs=1e-9)
        and torque(wired, position=1.57) > 0.0
    )
    told(wired, 0, struct.pack(">i", 50_000))
    assert torque(wired, velocity=0.0) > 0.0 and torque(wired, velocity=60.0) < 0.0
    told(wired, 1, bytes(4))
    assert torque(wired, velocity=0.0) == 0.0


def test_speed_limits_of_position_moves_are_in_units_of_ten():
    wired = board()
    turns = 30.0 / math.pi * 9 * 21
    # 1000 and 10 000 electrical revolutions a minute (a second)
    told(wired, 6, struct.pack(">ihh", 3_600_000, 100, 1000))
    for _ in range(200):
        wired.step(velocity=0.0)
    assert wired["torque"] == pytest.approx(5.0 * 1000 / turns)  # gain times what is left of the speed
    wired = board()
    told(wired, 6, struct.pack(">ihh", 3_600_000, 100, 1000))
    wired.step(velocity=0.0)
    assert wired["torque"] == pytest.approx(5.0 * 10_000 / turns * 0.001)


def test_the_origin_makes_the_present_position_zero():
    wired = board()
    wired["position"] = 2.0
    told(wired, 5, b"\0")
    [(_, data)] = wired.say(position=2.5)
    assert struct.unpack(">h", data[:2])[0] == round(math.degrees(0.5) * 10)


def test_power_loss_resets_drive_and_is_reported():
    wired = board()
    told(wired, 8, force(torque=5.0))
    wired.step(power_lost=True)
    assert wired["torque"] == 0.0 and wired["enabled"] == 0.0 and wired.say() == []
    assert wired.hear(reference.identifier(8, 7), force(torque=5.0)) == TAKEN
    wired.step()
    assert wired["torque"] == 0.0
    wired.step(power_lost=False)
    assert wired.say() == [(reference.identifier(0x2C, 7), b"\xfa\xfb\xfc\xfd")] and wired["torque"] == 0.0


def test_drive_with_fault_or_overheated_has_no_torque_and_reports_it():
    wired = board(trip_temperature=90.0)
    for state, code in (({"fault": 4}, 4), ({"fault": 0, "temperature": 95.0}, 1)):
        told(wired, 8, force(torque=5.0))
        assert torque(wired, **state) == 0.0
        assert [data[7] for _, data in wired.say()] == [code]


def test_reply_id_delay_and_silence_can_be_emulated():
    wired = board()
    told(wired, 8, force())
    assert [i for i, _ in wired.say(wrong_id=9)] == [reference.identifier(0x29, 9)]
    wired["wrong_id"] = 0
    told(wired, 8, force())
    assert wired.say(silent=True) == []
    wired["silent"], wired["delay"] = False, 0.01
    told(wired, 8, force())
    assert wired.say() == []
    wired.arena[0] = 0.011
    assert len(wired.say()) == 1


@pytest.mark.parametrize(
    "identifier, data, answer",
    [
        (reference.identifier(8, 8), bytes(8), FOREIGN),
        (0x807, bytes(8), FOREIGN),
        (EXTENDED | REMOTE | 0x807, bytes(8), FOREIGN),
        *((reference.identifier(kind, 7), bytes(8), FOREIGN) for kind in (7, 16, 0x29)),
        (reference.identifier(8, 7), bytes(7), MALFORMED),
        (reference.identifier(15, 7), bytes(8), MALFORMED),
        *((reference.identifier(kind, 7), bytes(length), MALFORMED) for kind, length in ((1, 8), (5, 4), (6, 4))),
    ],
)
def test_foreign_or_malformed_frames_are_ignored(identifier, data, answer):
    wired = board()
    before = wired.arena.copy()
    assert wired.hear(identifier, data) == answer and wired.arena.tobytes() == before.tobytes() and wired.say() == []


def test_boards_v1_and_v2_ignore_force_control_and_disable():
    wired = board(EmulatedCubeMarsServo, MIT)
    assert wired.hear(reference.identifier(8, 7), bytes(8)) == wired.hear(reference.identifier(15, 7), b"") == FOREIGN


@pytest.mark.parametrize("port", ["position", "velocity", "temperature"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_diverged_plant_sends_no_reply(port, bad):
    wired = board()
    told(wired, 8, force())
    assert wired.say(**{port: bad}) == NOT_FINITE


@given(kind=st.integers(0, 20), data=st.binary(max_size=64), length=st.integers(0, 64))
def test_torque_is_finite_and_within_peak_for_any_frame(kind, data, length):
    wired = board()
    wired.hear(reference.identifier(kind, 7), data, length)
    for velocity in (0.0, 30.0, -1e6):
        assert abs(torque(wired, velocity=velocity)) <= wired["peak"]
    wired.say()

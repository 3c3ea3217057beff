"""RobStride's MIT protocol: the bytes against the slow reference, over every field of every model that has it."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.actuators import RobStrideMIT
from blocks.actuators.robstride import mit
from blocks.actuators.robstride.family import FAMILY
from blocks.actuators.robstride.models import MIT_FIRMWARE, MODELS
from graph import DiagramError
from tests.blocks.actuators import reference
from tests.blocks.actuators.robstride_reference import ranges
from tests.blocks.actuators.wire import EXTENDED, FOREIGN, MALFORMED, NOT_FINITE, OUT_OF_LIMITS, REMOTE, TAKEN, Wired
from tests.soaking import soaked

NAMES = list(MIT_FIRMWARE)
FIELDS = tuple(name for name, _ in reference.FIELDS)
models = pytest.mark.parametrize("model", NAMES)
few = pytest.mark.parametrize("model", soaked(NAMES, but=[0, 8]))


def drive(model, **parameters):
    """A drive whose commands may be as wide as its wire, and whose feedback is too new to scale anything."""
    wired = Wired(RobStrideMIT, model, **parameters)
    wired["limits"] = [*wired["wire"], 1e9, 1.0][: len(wired["limits"])]
    return wired


DRIVES = {name: drive(name) for name in NAMES}
RANGES = {name: ranges(mit.find(name)) for name in NAMES}


def say(wired, **fields):
    ((identifier, data),) = wired.say(**{f"{name}_command": fields.get(name, 0.0) for name in FIELDS})
    assert identifier == wired["can_id"]
    return data


@given(data=st.data(), model=st.sampled_from(NAMES))
def test_commands_encode_as_reference_and_decode_within_one_code(data, model):
    limits = RANGES[model]
    fields = {name: data.draw(st.floats(*limits[name]), label=name) for name in FIELDS}
    sent = say(DRIVES[model], **fields)
    for name, code in reference.codes_of(sent).items():
        exact = reference.exact_code(fields[name], *limits[name], reference.BITS[name])
        moved = name == "position" and sent[:6] == b"\xff\xfe" + b"\xff" * 4
        assert moved or code == int(exact) or abs(exact - round(exact)) < 1e-9 and abs(code - exact) < 1.0 + 1e-9, name
    for name, x in reference.read_command(limits, sent).items():
        low, high = limits[name]
        assert -1e-9 * high <= fields[name] - x <= (high - low) / (2 ** reference.BITS[name] - 1) * 2.0, name


@few
def test_no_command_starts_with_six_bytes_of_ones(model):
    """Those set a drive up: they enable and disable it, and change its id, its protocol, its host."""
    limits = RANGES[model]
    top = {name: limits[name][1] for name in FIELDS}
    low, high = limits["torque"]
    for code in range(4096):
        torque = min(low + (code + 0.5) * (high - low) / 4095, high)
        data = say(DRIVES[model], **{**top, "torque": torque})
        assert data[:2] == b"\xff\xfe" and reference.codes_of(data)["torque"] == code
    assert say(DRIVES[model], **{**top, "position": 0.0})[:2] == b"\x7f\xff"


@models
def test_values_beyond_the_range_never_wrap_and_nan_is_rejected(model):
    limits, wired = RANGES[model], drive(model)
    wired["limits"] = wired["limits"] * 1e6  # no command reaches the wire like this: the last line of defence alone
    for name, bits in reference.FIELDS:
        low, high = limits[name]
        for x in (high, math.nextafter(high, math.inf), high * 1.0001, high * 2.0, high * 1e5):
            assert reference.codes_of(say(wired, **{name: x}))[name] == 2**bits - 1, (name, x)
        for x in () if low == 0.0 else (low, math.nextafter(low, -math.inf), low * 1.0001, low * 2.0, low * 1e5):
            assert reference.codes_of(say(wired, **{name: x}))[name] == 0, (name, x)
        for bad in (math.nan, math.inf, -math.inf):
            fresh = Wired.again(DRIVES[model])
            assert fresh.say(**{f"{name}_command": bad}) == NOT_FINITE and fresh.frames[0].length == 0
    plain = Wired(RobStrideMIT, model)
    assert plain.say(torque_command=MODELS[model].rated) != OUT_OF_LIMITS
    assert plain.say(torque_command=math.nextafter(MODELS[model].rated, math.inf)) == OUT_OF_LIMITS


@given(data=st.data(), model=st.sampled_from(NAMES), temperature=st.integers(-400, 1500))
def test_a_reply_is_decoded_as_the_reference_does(data, model, temperature):
    wired, limits = DRIVES[model], RANGES[model]
    p, v, t = (data.draw(st.integers(0, top)) for top in (65535, 4095, 4095))
    body = bytes([127, p >> 8, p & 255, v >> 4, (v & 15) << 4 | t >> 8, t & 255]) + struct.pack(">h", temperature)
    assert wired.hear(0xFD, body) == TAKEN
    for name, code in (("position", p), ("velocity", v), ("torque", t)):
        assert abs(wired[name] - reference.value(code, *limits[name], reference.BITS[name])) < 1e-12 * limits[name][1]
    assert abs(wired["temperature"] - temperature / 10) < 1e-9 and wired["fault"] == 0


@pytest.mark.parametrize(
    "identifier, data, answer",
    [
        (0xFD, b"\x7e" + bytes(7), FOREIGN),
        (0xFD, b"", FOREIGN),
        (0xFC, b"\x7f" + bytes(7), FOREIGN),
        (0xFD | EXTENDED, b"\x7f" + bytes(7), FOREIGN),
        (0xFD | REMOTE, b"\x7f" + bytes(7), FOREIGN),
        (0x7F, b"\x7f" + bytes(7), FOREIGN),
        (0xFD, b"\x7f" + bytes(6), MALFORMED),
        (0xFD, b"\x7f" + bytes(8), MALFORMED),
        (0xFD, b"\x7f", MALFORMED),
    ],
)
def test_drives_with_one_host_id_ignore_foreign_and_corrupt_frames(identifier, data, answer):
    wired = Wired.again(DRIVES["RS03"])
    before = wired.arena.copy()
    assert wired.hear(identifier, data) == answer and wired.arena.tobytes() == before.tobytes()


def test_arming_disables_selects_operation_and_enables():
    block = RobStrideMIT("RS03", can_id=5)
    to_drive = [data for identifier, _, data in block.set_up_frames() if identifier == 5]
    assert to_drive == [mit.DISABLE, mit.OPERATION, mit.FAULTS]
    assert block.enable_frames() == [(5, False, mit.ENABLE)] and block.ask_frames() == [(5, False, mit.DISABLE)]
    frames = block.set_up_frames() + block.enable_frames() + block.zero_frames() + block.disable_frames()
    assert {(identifier, extended) for identifier, extended, _ in frames} == {
        (5, False),
        (0x305, False),
        (0x405, False),
    }
    assert block.reply_frames() == [(0xFD, 0x7FF, False, b"\5")], "the guardian tells drives apart by their first byte"
    with pytest.raises(DiagramError, match="the CyberGear has no MIT protocol: use RobStride"):
        RobStrideMIT("CyberGear")
    with pytest.raises(DiagramError, match="can_id and host_id are both 5"):
        RobStrideMIT("RS03", can_id=5, host_id=5)


@pytest.mark.parametrize("host_id", [0, 5, 0xFD])
def test_the_stop_query_of_a_block_reads_replies_from_its_host_id_only(host_id):
    block = RobStrideMIT("RS03", can_id=7, host_id=host_id)
    query = FAMILY.stop_query(block)
    reply = bytes.fromhex("077fff7ff7ff012c")
    read = {identifier for identifier in range(0x100) if query.read(identifier, False, reply) is not None}
    assert (query.frame, read) == ((7, False, mit.DISABLE), {host_id}) and query.read(host_id, True, reply) is None

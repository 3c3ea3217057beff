"""AS5047 and AS5048A: frames of the data sheets, corrupt replies, an emulated chip behind the bus, and runs."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.logic import Compare
from blocks.sensors import AS5047, AS5048A, EmulatedAS5047, EmulatedAS5048A
from blocks.sensors.as504x import EmulatedRegisters, with_parity, words
from blocks.sources import Sine
from graph import Diagram
from tests.blocks.actuators.wire import EXTENDED, FOREIGN, MALFORMED, NOT_FINITE, TAKEN, Wired
from tests.blocks.running import run

NOTED, TROUBLE = 2, 15
CHIPS = {AS5047: EmulatedAS5047, AS5048A: EmulatedAS5048A}
WIRED = {}


def wired(kind, **parameters):
    key = kind, *parameters.items()
    return Wired.again(WIRED.setdefault(key, Wired(kind, **parameters)))


def reply(code, diagnostics=0x180, errors=0):
    return b"".join(with_parity(word).to_bytes(2, "big") for word in (errors, code, diagnostics))


def identifier(transfer=0, chip_select=0):
    return EXTENDED | transfer << 16 | chip_select


def test_commands_are_those_of_the_data_sheets():
    with Diagram("robot", rate=200):
        commands = {kind: words(kind(bus="a", chip_select=n).sample.data) for n, kind in enumerate(CHIPS)}
        commands["uncompensated"] = words(AS5047(bus="b", compensated=False).sample.data)
    # read ANGLE is 0xFFFF and clear error flag 0x4001 (AS5048, SPI communication); DIAAGC is 0x3FFC or 0x3FFD
    assert commands[AS5048A] == [0xFFFF, 0x7FFD, 0x4001]
    assert commands[AS5047] == [0xFFFF, 0xFFFC, 0x4001]
    assert commands["uncompensated"] == [0x7FFE, 0xFFFC, 0x4001]


@pytest.mark.parametrize("kind", CHIPS)
def test_codes_directions_offsets_and_the_field(kind):
    plain, turned = wired(kind), wired(kind, invert=True, offset=-0.5)
    # diagnostics: offset compensated 0x100, overflow 0x200, strong field 0x400, weak 0x800, gain below
    for code in (0, 1, 4096, 8191, 8193, 16383):
        for diagnostics, magnet in ((0x180, 0), (0x9FF, 1), (0x500, 2)):
            for encoder in (plain, turned):
                assert encoder.hear(identifier(), reply(code, diagnostics)) == TAKEN
                assert (encoder["counts"], encoder["magnet"]) == (code, magnet)
        angle = math.tau * code / 16384
        assert plain["position"] == pytest.approx(math.remainder(angle, math.tau), abs=1e-12)
        assert turned["position"] == pytest.approx(math.remainder(0.5 - angle, math.tau), abs=1e-12)
    for diagnostics in (0x000, 0x080, 0x200, 0x380, 0xE80):
        assert plain.hear(identifier(), reply(7, diagnostics)) == NOTED
        assert (plain["magnet"], plain["counts"], plain["errors"]) == (3, 16383, 0)  # the last angle stays
    assert plain.hear(identifier(), reply(7)[:-1]) == MALFORMED
    assert plain.hear(identifier(chip_select=1), reply(7)) == FOREIGN


@pytest.mark.parametrize("kind", CHIPS)
def test_every_inverted_bit_of_a_reply_is_refused_and_counted(kind):
    encoder, refused = wired(kind), 0
    for code in (0, 0x1555, 0x2AAA, 0x3FFF):
        assert encoder.hear(identifier(), reply(code)) == TAKEN
        before = encoder["position"]
        for bit in range(48):
            data = bytearray(reply(code ^ 0x0F0F))
            data[bit // 8] ^= 1 << bit % 8
            assert encoder.hear(identifier(), bytes(data)) == NOTED
            refused += 1
            assert (encoder["position"], encoder["counts"], encoder["errors"]) == (before, code, refused)
    for word in range(3):  # an error bit with its right parity
        data = bytearray(reply(9))
        data[2 * word : 2 * word + 2] = with_parity((words(reply(9))[word] & 0x7FFF) | 0x4000).to_bytes(2, "big")
        assert encoder.hear(identifier(), bytes(data)) == NOTED
    assert encoder.hear(identifier(TROUBLE), b"\x00\x05\x01\x00\x00") == NOTED
    assert encoder["errors"] == 261 + refused + 3  # failed transfers and refused replies
    for data in (b"\x00" * 6, b"\xff" * 6):  # a line that is held
        assert encoder.hear(identifier(), data) == NOTED and encoder["counts"] == 0x3FFF


@given(st.sampled_from(list(CHIPS)), st.binary(max_size=64), st.sampled_from([0, 1, TROUBLE]))
def test_any_frame_leaves_outputs_within_the_declared_range(kind, data, transfer):
    encoder = wired(kind)
    before = encoder.arena.copy()
    if encoder.hear(identifier(transfer), data) in (FOREIGN, MALFORMED):
        assert np.array_equal(before, encoder.arena, equal_nan=True)
    for name, interval in encoder.block.output_range().items():
        assert interval.low <= encoder[name] <= interval.high, name


@given(st.sampled_from(list(CHIPS)), st.floats(-20.0, 20.0), st.booleans(), st.integers(0, 3))
def test_a_chip_behind_the_bus_replies_one_frame_later(kind, position, invert, magnet):
    encoder, emulated = wired(kind, invert=invert), wired(CHIPS[kind], invert=invert)
    [(number, answer)] = emulated.say(position=position, magnet=magnet)
    chip, sent = encoder.block.chip(), encoder.block.sample.data
    assert encoder.hear(number, chip.shift(sent, answer)) == (NOTED if magnet == 3 else TAKEN)
    if magnet != 3:
        error = math.remainder(encoder["position"] - position, math.tau)
        assert abs(error) <= math.pi / 16384 + 1e-9 and encoder["magnet"] == magnet
    assert emulated.say(position=math.nan) == NOT_FINITE


def test_an_emulated_chip_sets_and_clears_its_error_bit():
    chip, answer = EmulatedRegisters(0x3FFF, 0x3FFC), reply(0x1234)
    read, errors = 0xFFFF, 0x4001

    def ask(*commands):
        return words(chip.shift(b"".join(command.to_bytes(2, "big") for command in commands), answer))

    assert ask(read, read, errors) == [0, words(answer)[1], words(answer)[1]]
    assert ask(read ^ 1, read, errors)[1:] == [0xC000, 0xC000]  # until the error register is read
    assert ask(read, errors)[0] == with_parity(4)  # a wrong parity
    assert ask(with_parity(0x4000 | 0x123), errors, read)[1:] == [0xC000, with_parity(2)]  # an unknown register


def robot(kind, corrupt_above, **faults):
    with Diagram("joint", rate=200) as diagram:
        encoder = kind(bus="joint", chip_select=1, invert=True, offset=0.25, name="encoder")
        kind(bus="joint", name="other", timeout=0.0)
    with Diagram("plant", rate=1000) as plant:
        position = Sine(amplitude=0.5, frequency=1.0, unit="rad")()
        corrupt = Compare(">")(position, corrupt_above)
        encoder.emulator(name="emulated")(position=position, corrupt=corrupt, **faults)
    return diagram, plant


@pytest.mark.parametrize("kind", CHIPS)
def test_a_run_reads_the_joint_and_ends_without_valid_angles(kind):
    diagram, plant = robot(kind, 10.0)
    recording = run(diagram, 200, plant=plant, substeps=5)
    assert recording.outcome.status == "ok"
    truth = 0.5 * np.sin(2.0 * math.pi * recording.time)
    assert np.abs(recording["encoder.position"][20:] - truth[20:]).max() < 0.5 * math.tau * 0.006 + 0.002
    for faults in ({"magnet": 3}, {"silent": True}, {"wrong_address": 2}):
        diagram, plant = robot(kind, 10.0, **faults)
        assert run(diagram, 200, plant=plant, substeps=5).outcome.status != "ok", faults
    diagram, plant = robot(kind, 0.4)  # from 0.147 s on
    recording = run(diagram, 200, plant=plant, substeps=5)
    assert recording.outcome.status != "ok" and 0.23 < recording.time[-1] < 0.28
    assert recording["encoder.errors"].max() >= 15 and recording["encoder.position"].max() < 0.41

"""AS5600 and AS5048B: registers as in the data sheets, readings without an angle, and runs with the emulated chips."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.logic import Compare, Debounce
from blocks.mathematics import Abs
from blocks.safety import EmergencyStop
from blocks.sensors import AS5048B, AS5600, EmulatedAS5048B, EmulatedAS5600
from blocks.sources import Sine
from graph import Diagram
from tests.blocks.actuators.wire import EXTENDED, FOREIGN, MALFORMED, NOT_FINITE, TAKEN, Wired
from tests.blocks.running import run

NOTED, TROUBLE = 2, 15
# (block, address, codes of a turn, registers of a code with a good, weak, strong and no magnet)
CHIPS = {
    AS5600: (0x36, 4096, lambda code, state: bytes([(0x20, 0x30, 0x28, 0x00)[state], code >> 8, code & 0xFF])),
    AS5048B: (0x40, 16384, lambda code, state: bytes([(1, 9, 5, 3)[state], 0x80, 0, code >> 6, code & 0x3F])),
}
EMULATED = {AS5600: EmulatedAS5600, AS5048B: EmulatedAS5048B}
WIRED = {}


def wired(kind, **parameters):
    key = kind, *parameters.items()
    return Wired.again(WIRED.setdefault(key, Wired(kind, **parameters)))


def identifier(transfer, address):
    return EXTENDED | transfer << 16 | address


@pytest.mark.parametrize("kind", CHIPS)
def test_codes_directions_offsets_and_the_magnet(kind):
    address, codes, registers = CHIPS[kind]
    plain, turned = wired(kind), wired(kind, invert=True, offset=-0.5)
    for code in (0, 1, codes // 4, codes // 2 - 1, codes // 2 + 1, codes - 1):
        for state in range(3):
            for encoder in (plain, turned):
                assert encoder.hear(identifier(0, address), registers(code, state)) == TAKEN
                assert (encoder["counts"], encoder["magnet"]) == (code, state)
            angle = math.tau * code / codes
            assert plain["position"] == pytest.approx(math.remainder(angle, math.tau), abs=1e-12)
            assert turned["position"] == pytest.approx(math.remainder(0.5 - angle, math.tau), abs=1e-12)
    assert plain.hear(identifier(0, address), registers(7, 3)) == NOTED
    assert plain["magnet"] == 3.0 and plain["counts"] == codes - 1  # the last angle stays
    assert plain.hear(identifier(0, address), registers(7, 0)[:-1]) == MALFORMED
    assert plain.hear(identifier(0, address + 1), registers(7, 0)) == FOREIGN
    assert plain.hear(identifier(TROUBLE, address), b"\x00\x05\x01\x00\x00") == NOTED and plain["errors"] == 261.0


def test_an_angle_before_the_offset_is_compensated_or_with_an_overflow_is_none():
    encoder = wired(AS5048B)
    for diagnostics, verdict in ((0, NOTED), (1, TAKEN), (2, NOTED), (3, NOTED), (0x0D, TAKEN)):
        assert encoder.hear(identifier(0, 0x40), bytes([diagnostics, 0, 0, 1, 1])) == verdict


@given(
    st.sampled_from(list(CHIPS)), st.floats(-20.0, 20.0), st.booleans(), st.sampled_from([0.0, 1.25]), st.integers(0, 2)
)
def test_an_emulated_encoder_is_read_to_half_a_code(kind, position, invert, offset, magnet):
    encoder = wired(kind, invert=invert, offset=offset)
    emulated = wired(EMULATED[kind], invert=invert, offset=offset)
    [reply] = emulated.say(position=position, magnet=magnet)
    assert encoder.hear(*reply) == TAKEN and encoder["magnet"] == magnet
    error = math.remainder(encoder["position"] - position, math.tau)
    assert abs(error) <= math.pi / CHIPS[kind][1] + 1e-9
    assert wired(EMULATED[kind]).say(position=math.inf) == NOT_FINITE


@given(
    st.sampled_from(list(CHIPS)), st.integers(0, 0xFFFFFFFF), st.binary(max_size=64), st.sampled_from([0, 1, TROUBLE])
)
def test_any_frame_leaves_outputs_within_the_declared_range(kind, number, data, transfer):
    encoder = wired(kind)
    for identity in (number, identifier(transfer, CHIPS[kind][0])):
        before = encoder.arena.copy()
        answer = encoder.hear(identity, data)
        if answer in (FOREIGN, MALFORMED):
            assert np.array_equal(before, encoder.arena, equal_nan=True)
        for name, interval in encoder.block.output_range().items():
            assert interval.low <= encoder[name] <= interval.high, name


def robot(kind, timeout=0.1, **faults):
    with Diagram("joint", rate=200) as diagram:
        encoder = kind(bus="joint", timeout=timeout, invert=True, offset=0.25, name="encoder")
    with Diagram("plant", rate=1000) as plant:
        position = Sine(amplitude=0.5, frequency=1.0, unit="rad")()
        encoder.emulator(name="emulated")(position=position, **faults)
    return diagram, plant


@pytest.mark.parametrize("kind", CHIPS)
def test_a_run_reads_the_joint_and_a_lost_magnet_ends_it(kind):
    diagram, plant = robot(kind)
    recording = run(diagram, 200, plant=plant, substeps=5)
    assert recording.outcome.status == "ok"
    truth = 0.5 * np.sin(2.0 * math.pi * recording.time)
    assert np.abs(recording["encoder.position"][20:] - truth[20:]).max() < 0.5 * math.tau * 0.006 + 0.002
    for faults in ({"magnet": 3}, {"silent": True}, {"wrong_address": 0x41}):
        diagram, plant = robot(kind, **faults)
        recording = run(diagram, 200, plant=plant, substeps=5)
        assert recording.outcome.status != "ok", faults


def test_two_encoders_that_differ_end_the_run():
    """The composition of docs/reference/i2c.md, with one encoder that sticks in motion."""
    for stuck in (False, True):
        with Diagram("joint", rate=200) as diagram:
            motor, joint = (AS5048B(bus="joint", address=0x40 + n, name=f"encoder{n}") for n in (0, 1))
            apart = Debounce(time=0.02)(Compare(">")(Abs()(joint.position - motor.position), 0.1))
            EmergencyStop()(apart)
        with Diagram("plant", rate=1000) as plant:
            position = Sine(amplitude=0.5, frequency=1.0, unit="rad")()
            motor.emulator(name="one")(position=position)
            joint.emulator(name="other")(position=position, stuck=stuck)
        recording = run(diagram, 200, plant=plant, substeps=5)
        assert (recording.outcome.status == "ok") != stuck

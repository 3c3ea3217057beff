"""ADS1115 and NAU7802: configurations and codes against other implementations, and what cannot be right."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.sensors import ADS1115, NAU7802, EmulatedADS1115, EmulatedNAU7802
from graph import Block, Diagram, DiagramError, Output, compile
from tests.blocks.actuators.wire import EXTENDED, FOREIGN, MALFORMED, NOT_FINITE, TAKEN, Wired
from tests.blocks.running import run
from tests.shared import entries

NOTED, TROUBLE = 2, 15
RANGES = {2 / 3: 6.144, 1: 4.096, 2: 2.048, 4: 1.024, 8: 0.512, 16: 0.256}  # V, by Adafruit's gain
CHANNELS = {0: "a0_a1", 4: "a0", 6: "a2"}  # by code of MUX


def identifier(transfer, address):
    return EXTENDED | transfer << 16 | address


@pytest.fixture(scope="module")
def converters():
    return {span: Wired(ADS1115, full_scale=span) for span in RANGES.values()}


@pytest.fixture(scope="module")
def amplifiers():
    return Wired(NAU7802, tare_at_start=False, capacity=50.0, sensitivity=0.002)


@pytest.fixture
def amplifier(amplifiers):
    return Wired.again(amplifiers)


def test_configuration_and_codes_match_another_implementation(converters):
    """Bytes alike; volts to 1e-12 of the range, which is what another order of the same operations may change."""
    seen = 0
    for entry in entries("peripherals"):
        if entry["kind"] != "ADS1115":
            continue
        given, code = entry["inputs"], bytes.fromhex(entry["conversion_register_hex"])
        span, name = RANGES[given["gain"]], CHANNELS[given["mux"]]
        converter = ADS1115(full_scale=span, rate=given["data_rate_sps"], channels=(name,))
        written = bytes.fromhex(entry["i2c_write_hex"])
        assert bytes((converter.start(name).register,)) + converter.start(name).data == written
        wired = Wired(ADS1115, full_scale=span, channels=(name,)) if name == "a0_a1" else Wired.again(converters[span])
        assert wired.hear(identifier(0, 0x48), code + written[1:]) == TAKEN
        assert wired[name] == pytest.approx(entry["decoded"]["volts"], rel=1e-12, abs=1e-12 * span)
        seen += 1
    assert seen > 100


def test_reply_identifies_its_device(converters):
    wired = Wired.again(converters[4.096])
    for name, code in (("a3", 1000), ("a0", -2000)):
        configuration = wired.block.configuration(name).to_bytes(2, "big")
        assert wired.hear(identifier(0, 0x48), code.to_bytes(2, "big", signed=True) + configuration) == TAKEN
    assert (
        wired["a3"] == pytest.approx(0.125, rel=1e-12)
        and wired["a0"] == pytest.approx(-0.25, rel=1e-12)
        and wired["a1"] == 0.0
    )


@pytest.mark.parametrize(
    "configuration, answer",
    [
        (0x43E3, NOTED),  # it converts still
        (0x8583, MALFORMED),  # what it has after power on: another range
        (0x93E3, MALFORMED),  # a difference that nobody has asked for
    ],
)
def test_conversion_with_other_configuration_is_discarded(converters, configuration, answer):
    wired = Wired.again(converters[4.096])
    assert wired.hear(identifier(0, 0x48), b"\x10\x00" + configuration.to_bytes(2, "big")) == answer
    assert all(wired[f"a{k}"] == 0.0 for k in range(4))


def test_each_conversion_is_read_after_its_longest_duration():
    """860 a second at 90 % of the clock, and 50 µs to wake up."""
    converter = ADS1115(channels=("a0", "a2_a3"))
    (cycle,) = converter.rounds()
    assert cycle.period == cycle.settle == pytest.approx(1.0 / 774.0 + 50e-6, rel=1e-12)
    assert [transfer.steps[2].data.hex() for transfer in cycle.transfers] == ["b3e3", "c3e3"]
    assert converter.set_up()[0].data.hex() == "c3e3" and converter.set_up()[0].wait == cycle.period


@pytest.mark.parametrize(
    "parameters, words",
    [
        ({"channels": ("a0", "a9")}, "unknown channel 'a9'"),
        ({"channels": ()}, "at least one channel"),
        ({"channels": ("a0", "a0")}, "without duplicates"),
        ({"full_scale": 5.0}, "must be one of"),
        ({"address": 0x50}, "address 0x50: the addresses of a ADS1115 are 0x48"),
    ],
)
def test_channels_that_it_does_not_have_are_refused(parameters, words):
    with pytest.raises(DiagramError, match=words):
        ADS1115(**parameters)


def test_counts_of_24_bits_read_as_by_other_implementations(amplifier):
    seen = 0
    for entry in entries("peripherals"):
        if entry["kind"] == "24-bit ADC":
            assert amplifier.hear(identifier(0, 0x2A), b"\x20" + bytes.fromhex(entry["data_hex"])) == TAKEN
            assert amplifier["counts"] == entry["decoded"]["raw"]
            seen += 1
    assert seen > 20


def test_the_force_of_a_load_cell_by_its_data_sheet(amplifier):
    """Half its signal is half its capacity: 1 mV/V · 2²⁴ · 128 counts."""
    counts = round(0.001 * 2**24 * 128)
    assert amplifier.hear(identifier(0, 0x2A), b"\x20" + counts.to_bytes(3, "big", signed=True)) == TAKEN
    assert amplifier["ratio"] == pytest.approx(0.001, rel=1e-6) and amplifier["force"] == pytest.approx(25.0, rel=1e-6)
    scaled = Wired(NAU7802, tare_at_start=False, scale=-2e-4)
    scaled.hear(identifier(0, 0x2A), b"\x20" + counts.to_bytes(3, "big", signed=True))
    assert scaled["force"] == pytest.approx(-2e-4 * counts, rel=1e-12)


def test_repeated_conversion_is_not_a_new_sample(amplifier):
    assert amplifier.hear(identifier(0, 0x2A), b"\x00\x10\x00\x00") == NOTED and amplifier["counts"] == 0


def test_tare_uses_first_samples_and_repeats_on_edge():
    wired = Wired(NAU7802, tare_time=0.1, rate=80, scale=0.01)  # 8 samples

    def hear(*counts):
        for count in counts:
            wired.hear(identifier(0, 0x2A), b"\x20" + count.to_bytes(3, "big", signed=True))
        return wired["force"]

    hear(*[1000, 1010] * 4)
    assert hear(1105) == pytest.approx(1.0, abs=1e-12) and hear(1005) == pytest.approx(0.0, abs=1e-12)
    wired["tare"] = 1.0
    hear(*[2000] * 8)
    assert hear(2100) == pytest.approx(1.0, abs=1e-12)  # still held: that is no second edge
    wired["tare"] = 0.0
    assert hear(2200) == pytest.approx(2.0, abs=1e-12)
    wired["tare"] = 1.0
    assert hear(3000) == 0.0


def test_the_registers_of_an_nau7802():
    """Reset, digital part, analogue part with its own supply, 3.0 V and gain 128, rate, chopper, capacitor,
    calibration, start.
    """
    amplifier = NAU7802(rate=320, gain=128, supply=3.0)
    assert [(write.register, *write.data) for write in amplifier.set_up()] == [
        (0x00, 0x01),
        (0x00, 0x02),
        (0x00, 0x86),
        (0x01, 0x2F),
        (0x02, 0x70),
        (0x15, 0x30),
        (0x1C, 0x80),
        (0x02, 0x74),
        (0x00, 0x96),
    ]
    assert amplifier.check() == (0x01, b"\x2f")
    with pytest.raises(ValueError, match="the internal calibration failed"):
        amplifier.learn(lambda register, count: b"\x78", None)


@given(number=st.integers(0, 0xFFFFFFFF), data=st.binary(max_size=64), transfer=st.integers(0, 15))
def test_any_frame_leaves_finite_outputs_within_the_declared_range(converters, amplifiers, number, data, transfer):
    for wired, address in ((Wired.again(converters[2.048]), 0x48), (Wired.again(amplifiers), 0x2A)):
        for identity in (number, identifier(transfer, address)):
            before = wired.arena.copy()
            answer = wired.hear(identity, data)
            assert answer in (FOREIGN, TAKEN, NOTED, MALFORMED)
            if answer in (FOREIGN, MALFORMED):
                assert np.array_equal(before, wired.arena, equal_nan=True)
            for name, interval in wired.block.output_range().items():
                assert interval.low <= wired[name] <= interval.high, name


@given(volts=st.lists(st.floats(-8.0, 8.0), min_size=4, max_size=4), span=st.sampled_from(sorted(RANGES.values())))
def test_an_emulated_converter_is_read_to_half_a_code(converters, volts, span):
    wired = Wired.again(converters[span])
    if span not in PLAYED:
        PLAYED[span] = Wired(EmulatedADS1115, full_scale=span)
    played = Wired.again(PLAYED[span])
    for k in range(4):
        played.arena[0] = 0.01 * k  # s
        (answer,) = played.say(**{f"a{n}": value for n, value in enumerate(volts)})
        assert wired.hear(*answer) == TAKEN
    for k in range(4):
        assert wired[f"a{k}"] == pytest.approx(max(-span, min(volts[k], span)), abs=1.01 * span / 32768)


PLAYED = {}


def test_an_emulated_amplifier_is_read_to_half_a_count(amplifier):
    played = Wired(EmulatedNAU7802)
    for k, ratio in enumerate((0.0, 0.0015, -0.0015, 1.0, -1.0)):
        played.arena[0] = 0.1 * k
        (answer,) = played.say(ratio=ratio)
        assert amplifier.hear(*answer) == TAKEN
        assert amplifier["ratio"] == pytest.approx(max(-0.5 / 128, min(ratio, 0.5 / 128)), abs=1.01 / (2**24 * 128))
    assert played.say(ratio=math.nan) == NOT_FINITE


class From(Block):
    """A fault, from 0.25 s on."""

    y = Output("1", dtype=bool)

    def step(self, t):
        return t >= 0.25


@pytest.mark.parametrize("kind", [ADS1115, NAU7802])
@pytest.mark.parametrize("fault, old", [("silent", True), ("not_ready", True), ("stuck", False)])
def test_faults_of_emulated_converters_take_effect(kind, fault, old):
    """The age of a silent or never ready sensor grows; a stuck sensor repeats its value at zero age."""

    class Wave(Block):
        y = Output("V" if kind is ADS1115 else "1")

        def step(self, t):
            return 0.001 * math.sin(20.0 * t)

    with Diagram("robot", rate=100) as robot:
        sensor = kind(name="sensor", timeout=0.0)
    with Diagram("plant", rate=1000) as plant:
        sensor.emulator()(Wave().y, **{fault: From().y})
    record = run(robot, 60, plant=plant, substeps=10)
    said = record["sensor.a0" if kind is ADS1115 else "sensor.ratio"]
    assert max(record["sensor.age"][5:24]) < 0.03 and len(set(said[5:24])) > 10
    assert (record["sensor.age"][-1] > 0.3) == old and len(set(said[28:])) == 1


def test_reply_from_other_address_is_treated_as_missing():
    played = Wired(EmulatedADS1115)
    (answer,) = played.say(wrong_address=0x49)
    assert answer[0] == identifier(0, 0x49)
    with Diagram("two", rate=100) as diagram:
        ADS1115(bus="imus")
        ADS1115(bus="imus", address=0x49)
        NAU7802(bus="imus")
    compile(diagram)

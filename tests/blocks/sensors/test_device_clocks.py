"""The clock of a device, mapped to the computer's: drift, counters that begin anew, and clocks that cannot be
believed.
"""

import binascii
import random
import struct

import numpy as np
import pytest

from blocks.sensors import Insole, Microcontroller
from graph import DiagramError
from runtime.setup.commissioning.guided.sensors import jumps_of
from tests.blocks.actuators.wire import TAKEN, Wired
from tests.blocks.sensors.test_insole import frame
from tests.blocks.sensors.test_microcontroller import packet

DELAY = 0.0008  # s, of the shortest way


@pytest.fixture(scope="module")
def microcontrollers():
    made = {}

    def fresh(kind="uint32", unit="s", scale=1e-6, **parameters):
        key = (kind, unit, scale, *parameters.items())
        if key not in made:
            made[key] = Wired(
                Microcontroller, fields=(("force", "float32", "N"), ("t", kind, unit, scale)), clock="t", **parameters
            )
        return Wired.again(made[key])

    return fresh


def hear(wired, number, count, came, layout="I"):
    """A packet whose clock shows `count`, at `came` s."""
    assert wired.hear(0, packet(number & 255, struct.pack("<f" + layout, 1.0, count)), time=round(came * 1e9)) == TAKEN
    return wired["sample_time"]


def errors(fresh, seconds, *, rate=100, drift=0.0, start=0.0, tick=1e-6, modulus=2**32, layout="I", **declared):
    """s by which sample_time is wrong, of each packet, and the reported drift. drift : by how much the device's
    clock is slower
    """
    wired, chance, found = fresh(**declared), random.Random(3), []
    for number in range(round(seconds * rate)):
        taken = 5.0 + number / rate
        count = int((start + (taken - 5.0) * (1.0 - drift)) / tick) % modulus
        late = DELAY + (0.02 if chance.random() < 0.05 else chance.expovariate(1.0) * 0.002)
        found.append(hear(wired, number, count, taken + late, layout) - taken)
    return found, wired["clock_drift"]


@pytest.mark.parametrize("drift", [0.0, 80e-6, -200e-6])
def test_clock_map_follows_a_drifting_device_clock(drift, microcontrollers):
    found, told = errors(microcontrollers, 25, drift=drift)
    assert told == pytest.approx(drift, abs=2e-5)
    assert all(-1e-4 < error < DELAY + 5e-4 for error in found[500:])  # though packets come up to 20 ms late


@pytest.mark.parametrize(
    ("declared", "tick", "modulus", "layout"),
    [
        ({}, 1e-6, 2**32, "I"),
        ({"kind": "uint16", "unit": "ms", "scale": 1.0}, 1e-3, 2**16, "H"),
        ({"kind": "int32", "unit": "µs", "scale": 10.0, "clock_wrap": 10.0}, 1e-5, 10**6, "i"),
    ],
)
def test_counter_wraps_and_time_continues(declared, tick, modulus, layout, microcontrollers):
    found, _ = errors(
        microcontrollers, 12, start=modulus * tick - 6.0, tick=tick, modulus=modulus, layout=layout, **declared
    )
    assert all(-1e-3 - tick < error < DELAY + 1e-3 for error in found[300:])


def test_clock_is_recovered_after_silence_of_several_wraps(microcontrollers):
    wired = microcontrollers("uint16", "ms", 0.1)
    for number in range(200):
        hear(wired, number, number * 100, 1.0 + number * 0.01, "H")
    later = 199 * 100 + 200_000  # 0.1 ms: more than three rounds
    assert hear(wired, 0, later % 65536, 1.0 + later / 1e4 + 0.004, "H") == pytest.approx(1.0 + later / 1e4, abs=1e-3)


def test_device_restart_restarts_map(microcontrollers):
    wired = microcontrollers()
    for number in range(300):
        hear(wired, number, 50_000_000 + number * 10_000, 1.0 + number * 0.01)
    for number in range(300):
        came = 4.2 + number * 0.01
        assert hear(wired, number, number * 10_000, came) == pytest.approx(came, abs=1e-4)


def test_stopped_or_nan_clock_is_ignored(microcontrollers):
    wired = microcontrollers()
    said = [hear(wired, number, 7, 1.0 + number * 0.01) for number in range(500)]
    assert said[200:] == pytest.approx([1.0 + number * 0.01 for number in range(200, 500)], abs=1e-9)
    wired = microcontrollers("float64", "s", 1.0)
    for number, count in enumerate((0.5, float("nan"), float("inf"), 1e308, -1e308, 1e308, 0.6)):
        assert hear(wired, number, count, 2.0, "d") == pytest.approx(2.0)


def test_without_a_device_clock_sample_time_is_the_arrival_time():
    wired = Wired(Microcontroller, fields=(("force", "float32", "N"),))
    wired.hear(0, packet(1, struct.pack("<f", 1.0)), time=1_500_000_000)
    assert wired["sample_time"] == 1.5 and wired["clock_drift"] == 0.0


def test_insole_sends_microseconds_if_configured():
    for declared, expected in ((True, 2.999), (False, 3.03)):
        wired = Wired(Insole, rows=6, columns=3, clock=declared)
        for number in range(101):
            data = bytearray(frame(number, [[0.0] * 3] * 6, rows=6, columns=3)[:-2])
            data[12:16] = struct.pack("<I", (2**32 - 500_000 + number * 10_000) % 2**32)
            came = 2.0 + number * 0.01 + (0.03 if number == 100 else -0.001)
            data += binascii.crc_hqx(bytes(data), 0xFFFF).to_bytes(2, "little")
            for at in range(0, len(data), 64):
                wired.hear(0, bytes(data[at : at + 64]), time=round(came * 1e9))
        assert wired["received"] == 101 and wired["sample_time"] == pytest.approx(expected, abs=1e-4)


@pytest.mark.hazard("H4i")
@pytest.mark.parametrize(
    ("jump", "words"),
    [
        (lambda t: 0.0, ""),
        (lambda t: 1e-4 * t, ""),
        (lambda t: -0.3 * (t > 3.0), "backwards"),
        (lambda t: -0.05 * int(t), "backwards"),
        (lambda t: -2.0 * (2.0 < t < 2.5), "backwards"),
        (lambda t: 0.2 * (t > 2.5), "or jump"),
        (lambda t: 0.05 * int(t), "or jump"),
    ],
    ids=["healthy", "drifts", "once back", "back each second", "back and forth", "once ahead", "ahead each second"],
)
def test_jumping_time_stamps_are_named_when_a_sensor_is_commissioned(jump, words, microcontrollers):
    wired, chance, drift = microcontrollers(), random.Random(5), []
    for number in range(600):
        t = number / 100
        late = DELAY + (0.02 if chance.random() < 0.05 else chance.expovariate(1.0) * 0.002)
        hear(wired, number, round((50.0 + t + jump(t)) * 1e6), 5.0 + t + late)
        drift.append(wired["clock_drift"])
    found = jumps_of(np.array(drift))
    assert words in found and bool(words) == bool(found), found


@pytest.mark.parametrize(
    ("fields", "clock", "words"),
    [
        ((("t", "uint32", "s", 1e-6),), "time", "clock must be one of the fields t, got 'time'"),
        ((("t", "uint32", "N", 1e-6),), "t", "cannot be the clock"),
        ((("t", "uint32[2]", "s"),), "t", "cannot be the clock"),
        ((("t", "int8", "s", -1.0),), "t", "cannot be the clock"),
    ],
)
def test_a_field_that_cannot_be_a_clock_is_rejected_with_reason(fields, clock, words):
    with pytest.raises(DiagramError, match=words):
        Microcontroller(fields=fields, clock=clock)

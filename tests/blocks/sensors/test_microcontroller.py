"""A microcontroller over serial: its packets against an oracle in Python, whatever comes between them, and the sketch
in docs/.
"""

import binascii
import math
import os
import random
import shutil
import struct
import subprocess
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.sensors import EmulatedMicrocontroller, Microcontroller
from blocks.sensors.fields import SIZES
from cext.lines.streams import Streams
from graph import Diagram, DiagramError
from runtime.robot.rig.serial_line import open_line
from tests.blocks.actuators.wire import MALFORMED, TAKEN, Wired
from tests.blocks.running import player, run
from tests.runtime.runs import ROOT

NOTED, BYTES, LOST, BACK = 2, 0, 1, 2
FORCE = (("force", "int24", "N", 0.01), ("accel", "int16[3]", "m/s²", 0.0048))
PYTHON_TYPES = {
    "uint8": "B",
    "int8": "b",
    "uint16": "H",
    "int16": "h",
    "uint32": "I",
    "int32": "i",
    "float32": "f",
    "float64": "d",
}


def stuffed(plain):
    """COBS by its definition: groups up to a zero, at most 254 bytes each, with their length in front."""
    out, group = b"", b""
    for byte in plain + b"\0":
        if byte == 0:
            out, group = out + bytes([len(group) + 1]) + group, b""
        else:
            group += bytes([byte])
            if len(group) == 254:
                out, group = out + b"\xff" + group, b""
    return out + b"\0"


def packet(counter, payload):
    plain = (b"" if counter is None else bytes([counter])) + payload
    return stuffed(plain + binascii.crc_hqx(plain, 0xFFFF).to_bytes(2, "little"))


def force_packet(counter, force, accel=(0, 0, 0)):
    return packet(counter, force.to_bytes(3, "little", signed=True) + struct.pack("<3h", *accel))


@pytest.fixture(scope="module")
def parser():
    made = {}

    def parser(*declared, **parameters):
        key = (declared, *parameters.items())
        if key not in made:
            made[key] = Wired(Microcontroller, fields=declared, **parameters)
        return Wired.again(made[key])

    return parser


def hear(wired, data, cut=64):
    """In frames of up to `cut` bytes. Returns the result of decode for each."""
    return [wired.hear(BYTES, data[at : at + cut]) for at in range(0, len(data), cut)]


def counts(wired):
    return tuple(int(wired[name]) for name in ("received", "lost", "corrupt"))


def test_packet_layout_follows_its_fields(parser):
    wired = parser(*FORCE)
    assert hear(wired, force_packet(7, -1234, (1, -2, 2043))) == [TAKEN]
    assert (
        wired["force"] == -12.34
        and wired["accel"] == pytest.approx([0.0048, -0.0096, 9.8064])
        and counts(wired) == (1, 0, 0)
    )


@given(
    data=st.data(),
    declared=st.lists(st.tuples(st.sampled_from(sorted(PYTHON_TYPES)), st.integers(1, 5)), min_size=1, max_size=6),
    counter=st.one_of(st.none(), st.integers(0, 255)),
    cut=st.integers(1, 64),
)
def test_every_type_round_trips_for_any_chunk_split(data, declared, counter, cut):
    names = [f"x{i}" for i in range(len(declared))]
    wired = Wired(
        Microcontroller,
        fields=tuple((name, f"{kind}[{n}]") for name, (kind, n) in zip(names, declared)),
        counter=counter is not None,
    )
    values = {}
    for name, (kind, n) in zip(names, declared):
        bits = 8 * SIZES[kind]
        one = (
            st.floats(width=bits, allow_nan=False)
            if kind.startswith("float")
            else st.integers(0, 2**bits - 1)
            if kind.startswith("u")
            else st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        )
        values[name] = data.draw(st.lists(one, min_size=n, max_size=n))
    payload = b"".join(
        struct.pack(f"<{n}{PYTHON_TYPES[kind]}", *values[name]) for name, (kind, n) in zip(names, declared)
    )
    assert TAKEN in hear(wired, packet(counter, payload), cut)
    for name in names:
        assert np.array_equal(np.atleast_1d(wired[name]), np.array(values[name], float))


@given(
    data=st.data(),
    values=st.lists(st.floats(-1e9, 1e9), min_size=4, max_size=4),
    form=st.sampled_from(["cobs", "lines"]),
)
def test_the_emulated_microcontroller_rounds_inputs_to_their_types(data, values, form):
    unit, wired = (
        Wired(EmulatedMicrocontroller, fields=FORCE, format=form),
        Wired(Microcontroller, fields=FORCE, format=form),
    )
    unit["force"], unit["accel"] = values[0], values[1:]
    wired.hear(BYTES, b"\n" if form == "lines" else b"\0")
    for _, sent in unit.say():
        wired.hear(BYTES, sent)
    if form == "lines":
        assert wired["force"] == pytest.approx(values[0], rel=1e-8, abs=1e-9)
    else:
        assert wired["force"] == pytest.approx(min(max(values[0], -83886.08), 83886.07), abs=0.005001)
        assert wired["accel"] == pytest.approx(np.clip(values[1:], -32768 * 0.0048, 32767 * 0.0048), abs=0.002401)


def test_lost_and_corrupt_packets_are_counted(parser):
    wired = parser(*FORCE)
    hear(wired, force_packet(254, 1) + force_packet(255, 2) + force_packet(3, 3))  # 0, 1 and 2 are missing
    assert counts(wired) == (3, 3, 0) and wired["force"] == 0.03
    broken = bytearray(force_packet(4, 77))
    broken[3] ^= 0x80
    assert hear(wired, bytes(broken)) == [MALFORMED] and counts(wired) == (3, 3, 1) and wired["force"] == 0.03
    assert hear(wired, packet(5, b"short")) == [MALFORMED] and counts(wired) == (3, 3, 2)
    assert hear(wired, b"\0\0\0") == [NOTED]  # ends of nothing
    assert set(hear(wired, b"\x55" * 1000 + b"\0")) == {NOTED, MALFORMED} and counts(wired) == (3, 3, 3)
    hear(wired, force_packet(6, 5))
    assert counts(wired) == (4, 5, 3) and wired["force"] == 0.05


def test_first_partial_packet_is_not_counted_as_corrupt(parser):
    wired = parser(*FORCE)
    hear(wired, force_packet(1, 1)[4:] + force_packet(2, 2))
    assert counts(wired) == (1, 0, 0)
    hear(wired, force_packet(3, 3)[:6])
    assert wired.hear(LOST, b"") == NOTED and wired.hear(BACK, b"") == NOTED
    hear(wired, force_packet(3, 3)[6:] + force_packet(4, 4))
    assert counts(wired) == (2, 1, 0) and wired["force"] == 0.04


@given(data=st.data())
def test_only_valid_packets_after_garbage_are_parsed(data, parser):
    wired = parser(*FORCE)
    stream, good = b"\0", 0
    for counter in range(data.draw(st.integers(1, 8))):
        garbage = data.draw(st.binary(max_size=40))
        mutated = bytearray(force_packet(counter, counter))
        if data.draw(st.booleans()):
            mutated[data.draw(st.integers(0, len(mutated) - 1))] ^= data.draw(st.integers(1, 255))
            garbage += bytes(mutated)
        stream += garbage + b"\0" + force_packet(counter, 1000 + counter)
        good += 1
    hear(wired, stream, data.draw(st.integers(1, 64)))
    assert wired["received"] == good and wired["force"] == pytest.approx(10.0 + 0.01 * (good - 1))


def storm(seed, streams):
    """Mutated streams: what is taken has its checksum by the oracle. Returns how many were taken."""
    source = random.Random(seed)
    wired, taken = Wired(Microcontroller, fields=FORCE), 0
    whole = [force_packet(n & 255, source.randrange(-(2**23), 2**23)) for n in range(64)]
    for _ in range(streams):
        stream = bytearray(b"".join(source.choice(whole) for _ in range(3)))
        for _ in range(source.randrange(4)):
            at = source.randrange(len(stream))
            stream[at : at + source.randrange(2)] = source.randbytes(source.randrange(3))
        before = wired["received"] + wired["late"]
        hear(wired, b"\0" + bytes(stream) + b"\0", source.randrange(1, 65))
        expected = sum(part + b"\0" in whole for part in bytes(stream).split(b"\0"))
        assert wired["received"] + wired["late"] - before == expected, (seed, bytes(stream))
        taken += expected
    return taken


def test_mutated_streams_are_parsed_safely():
    assert storm(1, 3000) > 3000


@pytest.mark.parametrize("form", ["cobs", "lines"])
def test_a_late_or_repeated_packet_gives_no_value(form, parser):
    wired = parser(("force", "float32"), format=form)
    for number, taken in ((250, 1), (252, 1), (251, 0), (252, 0), (257, 1), (257, 0), (258, 1)):
        data = b"%d,%d\n" % (number, number) if form == "lines" else packet(number & 255, struct.pack("<f", number))
        if form == "lines" and wired["received"] == 0:
            data = b"\n" + data
        before = wired["received"], wired["force"]
        assert hear(wired, data)[-1] == (TAKEN if taken else NOTED)
        assert (wired["received"], wired["force"]) == ((before[0] + 1, number) if taken else before)
    assert counts(wired) == (4, 5, 0) and wired["late"] == 3


@pytest.mark.soak
def test_a_million_mutated_streams_are_parsed_safely():
    for seed in range(100):
        storm(seed, 10_000)


def test_text_lines_of_numbers_are_parsed(parser):
    wired = parser(("force", "float32", "N", 2.0), ("accel", "int16[2]"), format="lines")
    assert hear(wired, b"half a line,4\n" + b"# begins\r\n" + b"9, 1.5,-2,3e1\r\n") == [TAKEN]
    assert wired["force"] == 3.0 and list(wired["accel"]) == [-2.0, 30.0] and counts(wired) == (1, 0, 0)
    hear(wired, b"12,1,2,3\n13,1,2\n13,1,2,3,4\n13,1,two,3\n13,1,2,3;\n\n-1,1,2,3\n13,1,2,3\0\n14,nan,2,3\n")
    assert counts(wired) == (3, 3, 6) and math.isnan(wired["force"])
    assert set(hear(wired, b"1," * 2000 + b"\n")) == {NOTED, MALFORMED} and counts(wired) == (3, 3, 7)


@pytest.mark.parametrize("gap", [lambda wired: None, lambda wired: (wired.hear(LOST, b""), wired.hear(BACK, b""))])
def test_line_with_lost_first_digits_is_discarded(gap, parser):
    wired = parser(("force", "float32"), format="lines", counter=False)
    gap(wired)
    assert hear(wired, b"2.5\n") == [NOTED] and counts(wired) == (0, 0, 0) and wired["force"] == 0.0
    assert hear(wired, b"12.5\n") == [TAKEN] and counts(wired) == (1, 0, 0) and wired["force"] == 12.5


@given(text=st.binary(max_size=200), cut=st.integers(1, 64))
def test_text_between_lines_is_skipped(text, cut, parser):
    wired = parser(("force", "float32"), format="lines", counter=False)
    hear(wired, b"\n" + text + b"\n4.25\n", cut)
    assert wired["force"] == 4.25


def robot(**parameters):
    with Diagram("robot", rate=200) as diagram:
        Microcontroller(fields=FORCE, name="teensy", **parameters)
    return diagram


def together(ticks, form="cobs", **faults):
    diagram = robot(format=form, timeout=0.1)
    with Diagram("plant", rate=1000) as plant:
        unit = EmulatedMicrocontroller.of(diagram["teensy"], name="unit")
        unit(
            force=player(np.arange(5.0 * (ticks + 50)) * 0.01, "N"),
            **{name: player(values, "1", bool) if np.ndim(values) else values for name, values in faults.items()},
        )
    return run(diagram, ticks, plant=plant, substeps=5)


@pytest.mark.parametrize("form", ["cobs", "lines"])
def test_in_simulation_its_bytes_are_parsed_as_on_a_rig(form):
    recording = together(100, form)
    assert recording.outcome.status == "ok" and recording["teensy.age"].max() < 0.011
    heard = recording["teensy.force"][2 * (form == "lines") :]  # the line that was on its way when it was armed is none
    assert np.diff(heard) == pytest.approx(np.full(len(heard) - 1, 0.05), abs=0.0101)
    assert recording["teensy.lost"][-1] == recording["teensy.corrupt"][-1] == 0.0


def test_emulator_has_the_packet_rate_of_its_block():
    assert robot(packet_rate=100.0)["teensy"].emulator().period == 0.01
    assert robot()["teensy"].emulator().period == 0.005


@pytest.mark.parametrize("form", ["cobs", "lines"])
def test_device_clock_of_the_emulator_is_the_time_of_the_plant_and_wraps(form):
    with Diagram("robot", rate=200) as diagram:
        declared = (("x", "float32"), ("t", "uint16", "s", 1e-4))
        Microcontroller(declared, clock="t", packet_rate=100.0, format=form, name="teensy")
    with Diagram("plant", rate=1000) as plant:
        diagram["teensy"].emulator(name="unit")(x=1.0)
    recording = run(diagram, 2000, plant=plant, substeps=5)  # 10 s, one wrap
    assert np.diff(recording["teensy.t"]).min() < -6.0 and recording["teensy.t"].max() < 6.5536
    arrival = recording["teensy.sample_time"] + recording["teensy.age"] - recording.time
    assert np.ptp(arrival[100:]) < 0.001 and abs(recording["teensy.clock_drift"][-1]) < 1e-4


def test_outputs_of_integer_fields_are_bounded_by_their_types():
    declared = (("angle", "int16", "rad", -0.001), ("level", "uint8"), ("load", "int24[2]"), ("x", "float32"))
    binary, text = (Microcontroller(fields=declared, format=form).output_range() for form in ("cobs", "lines"))
    assert (binary["angle"].low, binary["angle"].high) == (-32.767, 32.768)
    assert (binary["level"].low, binary["level"].high) == (0.0, 255.0)
    assert (binary["load"].low, binary["load"].high) == (-8388608.0, 8388607.0)
    assert "x" not in binary and "angle" not in text


def test_faults_of_the_emulated_sensor_are_detected():
    recording = together(400, dropped=0.2, broken=0.1)
    received, lost, corrupt = (recording[f"teensy.{name}"][-1] for name in ("received", "lost", "corrupt"))
    assert (
        received + lost == pytest.approx(400, abs=4)
        and lost == pytest.approx(0.28 * 400, rel=0.3)
        and corrupt == pytest.approx(0.08 * 400, rel=0.5)
    )
    silent = np.zeros(1000, bool)
    silent[400:] = True
    recording = together(150, silent=silent)
    assert recording.outcome.status == "silent" and recording.outcome.culprit == "teensy"


def test_a_microcontroller_is_read_over_a_pty_opened_by_pyserial(tmp_path):
    """As on a rig: its port is opened and started, and the native thread reads it."""
    master, slave = os.openpty()
    block = robot(port=os.ttyname(slave), start="go\n")["teensy"]
    line = open_line(block, block.opening())
    assert os.read(master, 10) == b"go\n"
    streams = Streams()
    stream = streams.add(line.fd, "teensy", path=line.path, setup=line.setup)
    os.close(line.fd)
    streams.start()
    sent = 400

    def speak():
        for counter in range(sent):
            os.write(master, force_packet(counter & 255, counter))
            time.sleep(0.0005)

    speaker = threading.Thread(target=speak)
    speaker.start()
    wired, deadline = Wired(Microcontroller, fields=FORCE), time.monotonic() + 10
    while wired["received"] < sent and time.monotonic() < deadline:
        for kind, _, data, _ in stream.end.receive():
            wired.hear(kind, data)
        time.sleep(0.001)
    speaker.join()
    streams.end()
    os.close(master), os.close(slave)
    assert counts(wired) == (sent, 0, 0) and wired["force"] == pytest.approx(0.01 * (sent - 1))


ARDUINO = r"""
#pragma once
#include <cstdint>
#include <cstdio>
#include <cstring>
#define HIGH 1
#define LOW 0
#define INPUT 0
#define OUTPUT 1
#define A0 14
#define A1 15
static unsigned long now = 0;
static bool connected = true;                   // the HX711, the MPU-6050
static int clocks = 0, level = 0;
static const uint32_t COUNTS = 0xFFCFC7;        // -12345, as an HX711 has it
inline void noInterrupts() {} inline void interrupts() {}
inline void delayMicroseconds(int) {} inline void pinMode(int, int) {}
inline unsigned long micros() { return now; }
inline int analogRead(int pin) { return pin == A0 ? 1023 : 256; }
inline void digitalWrite(int, int value) { clocks += value > level; level = value; }
inline int digitalRead(int) { return !connected || (clocks % 25 && COUNTS >> (24 - clocks % 25) & 1); }
struct { void begin(long) {} void write(const uint8_t *data, size_t count) { fwrite(data, 1, count, stdout); } } Serial;
"""
WIRE = r"""
#include "Arduino.h"
static uint8_t registers[128] = {};
struct {
    int at = 0, written = 0;
    void begin() {} void setClock(long) {}
    void beginTransmission(uint8_t) { written = 0; }
    void write(uint8_t byte) { if (written++) registers[at++] = byte; else at = byte; }
    int endTransmission(bool = true) { return connected ? 0 : 2; }
    uint8_t requestFrom(uint8_t, uint8_t count) {
        static const uint8_t measured[] = {0x10, 0, 0xF0, 0, 0, 1, 9, 9, 0x01, 0x48, 0xFF, 0xFF, 0, 0};
        memset(registers + 0x3B, 0, 14);        // asleep, all zero
        if (registers[0x6B] == 1 && registers[0x1B] == 0x10 && registers[0x1C] == 0x10)
            memcpy(registers + 0x3B, measured, 14);
        return count;
    }
    uint8_t read() { return registers[at++]; }
} Wire;
"""
MAIN = r"""
#include "SKETCH"
int main() {
    setup();
    for (int i = 0; i < 300; i++, now += PERIOD) {
        connected = i < 100 || i >= 200;
        loop();
    }
}
"""
SKETCHES = {  # (packets, values); a conversion of the HX711 is valid for 59 further packets
    "microcontroller.ino": (259, {"load": -12345.0, "analog": [3.3, 256 * 3.3 / 1023]}),
    "imu.ino": (
        200,
        {
            "t": 2.99,
            "accel": [9.80665, -9.80665, 9.80665 / 4096],
            "gyro": [math.radians(10.0), -math.radians(1 / 32.8), 0.0],
        },
    ),
}


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs a C++ compiler")
@pytest.mark.parametrize("name", SKETCHES)
def test_a_documented_sketch_sends_packets_for_the_block_while_its_sensor_responds(name, tmp_path):
    """Compiled with the functions of an Arduino that it calls."""
    folder = ROOT / "docs/sketches"
    (tmp_path / "Arduino.h").write_text(ARDUINO)
    (tmp_path / "Wire.h").write_text(WIRE)
    (tmp_path / "main.cpp").write_text(MAIN.replace("SKETCH", name))
    subprocess.run(
        ["g++", "-Wall", "-Werror", "-I", tmp_path, "-I", folder, tmp_path / "main.cpp", "-o", tmp_path / "sketch"],
        check=True,
        timeout=60,
    )
    output = subprocess.run([tmp_path / "sketch"], capture_output=True, timeout=10).stdout
    comment = [
        line.removeprefix("//") for line in (folder / name).read_text().splitlines() if line.startswith("//    ")
    ]
    block = eval("".join(comment).strip(), {"Microcontroller": Microcontroller, "math": math})
    wired = Wired(Microcontroller, fields=block.fields)
    hear(wired, output)
    packets, values = SKETCHES[name]
    assert counts(wired) == (packets, 0, 0)
    for field, value in values.items():
        assert wired[field] == pytest.approx(value), field


@pytest.mark.parametrize(
    "declared, words",
    [
        ((), "fields must contain at least one field"),
        ((("force",),), "field 1 must be .name, type, unit, scale., where unit and scale are 1 by default"),
        (((2, "int16"),), "field 1: the name must be text, got 2"),
        ((("2nd", "int16"),), "'2nd' cannot be the name of a port: it must be a Python identifier"),
        (
            (("force", "int12"),),
            "field 'force': the type must be one of uint8, int8, .* or an array such as int16.3., got 'int12'",
        ),
        ((("force", "int16", "N", 0.0),), "field 'force': the scale must be a nonzero number"),
        ((("force", "int16"), ("force", "int16")), "'force' cannot be the name of a port: it is used twice"),
        ((("age", "int16"),), "'age' cannot be the name of a port: it is reserved"),
        ((("self", "int16"),), "'self' cannot be the name of a port: it is reserved"),
        ((("\u00b5", "int16"),), "'\u00b5' cannot be the name of a port: Python reads it as '\u03bc'"),
        (
            (("force", "float64[40]"),),
            "a packet is limited to 250 bytes and 200 numbers, and these fields have 320 and 40",
        ),
    ],
)
def test_invalid_field_is_reported(declared, words):
    with pytest.raises(DiagramError, match=words):
        Microcontroller(fields=declared)

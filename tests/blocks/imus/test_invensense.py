"""IMUs of InvenSense: decoding of their bytes, against other implementations and the datasheets, and what cannot be
right.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.imus import ICM20948, MPU9250, EmulatedICM20948, EmulatedMPU9250
from graph import Block, Diagram, DiagramError, Output, Param, compile
from tests.blocks.actuators.wire import EXTENDED, FOREIGN, MALFORMED, NOT_FINITE, TAKEN, Wired
from tests.blocks.running import run
from tests.shared import entries

NOTED, TROUBLE = 2, 15
G = 9.80665  # m/s², standard
RIGHT = 0x68


def identifier(transfer, address=RIGHT, place=0):
    return EXTENDED | transfer << 16 | place << 8 | address


def int16s(values, order):
    return b"".join(int(value).to_bytes(2, order, signed=True) for value in values)


def mag_frame(raw, st1=0x01, st2=0x10, asa=(128, 128, 128)):
    return bytes((st1,)) + int16s(raw, "little") + bytes((st2, *asa))


def turned(mag):
    """The AK8963's axes in the accelerometer's: x is its y, y its x, z points the other way."""
    return np.array((mag[1], mag[0], -mag[2]))


@pytest.fixture(scope="module")
def mpus():
    return {(a, g): Wired(MPU9250, accel_range=a, gyro_range=g) for a in (2, 4, 8, 16) for g in (250, 500, 1000, 2000)}


@pytest.fixture
def mpu(mpus):
    return Wired.again(mpus[8, 1000])


@pytest.fixture(scope="module")
def icms():
    return Wired(ICM20948, accel_range=4, gyro_range=500)


@pytest.fixture
def icm(icms):
    return Wired.again(icms)


# The wire


def test_bursts_of_other_implementations_decode_per_datasheet(mpus):
    """1e-12 of the value: only the order of two multiplications may differ."""
    seen = 0
    for entry in entries("mpu9250"):
        if entry["kind"].startswith("accel"):
            wired = Wired.again(mpus[entry["inputs"]["acc_range_g"], entry["inputs"]["gyro_range_dps"]])
            assert wired.hear(identifier(0), bytes.fromhex(entry["i2c"]["data_hex"])) == TAKEN
            said = [*wired["accel"], *wired["gyro"], wired["temperature"]]
            assert said == pytest.approx(
                entry["decoded"]["datasheet (g=9.80665) m/s^2, rad/s, C"], rel=1e-12, abs=1e-12
            )
            seen += 1
    assert seen > 100


def test_magnetometer_measurements_decode_per_datasheet(mpu):
    """1e-12 of the value, as above."""
    seen = 0
    for entry in entries("mpu9250"):
        if entry["kind"].startswith("magnetometer"):
            frame = b"\x01" + bytes.fromhex(entry["i2c"]["data_hex"]) + bytes(entry["inputs"]["asa"])
            assert mpu.hear(identifier(1), frame) == NOTED
            wanted = entry["decoded"]["datasheet uT: raw*4912/32760*((ASA-128)*0.5/128+1)"]
            assert mpu["mag"] == pytest.approx(turned(wanted), rel=1e-12, abs=1e-12)
            assert mpu["mag_overflow"] == entry["decoded"]["datasheet overflow (ST2 HOFL 0x08)"]
            seen += 1
    assert seen > 50


def test_the_lowest_code_stays_negative(mpu):
    """-32768 read as +32768 would turn full scale around."""
    mpu.hear(identifier(0), b"\x80\x00" * 7)
    assert list(mpu["accel"]) == [-8.0 * G] * 3 and mpu["gyro"] == pytest.approx([-math.radians(1000.0)] * 3, rel=1e-15)
    mpu.hear(identifier(1), mag_frame((-32768,) * 3))
    assert list(np.sign(mpu["mag"])) == [-1.0, -1.0, 1.0]


def test_icm_20948_bytes_have_their_own_order(icm):
    """Accelerometer, gyroscope, temperature; its magnetometer points the other way in y and z, 0.15 µT a code."""
    assert icm.hear(identifier(0), int16s((8192, -8192, 4096, 6550, -655, 65, 3339), "big")) == TAKEN
    assert icm["accel"] == pytest.approx([G, -G, G / 2], rel=1e-15)
    assert icm["gyro"] == pytest.approx(np.radians(np.array((6550, -655, 65)) * 500.0 / 32768.0), rel=1e-14)
    assert icm["temperature"] == pytest.approx(31.0008, abs=1e-4)
    assert icm.hear(identifier(1), b"\x01" + int16s((100, -200, 300), "little") + b"\x00\x00") == NOTED
    assert icm["mag"] == pytest.approx([15.0, 30.0, -45.0], rel=1e-14)
    assert icm.hear(identifier(1), b"\x01" + int16s((1, 2, 3), "little") + b"\x00\x08") == NOTED
    assert icm["mag_overflow"] == 1.0 and icm["mag"] == pytest.approx([15.0, 30.0, -45.0], rel=1e-14)


def test_a_magnetometer_without_new_data_changes_nothing(mpu):
    mpu.hear(identifier(1), mag_frame((100, 200, 300)))
    before = mpu["mag"]
    assert mpu.hear(identifier(1), mag_frame((9, 9, 9), st1=0x00)) == NOTED
    assert list(mpu["mag"]) == list(before)
    assert mpu.hear(identifier(1), mag_frame((9, 9, 9), st1=0x02)) == NOTED  # an overrun alone is no measurement either
    assert list(mpu["mag"]) == list(before)


def test_magnetic_overflow_is_reported_and_keeps_last_value(mpu):
    mpu.hear(identifier(1), mag_frame((100, 200, 300)))
    before = mpu["mag"]
    mpu.hear(identifier(1), mag_frame((32767, 32767, 32767), st2=0x18))
    assert mpu["mag_overflow"] == 1.0 and list(mpu["mag"]) == list(before)
    mpu.hear(identifier(1), mag_frame((100, 200, 301)))
    assert mpu["mag_overflow"] == 0.0 and list(mpu["mag"]) != list(before)


def test_a_magnetometer_in_14_bits_has_lost_its_settings(mpu):
    assert mpu.hear(identifier(1), mag_frame((100, 200, 300), st2=0x00)) == MALFORMED and list(mpu["mag"]) == [0.0] * 3


def test_the_age_of_the_magnetometer_is_updated_at_each_sample(mpu):
    frames = (
        (0.010, 1, mag_frame((1, 2, 3))),
        (0.015, 0, bytes(14)),
        (0.020, 1, mag_frame((4, 5, 6), st1=0)),
        (0.035, 0, bytes(14)),
    )
    for at, kind, data in frames:
        mpu.hear(identifier(kind), data, time=round(at * 1e9))
    assert mpu["mag_age"] == pytest.approx(0.025, abs=1e-12)


def test_identical_replies_are_counted(mpu):
    for count, data in enumerate([bytes(14)] * 4):
        mpu.hear(identifier(0), data)
        assert mpu["repeated"] == count
    mpu.hear(identifier(0), bytes(13) + b"\x01")
    assert mpu["repeated"] == 0.0


def test_read_failures_are_reported_and_do_not_count_as_reply(mpu):
    assert mpu.hear(identifier(TROUBLE), bytes((1, 0x39, 0x30, 0, 0))) == NOTED and mpu["errors"] == 12345
    assert mpu.hear(identifier(TROUBLE), bytes(4)) == MALFORMED


@given(number=st.integers(0, 0xFFFFFFFF), data=st.binary(max_size=64))
def test_any_frame_leaves_finite_outputs_within_the_declared_range(mpus, icms, number, data):
    for wired in (Wired.again(mpus[8, 1000]), Wired.again(icms)):
        for identity in (number, identifier(number % 16)):
            before = wired.arena.copy()
            answer = wired.hear(identity, data)
            assert answer in (FOREIGN, TAKEN, NOTED, MALFORMED)
            if answer in (FOREIGN, MALFORMED):
                assert np.array_equal(before, wired.arena, equal_nan=True)
            for name, interval in wired.block.output_range().items():
                assert np.all((interval.low <= wired[name]) & (wired[name] <= interval.high)), name


@pytest.mark.parametrize(
    "number",
    [
        identifier(0, 0x69),
        identifier(0, place=1),
        identifier(0) & ~EXTENDED,
        identifier(3),
        identifier(0) | 0x100000,
        identifier(0) | 0x40000000,
    ],
)
def test_a_reply_of_another_device_is_not_accepted(mpu, number):
    assert mpu.hear(number, bytes(14)) == FOREIGN


# What is written and asked


def test_the_registers_of_an_mpu_9250():
    """RM-MPU-9250A-00: reset, clock, divider of 1 kHz, low-pass, ranges in bits 4 and 3, and the way through to the
    magnetometer.
    """
    imu = MPU9250(rate=200.0, accel_range=16, gyro_range=2000, low_pass=92)
    written = [(write.address, write.register, *write.data) for write in imu.set_up()]
    assert written == [
        (None, 0x6B, 0x80),
        (None, 0x6B, 0x01),
        (None, 0x19, 4),
        (None, 0x1A, 2),
        (None, 0x1B, 0x18),
        (None, 0x1C, 0x18),
        (None, 0x1D, 2),
        (None, 0x6A, 0),
        (None, 0x37, 0x02),
        (0x0C, 0x0B, 0x01),
        (0x0C, 0x0A, 0x00),
        (0x0C, 0x0A, 0x16),
    ]
    assert imu.check() == (0x19, bytes((4, 2, 0x18, 0x18, 2)))
    assert not any(write.address for write in MPU9250(magnetometer=False).set_up())


@pytest.mark.parametrize("rate, divider", [(1000.0, 0), (999.0, 0), (500.0, 1), (333.0, 2), (200.0, 4), (1.0, 255)])
def test_imu_samples_at_least_as_often_as_it_is_read(rate, divider):
    assert MPU9250(rate=rate).settings()[0] == divider


def test_the_registers_of_an_icm_20948():
    imu = ICM20948(rate=225.0, accel_range=16, gyro_range=250, low_pass=24)
    written = [(write.address, write.register, *write.data) for write in imu.set_up()]
    assert written[6:13] == [
        (None, 0x7F, 0x20),
        (None, 0x00, 4),
        (None, 0x01, 0x21),
        (None, 0x10, 0),
        (None, 0x11, 4),
        (None, 0x14, 0x27),
        (None, 0x7F, 0x00),
    ]
    assert written[-2:] == [(0x0C, 0x32, 0x01), (0x0C, 0x31, 0x08)]


def test_factory_adjustment_is_read_in_fuse_mode_and_applied():
    imu, done, mode = MPU9250(), [], {"now": 0x16}
    chip = {0x00: b"\x48", 0x10: bytes((176, 178, 166))}

    def write(one):
        done.append((one.register, one.data[0]))
        mode["now"] = one.data[0]

    def read(register, count, address=None):
        assert address == 0x0C and (register != 0x10 or mode["now"] == 0x0F)
        return chip[register]

    imu.learn(read, write)
    assert done[-1] == (0x0A, 0x16)  # it measures again
    magnetometer = imu.rounds()[1].transfers[0]
    assert (
        magnetometer.appended == bytes((176, 178, 166))
        and magnetometer.address == 0x0C
        and imu.rounds()[1].period == 0.01
    )
    chip[0x00] = b"\x00"
    with pytest.raises(ValueError, match="its magnetometer identifies itself as 0x00 instead of 0x48"):
        imu.learn(read, write)


@pytest.mark.parametrize(
    "parameters, words",
    [
        ({"address": 0x40}, "address 0x40: the addresses of a MPU-9250 are 0x68, 0x69"),
        ({"mux": 0x20}, "the addresses of a TCA9548A are 0x70 to 0x77"),
        ({"channel": 3}, "channel requires a multiplexer"),
        ({"rate": 2000.0}, "at most 1000"),
        ({"low_pass": 43}, "must be one of 184"),
    ],
)
def test_invalid_settings_are_refused_with_reason(parameters, words):
    with pytest.raises(DiagramError, match=words):
        MPU9250(**parameters)


@pytest.mark.parametrize(
    "first, second, fine",
    [
        ({"address": 0x68}, {"address": 0x69}, False),  # their magnetometers
        ({"address": 0x68}, {"address": 0x69, "magnetometer": False}, True),
        ({"address": 0x68}, {"address": 0x69, "bypass": False}, True),  # it reads its own by itself
        ({"mux": 0x70, "channel": 1}, {"mux": 0x70, "channel": 2}, True),
        ({"mux": 0x70, "channel": 1}, {"mux": 0x71, "channel": 1}, True),
        ({"mux": 0x70, "channel": 1}, {"mux": 0x70, "channel": 1}, False),
        ({}, {"mux": 0x70, "channel": 1}, False),  # what is on the bus itself is heard behind a multiplexer
    ],
)
def test_two_chips_on_one_address_are_an_error(first, second, fine):
    with Diagram("two", rate=200) as diagram:
        MPU9250(bus="imus", **first)
        MPU9250(bus="imus", **second)
    if fine:
        compile(diagram)
        return
    with pytest.raises(DiagramError, match=r"TW013.*shares I2C address 0x(68|0c) on bus 'imus'"):
        compile(diagram)


def test_sensor_with_internal_magnetometer_bus_is_read_in_one_burst(mpus):
    """22 bytes from 0x3B: the fourteen, then ST1 to ST2 as its own bus has read them; the factory adjustment behind."""
    imu = MPU9250(bypass=False, rate=200.0)
    imu.adjustment = bytes((176, 178, 166))
    (cycle,) = imu.rounds()
    assert cycle.period == 0.005 and cycle.transfers[0].steps[0].count == 22 and cycle.transfers[0].number == 2
    assert [(write.register, write.data[0]) for write in imu.set_up()][-6:] == [
        (0x37, 0x00),
        (0x6A, 0x20),
        (0x24, 0x0D),
        (0x25, 0x8C),
        (0x26, 0x02),
        (0x27, 0x88),
    ]
    one, two = Wired.again(mpus[8, 1000]), Wired.again(mpus[8, 1000])
    burst, field = int16s((100, -200, 4096, 5, 6, 7, 8), "big"), mag_frame((300, -200, 400), asa=(176, 178, 166))
    assert one.hear(identifier(2), burst + field) == TAKEN
    two.hear(identifier(1), field)
    two.hear(identifier(0), burst)
    assert all(np.array_equal(one[name], two[name]) for name in ("accel", "gyro", "mag", "temperature"))
    before = one["mag"]
    assert one.hear(identifier(2), burst + mag_frame((1, 2, 3), st1=0)) == TAKEN and np.array_equal(one["mag"], before)
    assert one.hear(identifier(2), burst + mag_frame((1, 2, 3), st2=0)) == TAKEN and np.array_equal(one["mag"], before)
    assert one.hear(identifier(2), burst + field[:-1]) == MALFORMED


def test_simulated_sensor_reads_its_magnetometer():
    with Diagram("robot", rate=200) as robot:
        imu = MPU9250(name="imu", bypass=False, timeout=0.0)
    with Diagram("plant", rate=1000) as plant:
        imu.emulator(adjustment=(176, 100, 166))()
    record = run(robot, 40, plant=plant, substeps=5)
    assert record["imu.mag[0]"][10:] == pytest.approx(20.0, abs=0.1) and record["imu.mag[2]"][10:] == pytest.approx(
        -44.0, abs=0.1
    )
    assert max(record["imu.age"][2:]) <= 0.005 + 1e-9 and max(record["imu.mag_age"][10:]) <= 0.010 + 1e-9


# The ones that are not there

PLAYED = [(MPU9250, EmulatedMPU9250, {"adjustment": (176, 100, 166)}), (ICM20948, EmulatedICM20948, {})]


@pytest.mark.parametrize("kind, emulated, parameters", PLAYED)
@given(data=st.data())
def test_block_reads_measurements_of_emulated_sensor(kind, emulated, parameters, data):
    """Within half a code of each quantity; the adjustment stretches that of the magnetometer."""
    vectors = {
        name: data.draw(st.tuples(*[st.floats(-most, most)] * 3))
        for name, most in (("accel", 78.0), ("gyro", 17.4), ("mag", 1000.0))
    }
    temperature = data.draw(st.floats(-40.0, 85.0))
    wired, played = block_of(kind, {}), block_of(emulated, parameters)
    answers = played.say(**vectors, temperature=temperature)
    assert [number for number, _ in answers] == [identifier(0), identifier(1)]
    assert [wired.hear(*answer) for answer in answers] == [TAKEN, NOTED]
    for name, scale in zip(vectors, wired.block.scales):
        assert wired[name] == pytest.approx(vectors[name], abs=scale * 0.51 * (1.5 if name == "mag" else 1.0)), name
    assert wired["temperature"] == pytest.approx(temperature, abs=0.5 / 333.87 + 1e-9)


KEPT = {}


def block_of(kind, parameters):
    if kind not in KEPT:
        KEPT[kind] = Wired(kind, **parameters)
    return Wired.again(KEPT[kind])


def test_bytes_follow_register_layout():
    """1 g at ±8 g is 4096 codes, 1 rad/s at ±1000 °/s 1877.47; the AK8963 has x and y exchanged and z the other way."""
    played = block_of(EmulatedMPU9250, {"adjustment": (176, 100, 166)})
    answers = played.say(accel=(0.0, -G, G), gyro=(1.0, 0.0, -1.0), mag=(20.0, -10.0, -44.0), temperature=21.0)
    raw = [
        round(field / (4912 / 32760 * ((asa - 128) / 256 + 1)))
        for field, asa in ((-10.0, 176), (20.0, 100), (44.0, 166))
    ]
    assert answers == [
        (identifier(0), int16s((0, -4096, 4096, 0, 1877, 0, -1877), "big")),
        (identifier(1), mag_frame(raw, asa=(176, 100, 166))),
    ]


def test_a_diverged_plant_sends_no_reply():
    played = block_of(EmulatedMPU9250, {})
    played["accel"] = (math.nan, 0.0, 0.0)
    assert played.say() == NOT_FINITE


class From(Block):
    """A fault that begins at a time, and may end."""

    begin = Param(0.0, "s")
    end = Param(math.inf, "s")
    y = Output("1", dtype=bool)

    def step(self, t):
        return self.begin <= t < self.end


class Address(From):
    """As above, a number."""

    value = Param(0x69, "1")
    y = Output("1", dtype=int)

    def step(self, t):
        return self.value if self.begin <= t < self.end else 0


def played(ticks, kind=MPU9250, fault=None, source=From, end=math.inf, **inputs):
    """Recording of an IMU, `imu`, in a plant at 1 kHz. From 0.1 s on it has a fault."""
    with Diagram("robot", rate=200) as robot:
        imu = kind(name="imu", timeout=0.0)
    with Diagram("plant", rate=1000) as plant:
        faults = {} if fault is None else {fault: source(begin=0.1, end=end).y}
        imu.emulator(name="played")(**faults, **inputs)
    return run(robot, ticks, plant=plant, substeps=5)


@pytest.mark.parametrize("kind", [MPU9250, ICM20948])
def test_a_simulated_imu_measures_gravity_in_every_tick(kind):
    record = played(40, kind)
    assert record["imu.accel[2]"][5:] == pytest.approx(G, abs=0.5 * 8 * G / 32768)  # half a code
    assert record["imu.mag[0]"][10:] == pytest.approx(20.0, abs=0.08) and max(record["imu.age"][2:]) <= 0.005 + 1e-9
    assert max(record["imu.mag_age"][10:]) <= 0.010 + 1e-9


@pytest.mark.parametrize("fault, source", [("silent", From), ("wrong_address", Address)])
def test_age_grows_while_sensor_is_silent(fault, source):
    age = played(60, fault=fault, source=source, end=0.2)["imu.age"]
    assert max(age[2:21]) < 0.006 and age[39] == pytest.approx(0.095, abs=0.0051) and max(age[43:]) < 0.006


def test_silence_beyond_timeout_ends_run():
    with Diagram("robot", rate=200) as robot:
        imu = MPU9250(name="imu", timeout=0.05)
    with Diagram("plant", rate=1000) as plant:
        imu.emulator()(silent=From(begin=0.1).y)
    outcome = run(robot, 100, plant=plant, substeps=5).outcome
    assert outcome.status == "silent" and outcome.culprit == "imu" and 0.145 <= outcome.tick / 200 <= 0.16


def test_stuck_sensor_is_detected_by_repeated_replies():
    class Swing(Block):
        rate = Output("rad/s", shape=(3,))

        def step(self, t):
            return [math.sin(6.0 * t), math.cos(5.0 * t), t]

    with Diagram("robot", rate=200) as robot:
        imu = MPU9250(name="imu", timeout=0.0)
    with Diagram("plant", rate=1000) as plant:
        imu.emulator()(stuck=From(begin=0.1, end=0.2).y, gyro=Swing().rate)
    record = run(robot, 60, plant=plant, substeps=5)
    assert (
        max(record["imu.repeated"][:20]) == 0.0
        and record["imu.repeated"][39] >= 18
        and record["imu.repeated"][45] == 0.0
    )
    assert len(set(record["imu.gyro[0]"][22:40])) == 1 and record["imu.age"][39] < 0.006


def test_a_strong_field_overflows_the_magnetometer():
    record = played(60, fault="mag_overflow", end=0.2)
    assert record["imu.mag_overflow"][30] == 1.0 and record["imu.mag_overflow"][55] == 0.0
    assert record["imu.mag_age"][39] > 0.08 and record["imu.age"][39] < 0.006
    strong = played(20, mag=(3000.0, 0.0, -2500.0))  # more than 4912 µT without signs
    assert strong["imu.mag_overflow"][-1] == 1.0


def test_only_the_age_of_the_magnetometer_grows_if_it_is_never_ready():
    record = played(60, fault="mag_not_ready")
    assert record["imu.mag_age"][-1] > 0.15 and record["imu.age"][-1] < 0.006


def test_calibration_is_applied_to_measurements(tmp_path):
    file = tmp_path / "imu.toml"
    file.write_text("""
[accelerometer]
offset = [0.5, -0.25, 0.1]
matrix = [[2.0, 0.0, 0.0], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]]

[gyroscope]
bias = [0.1, 0.2, -0.3]

[magnetometer]
offset = [10.0, 0.0, -4.0]
matrix = [[1.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 2.0]]
""")
    plain, laid = Wired(MPU9250), Wired(MPU9250, calibration=str(file))
    for number, data in ((0, int16s((1000, -2000, 4096, 0, 300, -200, 100), "big")), (1, mag_frame((300, -200, 400)))):
        plain.hear(identifier(number), data)
        laid.hear(identifier(number), data)
    accel = plain["accel"] - (0.5, -0.25, 0.1)
    assert laid["accel"] == pytest.approx([2.0 * accel[0], accel[1] + 0.5 * accel[2], accel[2]], rel=1e-14)
    assert laid["gyro"] == pytest.approx(plain["gyro"] - (0.1, 0.2, -0.3), rel=1e-14)
    assert laid["mag"] == pytest.approx((plain["mag"] - (10.0, 0.0, -4.0)) * (1.0, 0.5, 2.0), rel=1e-14)


@pytest.mark.parametrize(
    "text, words",
    [
        ("[gyroscope]\nbias = [1.0, 2.0]", r"\[gyroscope\] bias: expected three finite numbers"),
        ("[gyroscope]\nbias = [1.0, 2.0, nan]", "three finite numbers"),
        ("[gyro]\nbias = [0, 0, 0]", r"unknown table \[gyro\]"),
        ("[accelerometer]\nmatrix = [1, 2, 3]", "three rows of three"),
        ("[magnetometer]\nscale = 2", "unknown key 'scale'"),
        ("a =", "invalid TOML"),
    ],
)
def test_invalid_calibration_is_refused_with_reason(tmp_path, text, words):
    file = tmp_path / "imu.toml"
    file.write_text(text)
    with pytest.raises(DiagramError, match=words):
        MPU9250(calibration=str(file))
    with pytest.raises(DiagramError, match="cannot read .*nowhere"):
        MPU9250(calibration=str(tmp_path / "nowhere.toml"))

"""A MicroStrain sensor in virtual time: samples, faults and interruptions of its line."""

import math

import numpy as np
import pytest

from blocks.actuators import CubeMars
from blocks.imus import EmulatedMicroStrain, MicroStrain
from blocks.imus.microstrain import mip
from blocks.limiters import TorqueLimiter
from blocks.mathematics import Gain
from graph import Diagram, DiagramError, compile
from tests.blocks.imus.hearing import MALFORMED, NOTED, TAKEN, Hearing
from tests.blocks.running import player, run

RATE = 200


def turned(angle, axis):
    half = 0.5 * angle
    return np.array([math.cos(half), *(math.sin(half) * np.array(axis))])


def simulate(ticks, faults=None, device=None, emulated=None, tare=None, **inputs):
    """The recording of one sensor whose emulator has these inputs, each a value or one a tick of the plant."""
    with Diagram("robot", rate=RATE) as robot:
        imu = MicroStrain(name="imu", **{"timeout": 0.0, **(device or {})})
        if tare is not None:
            imu(tare=player(np.asarray(tare, dtype=bool), "1", bool))
    with Diagram("plant", rate=5 * RATE) as plant:
        sensor = EmulatedMicroStrain.of(imu, name="sensor", **(emulated or {}))
        for name, values in {**inputs, **(faults or {})}.items():
            port = sensor.inputs[name]
            values = np.asarray(values)
            if values.ndim > len(port.shape):
                played = player(values, port.unit, {"float": float, "bool": bool, "int": int}[port.dtype])
                sensor(**{name: played})
            else:
                sensor(**{name: values.tolist() if values.ndim else values.item()})
    return run(robot, ticks, plant=plant, substeps=5)


def vector(recording, name, size):
    return np.array([recording[f"imu.{name}[{index}]"] for index in range(size)]).T


@pytest.mark.parametrize(
    "model, attitude", [("3DM-GX5-25", "filter"), ("3DM-GX5-25", "sensor"), ("3DM-CV7-AHRS", "filter")]
)
def test_measurements_are_converted_to_si(model, attitude):
    q = turned(0.7, (0.0, 1.0, 0.0))
    walk = simulate(
        40,
        device={"attitude": attitude},
        emulated={"model": model},
        accel=(1.0, -2.0, 9.0),
        gyro=(0.1, 0.2, -0.3),
        mag=(20.0, -5.0, 40.0),
        quaternion=q,
        temperature=36.5,
    )
    for name, wanted in (
        ("accel", (1.0, -2.0, 9.0)),
        ("gyro", (0.1, 0.2, -0.3)),
        ("mag", (20.0, -5.0, 40.0)),
        ("quaternion", q),
        ("euler", (0, 0.7, 0)),
    ):
        # single precision on the wire
        np.testing.assert_allclose(vector(walk, name, len(wanted))[-1], wanted, rtol=1e-6, atol=1e-6)
    assert walk["imu.temperature"][-1] == 36.5 and walk["imu.corrupt"][-1] == walk["imu.lost"][-1] == 0
    # the first tick comes before the first sample
    assert walk["imu.packets"][-1] == (39 if attitude == "sensor" else 78)
    np.testing.assert_allclose(walk["imu.rotation[0][2]"][-1], math.sin(0.7), rtol=1e-6)


def test_outputs_are_nan_before_first_sample():
    walk = simulate(5, faults={"silent": True})
    assert (
        np.isnan(vector(walk, "accel", 3)).all()
        and np.isnan(vector(walk, "quaternion", 4)).all()
        and walk["imu.packets"][-1] == 0
    )


@pytest.mark.parametrize("seed", [1, 3])  # the first packets of the sensors' set are lost, or of the filter's
def test_arming_waits_for_the_first_sample_of_every_channel(seed):
    walk = simulate(1, device={"timeout": 0.1}, emulated={"seed": seed}, faults={"skipped": 0.4})
    assert np.isfinite([*vector(walk, "accel", 3)[0], *vector(walk, "quaternion", 4)[0]]).all()


def test_a_sample_needs_the_packets_of_all_requested_sets_that_the_sensor_sends():
    sensors, filter = mip.packet(0x80, (0x05, bytes(12))), mip.packet(0x82, (0x03, bytes(18)))
    sensor = Hearing(channels=("gyro", "quaternion"))
    answers = [sensor.feed(packet) for packet in (sensors, filter, sensors, sensors, filter)]
    assert answers == [{NOTED: 1}, {TAKEN: 1}, {NOTED: 1}, {NOTED: 1}, {TAKEN: 1}]
    without_filter = Hearing(channels=("gyro", "quaternion"))
    answers = [without_filter.feed(sensors, time=time) for time in (0.1, 0.59, 0.61, 0.62)]
    assert answers == [{NOTED: 1}, {NOTED: 1}, {TAKEN: 1}, {TAKEN: 1}]


def test_unrequested_channels_are_nan_and_extra_channels_have_ports():
    walk = simulate(10, device={"channels": ("gyro", "pressure", "linear_accel")}, accel=(1.0, 2.0, 3.0))
    assert np.isnan(vector(walk, "accel", 3)[-1]).all() and np.isnan(walk["imu.temperature"][-1])
    assert walk["imu.pressure"][-1] == pytest.approx(101325.0) and vector(walk, "linear_accel", 3)[-1] == pytest.approx(
        [1.0, 2.0, 3.0]
    )


def test_an_unknown_channel_is_rejected_with_the_known_ones():
    with (
        Diagram("robot", rate=RATE),
        pytest.raises(DiagramError, match="channels must be among accel, gyro, mag.*got 'acel'"),
    ):
        MicroStrain(channels=("acel",))


# Tare


def test_a_tare_at_the_start_is_over_before_anything_is_armed():
    q = turned(0.4, (1.0, 0.0, 0.0))
    walk = simulate(100, device={"tare_at_start": True, "timeout": 0.1}, quaternion=q)
    np.testing.assert_allclose(walk["imu.euler[0]"], 0.0, atol=1e-6)
    np.testing.assert_allclose(vector(walk, "tare_attitude", 4)[0], q, atol=1e-7)
    np.testing.assert_allclose(vector(walk, "raw_quaternion", 4)[-1], q, atol=1e-7)
    assert walk["imu.tared"].all()


def test_sensor_that_is_not_awaited_is_tared_during_run():
    walk = simulate(
        300, device={"tare_at_start": True, "tare_time": 1.0, "timeout": 0.0}, quaternion=turned(0.4, (1.0, 0.0, 0.0))
    )
    before, after = walk.time < 0.95, walk.time > 1.1
    np.testing.assert_allclose(walk["imu.euler[0]"][before][5:], 0.4, atol=1e-6)
    np.testing.assert_allclose(walk["imu.euler[0]"][after], 0.0, atol=1e-6)
    assert not walk["imu.tared"][before].any() and walk["imu.tared"][after].all()


def test_a_tare_longer_than_the_arming_limit_is_rejected():
    with Diagram("robot", rate=RATE), pytest.raises(DiagramError, match="tare_time must be at most 0.8 s"):
        MicroStrain(tare_at_start=True, tare_time=2.0)


def test_first_tick_uses_sample_received_while_arming():
    walk = simulate(3, device={"timeout": 0.1}, accel=(1.0, 2.0, 3.0))
    assert vector(walk, "accel", 3)[0] == pytest.approx([1.0, 2.0, 3.0]) and walk["imu.quaternion[0]"][0] == 1.0


def test_a_tare_starts_at_the_rising_edge_of_its_input():
    ticks = 400
    angles = np.where(np.arange(5 * ticks) < 5 * 200, 0.2, 0.5)  # tared at 0.2 rad, turned to 0.5 rad later
    path = np.array([turned(angle, (0.0, 0.0, 1.0)) for angle in angles])
    asked = np.zeros(ticks, dtype=bool)
    asked[50:60] = True
    walk = simulate(ticks, device={"tare_time": 0.2}, tare=asked, quaternion=path)
    assert walk["imu.euler[2]"][45] == pytest.approx(0.2, abs=1e-6) and walk["imu.euler[2]"][150] == pytest.approx(
        0.0, abs=1e-6
    )
    assert walk["imu.euler[2]"][-1] == pytest.approx(0.3, abs=1e-6) and walk["imu.tared"][-1]


def test_an_attitude_of_angles_alone_gives_the_same_quaternion():
    q = turned(1.0, (0.6, 0.0, 0.8))
    both = simulate(10, quaternion=q), simulate(10, device={"channels": ("euler",)}, quaternion=q)
    np.testing.assert_allclose(vector(both[1], "quaternion", 4)[-1], vector(both[0], "quaternion", 4)[-1], atol=1e-6)


# Faults


def test_a_sensor_that_stops_ends_the_run_past_its_timeout():
    walk = simulate(200, device={"timeout": 0.1}, faults={"silent": np.arange(1000) >= 500})
    assert walk.outcome.status == "silent" and walk.outcome.culprit == "imu"
    # its last sample came up to two ticks before
    assert 0.5 + 0.1 - 0.01 <= walk.outcome.tick / RATE <= 0.5 + 0.1 + 0.01
    assert walk["imu.age"][-1] == pytest.approx(0.1, abs=0.01)


def test_nan_from_a_sensor_never_becomes_a_torque():
    with Diagram("robot", rate=RATE) as robot:
        imu = MicroStrain(name="imu", timeout=0.0)
        knee = CubeMars("AK80-9", bus="legs", name="knee")
        knee(torque_command=TorqueLimiter(limit=5.0)(Gain(3.0, unit="N·m/rad")(imu.euler[0])))
    with Diagram("plant", rate=5 * RATE) as plant:
        sensor, drive = EmulatedMicroStrain.of(imu), knee.emulator()
        drive(position=0.0, velocity=0.0)
        sensor(not_a_number=player(np.arange(1000) >= 200, "1", bool))
    walk = run(robot, 200, plant=plant, substeps=5)
    assert walk.outcome.status == "not finite" and walk.outcome.culprit == "knee"


def test_invalid_filter_output_is_nan_and_reported():
    walk = simulate(100, faults={"uninitialised": np.arange(500) < 250})
    assert (
        np.isnan(walk["imu.quaternion[0]"][20]) and not walk["imu.valid"][20] and not np.isnan(walk["imu.accel[2]"][20])
    )
    assert walk["imu.quaternion[0]"][-1] == 1.0 and walk["imu.valid"][-1]


def test_unplug_and_reconnect_are_detected():
    walk = simulate(200, faults={"disconnected": (np.arange(1000) >= 300) & (np.arange(1000) < 600)})
    connected = walk["imu.connected"].astype(bool)
    assert connected[20] and not connected[70] and connected[130]
    assert walk["imu.age"][118] == pytest.approx(0.295, abs=0.01) and walk["imu.age"][-1] < 0.011
    assert walk["imu.lost"][-1] == pytest.approx(2 * 60, abs=2)  # of both sets, as its clock tells


def test_missing_samples_are_counted():
    walk = simulate(2000, device={"attitude": "sensor"}, faults={"skipped": 0.1})
    assert walk["imu.lost"][-1] == pytest.approx(2000 - walk["imu.packets"][-1], abs=2)
    assert 150 < walk["imu.lost"][-1] < 250  # 200 on the mean, 13 the standard deviation


def test_packets_with_a_wrong_bit_are_counted_and_discarded():
    walk = simulate(1000, faults={"flipped": 0.2}, accel=(0.0, 0.0, -9.8), quaternion=(1.0, 0.0, 0.0, 0.0))
    assert walk["imu.corrupt"][-1] > 200
    assert set(np.round(walk["imu.accel[2]"][5:], 5)) == {-9.8} and set(walk["imu.quaternion[0]"][5:]) == {1.0}


@pytest.mark.parametrize("faults", [{"garbage": 20.0}, {"dropped": 0.002}])
def test_garbage_and_lost_bytes_affect_only_their_packets(faults):
    walk = simulate(2000, device={"channels": ("gyro",)}, faults=faults, gyro=(0.1, 0.2, 0.3))
    sent = 2000  # 34 bytes each, with the time
    hit = sent * (1.0 - (1.0 - faults.get("dropped", 0.0)) ** 34)
    spread = 5.0 * math.sqrt(hit) + 3.0
    assert abs(walk["imu.packets"][-1] - (sent - hit)) <= spread
    assert np.abs(vector(walk, "gyro", 3)[50:] - (0.1, 0.2, 0.3)).max() < 1e-7


# The clock


@pytest.mark.parametrize("error", [0.0, 50e-6, -200e-6])
def test_sensor_clock_is_mapped_to_host_clock_with_drift(error):
    walk = simulate(20 * RATE, emulated={"clock_error": error, "clock_start": 12345.0})
    assert walk["imu.clock_drift"][-1] == pytest.approx(error, abs=2e-6)
    late = walk.time[2 * RATE :] - walk["imu.sample_time"][2 * RATE :]
    assert late.min() >= -1e-9 and late.max() <= 0.0061  # a tick and a step of the plant: none is from the future


def test_received_rate_is_reported():
    walk = simulate(600, device={"rate": 100.0})
    assert walk["imu.measured_rate"][-1] == pytest.approx(100.0, rel=0.02)


# Bytes

STREAM = b"".join(
    mip.packet(0x80, (0x05, bytes([number]) * 12), (0xD5, number.to_bytes(8, "big"))) for number in range(100)
)
LENGTH = len(STREAM) // 100


@pytest.mark.parametrize("chunk", [1, 2, 3, 5, 17, 31, 63, 64])
def test_a_stream_may_be_cut_anywhere(chunk):
    sensor = Hearing(channels=("gyro",))
    sensor.feed(STREAM, chunk)
    assert sensor["packets"] == 100 and sensor["corrupt"] == 0


def test_chunk_is_flagged_if_it_has_a_sample():
    sensor, packet = Hearing(channels=("gyro",)), STREAM[:LENGTH]
    assert sensor.feed(packet[:20]) == {NOTED: 1} and sensor.feed(packet[20:]) == {TAKEN: 1}
    assert sensor.feed(packet[:-1] + bytes([packet[-1] ^ 1])) == {MALFORMED: 1}
    assert sensor.feed(mip.command(mip.BASE, mip.PING)) == {NOTED: 1}


def test_bytes_after_gap_are_not_joined_to_earlier_ones():
    sensor, packet = Hearing(channels=("gyro",)), STREAM[:LENGTH]
    sensor.feed(packet[:20])
    sensor.feed(packet, flags=1)
    assert sensor["packets"] == 1
    sensor.feed(packet[:20])
    sensor.feed(b"", identifier=1)  # the line is gone
    assert sensor["connected"] == 0
    sensor.feed(packet)
    assert sensor["packets"] == 2 and sensor["connected"] == 1


def test_packet_with_inconsistent_field_lengths_is_rejected():
    sensor = Hearing(channels=("gyro",))
    for payload in (b"\x00\x05", b"\x01\x05\x02", b"\x0e\x05" + bytes(4), b""):
        head = mip.SYNC + bytes((0x80, len(payload))) + payload
        sensor.feed(head + mip.fletcher(head))
    assert sensor["packets"] == 0
    # fields that are too short: nothing is read beyond them
    sensor.feed(mip.packet(0x80, (0x05, bytes(4)), (0x05, b"")))
    assert np.isnan(sensor["gyro"]).all()


def test_after_a_stall_the_newest_sample_is_used():
    """Nine hundred frames wait when the first tick comes; a drain of 64 would leave it 0.8 s behind."""
    with Diagram("robot", rate=RATE) as robot:
        MicroStrain(name="imu", timeout=0.0, channels=("gyro",))

    def before(buses):
        for number in range(900):
            value = np.array([number] * 3, dtype=">f4").tobytes()
            assert buses["imu"].device.send(0, mip.packet(0x80, (0x05, value)))

    walk = run(robot, 1, before=before)
    assert walk["imu.gyro[0]"][0] == 899.0


def test_two_sensors_on_one_line_are_rejected():
    with Diagram("robot", rate=RATE) as robot:
        MicroStrain(name="a", bus="x")
        MicroStrain(name="b", bus="x")
    with pytest.raises(DiagramError, match="TW013.*is on bus 'x' with a.*needs a separate line"):
        compile(robot)
    with Diagram("robot", rate=RATE) as robot:
        MicroStrain(name="a", bus="x")
        CubeMars("AK80-9", bus="x", name="b")(torque_command=0.0)
    with pytest.raises(DiagramError, match="TW013.*needs an interface of kind can, but a uses stream"):
        compile(robot)


def test_line_is_named_after_the_path_of_the_sensor():
    from graph import subsystem

    with Diagram("robot", rate=RATE) as robot, subsystem("left"):
        MicroStrain(name="shank_imu")
    assert (
        compile(robot).buses == ["left/shank_imu"] and compile(robot).media == ["stream"] and not compile(robot).loads
    )

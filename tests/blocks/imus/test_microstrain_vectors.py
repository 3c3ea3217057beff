"""MIP against packets that the vendor's own libraries made or read: the vendor's C++ SDK, and MSCL through a
pseudo-terminal.

Values come as doubles that the SDK rounded to single precision on the wire: half a unit in the last place, 6e-8 of the
value, is what may differ. In whole numbers and doubles nothing may. A field whose flags are 0 is invalid to MSCL, and
NaN here.
"""

import math
import struct

import numpy as np
import pytest

from blocks.imus.microstrain import mip
from blocks.imus.microstrain.descriptors import STANDARD_GRAVITY
from tests.blocks.imus.hearing import EVERYTHING, TAKEN, Hearing
from tests.shared import entries

SINGLE = 6e-8
PACKETS = entries("mip_packets")
DATA = [entry for entry in PACKETS if entry["name"].startswith(("imu data", "filter data"))]
BAD = [entry for entry in PACKETS if entry.get("expect") == "reject"]
G = STANDARD_GRAVITY
SENSOR = {  # what the vectors call a field: output of the block, name in the table, scale, flagged
    "accel_g_04": ("accel", "accel", G),
    "gyro_rad_s_05": ("gyro", "gyro", 1.0),
    "mag_gauss_06": ("mag", "mag", 100.0),
    "dtheta_rad_07": ("delta_angle", "delta_angle", 1.0),
    "dv_g_s_08": ("delta_velocity", "delta_velocity", G),
    "matrix_09": ("sensor_matrix", "sensor_matrix", 1.0),
    "quat_wxyz_0A": ("raw_quaternion", "sensor_quaternion", 1.0),
    "euler_rad_0C": ("raw_euler", "sensor_euler", 1.0),
    "internal_ts_0E": ("internal_ticks", "internal_ticks", 1.0),
    "stab_mag_10": ("stabilised_mag", "stabilised_mag", 100.0),
    "stab_accel_11": ("stabilised_accel", "stabilised_accel", G),
    "gps_ts_12_tow_week_flags": ("sensor_time", "sensor_time", 1.0),
    "temp_c_14_min_max_mean": ("temperature", "temperatures", 1.0),
    "pressure_mbar_17": ("pressure", "pressure", 100.0),
    "event_D0": ("event", "event", 1.0),
    "gps_ts_D3_tow_week_flags": ("gps_time", "gps_time", 1.0),
    "delta_time_s_D4": ("delta_time", "delta_time", 1.0),
    "ref_time_ns_D5": ("reference_time", "reference_time", 1e-9),
}
FILTER = {
    "quat_wxyz_03_flags": ("raw_quaternion", "filter_quaternion", 1.0),
    "dcm_04_flags": ("filter_matrix", "filter_matrix", 1.0),
    "euler_rad_05_flags": ("raw_euler", "filter_euler", 1.0),
    "gyro_bias_06_flags": ("gyro_bias", "gyro_bias", 1.0),
    "linear_accel_m_s2_0D_flags": ("linear_accel", "linear_accel", 1.0),
    "comp_rate_rad_s_0E_flags": ("compensated_gyro", "compensated_gyro", 1.0),
    "status_10_state_dyn_flags": ("filter_status", "filter_status", 1.0),
    "filter_ts_11_tow_week_flags": ("filter_time", "filter_time", 1.0),
    "gravity_m_s2_13_flags": ("gravity", "gravity", 1.0),
    "comp_accel_m_s2_1C_flags": ("compensated_accel", "compensated_accel", 1.0),
    "ref_time_ns_D5": ("reference_time", "reference_time", 1e-9),
}
TIMES = ("tow_week_flags",)
FLAGGED = {
    "quat_wxyz_03_flags",
    "dcm_04_flags",
    "euler_rad_05_flags",
    "gyro_bias_06_flags",
    "linear_accel_m_s2_0D_flags",
    "comp_rate_rad_s_0E_flags",
    "gravity_m_s2_13_flags",
    "comp_accel_m_s2_1C_flags",
}


def numbers(key, given, scale):
    """Expected output of a field, from the vectors."""
    values = np.array([float(value) for value in np.ravel(given)])
    if key.endswith(TIMES):
        return values[:1]
    if key == "temp_c_14_min_max_mean":
        return values[2:] * scale
    if key in FLAGGED:
        values, valid = values[:-1], values[-1] != 0
        return values * scale if valid else np.full(len(values), np.nan)
    return values * scale


def check(found, wanted, key, entry):
    tolerance = 0.0 if key.endswith(("_0E", "_D0", "D5", "status_10_state_dyn_flags", *TIMES)) else SINGLE
    np.testing.assert_allclose(
        np.ravel(found),
        wanted,
        rtol=max(tolerance, 1e-15),
        atol=0.0,
        equal_nan=True,
        err_msg=f"{key} {entry['packet_hex']}",
    )


@pytest.mark.parametrize("prefix, attitude, table", [("imu data", "sensor", SENSOR), ("filter data", "filter", FILTER)])
def test_every_field_of_every_packet_equals_the_vendors_value(prefix, attitude, table):
    fields = 0
    for entry in DATA:
        if not entry["name"].startswith(prefix):
            continue
        sensor = Hearing(attitude=attitude, channels=EVERYTHING)
        packet = bytes.fromhex(entry["packet_hex"])
        sensor.feed(packet, chunk=7)
        assert sensor["packets"] == 1, entry
        in_python = mip.decode(packet)
        for key, given in entry["inputs"].items():
            output, name, scale = table[key]
            check(sensor[output], numbers(key, given, scale), key, entry)
            theirs = in_python[name][2:] if name == "temperatures" else in_python[name]
            check(theirs, numbers(key, given, scale), key, entry)
            fields += 1
    assert fields > 300


def test_values_invalid_in_vendor_library_are_nan():
    seen = set()
    for entry in DATA:
        read = entry.get("also_decoded_by", {}).get("pymscl 68.4.5", {}).get("estOrientQuaternion")
        if read is None:
            continue
        sensor = Hearing(channels=EVERYTHING)
        sensor.feed(bytes.fromhex(entry["packet_hex"]))
        theirs = read["value"]
        if read["valid"] and all(isinstance(value, float) and math.isfinite(value) for value in theirs):
            np.testing.assert_allclose(sensor["raw_quaternion"], theirs, rtol=SINGLE)
        else:
            assert (
                not read["valid"]
                and np.isnan(sensor["raw_quaternion"]).all()
                or not np.isfinite(sensor["raw_quaternion"]).all()
            )
        seen.add(read["valid"])
    assert seen == {True, False}


def test_corrupted_packets_are_refused():
    assert len(BAD) == 20
    for entry in BAD:
        sensor, packet = Hearing(channels=EVERYTHING), bytes.fromhex(entry["packet_hex"])
        answers = sensor.feed(packet + bytes(300))  # zeros, for a length that was spoilt
        assert TAKEN not in answers and sensor["packets"] == 0, entry
        assert not mip.split(packet + bytes(300))[0], entry


def test_all_packets_in_one_stream_are_parsed():
    good = [bytes.fromhex(entry["packet_hex"]) for entry in DATA]
    bad = [bytes.fromhex(entry["packet_hex"]) for entry in BAD]
    stream = b"".join(packet + bad[number % len(bad)] for number, packet in enumerate(good)) + bytes(300)
    sensor = Hearing(channels=EVERYTHING)
    sensor.feed(stream)
    assert sensor["packets"] == len(good)


def test_commands_are_byte_for_byte_those_of_the_vendors_libraries():
    """Set-up: every packet that the vendors' programs sent to a sensor, encoded again."""
    sent = {(entry["name"], entry["packet_hex"]) for entry in PACKETS if entry["direction"] == "host->device"}
    assert len(sent) > 100
    for name, text in sent:
        packet = bytes.fromhex(text)
        assert mip.packet(packet[2], *mip.fields(packet)) == packet, name
    ours = {
        "base ping 01/01": mip.command(mip.BASE, mip.PING),
        "setToIdle": mip.command(mip.BASE, mip.IDLE),
        "resume": mip.command(mip.BASE, mip.RESUME),
        "modelName": mip.command(mip.BASE, mip.INFO),
        "enableDataStream IMU": mip.command(mip.COMMAND_3DM, 0x11, "BBB", mip.WRITE, 1, 1),
    }
    theirs = {name: bytes.fromhex(text) for name, text in sent}
    assert {name: theirs[name] for name in ours} == ours


def test_device_information_is_decoded_as_by_the_vendor():
    from blocks.imus.microstrain.queries import Information

    [entry] = [entry for entry in PACKETS if entry["name"].startswith("device info reply")]
    [(_, data)] = [field for field in mip.fields(bytes.fromhex(entry["packet_hex"])) if field[0] == 0x81]
    found = Information.of(data)
    told = entry["inputs"]
    assert (found.model, found.serial, found.lot, found.firmware) == (
        told["model_name"],
        told["serial_number"],
        told["lot_number"],
        "1.2.34",
    )
    assert struct.unpack(">H", data[:2])[0] == told["firmware_version"]

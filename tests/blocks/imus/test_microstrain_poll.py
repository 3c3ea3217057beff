"""Data on request and the status of an emulated MicroStrain sensor, as its protocol describes them.

Layouts: the data communications protocol of the 3DM-GX5 (0C 01, 0C 64), commands_3dm.h of the MIP SDK (0C 0D), and
DeviceStatus.cpp of MSCL 68 for the further models.
"""

import struct

import pytest

from blocks.imus.microstrain import mip
from blocks.imus.microstrain.models import MODELS
from tests.blocks.actuators.wire import TAKEN
from tests.blocks.imus.test_microstrain_settings import BYTES, CV5, CV7, GX5, answer, wired

ACCEL, GYRO, MATRIX, FILTER_EULER, UNKNOWN = 0x04, 0x05, 0x09, 0x05, 0x7B
SENSOR, FILTER = 0x80, 0x82
TIME = 0  # slot of the arena, cext/abi.pxd


def replies(sensor, packet):
    """[(set, [(descriptor, data)])] that the sensor sends."""
    packets, _, _ = mip.split(answer(sensor, packet))
    return [(each[2], mip.fields(each)) for each in packets]


def poll(model, which, *descriptors, quiet=False):
    """Packet that requests data once: the older generation has a command for each set."""
    if MODELS[model].newer:
        data = bytes((which, quiet, len(descriptors), *descriptors))
        return mip.packet(0x0C, (0x0D, data))
    data = bytes((quiet, len(descriptors))) + b"".join(struct.pack(">BH", each, 0) for each in descriptors)
    return mip.packet(0x0C, (0x01 if which == SENSOR else 0x03, data))


def command_of(model, which):
    return 0x0D if MODELS[model].newer else 0x01 if which == SENSOR else 0x03


@pytest.mark.parametrize("model", [GX5, CV7])
@pytest.mark.parametrize("which, descriptor, length", [(SENSOR, ACCEL, 12), (FILTER, FILTER_EULER, 14)])
def test_polled_data_follow_the_acknowledgement(model, which, descriptor, length):
    sensor = wired(model)
    (_, acknowledged), (found, [(name, data)]) = replies(sensor, poll(model, which, descriptor))
    assert acknowledged == [(mip.ACKNOWLEDGE, bytes((command_of(model, which), 0)))]
    assert (found, name, len(data)) == (which, descriptor, length)
    if which == SENSOR:
        assert struct.unpack(">3f", data) == pytest.approx((0.0, 0.0, -1.0))  # g


@pytest.mark.parametrize("model", [GX5, CV7])
def test_a_poll_keeps_the_order_and_ignores_unknown_descriptors(model):
    _, (_, fields) = replies(wired(model), poll(model, SENSOR, GYRO, UNKNOWN, ACCEL))
    assert [name for name, _ in fields] == [GYRO, ACCEL]
    assert len(replies(wired(model), poll(model, SENSOR, UNKNOWN))) == 1


@pytest.mark.parametrize("model", [GX5, CV7])
def test_a_poll_without_acknowledgement_sends_the_data_alone(model):
    [(which, fields)] = replies(wired(model), poll(model, SENSOR, MATRIX, quiet=True))
    assert which == SENSOR and [name for name, _ in fields] == [MATRIX]


@pytest.mark.parametrize("model", [GX5, CV7])
def test_a_poll_without_descriptors_uses_the_stored_format(model):
    sensor = wired(model)
    stored = [name for name, _ in replies(sensor, poll(model, SENSOR))[1][1]]
    assert ACCEL in stored and len(stored) > 3
    format = (SENSOR, 0) if MODELS[model].newer else (0,)
    answer(sensor, mip.packet(0x0C, (0x0F if MODELS[model].newer else 0x08, bytes((mip.WRITE, *format)))))
    [(_, [(_, (_, code))])] = replies(sensor, poll(model, SENSOR))
    assert code == 4  # no format in the command, and none stored


def test_a_short_poll_is_refused():
    for data in (b"", b"\0", b"\0\2\4\0\0"):
        [(_, [(_, (command, code))])] = replies(wired(), mip.packet(0x0C, (0x01, data)))
        assert (command, code) == (0x01, 3)


def status(sensor, number, selector):
    packet = mip.packet(0x0C, (0x64, struct.pack(">HB", number, selector)))
    [(_, [(_, (command, code)), *rest])] = replies(sensor, packet)
    assert command == 0x64
    return rest[0] if code == 0 else code


RUNNING = 3


def test_the_status_of_a_gx5_25_states_its_model_time_streams_and_port():
    sensor = wired(GX5)
    sensor.arena[TIME] = 2.5
    head = struct.pack(">HBIHI", 6253, 1, 0, RUNNING, 2500)
    assert status(sensor, 6253, 1) == (0x90, head)
    answer(sensor, mip.packet(0x0C, (0x11, b"\1\1\1")))  # streams set 80
    reply, data = status(sensor, 6253, 2)
    imu, filtered, *dropped, written, read, _, _, errors, samples, last = struct.unpack_from(">BB9I", data, len(head))
    assert reply == 0x90 and data[3:13] == head[3:] and len(data) == 51
    assert (imu, filtered, dropped, errors) == (1, 0, [0, 0], 0)
    assert written > 20 and read > 20 and samples > 400 and last == 2500


def test_the_status_of_a_cv5_10_has_the_layout_of_an_inertial_unit():
    sensor = wired(CV5)
    sensor.arena[TIME] = 1.0
    assert status(sensor, 6259, 1) == (0x90, struct.pack(">HBII", 6259, 1, 0, 1000))
    _, data = status(sensor, 6259, 2)
    magnetometer, pressure, power, gyro, accel, _, temperature, _, error, *_ = struct.unpack_from(">3BHHIfIB", data, 11)
    assert (magnetometer, pressure, power, gyro, accel) == (0, 1, 1, 300, 5)
    assert (temperature, error, len(data)) == (30.0, 0, 60)


@pytest.mark.parametrize("number, selector", [(6252, 1), (6253, 3), (0, 0)])
def test_the_status_of_another_model_or_selector_is_refused(number, selector):
    assert status(wired(GX5), number, selector) == 3


def test_the_newer_generation_has_no_device_status():
    assert status(wired(CV7), 6286, 1) == 1
    [(_, [(_, (_, code))])] = replies(wired(CV7), mip.packet(0x0C, (0x01, b"\0\0")))
    assert code == 1


def test_the_time_of_an_external_clock_is_accepted_with_or_without_acknowledgement():
    def update(function, selector):
        return replies(wired(), mip.packet(0x01, (0x72, struct.pack(">BBI", function, selector, 77))))

    assert update(mip.WRITE, 1) == [(0x01, [(mip.ACKNOWLEDGE, b"\x72\0")])] and update(6, 2) == []
    assert update(mip.READ, 2) == [(0x01, [(mip.ACKNOWLEDGE, b"\x72\0"), (0x85, struct.pack(">I", 1000))])]
    assert update(mip.WRITE, 3) == [(0x01, [(mip.ACKNOWLEDGE, b"\x72\3")])]


def test_a_line_that_is_too_slow_drops_whole_packets_and_no_reply():
    """1000 Hz with one tick of 256 bytes in 20 ms: an order of magnitude more than the line carries."""
    sensor, received = wired(GX5), b""
    fields = (0x04, 0x05, 0x06, 0x09, 0x0A, 0x0C)
    answer(
        sensor, mip.command(mip.COMMAND_3DM, 0x08, "BB" + "BH" * 6, mip.WRITE, 6, *(n for f in fields for n in (f, 1)))
    )
    answer(sensor, mip.packet(0x0C, (0x11, b"\1\1\1")))
    for tick in range(1, 100):
        sensor.arena[TIME] = 0.02 * tick
        received += b"".join(chunk for _, chunk in sensor.say())
    assert sensor.hear(BYTES, mip.packet(0x01, (0x02, b""))) == TAKEN  # idle
    for _ in range(100):
        received += b"".join(chunk for _, chunk in sensor.say())
    packets, _, corrupt = mip.split(received)
    assert not corrupt and len(packets) > 100 and mip.fields(packets[-1]) == [(mip.ACKNOWLEDGE, b"\2\0")]
    _, data = status(sensor, 6253, 2)
    assert struct.unpack_from(">I", data, 15)[0] > 1000  # dropped packets of the set 80

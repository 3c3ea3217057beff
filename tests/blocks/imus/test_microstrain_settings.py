"""Filters and mounting of a MicroStrain sensor: written, read back, and obeyed by the emulated one."""

import math

import numpy as np
import pytest

from blocks.imus import EmulatedMicroStrain, MicroStrain
from blocks.imus.microstrain import mip, mounting
from blocks.imus.microstrain.models import MODELS
from cext.kernels.devices.microstrain import emulator as kernels
from graph import Diagram, DiagramError
from graph.dialogue import Rejected
from tests.blocks.actuators.wire import TAKEN, Wired
from tests.blocks.imus.test_microstrain import simulate, turned, vector

BYTES = 0  # cext/lines/stream_frames.pxd: a chunk of a line
GX5, CV5, CV7 = "3DM-GX5-25", "3DM-CV5-10", "3DM-CV7-AHRS"
ROLLED = (0.5 * math.pi, 0.0, 0.0)

# What MSCL 68.4.5 sends for Epically Powerful 1.0.7 at 200 Hz: format of six fields, stream, rotation, 0C 51.
CLIENT = (
    "756501020201e0c6",
    "756501020204e3c9",
    "756501020202e1c7",
    "75650c020206f0f7",
    "75650c16160801060a00050c00050500050400050900050600056dfa",
    "75650c050511010101041a",
    "756501020206e5cb",
    "75650d0f0f11010000000000000000000000001772",
)


def wired(model=GX5):
    return Wired(EmulatedMicroStrain, model=model, streaming_at_start=False)


def answer(sensor, packet):
    """Bytes that the emulated sensor sends for those it receives."""
    for at in range(0, len(packet), 60):
        assert sensor.hear(BYTES, packet[at : at + 60]) == TAKEN
    return b"".join(chunk for _, chunk in sensor.say())


def set_up(sensor, drop=(), **parameters):
    """(messages, remarks, settings) of a block at this sensor, which acknowledges and ignores the commands `drop`."""
    with Diagram("robot", rate=200):
        dialogue = MicroStrain(name="imu", **parameters).set_up()
    reply = None
    while True:
        try:
            exchange = dialogue.send(reply)
        except StopIteration as end:
            return end.value
        packet = exchange.data
        if packet:
            [(command, data)] = mip.fields(packet)
            if packet[2] << 8 | command in drop and data[0] == mip.WRITE:
                reply = mip.packet(packet[2], (mip.ACKNOWLEDGE, bytes((command, 0))))
                continue
        reply = answer(sensor, packet) if packet else b""


@pytest.mark.parametrize("model", [GX5, CV7])
def test_every_setting_of_a_block_reads_back(model):
    _, remarks, settings = set_up(
        wired(model),
        heading="none",
        up_compensation=2.0,
        north_compensation=300.0,
        sensor_to_vehicle=(0.1, -0.2, 0.3),
        low_pass=25.0,
        channels=("accel", "gyro", "mag", "pressure", "quaternion"),
    )
    assert not remarks and settings == {
        "heading source": "none",
        "up compensation": "2 s",
        "north compensation": "300 s",
        "sensor to vehicle": "roll, pitch, yaw 5.73, -11.46, 17.19°",
        "low-pass of accel": "25 Hz",
        "low-pass of gyro": "25 Hz",
        "low-pass of mag": "25 Hz",
        "low-pass of pressure": "25 Hz",
    }


@pytest.mark.parametrize("model", [GX5, CV7])
def test_settings_that_a_block_leaves_are_read_and_not_written(model):
    messages, _, settings = set_up(wired(model))
    written = {packet[2] << 8 | mip.fields(packet)[0][0] for packet in messages}
    assert not written & {0x0D18, 0x0D50, 0x0C51, 0x0D11, 0x0C31, 0x0C50, 0x0C54}
    assert settings["up compensation"] == "10 s" and settings["low-pass of mag"] == "half the sample rate"


@pytest.mark.parametrize(
    "command, parameters, what",
    [
        (0x0D18, {"heading": "magnetometer"}, "heading source was set to magnetometer, but reads back as none"),
        (0x0C51, {"up_compensation": 20.0}, "up compensation was set to 20 s, but reads back as 10 s"),
        (0x0C51, {"north_compensation": 0.0}, "north compensation was set to off, but reads back as 10 s"),
        (
            0x0D11,
            {"sensor_to_vehicle": ROLLED},
            "roll, pitch, yaw 90, 0, 0°, but reads back as roll, pitch, yaw 0, 0, 0°",
        ),
        (0x0C50, {"low_pass": 30.0}, "low-pass of accel was set to 30 Hz, but reads back as half the sample rate"),
        (0x0C50, {"anti_aliasing": "off"}, "low-pass of accel was set to off, but reads back as half the sample rate"),
    ],
)
def test_a_setting_that_reads_back_differently_is_rejected(command, parameters, what):
    with pytest.raises(Rejected, match=what):
        set_up(wired(), drop={command}, **parameters)


@pytest.mark.parametrize("parameters", [{"anti_aliasing": "on"}, {"anti_aliasing": "off"}])
def test_the_low_pass_is_at_half_the_sample_rate_or_off(parameters):
    sensor = wired()
    set_up(sensor, low_pass=30.0)
    _, _, settings = set_up(sensor, **parameters)
    assert settings["low-pass of gyro"] == {"on": "half the sample rate", "off": "off"}[parameters["anti_aliasing"]]


def test_north_compensation_needs_a_magnetometer():
    with pytest.raises(Rejected, match="cannot correct the heading: it has no magnetometer"):
        set_up(wired(CV5), north_compensation=10.0)
    assert set_up(wired(CV5), north_compensation=0.0)[2]["north compensation"] == "off"


def test_the_older_generation_rejects_a_mounting_with_the_complementary_filter():
    with pytest.raises(Rejected, match="does not turn the attitude of its complementary filter"):
        set_up(wired(GX5), attitude="sensor", sensor_to_vehicle=ROLLED)
    set_up(wired(GX5), attitude="sensor", channels=("accel", "gyro"), sensor_to_vehicle=ROLLED)
    with pytest.raises(DiagramError, match="does not turn the attitude of its complementary filter"):
        simulate(5, device={"channels": ("accel", "sensor_matrix"), "sensor_to_vehicle": ROLLED})
    set_up(wired(CV7), attitude="sensor", sensor_to_vehicle=ROLLED)


@pytest.mark.parametrize(
    "parameters, message",
    [
        ({"up_compensation": 0.5}, "up_compensation must be 0, or 1 to 1000 s, got 0.5 s"),
        ({"low_pass": 20.0, "anti_aliasing": "off"}, "set one of the two"),
        ({"sensor_to_vehicle": (0.0, 1.0)}, "must be .roll, pitch, yaw. in rad"),
    ],
)
def test_settings_that_contradict_each_other_are_rejected(parameters, message):
    with Diagram("robot", rate=200), pytest.raises(DiagramError, match=message):
        MicroStrain(**parameters)


# Mounting

ANGLES = [(0.3, -0.4, 2.0), (3.0, 1.2, -2.5), (0.0, 0.5 * math.pi, 0.7), (0.0, -0.5 * math.pi, 0.7)]


@pytest.mark.parametrize("angles", ANGLES)
def test_stored_angles_are_those_of_the_inverse_rotation(angles):
    inverse = mounting.stored_angles(angles, False)
    np.testing.assert_allclose(np.array(mounting.matrix(inverse)), np.array(mounting.matrix(angles)).T, atol=1e-12)
    assert (
        mounting.between(mounting.stored_angles(inverse, False), angles) < 1e-7
        and mounting.stored_angles(angles, True) == angles
    )


@pytest.mark.parametrize("model", [GX5, CV7])
def test_a_rolled_sensor_reports_in_the_axes_of_its_segment(model):
    """The segment is level: its gravity is on z, while that of the sensor, rolled by 90°, is on y."""
    walk = simulate(
        10,
        device={"sensor_to_vehicle": ROLLED},
        emulated={"model": model},
        accel=(0.0, -9.80665, 0.0),
        gyro=(0.1, 0.2, 0.3),
        quaternion=turned(0.5 * math.pi, (1.0, 0.0, 0.0)),
    )
    np.testing.assert_allclose(vector(walk, "accel", 3)[-1], (0.0, 0.0, -9.80665), atol=1e-6)
    np.testing.assert_allclose(vector(walk, "gyro", 3)[-1], (0.1, -0.3, 0.2), atol=1e-6)
    np.testing.assert_allclose(vector(walk, "quaternion", 4)[-1], (1.0, 0.0, 0.0, 0.0), atol=1e-6)


def test_both_filters_at_once():
    q = turned(0.4, (0.0, 0.0, 1.0))
    channels = ("euler", "sensor_euler", "sensor_matrix", "filter_matrix")
    walk = simulate(10, device={"channels": channels}, quaternion=q)
    assert walk["imu.euler[2]"][-1] == pytest.approx(0.4) and walk["imu.sensor_euler[2]"][-1] == pytest.approx(0.4)
    for name in ("sensor_matrix", "filter_matrix"):  # from the earth's axes to the sensor's
        first = (math.cos(0.4), math.sin(0.4), 0.0)
        np.testing.assert_allclose(vector(walk, name, 9)[-1][:3], first, atol=1e-6)


# The emulated sensor


def test_the_commands_of_the_vendors_library_are_acknowledged():
    sensor = wired()
    for text in CLIENT:
        packets, _, _ = mip.split(answer(sensor, bytes.fromhex(text)))
        assert mip.fields(packets[0])[0][1][1] == 0, text


@pytest.mark.parametrize("model", sorted(MODELS))
def test_each_setting_of_a_model_is_stored_returned_saved_and_reset(model):
    sensor = wired(model)
    assert len(MODELS[model].settings) <= kernels.register_limit
    for setting in MODELS[model].settings:
        which, command, size = setting.command >> 8, setting.command & 0xFF, len(setting.factory)

        def ask(function, data=b""):
            packets, _, _ = mip.split(answer(sensor, mip.packet(which, (command, bytes((function,)) + data))))  # noqa: B023
            (_, (_, code)), *rest = mip.fields(packets[0])
            return code, rest

        assert size <= kernels.value_limit
        assert ask(mip.READ) == (0, [(setting.reply, setting.factory)])
        other = b"\0\0" + setting.factory[2:] if setting.command == 0x0C51 else bytes(size)
        assert ask(mip.WRITE, other) == (0, []) and ask(mip.READ) == (0, [(setting.reply, other)])
        assert ask(mip.WRITE, other[:-1]) == (3, []) and ask(9) == (3, [])
        assert ask(5) == (0, []) and ask(mip.READ)[1] == [(setting.reply, setting.factory)]
        ask(mip.WRITE, other), ask(3), ask(5), ask(4)
        assert ask(mip.READ)[1] == [(setting.reply, other)]


def test_a_time_constant_out_of_range_is_refused():
    sensor = wired()
    for constants in ((0.5, 10.0), (10.0, 1001.0), (math.nan, 10.0)):
        packet = mip.command(mip.COMMAND_3DM, 0x51, "BBBff", mip.WRITE, 1, 1, *constants)
        [reply], _, _ = mip.split(answer(sensor, packet))
        assert mip.fields(reply) == [(mip.ACKNOWLEDGE, b"\x51\x03")]


@pytest.mark.parametrize(
    "channels", [("mag",), ("accel", "stabilised_accel"), ("gyro", "sensor_time", "external_time")]
)
def test_a_channel_that_the_model_lacks_is_named(channels):
    lacking = channels[-1]
    with pytest.raises(DiagramError, match=f"channels: the {CV5} has no {lacking}"):
        simulate(5, device={"channels": channels}, emulated={"model": CV5})
    with pytest.raises(Rejected, match=f"it has no {lacking}"):
        set_up(wired(CV5), channels=channels)


def test_standard_channels_that_a_model_lacks_are_nan():
    walk = simulate(10, emulated={"model": CV5})
    assert np.isnan(vector(walk, "mag", 3)[-1]).all() and np.isfinite(vector(walk, "accel", 3)[-1]).all()
    assert set_up(wired(CV5))[1] == ["has no mag: those outputs are NaN"]

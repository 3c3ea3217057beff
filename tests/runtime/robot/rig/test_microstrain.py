"""MicroStrain's sensors on a rig: real pyserial on pseudo-terminals, behind them a process that answers byte for
byte.
"""

import fcntl
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import runtime
from blocks.imus import MicroStrain
from graph import Diagram
from runtime.host.errors import OK
from runtime.robot.rig.dialogue_line import converse, open_lines
from runtime.robot.rig.line import Opened
from runtime.robot.rig.streams import StreamLines
from tests.blocks.imus.hearing import Hearing
from tests.runtime.runs import finished, module, write

FILTERED = """
from blocks.imus import MicroStrain
from blocks.recorders import CsvRecorder
from graph import Diagram

SETTINGS = {"heading": "none", "up_compensation": 7.0, "north_compensation": 0.0, "sensor_to_vehicle": (0.0, 0.0, 0.0)}

with Diagram("filtered", rate=200) as diagram:
    MicroStrain(attitude="sensor", anti_aliasing="off", channels=("gyro", "euler"), **SETTINGS, name="shank")
    CsvRecorder()
"""


class Sensors:
    """The process."""

    def __init__(self, folder, *sensors, rate=1000):
        self.folder = folder
        self.process = module(
            "tests.runtime.robot.rig.sensors", folder, rate, *sensors, stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout.readline() == "ready\n"

    def unplug(self):
        """What a kernel does when a USB device goes: its line hangs up."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()
        for link in self.folder.glob("tty*"):
            link.unlink()


@pytest.fixture
def plug(tmp_path, monkeypatch):
    """Plugs sensors in: plug("133931", ...)"""
    monkeypatch.setenv("TICKWORK_PORTS", str(tmp_path / "tty*"))
    there = []

    def start(*sensors, **options):
        there.append(Sensors(tmp_path, *sensors, **options))
        return there[-1]

    yield start
    for sensors in there:
        sensors.process.kill()
        sensors.process.wait()
        sensors.process.stdout.close()


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """Four sensors that stay plugged in: the folder of their ports."""
    folder = tmp_path_factory.mktemp("bench")
    sensors = Sensors(folder, "133931", "133932=3DM-CV7-AHRS", "900001=3DM-CV5-10", "233931")
    yield folder
    sensors.unplug()
    sensors.process.stdout.close()


@pytest.fixture
def there(bench, monkeypatch):
    monkeypatch.setenv("TICKWORK_PORTS", str(bench / "tty*"))
    return bench


def robot(*imus):
    with Diagram("robot", rate=200) as diagram:
        return [MicroStrain(name=f"imu_{number}", **parameters) for number, parameters in enumerate(imus)], diagram


def one(**parameters):
    (device,), _ = robot(parameters)
    found = open_lines([device])[device]
    if isinstance(found, Opened):
        os.close(found.fd)
    return found


@pytest.fixture
def opened():
    """Opens the lines of devices: opened(devices)"""
    there = []

    def lines(devices):
        there.append(StreamLines(devices))
        return there[-1]

    yield lines
    for lines in there:
        lines.close()


def heard(pairs, until, patience=10.0):
    """Feed what streams bring to blocks until something is so. pairs : (stream, block)"""
    deadline = time.monotonic() + patience
    while not until():
        assert time.monotonic() < deadline, "it did not come to that"
        for stream, block in pairs:
            for kind, _, data, when in stream.end.receive():
                block.feed(data, identifier=kind, time=when * 1e-9)
        time.sleep(0.002)


def test_sensors_are_matched_by_last_serial_digits_on_any_port(there, opened):
    devices, _ = robot(
        {"serial": "3932", "rate": 500.0},
        {"serial": "6253.133931"},
        {"serial": "0001", "attitude": "sensor", "rate": 100.0},
    )
    lines = opened(devices)
    assert lines.problems == []
    lines.start(30)  # a busy machine must not delay it until the buffer of the line is full
    blocks = [Hearing(**{name: getattr(device, name) for name in ("serial", "rate", "attitude")}) for device in devices]
    streams = [lines.lines[device.bus][1] for device in devices]
    for stream in streams:
        stream.begin(time.monotonic_ns())

    def at_their_rate():
        """500, 200, 100 Hz; a busy machine may hold up the sensors, but not for long."""
        return [block["measured_rate"] for block in blocks] == pytest.approx([each.rate for each in devices], rel=0.3)

    heard(list(zip(streams, blocks)), at_their_rate)
    channels = {device.path: lines.lines[device.bus][0].bus.channel for device in devices}
    remarks = {device.path: lines.lines[device.bus][0].remarks for device in devices}
    assert [Path(channels[device.path]).name for device in devices] == ["tty133932", "tty133931", "tty900001"]
    for block in blocks:
        assert block["corrupt"] == 0 and block["accel"][2] == pytest.approx(-9.80665) and block["quaternion"][0] == 1.0
    assert "has no mag" in remarks["imu_2"][0] and not remarks["imu_0"]


def test_sensor_has_the_settings_sent(there):
    """The set-up that is kept for its return, read back from the sensor."""
    from blocks.imus.microstrain import mip
    from blocks.imus.microstrain.queries import ask, identify
    from runtime.robot.rig.ports import open_port

    found = one(
        serial="133931",
        rate=250.0,
        heading="magnetometer",
        north_compensation=0.0,
        sensor_to_vehicle=(0.0, 0.0, 0.0),
        low_pass=40.0,
        channels=("gyro", "quaternion"),
    )
    assert [message[2] << 8 | mip.fields(message)[0][0] for message in found.setup] == [
        0x0102,
        0x0C08,
        0x0C0A,
        0x0D18,
        0x0C51,
        0x0D11,
        0x0C50,
        0x0C11,
        0x0C11,
        0x0106,
    ]
    with open_port("", found.channel, 115200) as port:
        converse(port, identify())
        assert converse(port, ask(mip.command(mip.COMMAND_3DM, 0x08, "B", mip.READ)))[0x80] == bytes(
            (2, 0x12, 0, 4, 0x05, 0, 4)
        )
        assert converse(port, ask(mip.command(mip.COMMAND_3DM, 0x0A, "B", mip.READ)))[0x82] == bytes(
            (2, 0x11, 0, 4, 0x03, 0, 4)
        )
        assert converse(port, ask(mip.command(mip.COMMAND_3DM, 0x11, "BB", mip.READ, 3)))[0x85] == bytes((3, 1))


def test_newer_generation_is_configured_for_magnetometer_aiding(there):
    """0D 50, of which it supports one source: the fourth, as in the examples of its maker."""
    from blocks.imus.microstrain import mip
    from blocks.imus.microstrain.queries import Refusal, ask, identify
    from runtime.robot.rig.ports import open_port

    for heading, enabled in (("magnetometer", 1), ("none", 0)):
        found = one(serial="133932", heading=heading)
        assert [mip.fields(message)[0] for message in found.setup if message[2] == mip.COMMAND_FILTER] == [
            (0x50, bytes((mip.WRITE, 0, 4, enabled)))
        ]
    with open_port("", found.channel, 115200) as port:
        converse(port, identify())
        for source in (3, 0x104):
            with pytest.raises(Refusal) as refused:
                converse(port, ask(mip.command(mip.COMMAND_FILTER, 0x50, "BHB", mip.WRITE, source, 1)))
            assert refused.value.code == 3


def test_filters_and_mounting_are_written_and_read_back(there):
    found = one(
        serial="133931",
        heading="magnetometer",
        up_compensation=20.0,
        north_compensation=0.0,
        sensor_to_vehicle=("90 deg", 0.0, "-30 deg"),
        low_pass=40.0,
        channels=("gyro", "mag", "quaternion"),
    )
    assert found.settings == {
        "sensor": "3DM-GX5-25 6253.133931, firmware 1.1.6",
        "heading source": "magnetometer",
        "up compensation": "20 s",
        "north compensation": "off",
        "sensor to vehicle": "roll, pitch, yaw 90, 0, -30°",
        "low-pass of gyro": "40 Hz",
        "low-pass of mag": "40 Hz",
    }
    untouched = one(serial="133931", channels=("gyro", "quaternion"))
    assert untouched.settings["up compensation"] == "20 s" and untouched.settings["low-pass of gyro"] == "40 Hz"
    assert "axes turned by the rotation stored in it: roll, pitch, yaw 90, 0, -30°" in untouched.remarks[0]
    one(serial="133931", sensor_to_vehicle=(0.0, 0.0, 0.0), anti_aliasing="on", up_compensation=10.0)


@pytest.mark.paced
def test_the_settings_that_were_read_are_recorded(there, tmp_path):
    write(tmp_path, FILTERED, "filtered.py")
    write(tmp_path, '[device.shank]\nserial = "133931"\n', "lab.toml")
    arguments = ("--rig", "lab.toml", "--yes", "--duration", "0.2", "--record", "out")
    run = finished("filtered.py", *arguments, cwd=tmp_path)
    assert run.returncode == OK, run.stderr
    [recording] = (tmp_path / "out").glob("*.mcap")
    assert runtime.load(recording).about["metadata"]["rig"]["settings"] == {
        "shank": {
            "sensor": "3DM-GX5-25 6253.133931, firmware 1.1.6",
            "heading source": "none",
            "up compensation": "7 s",
            "north compensation": "off",
            "sensor to vehicle": "roll, pitch, yaw 0, 0, 0°",
            "low-pass of gyro": "off",
        }
    }


def streaming(plug, opened):
    """One sensor that is set up and read: (the device, its stream, the block that decodes it)."""
    sensors = plug("133931")
    devices, _ = robot({"serial": "133931"})
    lines = opened(devices)
    assert lines.problems == []
    lines.start(30)  # a busy machine must not delay it until the buffer of the line is full
    stream, block = lines.lines["imu_0"][1], Hearing()
    stream.begin(time.monotonic_ns())
    heard([(stream, block)], lambda: block["packets"] > 30 and block["connected"])
    return sensors, stream, block


def test_a_reconnected_sensor_streams_as_before(plug, opened):
    sensors, stream, block = streaming(plug, opened)
    sensors.unplug()
    heard([(stream, block)], lambda: not block["connected"])
    gone = block["packets"]
    plug("133931")  # which has forgotten everything, and streams nothing by itself
    heard([(stream, block)], lambda: block["connected"] and block["packets"] > gone + 30)
    assert stream.counts["losses"] == stream.counts["returns"] == 1


def test_a_replaced_sensor_is_not_accepted(plug, opened, tmp_path):
    sensors, stream, block = streaming(plug, opened)
    sensors.unplug()
    heard([(stream, block)], lambda: not block["connected"])
    before, other = block["packets"], plug("133932")
    (tmp_path / "tty133931").symlink_to(os.readlink(tmp_path / "tty133932"))  # at the very port
    heard([(stream, block)], lambda: stream.counts["strangers"] > 0)
    assert not block["connected"] and block["packets"] == before and stream.counts["returns"] == 0
    other.unplug()
    plug("133931")
    heard([(stream, block)], lambda: block["connected"] and block["packets"] > before + 30)
    assert stream.counts["returns"] == 1


# Failures in words


def test_an_unknown_serial_number_is_reported_with_the_sensors_found(there):
    trouble = one(serial="77")
    assert (
        trouble.code == "TW127" and 'serial = "77": no sensor has a serial number with this ending' in trouble.message
    )
    assert "6253.133931 (3DM-GX5-25" in trouble.hint and "6286.133932 (3DM-CV7-AHRS" in trouble.hint


def test_heading_from_a_missing_magnetometer_is_rejected(there):
    trouble = one(serial="900001", heading="magnetometer", channels=("gyro",))
    assert (
        trouble.code == "TW129"
        and "cannot use a magnetometer for the heading: it has no magnetometer" in trouble.message
    )
    assert "omit `heading`" in trouble.hint and isinstance(
        one(serial="900001", heading="none", channels=("gyro",)), Opened
    )


def test_an_ambiguous_or_missing_serial_number_is_rejected(there):
    assert "2 sensors have a serial number with this ending" in one(serial="33931").message
    trouble = one()
    assert trouble.code == "TW127" and "has neither a serial number nor a port" in trouble.message


def test_a_missing_sensor_is_reported(plug, tmp_path):
    trouble = one(serial="133931")
    assert trouble.code == "TW127" and "no MicroStrain sensor was found" in trouble.hint


def test_a_port_in_use_is_reported(there):
    path = str(there / "tty133931")
    holder = subprocess.Popen(
        [
            sys.executable,
            "-c",
            f"import serial; p = serial.Serial({path!r}, exclusive=True); print('held', flush=True); input()",
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert holder.stdout.readline() == "held\n"
    by_port, by_serial = one(port=path), one(serial="133931")
    holder.communicate("\n")
    assert (
        by_port.code == "TW126"
        and "is in use by python" in by_port.message
        and f"(process {holder.pid})" in by_port.message
    )
    assert by_serial.code == "TW127" and f"(process {holder.pid})" in by_serial.hint
    assert isinstance(one(serial="133931"), Opened)


def test_a_port_that_does_not_exist(there):
    trouble = one(port=str(there / "ttyACM7"))
    assert trouble.code == "TW125" and "no such port" in trouble.message


@pytest.mark.skipif(os.geteuid() == 0, reason="root may open everything")
def test_a_port_without_permission_is_reported(there):
    os.chmod(os.path.realpath(there / "tty133931"), 0)
    trouble = one(port=str(there / "tty133931"))
    assert trouble.code == "TW124" and "udevadm" in trouble.hint


def test_a_port_without_response_is_reported(there):
    master, slave = os.openpty()
    trouble = one(port=os.ttyname(slave))
    os.close(master)
    os.close(slave)
    assert trouble.code == "TW128" and "no MicroStrain sensor responds at 115200 bit/s" in trouble.message


def test_a_wrong_sensor_at_a_port_is_rejected(there):
    trouble = one(port=str(there / "tty133931"), serial="55")
    assert trouble.code == "TW127" and "that sensor is 6253.133931" in trouble.message


def test_an_unsupported_rate_is_rejected(there):
    trouble = one(serial="133931", rate=300.0)
    assert trouble.code == "TW129" and "300 Hz is not its base rate, 1000 Hz, divided by an integer" in trouble.message
    assert "333.333 or 250 Hz" in trouble.hint


def test_unsupported_channels_are_rejected(there):
    trouble = one(serial="900001", channels=("mag",))
    assert trouble.code == "TW129" and "it has no mag" in trouble.message


def test_open_port_is_locked_against_other_processes(there, opened):
    devices, _ = robot({"serial": "133931"})
    lines = opened(devices)
    descriptor = os.open(lines.lines["imu_0"][0].bus.channel, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    with pytest.raises(BlockingIOError):
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(descriptor)

"""Combined transfers, I2C_RDWR, through the kernel: an adapter in user space with register chips, multiplexers,
refusals and chips that hang.

Under User Mode Linux, where test_user_mode_linux.py runs this file.
"""

import errno
import math
import os
import subprocess
import time

import pytest

from blocks.imus import ICM20948, MPU9250
from graph import Device, Diagram
from runtime.robot.rig.chips import KnownChips
from runtime.robot.rig.file import RigBus
from runtime.robot.rig.i2c import I2cInterface, SeveralRefused, open_adapter
from tests.hardware.i2c_adapter import UserSpaceBus
from tests.hardware.reading import newest
from tests.hardware.vcan import REQUIRED
from tests.runtime.runs import Files, finished, write

needs_cuse = pytest.mark.skipif(
    not os.environ.get(REQUIRED), reason="makes a device of the kernel: under User Mode Linux alone"
)
pytestmark = [needs_cuse, pytest.mark.soak]
BUS = RigBus("imus", "i2c", UserSpaceBus.path)
G = 9.80665  # m/s²
ROBOT = """
from blocks.imus import ICM20948, MPU9250
from blocks.recorders import CsvRecorder
from graph import Diagram

with Diagram("sensors", rate=50) as diagram:
    common = {"bus": "imus", "rate": 20.0, "accel_range": 4, "gyro_range": 500, "timeout": 3.0}
    MPU9250(name="trunk", address=0x69, bypass=False, **common)
    MPU9250(name="shank", mux=0x70, channel=0, **common)
    ICM20948(name="thigh", mux=0x70, channel=1, **common)
    MPU9250(name="foot", mux=0x70, channel=5, bypass=False, **common)
    CsvRecorder()
"""
MUX, TRUNK, SHANK, THIGH, FOOT = range(5)
WIRED = (
    ("Tca9548a", {}, None),
    (
        "Mpu9250",
        {"address": 0x69, "accel": (100, -200, 8192), "gyro": (1, 2, -3), "temperature": 3339, "mag": (10, 20, 30)},
        None,
    ),
    ("Mpu9250", {"accel": (1, 2, 3), "gyro": (400, 500, -600), "mag": (300, -200, 100)}, (MUX, 0)),
    ("Icm20948", {"accel": (-1, -2, -3), "gyro": (-40, 50, 60), "temperature": -334, "mag": (-7, 8, 9)}, (MUX, 1)),
    ("Mpu9250", {"accel": (32767, -32768, 0), "mag": (-1, 1, 0)}, (MUX, 5)),
)


@pytest.fixture(scope="module", autouse=True)
def cuse():
    if not os.path.exists("/dev/cuse"):
        subprocess.run(["modprobe", "-d", "/run", "cuse"], check=True)


@pytest.fixture
def wires():
    bus = UserSpaceBus(*WIRED)
    yield bus
    bus.close()
    deadline = time.monotonic() + 5.0
    while os.path.exists(bus.path):
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.fixture
def robot():
    namespace = {}
    exec(ROBOT, namespace)
    return namespace["diagram"]


@pytest.fixture
def interface(wires, robot):
    """Every chip set up; its thread asks."""
    interface = I2cInterface(BUS, [block for block in robot if isinstance(block, Device)])
    interface.start(0)
    yield interface
    interface.close()


def until(condition, interface, seconds=5.0):
    deadline = time.monotonic() + seconds
    while not condition(interface.counts["devices"]):
        assert time.monotonic() < deadline, interface.counts
        time.sleep(0.01)


def assert_read(last):
    """What the chips measure, in SI units. last : newest by path"""

    def told(path, sign=1.0):
        return [sign * last[f"{path}[{k}]"] for k in range(3)]

    def exactly(values, scale):
        return pytest.approx([value * scale for value in values], rel=1e-9)

    accel, gyro, microtesla = 4 * G / 32768.0, math.radians(500.0) / 32768.0, 4912.0 / 32760.0
    for name, number in (("trunk", TRUNK), ("shank", SHANK), ("thigh", THIGH), ("foot", FOOT)):
        chip = WIRED[number][1]
        assert told(f"{name}.accel") == exactly(chip["accel"], accel)
        assert told(f"{name}.gyro") == exactly(chip.get("gyro", (0, 0, 0)), gyro)
        assert last[f"{name}.temperature"] == pytest.approx(chip.get("temperature", 0) / 333.87 + 21.0, rel=1e-9)
        assert last[f"{name}.errors"] == 0.0
        x, y, z = chip["mag"]
        if name != "thigh":  # its fuses say 1, 1.25 and 0.75; its x is the accelerometer's y, its z points down
            assert told(f"{name}.mag") == exactly((1.25 * y, x, -0.75 * z), microtesla)
        else:
            assert told(f"{name}.mag") == exactly((x, -y, -z), 0.15)


def test_every_sensor_is_read_by_combined_transfers(wires, robot):
    interface = I2cInterface(BUS, [block for block in robot if isinstance(block, Device)])
    set_up = wires.counts
    assert set_up["timeout"] == 0.03
    assert_read(newest(robot, interface, 50))
    counts = wires.counts
    answers = sum(told["answers"] for told in interface.counts["devices"].values())
    # the thread's are combined, checks among them
    assert counts["smbus"] == set_up["smbus"] and counts["combined"] >= answers > 40
    assert counts["single"] == counts["switches"] - set_up["switches"] == interface.counts["switches"]
    assert counts["single"] <= 2 * interface.counts["rounds"] + 3  # three channels: two switches a round


def test_a_run_from_the_command_line_records_every_sensor(wires, tmp_path):
    rig = f'[bus.imus]\ninterface = "i2c"\nchannel = "{wires.path}"\n'
    done = finished(
        write(tmp_path, ROBOT, "robot.py"),
        "--rig",
        write(tmp_path, rig, "lab.toml"),
        "--yes",
        "--duration",
        "1",
        "--record",
        tmp_path / "out",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    files = Files(tmp_path / "out")
    assert_read({header.split(" [")[0]: column[-1] for header, column in files.table.items()})
    assert files.table["tick"][-1] == 49 and wires.counts["combined"] > 40


def test_stream_shows_the_named_sensors(wires, tmp_path):
    done = finished(
        "stream",
        "i2c",
        "0x69",
        "0x70.1:0x68",
        "--channel",
        wires.path,
        "--rate",
        "20",
        "--duration",
        "1",
        "--channels",
        "accel,mag",
        "--set",
        "accel_range=4",
        "--record",
        tmp_path / "out",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "mpu9250_69  accel    0.120   -0.239    9.807 m/s²" in done.stdout and "icm20948_70_1_68" in done.stdout
    [file] = (tmp_path / "out").glob("i2c_*.csv")
    last = [float(x) for x in file.read_text().splitlines()[-1].split(",")]
    assert last[5:8] == pytest.approx([-7 * 0.15, -8 * 0.15, -9 * 0.15], rel=1e-6)
    assert last[11:14] == pytest.approx(
        [1.25 * 20 * 4912 / 32760, 10 * 4912 / 32760, -0.75 * 30 * 4912 / 32760], rel=1e-6
    )


def test_a_chip_without_acknowledgement_is_lost_alone_and_configured_on_return(wires, interface):
    until(lambda devices: all(told["answers"] > 2 for told in devices.values()), interface)
    wires.behave(THIGH, absent=True)
    until(lambda devices: devices["thigh"]["state"] == "lost", interface)
    before = interface.counts["devices"]
    assert before["thigh"]["error"] == errno.EREMOTEIO and before["thigh"]["losses"] == 1
    until(
        lambda devices: all(
            devices[name]["answers"] > before[name]["answers"] + 3 for name in ("trunk", "shank", "foot")
        ),
        interface,
    )
    assert [interface.counts["devices"][name]["failures"] for name in ("trunk", "shank", "foot")] == [0, 0, 0]
    wires.behave(THIGH, absent=False, reset=True)  # without supply it has forgotten all, and sleeps
    until(
        lambda devices: (
            devices["thigh"]["returns"] == 1 and devices["thigh"]["answers"] > before["thigh"]["answers"] + 3
        ),
        interface,
    )
    assert (
        wires.registers(THIGH, 0x14, bank=2) == bytes((3 << 3 | 1 | 1 << 1,))
        and wires.registers(THIGH, 0x06, bank=0) == b"\x01"
    )
    assert wires.registers(THIGH, 0x31, inner=True) == b"\x08"


def test_a_multiplexer_that_lost_its_channel_is_switched_again(wires, interface):
    until(lambda devices: all(told["answers"] > 2 for told in devices.values()), interface)
    wires.behave(MUX, absent=True)
    until(lambda devices: all(devices[name]["state"] == "lost" for name in ("shank", "thigh", "foot")), interface)
    before = interface.counts["devices"]
    until(lambda devices: devices["trunk"]["answers"] > before["trunk"]["answers"] + 3, interface)
    assert interface.counts["devices"]["trunk"]["failures"] == 0
    wires.behave(MUX, absent=False, reset=True)
    until(
        lambda devices: all(
            devices[name]["returns"] == 1 and devices[name]["answers"] > before[name]["answers"] + 3
            for name in ("shank", "thigh", "foot")
        ),
        interface,
    )


def test_a_reconnected_imu_reads_its_internal_magnetometer_again(wires, interface):
    until(lambda devices: devices["trunk"]["answers"] > 2, interface)
    wires.behave(TRUNK, reset=True)  # a moment without supply, between two questions
    until(lambda devices: devices["trunk"]["failures"] > 0, interface)
    assert interface.counts["devices"]["trunk"]["error"] == -1
    until(lambda devices: devices["trunk"]["state"] == "fine", interface)
    assert wires.registers(TRUNK, 0x25, 3) == b"\x8c\x02\x88" and wires.registers(TRUNK, 0x6A) == b"\x20"
    assert wires.registers(TRUNK, 0x0A, inner=True) == b"\x16"


def test_a_hanging_chip_is_abandoned_after_30_ms_and_recovers(wires, interface):
    until(lambda devices: all(told["answers"] > 2 for told in devices.values()), interface)
    wires.behave(TRUNK, stuck=0.5)
    until(lambda devices: devices["trunk"]["state"] == "lost", interface)
    before = interface.counts["devices"]
    assert before["trunk"]["error"] == errno.ETIMEDOUT
    until(lambda devices: devices["shank"]["answers"] > before["shank"]["answers"], interface)
    until(
        lambda devices: devices["trunk"]["returns"] == 1 and devices["trunk"]["answers"] > before["trunk"]["answers"],
        interface,
    )
    wires.behave(TRUNK, stuck=5.0)
    until(lambda devices: devices["trunk"]["state"] == "lost", interface)
    began = time.monotonic()
    interface.close()
    assert time.monotonic() - began < 0.5  # of an exchange, not of the chip


def test_a_rejected_setting_is_reported_with_its_reason(wires):
    with Diagram("robot", rate=50):
        wrong = MPU9250(name="imu", bus="imus", address=0x68)
        hung = ICM20948(name="thigh", bus="imus", mux=0x70, channel=1)
    with pytest.raises(SeveralRefused, match="TW128.*address 0x68: no reply") as refused:
        I2cInterface(BUS, [wrong])
    assert "on this bus 0x69, 0x70 reply" in str(refused.value)
    wires.behave(THIGH, stuck=5.0)
    with pytest.raises(SeveralRefused, match="TW128.*the bus is stuck"):
        I2cInterface(BUS, [hung])


def test_a_scan_shows_the_chips_and_where_they_are(wires):
    chips, _ = open_adapter(BUS)
    try:
        assert [(mux, channel, address, name) for mux, channel, address, name, _ in KnownChips(chips).everywhere()] == [
            (0, 0, 0x69, "MPU-9250"),
            (0, 0, 0x70, "TCA9548A multiplexer"),
            (0x70, 0, 0x68, "MPU-9250"),
            (0x70, 1, 0x68, "ICM-20948"),
            (0x70, 5, 0x68, "MPU-9250"),
        ]
    finally:
        chips.close()

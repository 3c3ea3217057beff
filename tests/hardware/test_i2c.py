"""Real smbus2 and the kernel's own I2C, on the chips of i2c-stub: registers that hold what is written to them, by SMBus
alone.

Under User Mode Linux, where test_user_mode_linux.py runs this file: elsewhere there may be real chips.
"""

import math
import os
import threading
import time

import pytest

from blocks.imus import MPU9250
from blocks.sensors import ADS1115
from graph import Device, Diagram
from runtime.robot.rig.file import RigBus
from runtime.robot.rig.i2c import I2cInterface, SeveralRefused
from tests.hardware.reading import newest
from tests.hardware.vcan import REQUIRED

needs_stub = pytest.mark.skipif(
    not os.environ.get(REQUIRED), reason="needs the chips of i2c-stub: under User Mode Linux alone"
)
pytestmark = needs_stub
NODE = "/dev/i2c-0"
MPU, MAG, ICM, ADC, NAU, MUX, KNEE, HIP = CHIPS = (0x68, 0x0C, 0x69, 0x48, 0x2A, 0x70, 0x36, 0x40)
G = 9.80665  # m/s²
ROBOT = """
from blocks.imus import ICM20948, MPU9250
from blocks.recorders import CsvRecorder
from blocks.sensors import ADS1115, AS5600, NAU7802, AS5048B
from cext.schedule.executor import Executor
from cext.memory.shared_state import RECORD_ROW, SharedState
from cext.schedule.program import Program
from graph import Device, Diagram, compile

with Diagram("sensors", rate=50) as diagram:
    MPU9250(name="shank", bus="imus", accel_range=8, rate=50.0)
    ICM20948(name="thigh", bus="imus", address=0x69, mux=0x70, channel=2, magnetometer=False, accel_range=4, rate=50.0)
    ADS1115(name="insole", bus="imus", channels=("a0", "a2_a3"), rate=64)
    NAU7802(name="handle", bus="imus", tare_at_start=False, capacity=50.0, rate=40)
    AS5600(name="knee", bus="imus", rate=50.0)
    AS5048B(name="hip", bus="imus", rate=50.0, invert=True)
    CsvRecorder()
"""
BUS = RigBus("imus", "i2c", NODE)


@pytest.fixture
def stub():
    """smbus2 on the chips, which say who they are."""
    from smbus2 import SMBus

    with SMBus(0) as wires:
        for address, registers in {
            MPU: {0x75: b"\x71", 0x3B: bytes.fromhex("0800 F000 1000 0D0B 0100 FF00 0000")},
            MAG: {0x00: b"\x48", 0x02: bytes.fromhex("01 2C01 38FF 9001 10"), 0x10: bytes((128, 192, 64))},
            ICM: {0x00: b"\xea", 0x2D: bytes.fromhex("2000 0000 E000 0000 0000 0083 0000")},
            KNEE: {0x0B: bytes((0x30, 0x04, 0x00))},
            HIP: {0xFB: bytes((0x01, 0x80, 0x00, 0x20, 0x00))},
            NAU: {0x1F: b"\x0f", 0x00: b"\x00", 0x12: (429497).to_bytes(3, "big")},
        }.items():
            for register, data in registers.items():
                for place, byte in enumerate(data):
                    wires.write_byte_data(address, register + place, byte)
        wires.write_word_data(ADC, 0, int.from_bytes(b"\x20\x00", "little"))
        yield wires


@pytest.fixture
def converting(stub):
    """The NAU7802 says that its conversions are new, as soon as it has been started."""
    over = threading.Event()

    def convert():
        while not over.wait(0.02):
            power = stub.read_byte_data(NAU, 0x00)
            if power & 0x10 and not power & 0x20:
                stub.write_byte_data(NAU, 0x00, power | 0x20)

    thread = threading.Thread(target=convert)
    thread.start()
    yield
    over.set()
    thread.join()


def assert_read(last):
    """What stands in the registers, in SI units: half a code of the gyroscope is the tolerance where it is not exact.
    last : newest by path
    """

    def vector(path):
        return [last[f"{path}[{k}]"] for k in range(3)]

    assert vector("shank.accel") == pytest.approx([0.5 * G, -G, G], rel=1e-9)
    # 256 codes of 1000 °/s over 32768
    assert vector("shank.gyro") == pytest.approx([0.136354, -0.136354, 0.0], abs=1e-5)
    scale = 4912.0 / 32760.0
    assert vector("shank.mag") == pytest.approx([-200 * scale * 1.25, 300 * scale, -400 * scale * 0.75], rel=1e-9)
    assert last["shank.temperature"] == pytest.approx(0x0D0B / 333.87 + 21.0, rel=1e-9)
    assert vector("thigh.accel") == pytest.approx([G, 0.0, -G], rel=1e-9)
    assert vector("thigh.gyro")[2] == pytest.approx(0x0083 * math.radians(1000.0) / 32768.0, rel=1e-9)
    assert last["insole.a0"] == last["insole.a2_a3"] == pytest.approx(1.024, rel=1e-9)
    assert last["handle.force"] == pytest.approx(50.0 * 429497 / (2**24 * 128 * 0.002), rel=1e-9)
    assert last["knee.position"] == pytest.approx(math.pi / 2.0) and last["knee.magnet"] == 1.0
    assert last["hip.position"] == pytest.approx(-math.pi / 4.0) and last["hip.magnet"] == 0.0
    sensors = ("shank", "thigh", "insole", "handle", "knee", "hip")
    assert [last[f"{name}.errors"] for name in sensors] == [0.0] * len(sensors)


def test_every_sensor_is_set_up_and_read_through_the_kernel(stub, converting):
    namespace = {}
    exec(ROBOT, namespace)
    interface = I2cInterface(BUS, [block for block in namespace["diagram"] if isinstance(block, Device)])
    assert_read(newest(namespace["diagram"], interface, 15))
    assert (
        stub.read_byte_data(MPU, 0x1C) == 0x10
        and stub.read_byte_data(MPU, 0x37) == 0x02
        and stub.read_byte_data(MAG, 0x0A) == 0x16
    )
    assert stub.read_byte_data(NAU, 0x01) == 0x2F and stub.read_byte_data(ICM, 0x14) == 3 << 3 | 1 | 1 << 1


def test_a_wrong_address_lists_the_responding_ones(stub):
    with Diagram("robot", rate=50):
        insole = ADS1115(name="insole", bus="imus", address=0x49)
    with pytest.raises(SeveralRefused, match="TW128.*address 0x49: no reply") as refused:
        I2cInterface(BUS, [insole])
    assert "0x0c, 0x2a, 0x36, 0x40, 0x48, 0x68, 0x69, 0x70 reply" in str(refused.value)


def test_the_bus_thread_detects_lost_settings(stub):
    """The stub forgets nothing by itself: somebody else writes its register, as a moment without power would."""
    with Diagram("robot", rate=50):
        imu = MPU9250(name="imu", bus="imus", rate=50.0)
    interface = I2cInterface(BUS, [imu])
    interface.start(0)
    try:
        time.sleep(0.1)
        stub.write_byte_data(MPU, 0x1C, 0x00)
        deadline = time.monotonic() + 3.0
        while stub.read_byte_data(MPU, 0x1C) != 0x10:
            assert time.monotonic() < deadline, interface.counts
            time.sleep(0.02)
    finally:
        interface.close()
    assert interface.counts["devices"]["imu"]["error"] == -1

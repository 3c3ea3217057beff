"""I2C on a rig: what is found, set up and handed over, and in which words it fails."""

import errno
import math
import sys
import time

import pytest

from blocks.imus import ICM20948, MPU9250
from blocks.sensors import ADS1115, NAU7802
from cext.lines.i2c_memory import MemoryI2c
from graph import Diagram, compile
from runtime.robot.rig.buses import RigBuses
from runtime.robot.rig.chips import Chips, KnownChips
from runtime.robot.rig.errors import Refused, RigError
from runtime.robot.rig.file import RigBus, parse
from runtime.robot.rig.i2c import I2cInterface, SeveralRefused, hint_of_buses, in_words, open_adapter, paths
from runtime.robot.rig.overrides import override
from tests.runtime.robot.rig.wires import ADJUSTMENT, Wires, add_mpu, opened

RIG = '[bus.imus]\ninterface = "i2c"\nchannel = "/dev/i2c-1"\n'


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """Chips in memory need no time to wake up."""
    monkeypatch.setattr("runtime.robot.rig.i2c.time.sleep", lambda seconds: None)


def imus(*kinds, **parameters):
    with Diagram("robot", rate=200):
        return [kind(name=f"imu{k}", bus="imus", **parameters) for k, kind in enumerate(kinds)]


def refused(wires, *devices):
    with pytest.raises(SeveralRefused) as found:
        opened(wires, *devices)
    return [str(trouble) for trouble in found.value.problems]


def test_chip_is_identified_configured_and_polled():
    wires = MemoryI2c()
    number, mag = add_mpu(wires, name=0x73)
    wires.write(number, 0x3B, b"\x10\x00" + bytes(12))
    wires.write(mag, 0x02, b"\x01\x64\x00\x00\x00\x00\x00\x10")
    (imu,) = imus(MPU9250, accel_range=16)
    interface = opened(wires, imu)
    assert interface.remarks == ["imu0 is a MPU-9255"]
    assert (
        wires.read(number, 0x19, 5) == imu.settings()
        and wires.read(number, 0x37) == b"\x02"
        and wires.read(mag, 0x0A) == b"\x16"
    )
    interface.start(0)
    deadline = time.monotonic() + 5.0
    while interface.counts["devices"]["imu0"]["answers"] < 4 and time.monotonic() < deadline:
        pass
    interface.close()
    frames = {frame[0] >> 16: frame[2] for frame in interface.end.receive()}
    assert frames[0] == b"\x10\x00" + bytes(12) and frames[1] == b"\x01\x64\x00\x00\x00\x00\x00\x10" + ADJUSTMENT


def test_two_imus_on_one_segment_are_configured_without_magnetometer_conflict():
    """What a run before has left open is closed on both first; afterwards each asks its own by itself."""
    wires = MemoryI2c()
    first, _ = add_mpu(wires)
    second = wires.add(0x69)
    wires.write(second, 0x75, b"\x71")
    wires.write(second, 0x37, b"\x02")
    closed = []

    class Watching(Wires):
        def read_byte_data(self, address, register):
            if address == 0x0C:
                closed.append((wires.read(first, 0x37), wires.read(second, 0x37)))
            return super().read_byte_data(address, register)

    with Diagram("robot", rate=200):
        devices = [MPU9250(name=f"imu{k}", bus="imus", address=0x68 + k, bypass=False) for k in range(2)]
    I2cInterface(RigBus("imus", "i2c", "/dev/i2c-1"), devices, (Chips(Watching(wires)), wires))
    assert closed == [(b"\x02", b"\x00"), (b"\x00", b"\x02")]
    for number in (first, second):
        assert (
            wires.read(number, 0x6A) == b"\x20"
            and wires.read(number, 0x37) == b"\x00"
            and wires.read(number, 0x25, 3) == b"\x8c\x02\x88"
        )
    assert devices[0].adjustment == ADJUSTMENT


def test_every_built_in_sensor_is_configured_by_its_table():
    wires = MemoryI2c()
    icm, adc, nau = wires.add(0x68), wires.add(0x48, wide=True), wires.add(0x2A)
    wires.write(icm, 0x00, b"\xea")
    wires.write(nau, 0x1F, b"\x0f")
    with Diagram("robot", rate=200):
        sensors = ICM20948(bus="imus", magnetometer=False), ADS1115(bus="imus"), NAU7802(bus="imus")
    interface = opened(wires, *sensors)
    assert (
        wires.read(icm, 0x06) == b"\x01" and wires.read(adc, 1, 2).hex() == "c3e3" and wires.read(nau, 0x01) == b"\x2f"
    )
    assert interface.remarks == []


def test_a_wrong_address_lists_the_responding_ones():
    wires = MemoryI2c()
    add_mpu(wires, 0x69)
    wires.add(0x48)
    (said,) = refused(wires, *imus(MPU9250))
    assert "TW128" in said and '[device."imu0"] /dev/i2c-1, address 0x68: no reply' in said
    assert "on this bus 0x0c, 0x48, 0x69 reply: correct address, mux or channel" in said


def test_different_chip_at_address_is_reported():
    wires = MemoryI2c()
    wires.write(wires.add(0x68), 0x75, b"\x68")
    (said,) = refused(wires, *imus(MPU9250))
    assert (
        "TW134" in said
        and "its identity register is 0x68, but that of a MPU-9250 is 0x71 (MPU-9250) or 0x73 (MPU-9255)" in said
    )


def test_missing_magnetometer_is_reported_with_option_to_disable_it():
    wires = MemoryI2c()
    wires.write(wires.add(0x68), 0x75, b"\x71")
    (said,) = refused(wires, *imus(MPU9250))
    assert "TW128" in said and "no reply at 0x0c, inside it" in said
    wires.add(0x0C)
    (said,) = refused(wires, *imus(MPU9250))
    assert "TW129" in said and "set magnetometer=False" in said


def test_unresponsive_multiplexer_is_reported():
    wires = MemoryI2c((0x71,))
    wires.add(0x48)
    (said,) = refused(wires, *imus(MPU9250, mux=0x70, channel=3))
    assert "TW133" in said and "no multiplexer replies at 0x70" in said and "0x48, 0x71 reply on the bus itself" in said


def test_device_behind_another_channel_is_reported_with_device_found():
    wires = MemoryI2c((0x70,))
    add_mpu(wires, 0x69, 1 + 3)
    (said,) = refused(wires, *imus(MPU9250, mux=0x70, channel=3))
    assert "multiplexer 0x70 channel 3, address 0x68: no reply" in said
    assert "on channel 3 of the multiplexer 0x70 0x0c, 0x69, 0x70 reply" in said


def test_all_problems_of_a_bus_are_reported_together():
    wires = MemoryI2c()
    wires.write(wires.add(0x2A), 0x1F, b"\x01")
    with Diagram("robot", rate=200):
        sensors = MPU9250(bus="imus"), NAU7802(bus="imus"), ADS1115(bus="imus")
    codes = [said.split()[1] for said in refused(wires, *sensors)]
    assert codes == ["TW134", "TW128", "TW128"]


class Held(Wires):
    """A driver of the kernel has the chip, or the bus hangs."""

    def __init__(self, wires, error):
        super().__init__(wires)
        self.error = error

    def read_byte_data(self, address, register):
        raise OSError(self.error, "")

    def write_quick(self, address):
        raise OSError(self.error, "")


@pytest.mark.parametrize(
    "error, code, words",
    [(errno.EBUSY, "TW135", "address in use by a kernel driver"), (errno.ETIMEDOUT, "TW128", "the bus is stuck")],
)
def test_hanging_bus_and_chip_bound_to_kernel_driver_are_reported(error, code, words):
    wires = MemoryI2c()
    with pytest.raises(SeveralRefused, match=f"{code}.*{words}"):
        I2cInterface(RigBus("imus", "i2c", "/dev/i2c-1"), imus(MPU9250), (Chips(Held(wires, error)), wires))


class Deaf(Wires):
    """Its settings do not arrive."""

    def write_byte_data(self, address, register, value):
        super().write_byte_data(address, register, 0 if register == 0x1C else value)


def test_settings_that_read_back_differently_are_reported():
    wires = MemoryI2c()
    add_mpu(wires)
    with pytest.raises(SeveralRefused, match="TW129.*it was configured with 04 03 10 10 03 and returns 04 03 10 00 03"):
        I2cInterface(RigBus("imus", "i2c", "/dev/i2c-1"), imus(MPU9250), (Chips(Deaf(wires)), wires))


def test_missing_bus_is_reported_with_way_to_enable_it(tmp_path):
    with pytest.raises(Refused) as found:
        open_adapter(RigBus("imus", "i2c", "/dev/i2c-77"))
    said = str(found.value.problem)
    assert "TW131" in said and "no such bus" in said and "raspi-config nonint do_i2c 0" in said and "jetson-io" in said
    with pytest.raises(Refused, match="TW131.*is not an I2C bus"):
        open_adapter(RigBus("imus", "i2c", str(tmp_path)))
    with pytest.raises(Refused, match="TW131.*/dev/null is not an I2C bus"):
        open_adapter(RigBus("imus", "i2c", "/dev/null"))
    for name in ("i2c-10", "i2c-2", "i2c-x"):
        (tmp_path / name).touch()
    assert paths(tmp_path) == [str(tmp_path / "i2c-2"), str(tmp_path / "i2c-10")] and "i2c-10; " in hint_of_buses(
        tmp_path
    )


def test_a_library_that_is_missing_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "smbus2", None)  # as where it is not installed
    with pytest.raises(Refused, match="TW119.*smbus2 is not installed"):
        open_adapter(RigBus("imus", "i2c", "/dev/null"))


def test_a_bus_without_permission_is_reported_with_the_command_that_grants_it():
    said = str(in_words("[bus.imus] /dev/i2c-1", "/dev/null", PermissionError(errno.EACCES, "Permission denied")))
    assert "TW132" in said and "udevadm" in said


def test_each_device_on_a_bus_is_listed_once():
    wires = MemoryI2c((0x70,))
    add_mpu(wires)
    wires.add(0x49, wide=True)
    nau = wires.add(0x2A, 1 + 2)
    wires.write(nau, 0x1F, b"\x0f")
    wires.exchange_bytes(0x70, -1, b"\x04")  # what a run before has left open
    found = KnownChips(Chips(Wires(wires))).everywhere()
    assert [(mux, channel, address, name) for mux, channel, address, name, _ in found] == [
        (0, 0, 0x0C, "AK8963"),
        (0, 0, 0x49, "ADS1115 or ADS1015"),
        (0, 0, 0x68, "MPU-9250"),
        (0, 0, 0x70, "TCA9548A multiplexer"),
        (0x70, 2, 0x2A, "NAU7802"),
    ]
    assert wires.exchange_bytes(0x70, -1, count=1) == b"\x00"  # closed again


# The rig file


@pytest.mark.parametrize(
    "line, words",
    [
        ("bitrate = 400_000", "bitrate: not valid for an I2C bus"),
        ("fd = true", "fd: not valid for an I2C bus"),
        ("options = { a = 1 }", "options: not valid for an I2C bus"),
        ('channel = "i2c-1"', "expected a device file in /dev"),
    ],
)
def test_unsupported_i2c_option_is_refused(tmp_path, line, words):
    text = RIG.replace('channel = "/dev/i2c-1"', line) if line.startswith("channel") else RIG + line
    with pytest.raises(RigError, match=words):
        parse(tmp_path / "lab.toml", text)


def test_rig_defines_sensor_location(tmp_path):
    rig = parse(tmp_path / "lab.toml", RIG + '[device."imu0"]\naddress = 0x69\nmux = 0x71\nchannel = 4\n')
    with Diagram("robot", rate=200) as robot:
        imu = MPU9250(name="imu0", bus="imus")
    override(rig, robot)
    assert (imu.address, imu.mux, imu.channel) == (0x69, 0x71, 4) and imu.identity == (1 + 8 + 4) << 8 | 0x69


@pytest.mark.parametrize(
    "kind, interface, words", [("imu", "socketcan", "its devices use I2C"), ("knee", "i2c", "its devices use CAN")]
)
def test_an_interface_of_another_medium_is_refused(tmp_path, kind, interface, words):
    from blocks.actuators import CubeMars

    channel = "/dev/i2c-1" if interface == "i2c" else "can0"
    rig = parse(tmp_path / "lab.toml", f'[bus.one]\ninterface = "{interface}"\nchannel = "{channel}"\n')
    with Diagram("robot", rate=200) as robot:
        if kind == "imu":
            MPU9250(bus="one")
        else:
            CubeMars("AK80-9", bus="one", can_id=1)(torque_command=0.0)
    override(rig, robot)
    with pytest.raises(RigError, match=f"TW105.*{words}"):
        RigBuses(rig, robot, ["one"])


def test_a_diagram_with_sensors_on_i2c_compiles_and_has_no_load_of_can():
    with Diagram("robot", rate=200) as robot:
        MPU9250(bus="imus")
    assert compile(robot).loads == [] and math.isfinite(robot.rate)

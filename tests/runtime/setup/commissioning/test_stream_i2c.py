"""`stream i2c`: sensors on an I2C bus, recognised, set up, shown, recorded and plotted. On chips in memory;
tests/hardware has real calls.
"""

import os

import pytest

from cext.lines.i2c_memory import MemoryI2c
from runtime.host.errors import BAD_INPUT, OK
from runtime.robot.guardian.lock import BusLock
from runtime.robot.rig.chips import Chips
from tests.runtime.robot.rig.wires import Wires, add_mpu
from tests.runtime.runs import Listener

pytestmark = pytest.mark.paced

CHANNEL = f"/dev/i2c-{os.getpid()}"  # another worker of pytest takes another bus


@pytest.fixture
def wires(monkeypatch):
    """An MPU-9250 on the bus, another behind a multiplexer, and a converter."""
    wires = MemoryI2c((0x70,))
    first, _ = add_mpu(wires, 0x69)
    wires.write(first, 0x3B, bytes.fromhex("1000 0000 F000 0D0B 0100 0000 0000"))
    second = wires.add(0x68, 1 + 3)
    wires.write(second, 0x75, b"\x73")
    wires.write(wires.add(0x48, wide=True), 0, b"\x20\x00")
    for module in ("watched_chips", "chips"):
        monkeypatch.setattr(
            f"runtime.setup.commissioning.{module}.open_adapter", lambda bus: (Chips(Wires(wires)), wires)
        )
    monkeypatch.setattr("runtime.robot.rig.i2c.open_adapter", lambda bus: (Chips(Wires(wires)), wires))
    return wires


def test_named_sensors_are_shown_recorded_and_plotted(wires, command_line):
    with Listener() as listener:
        code, out, err = command_line(
            "stream",
            "i2c",
            "0x69",
            "0x48",
            "--channel",
            CHANNEL,
            "--channels",
            "accel,gyro,a0",
            "--set",
            "accel_range=4",
            "--duration",
            "0.3",
            "--record",
            "out",
            "--plotjuggler",
            listener.address,
        )
        told = listener.rest()
    assert (code, err) == (OK, ""), err
    assert f"{CHANNEL}: ads1115_48, ADS1115\n{CHANNEL}: mpu9250_69, MPU-9250\n" in out
    assert "mpu9250_69  accel    4.903    0.000   -4.903 m/s²" in out and "ads1115_48  a0    1.024 V" in out
    [file] = (command_line.folder / "out").glob("i2c_*.csv")
    header, *rows = file.read_text().splitlines()
    assert header == (
        "time [s],tick,ads1115_48.a0 [V],mpu9250_69.accel[0] [m/s^2],mpu9250_69.accel[1] "
        "[m/s^2],mpu9250_69.accel[2] [m/s^2],"
        "mpu9250_69.gyro[0] [rad/s],mpu9250_69.gyro[1] [rad/s],mpu9250_69.gyro[2] [rad/s]"
    )
    assert [float(x) for x in rows[-1].split(",")[3:6]] == pytest.approx([4.903325, 0.0, -4.903325], rel=1e-5)
    assert len(told) == len(rows) and told[0]["ads1115_48"]["a0"] == pytest.approx(1.024)


def test_without_a_name_every_known_sensor_is_shown(wires, command_line):
    """Two IMUs are heard together where one is on the bus itself: each asks its own magnetometer."""
    wires.add(0x0C, 1 + 3)
    wires.write(4, 0x00, b"\x48")
    code, out, err = command_line("stream", "i2c", "--channel", CHANNEL, "--duration", "0.2")
    assert (code, err) == (OK, ""), err
    assert all(f"{CHANNEL}: {name}, " in out for name in ("mpu9250_69", "mpu9250_70_3_68", "ads1115_48"))
    assert wires.read(0, 0x6A) == b"\x20" and " 0 failed" in out


@pytest.mark.parametrize(
    "words, said",
    [
        (["0x4a"], "no chip responds at 0x4a; addresses that respond: 0x0c, 0x48, 0x69, 0x70"),
        (["0x71.2:0x68"], "no chip responds at 0x71, the multiplexer"),
        (
            ["0x70"],
            "the chip at 0x70 is TCA9548A multiplexer; supported chips: MPU-9250, MPU-9255, ICM-20948, NAU7802, "
            "ADS1115 or ADS1015",
        ),
        (["0x148"], "0x148: expected the address of a sensor, as in 0x68, or behind a multiplexer 0x70.3:0x68"),
        (["0x48", "--channels", "accel"], "--channels accel: available: a0, a1, a2, a3, age, errors"),
        (["0x69", "--set", "accel_rang=4"], "--set accel_rang: did you mean 'accel_range'?"),
        (["0x69", "--set", "accel_range=5"], "accel_range"),
    ],
)
def test_stream_i2c_rejects_invalid_options_with_reason(wires, command_line, words, said):
    code, out, err = command_line("stream", "i2c", *words, "--channel", CHANNEL, "--duration", "0.1")
    assert code != OK and said in err, err


def test_a_bus_of_a_run_and_one_that_does_not_exist_are_reported(wires, command_line, monkeypatch):
    lock = BusLock("i2c", CHANNEL)
    try:
        code, _, err = command_line("stream", "i2c", "0x69", "--channel", CHANNEL)
    finally:
        lock.close()
    assert code == BAD_INPUT and f"{CHANNEL} is controlled by" in err and wires.exchanges == 0
    monkeypatch.setattr("runtime.robot.rig.i2c.paths", lambda folder="/dev": [])
    assert "no I2C bus selected: add, for example, --channel /dev/i2c-1" in command_line("stream", "i2c")[2]

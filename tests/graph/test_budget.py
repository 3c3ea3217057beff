"""Bits on the bus, against the fact sheet's table of what 1 Mbit/s carries."""

import pytest

from blocks.actuators import CubeMars
from blocks.imus import MicroStrain
from blocks.recorders import CsvRecorder
from blocks.sensors import Microcontroller
from graph import Diagram, compile
from graph.budget import frame_bits
from graph.compiler import examine
from tests.graph.complaints import complaint


def actuators(count, rate):
    with Diagram("d", rate=rate) as diagram:
        for number in range(1, count + 1):
            CubeMars("AK80-9", bus="legs", can_id=number, timeout=0.1)(torque_command=0.0)
    return diagram


def test_frame_lengths_match_the_standard():
    assert frame_bits(8, False) == (pytest.approx(115.1, abs=0.01), 135)
    assert frame_bits(8, True) == (pytest.approx(135.1, abs=0.01), 160)
    assert frame_bits(0, False) == (47, 55)


def test_frames_of_can_fd_have_two_bitrates():
    """48 bytes: 5 + 384 + 32 bits at the data bitrate, and stuffing of 4 and 97 bits at worst."""
    typical, worst = frame_bits(48, False, 0.2)
    assert (typical, worst) == (pytest.approx(30 + 0.2 * (421 + 384 / 15.6)), pytest.approx(34 + 0.2 * 518))
    assert frame_bits(12, True) == (pytest.approx(49 + 128 + 96 / 15.6), 177 + 34)


@pytest.mark.parametrize("count, highest, worst", [(1, 4343, 3703), (4, 1085, 925), (8, 542, 462)])
def test_the_highest_rate_of_n_actuators(count, highest, worst):
    (load,) = compile(actuators(count, highest)).loads
    assert load.frames == 2 * count * highest and 0.99 < load.typical <= 1.0
    (load,) = compile(actuators(count, worst)).loads
    assert 0.99 < load.worst <= 1.0


def test_a_bus_that_cannot_carry_its_traffic_is_an_error():
    found = complaint(actuators(8, 600))
    assert (
        found.code == "TW016"
        and "9600 frames per second" in found.message
        and "bus 'legs' at 1 Mbit/s" in found.message
        and "8 devices" in found.hint
    )


def test_a_busy_bus_is_a_warning_and_a_quiet_one_is_not():
    assert [w.code for w in compile(actuators(8, 400)).warnings] == ["TW022"]
    assert compile(actuators(2, 200)).warnings == [] and compile(actuators(2, 200)).loads[0].typical == pytest.approx(
        0.092, abs=1e-3
    )


def sensor_codes(sensor):
    with Diagram("robot", rate=200) as robot:
        sensor()
        CsvRecorder()
    return [(d.code, d.message) for d in examine(robot).diagnostics]


@pytest.mark.parametrize(
    "parameters, code, share",
    [
        ({"port": "/dev/ttyAMA0", "baudrate": 115200}, "TW016", "191%"),
        ({"port": "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A1-if00-port0", "baudrate": 460800}, None, ""),
        ({"port": "/dev/ttyUSB0", "baudrate": 250000}, "TW022", "88%"),
        ({"port": "/dev/ttyACM0", "baudrate": 9600}, None, ""),  # USB: it has no baud rate
        ({"serial": "133931", "baudrate": 9600}, None, ""),  # found somewhere
    ],
)
def test_a_serial_line_that_cannot_carry_its_sensor_is_reported(parameters, code, share):
    """At 500 Hz packets of 6 bytes around a time of 10, and accel and gyro of 14 each."""
    found = sensor_codes(lambda: MicroStrain(name="imu", rate=500.0, channels=("accel", "gyro"), **parameters))
    assert [each[0] for each in found] == ([code] if code else [])
    if code:
        [(_, message)] = found
        assert f"500 messages per second, at least 22000 bytes, use {share} of its line" in message


def test_a_microcontroller_with_a_declared_rate_is_checked():
    def teensy(**parameters):
        return sensor_codes(
            lambda: Microcontroller(fields=(("force", "int32"), ("accel", "int16[3]")), name="teensy", **parameters)
        )

    [(code, message)] = teensy(port="/dev/ttyUSB0", packet_rate=1000.0)  # 1 + 10 + 2 bytes, stuffed 14, and a zero
    assert (
        code == "TW016"
        and "1000 messages per second, at least 15000 bytes, use 130% of its line at 115200 bit/s" in message
    )
    assert teensy(port="/dev/ttyUSB0") == teensy(port="/dev/ttyACM0", packet_rate=1000.0) == []
    assert teensy(port="/dev/ttyUSB0", packet_rate=500.0) == []

"""`scan` lists what is plugged in and not asked: serial ports as pyserial tells them, and chips of GPIO lines."""

import json
from types import SimpleNamespace

import pytest

from runtime.setup.commissioning import ports_inventory


def port(device, vid, manufacturer, product, serial):
    return SimpleNamespace(device=device, vid=vid, manufacturer=manufacturer, product=product, serial_number=serial)


@pytest.fixture
def there(monkeypatch):
    monkeypatch.setattr(
        "runtime.robot.rig.ports.list_ports",
        lambda: [
            port("/dev/ttyACM0", 0x16C0, "Teensyduino", "USB Serial", "1234560"),
            port("/dev/ttyACM1", 0x199B, "MicroStrain", "3DM-GX5", "6253.133931"),
            port("/dev/ttyUSB0", 0x1A86, None, "USB Serial", None),
        ],
    )
    monkeypatch.setattr(
        ports_inventory,
        "gpio_chips",
        lambda: [
            ports_inventory.GpioChip("/dev/gpiochip0", "pinctrl-bcm2711", 58),
            ports_inventory.GpioChip("/dev/gpiochip1", trouble="Permission denied"),
        ],
    )
    monkeypatch.setattr("runtime.setup.commissioning.imus.look", lambda: ([], []))


LINES = [
    "port /dev/ttyACM0  Teensy  Teensyduino USB Serial, serial 1234560  (not opened)",
    "port /dev/ttyUSB0  serial port  USB Serial  (not opened)",
    "gpio /dev/gpiochip0  pinctrl-bcm2711, 58 lines; to list their names: gpioinfo gpiochip0",
    "gpio /dev/gpiochip1  Permission denied",
]


def test_ports_and_chips_that_did_not_reply_are_listed(there):
    assert ports_inventory.text(ports_inventory.look({"/dev/ttyACM1"})) == LINES


def test_scan_lists_sensors_without_a_can_bus(there, command_line, monkeypatch):
    monkeypatch.setattr("runtime.setup.commissioning.bus.Machine.glob", lambda self, pattern: [])
    code, out, err = command_line("scan")
    assert code != 0 and set(LINES) <= set(out.splitlines()) and "this machine has no CAN interface" in err


def test_a_rig_is_checked_alone_and_machines_are_reported_too(there, command_line, monkeypatch):
    monkeypatch.setattr("runtime.cli.scan.on_can", lambda options, others: [])
    told = json.loads(command_line("scan", "--json")[1])
    assert [each["path"] for each in told["ports"]] == ["/dev/ttyACM0", "/dev/ttyACM1", "/dev/ttyUSB0"] and told[
        "gpio"
    ][0]["lines"] == 58


def test_an_unknown_chip_is_reported(tmp_path):
    (tmp_path / "gpiochip3").write_text("")
    (tmp_path / "gpiochip_other").write_text("")
    [found] = ports_inventory.gpio_chips(tmp_path)
    assert found.path == f"{tmp_path}/gpiochip3" and "not a GPIO chip" in found.text

"""Checks of serial ports and I2C buses: present, permitted, and at full speed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from runtime.host.machine.finding import BAD, OK, WORSE, Finding
from runtime.host.machine.probe import PI

if TYPE_CHECKING:
    from runtime.host.machine.finding import Wants
    from runtime.host.machine.probe import Device, Machine

I2C_CLOCK_MINIMUM = 400_000  # Hz, for IMUs
SERIAL = ("ttyUSB*", "ttyACM*", "ttyAMA*", "ttyTHS*")


def _serial_ports(machine: Machine, wants: Wants) -> Finding:
    """Check that this user may open the serial ports."""
    ports = [port for port in machine.devices(*SERIAL) if port.group != "tty"]  # group tty: consoles
    if not ports:
        return Finding("serial ports", OK, "none")
    return permission(machine, "serial ports", ports, "serial")


def _serial_latency(machine: Machine, wants: Wants) -> Finding | None:
    """Check the latency timer, in ms, that only FTDI chips have."""
    timers = {
        name.split("/")[-2]: machine.read(name) for name in machine.glob("sys/bus/usb-serial/devices/*/latency_timer")
    }
    slow = {port: timer for port, timer in timers.items() if timer.isdigit() and int(timer) > 1}
    if not timers:
        return None
    if not slow:
        return Finding("serial latency", OK, f"1 ms on {', '.join(timers)}")
    port = next(iter(slow))
    return Finding(
        "serial latency",
        WORSE,
        ", ".join(f"{timer} ms on {port}" for port, timer in slow.items()),
        "an FTDI chip delays received data by up to this time",
        f"echo 1 | sudo tee /sys/bus/usb-serial/devices/{port}/latency_timer",
        "ftdi",
    )


def _modem_manager(machine: Machine, wants: Wants) -> Finding | None:
    """Check that no ModemManager probes the serial ports."""
    if not machine.devices("ttyACM*", "ttyUSB*") or not machine.runs("ModemManager"):
        return None
    return Finding(
        "modem manager",
        WORSE,
        "ModemManager runs",
        "it opens every new serial port and writes modem commands to it",
        "sudo systemctl disable --now ModemManager, if no modem is needed",
        "modems",
    )


def _i2c_buses(machine: Machine, wants: Wants) -> Finding:
    """Check that this user may open the I2C buses."""
    buses = machine.devices("i2c-*")
    if not buses:
        return Finding("I2C", OK, "none" + ("; enable it with sudo raspi-config" if machine.kind == PI else ""))
    return permission(machine, "I2C", buses, "i2c")


def _spi_buses(machine: Machine, wants: Wants) -> Finding | None:
    """Check that this user may open the SPI buses."""
    buses = machine.devices("spidev*")
    return permission(machine, "SPI", buses, "spi") if buses else None


def _i2c_speed(machine: Machine, wants: Wants) -> Finding | None:
    """Check the I2C clock, which the device tree has as four bytes, big-endian.

    Only a Raspberry Pi has a fixed number for the bus of its header: 1.
    """
    clock = machine.raw("/sys/class/i2c-adapter/i2c-1/of_node/clock-frequency")
    if machine.kind != PI or len(clock) != 4:
        return None
    rate = int.from_bytes(clock, "big")
    if rate >= I2C_CLOCK_MINIMUM:
        return Finding("I2C speed", OK, f"{rate / 1e3:g} kHz")
    return Finding(
        "I2C speed",
        WORSE,
        f"{rate / 1e3:g} kHz",
        "reading a sample of an IMU takes four times as long",
        "dtparam=i2c_arm_baudrate=400000 in config.txt",
        "i2c speed",
    )


def permission(machine: Machine, name: str, devices: Sequence[Device], part: str) -> Finding:
    """Return a finding on devices that this user may or may not open."""
    refused = [device for device in devices if not device.usable]
    if not refused:
        return Finding(name, OK, ", ".join(device.name for device in devices))
    group = refused[0].group
    names = ", ".join(device.name for device in refused)
    if machine.user in (machine.members(group) or []):
        cure = "log in again: the groups of this session are older than the membership"
        part = ""
    elif group == "root":
        cure = f"add a udev rule that assigns it to a group, and add {machine.user} to that group"
    else:
        cure = f"sudo usermod -aG {group} {machine.user}, then log in again"
    found = f"{machine.user} may not use {names} of group {group}"
    return Finding(name, BAD, found, "the connected devices cannot be opened", cure, part, group)


CHECKS = (_serial_ports, _serial_latency, _modem_manager, _i2c_buses, _i2c_speed, _spi_buses)

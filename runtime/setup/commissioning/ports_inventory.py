"""Serial ports and GPIO chips of this machine, listed without being opened for communication.

Opening the serial port of a microcontroller can reset it.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import struct
from dataclasses import asdict, dataclass
from pathlib import Path

from runtime.robot.rig import ports

CHIP_INFO = struct.Struct("=32s32sI")  # gpiochip_info of <linux/gpio.h>: name, label, number of lines
GET_CHIP_INFO = 0x8044B401
BOARDS = {
    0x16C0: "Teensy",
    0x2341: "Arduino",
    0x2A03: "Arduino",
    0x239A: "Adafruit board",
    0x2E8A: "Raspberry Pi Pico",
    0x303A: "ESP32",
    0x0483: "STM32",
}


@dataclass(frozen=True)
class Port:
    """Serial port.

    path : device file
    board : kind of microcontroller by its USB vendor id, "" if unknown
    name, serial : manufacturer with product, and serial number, as reported over USB
    """

    path: str
    board: str
    name: str
    serial: str

    @property
    def text(self) -> str:
        """Line of the report."""
        details = ", ".join(word for word in (self.name, f"serial {self.serial}" if self.serial else "") if word)
        return f"port {self.path}  {self.board or 'serial port'}{f'  {details}' if details else ''}  (not opened)"


@dataclass(frozen=True)
class GpioChip:
    """GPIO chip.

    path : device file
    label : label of the chip
    lines : number of lines
    trouble : reason why it cannot be read, or ""
    """

    path: str
    label: str = ""
    lines: int = 0
    trouble: str = ""

    @property
    def text(self) -> str:
        """Line of the report."""
        return f"gpio {self.path}  " + (
            self.trouble or f"{self.label}, {self.lines} lines; to list their names: gpioinfo {Path(self.path).name}"
        )


def serial_ports(known: set[str]) -> list[Port]:
    """Return a Port for each serial port with a device. known : paths of ports to leave out"""
    return [
        Port(
            port.device,
            BOARDS.get(port.vid, ""),
            " ".join(word for word in (port.manufacturer, port.product) if word),
            port.serial_number or "",
        )
        for port in ports.list_ports()
        if port.device not in known
    ]


def gpio_chips(folder: str | Path = "/dev") -> list[GpioChip]:
    """Return every GpioChip of this machine."""
    paths = sorted(
        (path for path in Path(folder).glob("gpiochip*") if path.name[8:].isdigit()),
        key=lambda path: int(re.sub(r"\D", "", path.name)),
    )
    return [chip(str(path)) for path in paths]


def chip(path: str) -> GpioChip:
    """Return the GpioChip of a device file, such as /dev/gpiochip0. An error is its `trouble`."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError as error:
        remedy = (
            ": sudo usermod -aG gpio $USER, then log in again" if error.errno in (errno.EACCES, errno.EPERM) else ""
        )
        return GpioChip(path, trouble=f"{error.strerror}{remedy}")
    try:
        _, label, lines = CHIP_INFO.unpack(fcntl.ioctl(descriptor, GET_CHIP_INFO, bytes(CHIP_INFO.size)))
        return GpioChip(path, label.rstrip(b"\0").decode(errors="replace"), lines)
    except OSError as error:
        return GpioChip(path, trouble=f"not a GPIO chip: {error.strerror}")
    finally:
        os.close(descriptor)


def look(known: set[str]) -> tuple[list[Port], list[GpioChip]]:
    """Return (list of Port, list of GpioChip)."""
    return serial_ports(known), gpio_chips()


def text(inventory: tuple[list[Port], list[GpioChip]]) -> list[str]:
    """Return the lines of the report. inventory : result of `look`"""
    return [each.text for kind in inventory for each in kind]


def plain(inventory: tuple[list[Port], list[GpioChip]]) -> dict[str, list[dict[str, int | str]]]:
    """Return the inventory as a dict for JSON. inventory : result of `look`"""
    return {name: [asdict(each) for each in kind] for name, kind in zip(("ports", "gpio"), inventory)}

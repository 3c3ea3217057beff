"""What is plugged in and is not asked who it is: serial ports, of microcontrollers above all, which opening would
restart; chips of GPIO lines.
"""

import errno
import fcntl
import os
import re
import struct
from dataclasses import asdict, dataclass
from pathlib import Path

from runtime.rig import ports

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
    """path : of a serial port; board : kind of microcontroller, as far as its maker's number says, or ""; name, serial
    : as it tells them over USB
    """

    path: str
    board: str
    name: str
    serial: str

    @property
    def text(self):
        said = ", ".join(word for word in (self.name, f"serial {self.serial}" if self.serial else "") if word)
        return f"port {self.path}  {self.board or 'serial port'}{f'  {said}' if said else ''}  (not opened)"


@dataclass(frozen=True)
class GpioChip:
    """path; label : of the chip; lines : how many; trouble : why it cannot be asked, or "" """

    path: str
    label: str = ""
    lines: int = 0
    trouble: str = ""

    @property
    def text(self):
        return f"gpio {self.path}  " + (
            self.trouble or f"{self.label}, {self.lines} lines; their names: gpioinfo {Path(self.path).name}"
        )


def serial_ports(known):
    """A Port for each that has a device behind it. known : paths of those that have answered"""
    return [
        Port(
            port.device,
            BOARDS.get(port.vid, ""),
            " ".join(word for word in (port.manufacturer, port.product) if word),
            port.serial_number or "",
        )
        for port in ports.listed()
        if port.device not in known
    ]


def gpio_chips(folder="/dev"):
    """Every GpioChip of this machine."""
    paths = sorted(
        (path for path in Path(folder).glob("gpiochip*") if path.name[8:].isdigit()),
        key=lambda path: int(re.sub(r"\D", "", path.name)),
    )
    return [chip(str(path)) for path in paths]


def chip(path):
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError as error:
        cure = ": sudo usermod -aG gpio $USER, then log in again" if error.errno in (errno.EACCES, errno.EPERM) else ""
        return GpioChip(path, trouble=f"{error.strerror}{cure}")
    try:
        _, label, lines = CHIP_INFO.unpack(fcntl.ioctl(descriptor, GET_CHIP_INFO, bytes(CHIP_INFO.size)))
        return GpioChip(path, label.rstrip(b"\0").decode(errors="replace"), lines)
    except OSError as error:
        return GpioChip(path, trouble=f"no chip of GPIO lines: {error.strerror}")
    finally:
        os.close(descriptor)


def look(known):
    """(every Port, every GpioChip)"""
    return serial_ports(known), gpio_chips()


def text(found):
    """Return the lines of the report. found : as `look` returns it"""
    return [each.text for kind in found for each in kind]


def plain(found):
    return {name: [asdict(each) for each in kind] for name, kind in zip(("ports", "gpio"), found)}

"""Serial ports of this machine: listing, identification, and opening with the cause of errors."""

from __future__ import annotations

import errno
import os
import stat
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.host.suggestions import suggestion
from runtime.robot.rig.errors import Refused, RigProblem
from runtime.robot.rig.serial_port import holder, permission

if TYPE_CHECKING:
    from serial import Serial
    from serial.tools.list_ports_common import ListPortInfo


BY_ID = Path("/dev/serial/by-id")


def list_ports() -> list[ListPortInfo]:
    """Return pyserial's ListPortInfo of every port with a device."""
    from serial.tools.list_ports import comports

    return sorted((port for port in comports() if port.hwid != "n/a"), key=lambda port: port.device)


def by_id(path: str | Path, folder: Path = BY_ID) -> str:
    """Return the by-id path of a port, which is independent of the USB socket; the path itself if there is none."""
    real = os.path.realpath(path)
    for link in sorted(folder.glob("*")) if folder.is_dir() else ():
        if os.path.realpath(link) == real:
            return str(link)
    return str(path)


def with_serial(device_path: str, digits: str) -> str:
    """Return the path of the port whose USB serial number ends with `digits`. Raises Refused."""
    known = list_ports()
    matches = [port for port in known if digits and (port.serial_number or "").endswith(digits)]
    if len(matches) == 1:
        return matches[0].device
    seen = (
        ", ".join(f"{port.serial_number or 'no serial number'} ({port.device})" for port in known)
        or "no serial port at all"
    )
    if not digits:
        raise Refused(
            RigProblem(
                "TW127",
                f'[device."{device_path}"] has neither a port nor a serial number',
                f'write serial = "..." or port = "/dev/ttyACM0"; this machine has {seen}',
            )
        )
    what = f"{len(matches)} ports have" if matches else "no port has"
    raise Refused(
        RigProblem(
            "TW127",
            f'[device."{device_path}"] serial = "{digits}": {what} a serial number with this ending',
            f"found: {seen}",
        )
    )


def open_port(device_path: str, path: str | Path, baudrate: int, timeout: float = 0.0) -> Serial:
    """Open a port for exclusive use. Raises Refused with the cause.

    device_path : path of the device at the port, for messages; "" for none
    baudrate : bit/s
    timeout : s that a read waits
    """
    import serial

    try:
        if stat.S_ISCHR(os.stat(path).st_mode):
            port = serial.Serial(str(path), baudrate, timeout=timeout, write_timeout=1.0, exclusive=True)
            port.reset_input_buffer()
            return port
        raise Refused(RigProblem("TW125", f"{_prefix(device_path)}{path} is not a serial port", _ports_text(path)))
    except OSError as error:  # includes pyserial's SerialException
        raise Refused(_open_problem(device_path, path, error, baudrate)) from None
    except ValueError as error:
        raise Refused(
            RigProblem(
                "TW119", f"{_prefix(device_path)}{path}: {error}", f"check that the port supports {baudrate} bit/s"
            )
        ) from None


def _prefix(device_path):
    """Return the prefix of messages about a device's port; "" without a device."""
    return f'[device."{device_path}"] ' if device_path else ""


def _open_problem(device_path, path, error, baudrate):
    """Return a RigProblem that explains why a port cannot be opened."""
    name = f"{_prefix(device_path)}{path}"
    number = error.errno or getattr(error.__context__, "errno", None)
    if number in (errno.EACCES, errno.EPERM):
        return RigProblem("TW124", f"{name}: {os.strerror(number)}", permission(path))
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.ENOTDIR):
        return RigProblem("TW125", f"{name}: no such port", _ports_text(path))
    if number in (errno.EBUSY, errno.EAGAIN):
        owner = locker(path) or holder(path) or f"a process that this user cannot see; find it: sudo fuser -v {path}"
        return RigProblem(
            "TW126", f"{name} is in use by {owner}", "end that process first: two readers of a port each lose data"
        )
    return RigProblem(
        "TW119",
        f"{name}: {os.strerror(number) if number else error}",
        f"check that the device is plugged in and that the port supports {baudrate} bit/s",
    )


def locker(path: str | Path) -> str:
    """Return 'NAME (process PID)' of the owner of a port's lock; "" if this user cannot see it."""
    with suppress(OSError):
        about = os.stat(path)
        place = f"{os.major(about.st_dev):02x}:{os.minor(about.st_dev):02x}:{about.st_ino}"
        for line in Path("/proc/locks").read_text().splitlines():
            words = line.split()
            if words[1] == "FLOCK" and words[5] == place:
                return f"{Path('/proc', words[4], 'comm').read_text().strip()} (process {words[4]})"
    return ""


def _ports_text(path):
    """Return a hint that lists the ports of this machine, with the best match first."""
    known = [port.device for port in list_ports()]
    near = suggestion(str(path), known)
    return (f"{near} " if near else "") + (
        f"there are {', '.join(known)}" if known else "no serial port found: check that it is plugged in"
    )

"""Serial ports of this machine: which there are, who is behind them, opened with the cause in words where that
fails.
"""

import errno
import os
import stat
from contextlib import suppress
from pathlib import Path

from graph.names import suggestion
from runtime.rig.errors import Refused, Trouble
from runtime.rig.serial_port import holder, permission

BY_ID = Path("/dev/serial/by-id")


def listed():
    """pyserial's ListPortInfo of every port with a device behind it."""
    from serial.tools.list_ports import comports

    return sorted((port for port in comports() if port.hwid != "n/a"), key=lambda port: port.device)


def by_id(path, folder=BY_ID):
    """The path under which the same device is found at any port, where the system keeps one; else the path itself."""
    real = os.path.realpath(path)
    for link in sorted(folder.glob("*")) if folder.is_dir() else ():
        if os.path.realpath(link) == real:
            return str(link)
    return str(path)


def with_serial(who, digits):
    """Path of the port whose USB serial number ends so. Refused"""
    there = listed()
    found = [port for port in there if digits and (port.serial_number or "").endswith(digits)]
    if len(found) == 1:
        return found[0].device
    seen = (
        ", ".join(f"{port.serial_number or 'no serial number'} ({port.device})" for port in there)
        or "no serial port at all"
    )
    if not digits:
        raise Refused(
            Trouble(
                "TW127",
                f'[device."{who}"] names neither a port nor a serial number',
                f'write serial = "..." or port = "/dev/ttyACM0"; this machine has {seen}',
            )
        )
    what = f"{len(found)} ports have" if found else "nothing here has"
    raise Refused(
        Trouble("TW127", f'[device."{who}"] serial = "{digits}": {what} a serial number that ends so', f"seen: {seen}")
    )


def open_port(who, path, baudrate, timeout=0.0):
    """pyserial's Serial, ours alone. Refused, with the cause in words"""
    import serial

    try:
        if stat.S_ISCHR(os.stat(path).st_mode):
            port = serial.Serial(str(path), baudrate, timeout=timeout, write_timeout=1.0, exclusive=True)
            port.reset_input_buffer()
            return port
        raise Refused(Trouble("TW125", f"{device(who)}{path} is no serial port", others(path)))
    except OSError as error:  # pyserial's SerialException is one
        raise Refused(in_words(who, path, error, baudrate)) from None
    except ValueError as error:
        raise Refused(
            Trouble("TW119", f"{device(who)}{path}: {error}", f"is {baudrate} bit/s what the port can do?")
        ) from None


def device(who):
    """How a device stands in front of what is said of its port; "" is nobody's."""
    return f'[device."{who}"] ' if who else ""


def in_words(who, path, error, baudrate):
    name = f"{device(who)}{path}"
    number = error.errno or getattr(error.__context__, "errno", None)
    if number in (errno.EACCES, errno.EPERM):
        return Trouble("TW124", f"{name}: {os.strerror(number)}", permission(path))
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV, errno.ENOTDIR):
        return Trouble("TW125", f"{name}: there is no such port", others(path))
    if number in (errno.EBUSY, errno.EAGAIN):
        owner = locker(path) or holder(path) or f"a process that this user may not see; who it is: sudo fuser -v {path}"
        return Trouble(
            "TW126",
            f"{name} is in use by {owner}",
            "end that one first: two that read one port take each other's bytes",
        )
    return Trouble(
        "TW119",
        f"{name}: {os.strerror(number) if number else error}",
        f"is it plugged in, and does it take {baudrate} bit/s?",
    )


def locker(path):
    """'NAME (process PID)' of who has a port for itself, as far as this user may see; "" where it is not to be seen."""
    with suppress(OSError):
        about = os.stat(path)
        place = f"{os.major(about.st_dev):02x}:{os.minor(about.st_dev):02x}:{about.st_ino}"
        for line in Path("/proc/locks").read_text().splitlines():
            words = line.split()
            if words[1] == "FLOCK" and words[5] == place:
                return f"{Path('/proc', words[4], 'comm').read_text().strip()} (process {words[4]})"
    return ""


def others(path):
    there = [port.device for port in listed()]
    near = suggestion(str(path), there)
    return (f"{near} " if near else "") + (
        f"there are {', '.join(there)}" if there else "this machine has no serial port: is it plugged in?"
    )

"""Rig files: the interface of each logical bus, and the hardware parameters of devices.

    [bus.legs]
    interface = "socketcan"
    channel = "can0"
    bitrate = 1_000_000

    [device."left/knee"]
    can_id = 3

This module checks the file itself; runtime.robot.rig.overrides applies it to a diagram.
"""

from __future__ import annotations

import os
import re
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cext.user_files import read_small
from runtime.host.suggestions import suggestion
from runtime.robot.rig.battery import Battery, parse_battery
from runtime.robot.rig.bus import BITRATE_MAXIMUM, DATA_BITRATE_MAXIMUM, RigBus
from runtime.robot.rig.errors import RigError, RigProblem
from runtime.robot.rig.udp import EXAMPLE, UDP, Endpoint

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SOCKETCAN, I2C, SPI = "socketcan", "i2c", "spi"
CHIP_BUSES = {I2C: "/dev/i2c-1", SPI: "/dev/spidev0"}  # read by a thread: example of a channel
SPI_CLOCK_MAXIMUM = 10_000_000  # Hz
EMULATED_TEXT = "emulated by another process"
EMULATED = "unix:"  # prefix of the socket of `emulate`, as the channel of an I2C or SPI bus or as a GPIO chip
BITRATE_MINIMUM = 10_000  # bit/s
INTERFACE_NAME_LIMIT = 15  # characters of a network interface
KEYS = {  # of a bus: type, example, whether it is required
    "interface": (str, '"socketcan"', True),
    "channel": (str, '"can0"', True),
    "bitrate": (int, "1_000_000", False),
    "fd": (bool, "true", False),
    "data_bitrate": (int, "5_000_000", False),
    "peer": (str, '"192.168.4.2:9871"', False),
    "key": (str, '"estop.key"', False),
    "options": (dict, "{ ttyBaudrate = 1_000_000 }", False),
}
OWN = ("interface", "channel", "bitrate", "fd", "data_bitrate")  # not allowed in `options`
TABLES = ("bus", "device", "battery")
WORDS = {str: "text", int: "a whole number of bit/s", bool: "true or false", dict: "a table"}


@dataclass(frozen=True)
class RigFile:
    """Rig file.

    buses : RigBus by logical name; devices : {path: {parameter: value}}; text : unchanged file content
    battery : Battery, or None if the file has none
    """

    path: Path
    text: str
    buses: dict[str, RigBus]
    devices: dict[str, dict[str, Any]]
    battery: Battery | None = None


def read(path: str | Path) -> RigFile:
    """Read the rig file at a path. Raises RigError with every problem of the file."""
    return parse(Path(path), read_text(Path(path)))


def parse(path: str | Path, text: str) -> RigFile:
    """Parse the text of a rig file. path : file named in messages. Raises RigError."""
    try:
        content = tomllib.loads(text)
    except ValueError as error:
        hint = 'quote text with "", and a path in a name: [device."left/knee"]'
        if re.search("twice|overwrite", str(error)):
            hint = "write each table and each key once"
        raise RigError(path, [RigProblem("TW101", f"invalid TOML: {error}", hint)]) from None
    except RecursionError:
        problem = RigProblem("TW101", "invalid TOML: too many nested brackets", "remove brackets")
        raise RigError(path, [problem]) from None
    hint = 'write [bus.NAME], [device."PATH"] or [battery]'
    problems = [
        RigProblem(
            "TW102", f"[{key}]: unknown table: a rig has [bus], [device] and [battery]", suggestion(key, TABLES) or hint
        )
        for key in content
        if key not in TABLES
    ]
    buses = {name: _bus(name, table, problems) for name, table in _tables(content, "bus", "NAME", problems)}
    devices = dict(_tables(content, "device", '"PATH"', problems))
    battery = _battery(content["battery"], problems) if "battery" in content else None
    problems += _shared_channels([bus for bus in buses.values() if bus is not None])
    if problems:
        raise RigError(path, problems)
    named = {
        name: replace(bus, key=os.path.join(Path(path).parent, bus.key)) if bus.key else bus
        for name, bus in buses.items()
        if bus is not None
    }
    return RigFile(Path(path), text, named, devices, battery)


def read_text(path: Path) -> str:
    """Return the text of a rig file, with the line ends of Linux. Raises RigError."""
    if path.is_dir():
        raise RigError(path, [RigProblem("TW101", "is a folder", "pass a rig file, such as lab.toml")])
    try:
        return read_small(path).decode("utf-8-sig").replace("\r\n", "\n")
    except FileNotFoundError:
        near = suggestion(path.name, [file.name for file in path.parent.glob("*.toml")]) if path.parent.is_dir() else ""
        raise RigError(path, [RigProblem("TW101", "no such file", near)]) from None
    except UnicodeDecodeError:
        raise RigError(path, [RigProblem("TW101", "not UTF-8 text", "save the file in the encoding UTF-8")]) from None
    except OSError as error:
        raise RigError(path, [RigProblem("TW101", f"cannot be read: {error.strerror}")]) from None


def _tables(content, kind, name, problems):
    """Yield (name, table) of every [kind.name]."""
    entries = content.get(kind, {})
    if not isinstance(entries, dict):
        problems.append(RigProblem("TW102", f"{kind} = {entries!r}: expected a table", f"write [{kind}.{name}]"))
        return []
    hint = f"write [{kind}.{name}], followed by its keys"
    problems += [
        RigProblem("TW102", f"[{kind}] {key} = {value!r}: expected a table", hint)
        for key, value in entries.items()
        if not isinstance(value, dict)
    ]
    return [(key, value) for key, value in entries.items() if isinstance(value, dict)]


def _battery(table, problems):
    """Return the Battery of a table; None if it is invalid, with the problems added to `problems`."""

    def report(message, hint):
        problems.append(RigProblem("TW102", f"[battery] {message}", hint))

    if isinstance(table, dict):
        return parse_battery(table, report)
    report(f"= {table!r}: expected a table", "write [battery], followed by its keys")
    return None


def _bus(name, table, problems):
    """Return the RigBus of a table; None if it is invalid, with the problems added to `problems`."""
    before = len(problems)

    def report(message, hint):
        problems.append(RigProblem("TW102", f"[bus.{name}] {message}", hint))

    for key in table:
        if key not in KEYS:
            report(f"{key}: unknown key", suggestion(key, KEYS) or f"it has {', '.join(KEYS)}")
    for key, (kind, example, needed) in KEYS.items():
        if key not in table:
            if needed and not any(suggestion(other, (key,)) for other in table if other not in KEYS):
                report(f"{key} is missing", f"write {key} = {example}")
        elif type(table[key]) is not kind or table[key] == "":
            report(f"{key} = {table[key]!r}: expected {WORDS[kind]}", f"write {key} = {example}")
    if len(problems) > before:
        return None
    parsed = RigBus(name, **table)
    if parsed.interface in CHIP_BUSES:
        _check_chip_bus(parsed, table, report)
        return parsed if len(problems) == before else None
    if not BITRATE_MINIMUM <= parsed.bitrate <= BITRATE_MAXIMUM:
        report(
            f"bitrate = {parsed.bitrate}: outside the range of CAN, {BITRATE_MINIMUM} to {BITRATE_MAXIMUM} bit/s",
            "write bitrate = 1_000_000",
        )
    if "data_bitrate" in table and not parsed.fd:
        report("data_bitrate: only frames of CAN FD have a data phase", "write fd = true, or remove data_bitrate")
    elif "data_bitrate" in table and not parsed.bitrate <= parsed.data_bitrate <= DATA_BITRATE_MAXIMUM:
        report(
            f"data_bitrate = {parsed.data_bitrate}: outside the range of CAN FD on this bus, from its bitrate, "
            f"{parsed.bitrate}, to {DATA_BITRATE_MAXIMUM} bit/s",
            "write data_bitrate = 5_000_000",
        )
    if parsed.interface == SOCKETCAN and not re.fullmatch(r"[^/\s]{1,%d}" % INTERFACE_NAME_LIMIT, parsed.channel):
        report(
            f"channel = {parsed.channel!r}: not a valid name of a network interface",
            'write channel = "can0"; `ip link` lists the interfaces of this machine',
        )
    _check_options(parsed, report)
    if parsed.interface == UDP:
        _check_udp(parsed, report)
    for only in ("peer", "key") if parsed.interface != UDP else ():
        if getattr(parsed, only):
            report(f"{only}: only valid for UDP", "remove it")
    if parsed.interface not in (SOCKETCAN, UDP) and parsed.interface not in _kinds():
        report(
            f"interface = {parsed.interface!r}: python-can has no such interface",
            suggestion(parsed.interface, [*_kinds(), UDP, *CHIP_BUSES]) or 'write interface = "socketcan"',
        )
    return parsed if len(problems) == before else None


def _check_options(bus, report):
    """Check the options of a bus. report : callback for (message, hint)"""
    if bus.options and bus.interface in (SOCKETCAN, UDP):
        report(f"options: {bus.interface} does not use python-can and has no options", "remove them")
    for key, value in bus.options.items():
        if key in OWN:
            report(f"options.{key}: key of the bus itself", f"write {key} in [bus.{bus.name}]")
        elif not _is_plain(value):
            report(f"options.{key} = {value}: expected text, a number, true or false, or a list of those", "remove it")


def _is_plain(value):
    """Return whether a value is text, a number, a bool or a list of those."""
    return all(map(_is_plain, value)) if isinstance(value, list) else isinstance(value, (str, int, float, bool))


def _check_udp(bus, report):
    """Check a UDP bus. report : callback for (message, hint)"""
    for key in ("channel", "peer"):
        text = getattr(bus, key)
        try:
            if text:
                Endpoint(text)
        except ValueError as error:
            report(
                f"{key} = {text!r}: {error}",
                f"write {key} = " + (EXAMPLE if key == "channel" else '"192.168.4.2:9871"'),
            )
    if bus.peer and bus.key:
        report("peer and key exclude each other: signed datagrams are received from any address", "remove peer")
    if bus.fd:
        report("fd = true: UDP carries classic CAN frames only", "remove it")


def _check_chip_bus(bus, table, report):
    """Check an I2C or SPI bus. report : callback for (message, hint)"""
    example, spi = CHIP_BUSES[bus.interface], bus.interface == SPI
    for key in table:
        if key not in ("interface", "channel", *["bitrate"] * spi):
            report(
                f"{key}: not valid for an {bus.interface.upper()} bus",
                "remove it"
                + ("" if spi else "; the clock is set in the system's configuration: dtparam=i2c_arm_baudrate"),
            )
    if spi and not BITRATE_MINIMUM <= bus.bitrate <= SPI_CLOCK_MAXIMUM:
        report(
            f"bitrate = {bus.bitrate}: outside the range of the clock, {BITRATE_MINIMUM} to {SPI_CLOCK_MAXIMUM} bit/s",
            "write bitrate = 1_000_000",
        )
    if not bus.channel.startswith(("/dev/", EMULATED)):
        report(
            f"channel = {bus.channel!r}: expected a device file in /dev, or {EMULATED}PATH for `emulate`",
            f'write channel = "{example}"; ls {example.rstrip("01")}* lists the buses of this machine',
        )
    elif spi and re.fullmatch(r"/dev/spidev\d+\.\d+", bus.channel):
        channel, chip_select = bus.channel.split(".")
        report(
            f"channel = {bus.channel!r}: it includes a chip select",
            f'write channel = "{channel}", and chip_select = {chip_select} of the device',
        )


def _kinds():
    """Return the interface names of python-can.

    Its import takes 0.1 s, so this is not called for SocketCAN.
    """
    from can import VALID_INTERFACES

    return sorted(VALID_INTERFACES)


def _shared_channels(buses):
    """Yield a RigProblem for each bus with the channel of another."""
    first = {}
    for bus in buses:
        other = first.setdefault((bus.interface, bus.channel), bus)
        if other is not bus:
            yield RigProblem(
                "TW102",
                f"[bus.{bus.name}] channel = {bus.channel!r} is also used by [bus.{other.name}]",
                "use a separate interface, or put the devices that share a wire on one bus in the diagram",
            )

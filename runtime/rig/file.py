"""Rig files: which interface stands behind each logical bus, and which devices are mounted otherwise than the diagram
says.

    [bus.legs]
    interface = "socketcan"
    channel = "can0"
    bitrate = 1_000_000

    [device."left/knee"]
    can_id = 3

Here the file is read by itself; runtime.rig.overrides has what it says of a diagram.
"""

import re
import sys
from dataclasses import dataclass, field
from pathlib import Path

from graph.names import suggestion
from runtime.rig.errors import RigError, Trouble
from runtime.rig.udp import EXAMPLE, UDP, Endpoint

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SOCKETCAN, I2C = "socketcan", "i2c"
SLOWEST, FASTEST = 10_000, 1_000_000  # bit/s that CAN is specified for
LONGEST_NAME = 15  # characters of a network interface
KEYS = {  # of a bus: type, example, whether it must be there
    "interface": (str, '"socketcan"', True),
    "channel": (str, '"can0"', True),
    "bitrate": (int, "1_000_000", False),
    "fd": (bool, "true", False),
    "peer": (str, '"192.168.4.2:9871"', False),
    "options": (dict, "{ ttyBaudrate = 1_000_000 }", False),
}
OWN = ("interface", "channel", "bitrate", "fd")  # that `options` cannot say again
WORDS = {str: "text", int: "a whole number of bit/s", bool: "true or false", dict: "a table"}


@dataclass(frozen=True)
class RigBus:
    """
    interface : of python-can's kinds, udp, or i2c; channel : which one; bitrate in bit/s; fd : whether it carries CAN
        FD
    peer : where UDP sends to, "" for nowhere
    options : more that the interface of python-can is given, as it is
    """

    name: str
    interface: str
    channel: str
    bitrate: int = FASTEST
    fd: bool = False
    peer: str = ""
    options: dict = field(default_factory=dict)


@dataclass(frozen=True)
class RigFile:
    """buses : RigBus by logical name; devices : {path: {parameter: value}}; text : the file as it was"""

    path: Path
    text: str
    buses: dict
    devices: dict


def read(path):
    """The RigFile at a path. RigError with everything that is wrong with it as a file."""
    return parse(Path(path), text_of(Path(path)))


def parse(path, text):
    """The RigFile of a text, which came from that path. RigError."""
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        hint = 'text stands in "", and so does a path in a name: [device."left/knee"]'
        raise RigError(path, [Trouble("TW101", f"it is not TOML: {error}", hint)]) from None
    hint = 'write [bus.NAME] or [device."PATH"]'
    troubles = [
        Trouble("TW102", f"[{key}]: a rig has buses and devices", suggestion(key, ("bus", "device")) or hint)
        for key in content
        if key not in ("bus", "device")
    ]
    buses = {name: bus(name, table, troubles) for name, table in tables(content, "bus", "NAME", troubles)}
    devices = dict(tables(content, "device", '"PATH"', troubles))
    troubles += shared_channels([found for found in buses.values() if found is not None])
    if troubles:
        raise RigError(path, troubles)
    return RigFile(path, text, buses, devices)


def text_of(path):
    if path.is_dir():
        raise RigError(path, [Trouble("TW101", "it is a folder", "name the file of a rig, such as lab.toml")])
    try:
        return path.read_bytes().decode("utf-8").replace("\r\n", "\n")
    except FileNotFoundError:
        near = suggestion(path.name, [file.name for file in path.parent.glob("*.toml")]) if path.parent.is_dir() else ""
        raise RigError(path, [Trouble("TW101", "there is no such file", near)]) from None
    except UnicodeDecodeError:
        raise RigError(path, [Trouble("TW101", "it is not text in UTF-8", "a rig file is TOML")]) from None
    except OSError as error:
        raise RigError(path, [Trouble("TW101", f"cannot be read: {error.strerror}")]) from None


def tables(content, kind, name, troubles):
    """(name, table) of every [kind.name]."""
    found = content.get(kind, {})
    if not isinstance(found, dict):
        troubles.append(Trouble("TW102", f"{kind} = {found!r}: expected a table", f"write [{kind}.{name}]"))
        return []
    hint = f"write [{kind}.{name}], and what it says below that"
    troubles += [
        Trouble("TW102", f"[{kind}] {key} = {value!r}: expected a table", hint)
        for key, value in found.items()
        if not isinstance(value, dict)
    ]
    return [(key, value) for key, value in found.items() if isinstance(value, dict)]


def bus(name, table, troubles):
    """The RigBus that a table says; None where it says something wrong, which is added to `troubles`."""
    before = len(troubles)

    def wrong(message, hint):
        troubles.append(Trouble("TW102", f"[bus.{name}] {message}", hint))

    for key in table:
        if key not in KEYS:
            wrong(f"{key}: there is no such key", suggestion(key, KEYS) or f"it has {', '.join(KEYS)}")
    for key, (kind, example, needed) in KEYS.items():
        if key not in table:
            if needed and not any(suggestion(other, (key,)) for other in table if other not in KEYS):
                wrong(f"{key} is missing", f"write {key} = {example}")
        elif type(table[key]) is not kind or table[key] == "":
            wrong(f"{key} = {table[key]!r}: expected {WORDS[kind]}", f"write {key} = {example}")
    if len(troubles) > before:
        return None
    found = RigBus(name, **table)
    if found.interface == I2C:
        check_i2c(found, table, wrong)
        return found if len(troubles) == before else None
    if not SLOWEST <= found.bitrate <= FASTEST:
        wrong(f"bitrate = {found.bitrate}: CAN has {SLOWEST} to {FASTEST} bit/s", "write bitrate = 1_000_000")
    if found.interface == SOCKETCAN and not re.fullmatch(r"[^/\s]{1,%d}" % LONGEST_NAME, found.channel):
        wrong(
            f"channel = {found.channel!r}: no network interface has such a name",
            'write channel = "can0"; `ip link` lists those of this machine',
        )
    check_options(found, wrong)
    if found.interface == UDP:
        check_udp(found, wrong)
    elif found.peer:
        wrong("peer is of UDP alone", "take it out")
    if found.interface not in (SOCKETCAN, UDP) and found.interface not in kinds():
        wrong(
            f"interface = {found.interface!r}: python-can has none of that name",
            suggestion(found.interface, [*kinds(), UDP, I2C]) or 'write interface = "socketcan"',
        )
    return found if len(troubles) == before else None


def check_options(bus, wrong):
    """wrong : called with what is wrong, and the cure"""
    if bus.options and bus.interface in (SOCKETCAN, UDP):
        wrong(f"options: {bus.interface} is driven without python-can, and has none", "take them out")
    for key, value in bus.options.items():
        if key in OWN:
            wrong(f"options.{key}: that belongs to the bus itself", f"write {key} in [bus.{bus.name}]")
        elif not is_plain(value):
            wrong(f"options.{key} = {value}: expected text, a number, true or false, or a list of those", "take it out")


def is_plain(value):
    return all(map(is_plain, value)) if isinstance(value, list) else isinstance(value, (str, int, float, bool))


def check_udp(bus, wrong):
    """wrong : called with what is wrong, and the cure"""
    for key in ("channel", "peer"):
        text = getattr(bus, key)
        try:
            if text:
                Endpoint(text)
        except ValueError as error:
            wrong(
                f"{key} = {text!r}: {error}",
                f"write {key} = " + (EXAMPLE if key == "channel" else '"192.168.4.2:9871"'),
            )
    if bus.fd:
        wrong("fd = true: a datagram of UDP is a classic frame", "take it out")


def check_i2c(bus, table, wrong):
    """wrong : called with what is wrong, and the cure"""
    for key in table:
        if key not in ("interface", "channel"):
            wrong(
                f"{key}: an I2C bus has none",
                "take it out; how fast it is, the system's configuration says: dtparam=i2c_arm_baudrate",
            )
    if not bus.channel.startswith("/dev/"):
        wrong(
            f"channel = {bus.channel!r}: an I2C bus is a file in /dev",
            'write channel = "/dev/i2c-1"; ls /dev/i2c-* lists those of this machine',
        )


def kinds():
    """Names of the interfaces that python-can has here. It takes a tenth of a second to import, so SocketCAN is not
    looked up.
    """
    from can import VALID_INTERFACES

    return sorted(VALID_INTERFACES)


def shared_channels(buses):
    first = {}
    for bus in buses:
        other = first.setdefault((bus.interface, bus.channel), bus)
        if other is not bus:
            yield Trouble(
                "TW102",
                f"[bus.{bus.name}] channel = {bus.channel!r} is that of [bus.{other.name}] too",
                "two buses of a robot are two interfaces; what shares a wire has one bus in the diagram",
            )

"""The bus that the options of a command select."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from runtime.host.errors import BadInput
from runtime.host.machine.can import ARPHRD_CAN, bitrates
from runtime.host.machine.probe import Machine
from runtime.host.suggestions import suggestion
from runtime.robot.rig.errors import Refused
from runtime.robot.rig.file import CHIP_BUSES, I2C, SOCKETCAN, SPI, UDP, parse, read
from runtime.robot.rig.interface_checks import link
from runtime.robot.rig.tool_bus import ToolBus

if TYPE_CHECKING:
    from argparse import Namespace

    from runtime.robot.rig.file import RigBus


def named_buses(options: Namespace, machine: Machine | None = None) -> list[RigBus]:
    """Return the RigBuses selected by the options of `add_bus`, or all CAN interfaces of this machine.

    Raises BadInput if the options conflict or match no bus.
    """
    machine = machine or Machine()
    if options.rig is not None:
        if options.interface or options.channel or options.bitrate:
            raise BadInput("--rig and --interface, --channel, --bitrate exclude each other: the rig contains all three")
        buses = read(options.rig).buses
        if options.bus is not None and options.bus not in buses:
            hint = suggestion(options.bus, buses) or f"its buses: {', '.join(buses) or 'none'}"
            raise BadInput(f"--bus {options.bus}: {options.rig} has no such bus; {hint}")
        if not buses:
            raise BadInput(f"{options.rig} has no bus: write [bus.legs] with interface and channel")
        if options.bus is not None:
            return [bus for bus in (buses[options.bus],) if bus.interface != UDP]
        return [bus for bus in buses.values() if bus.interface not in (UDP, SPI)]  # SPI has no addresses to query
    if options.bus is not None:
        raise BadInput("--bus selects a bus of a rig file: add --rig RIG")
    if options.channel or (options.interface and options.interface != SOCKETCAN):
        if not options.channel:
            example = CHIP_BUSES.get(options.interface, "/dev/ttyACM0")
            raise BadInput(f"--interface {options.interface} needs a channel: add, for example, --channel {example}")
        return [one_bus(options.interface or SOCKETCAN, options.channel, options.bitrate, machine)]
    names = [path.split("/")[-2] for path in machine.glob("sys/class/net/*/type") if machine.read(path) == ARPHRD_CAN]
    if not names:
        raise BadInput(
            "this machine has no CAN interface: check that the adapter is plugged in and its driver is loaded, or run "
            "the command `doctor`. For an adapter that is not a network interface, name it: --interface slcan "
            "--channel /dev/ttyACM0"
        )
    return [one_bus(SOCKETCAN, name, options.bitrate, machine) for name in names]


def one_bus(interface: str, channel: str, bitrate: int | None, machine: Machine) -> RigBus:
    """Return a RigBus, parsed as from a rig file so that errors have the same text."""
    own = fast = None
    if interface == SOCKETCAN and bitrate is None:
        own, fast = bitrates(link(channel, machine).get("info_data") or {})
    text = f"[bus.can]\ninterface = {quoted(interface)}\nchannel = {quoted(channel)}\n"
    text += f"bitrate = {bitrate or own}\n" if bitrate or own else ""
    text += f"fd = true\ndata_bitrate = {fast}\n" if fast else ""
    bus = parse("the command line", text).buses["can"]
    plain = "".join(letter if letter.isalnum() else "_" for letter in channel).strip("_")
    return (
        replace(bus, name="imus") if interface == I2C else replace(bus, name=plain) if interface == SOCKETCAN else bus
    )


def quoted(text: object) -> str:
    """Return a text as a TOML string."""
    return json.dumps(str(text), ensure_ascii=False)


def entry(bus: RigBus, name: str | None = None) -> list[str]:
    """Return the lines of a rig file for a bus."""
    lines = [f"[bus.{name or bus.name}]", f"interface = {quoted(bus.interface)}", f"channel = {quoted(bus.channel)}"]
    lines += [f"bitrate = {bus.bitrate:_}"] * (bus.interface != I2C)
    lines += ["fd = true"] * bus.fd + [f"data_bitrate = {bus.data_bitrate:_}"] * (bus.data_bitrate > 0)
    if bus.options:
        lines.append("options = { " + ", ".join(f"{key} = {plain(value)}" for key, value in bus.options.items()) + " }")
    return lines


def plain(value: Any) -> str:
    """Return a value of `options` in TOML notation."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return "[" + ", ".join(map(plain, value)) + "]"
    return quoted(value) if isinstance(value, str) else repr(value)


def single_bus(options: Namespace) -> RigBus:
    """Return the one RigBus that the options select. Raises BadInput if there are several."""
    buses = named_buses(options)
    if len(buses) != 1:
        names = ", ".join(f"{bus.name} ({bus.channel})" for bus in buses)
        raise BadInput(
            f"more than one bus: {names}. Select one: add "
            + ("--bus NAME" if options.rig is not None else "--channel NAME")
        )
    return buses[0]


def i2c_bus(options: Namespace) -> RigBus:
    """Return the one I2C RigBus that the options select or this machine has. Raises BadInput otherwise."""
    from runtime.robot.rig.i2c import hint_of_buses, paths

    if options.rig is None:
        options.interface = options.interface or I2C
        channels = paths()
        if options.channel is None and len(channels) == 1:
            options.channel = channels[0]
        if options.channel is None:
            raise BadInput(f"no I2C bus selected: add, for example, --channel /dev/i2c-1; {hint_of_buses()}")
    buses = [bus for bus in named_buses(options) if bus.interface == I2C]
    if len(buses) != 1:
        raise BadInput(
            f"more than one I2C bus: select one of {', '.join(f'--bus {bus.name}' for bus in buses)}"
            if buses
            else "the selected buses include no I2C bus"
        )
    return buses[0]


def open_bus(bus: RigBus) -> ToolBus:
    """Open a ToolBus. Raises BadInput with the cause and the remedy."""
    try:
        return ToolBus(bus)
    except Refused as refused:
        raise BadInput(str(refused.problem)) from None


def in_candump(identifier: int, extended: bool, data: bytes) -> str:
    """Return a frame in the notation of candump's log."""
    return f"{identifier:08X}#{data.hex().upper()}" if extended else f"{identifier:03X}#{data.hex().upper()}"

"""Changes that a rig makes to a diagram: hardware parameters of devices, and bitrates of buses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from graph import Device, DiagramError
from graph.budget import CLASSIC_BYTES
from runtime.host.suggestions import suggestion
from runtime.robot.rig.errors import RigError, RigProblem

if TYPE_CHECKING:
    from graph import Diagram
    from runtime.robot.rig.file import RigFile


def override(rig: RigFile, diagram: Diagram) -> None:
    """Apply a rig to a diagram before it is compiled. Raises RigError with every mismatch of the two.

    rig : RigFile
    """
    devices = {block.path: block for block in diagram if isinstance(block, Device)}
    problems = list(_unmapped(rig, {block.bus for block in devices.values() if block.medium != "stream"}))
    for path, values in rig.devices.items():
        if path in devices:
            problems += _changed(devices[path], values, str(rig.path))
        else:
            problems.append(_unknown_path(path, diagram, devices))
    problems += _other_bitrates(rig, devices.values())
    problems += _without_fd(rig, devices.values())
    if problems:
        raise RigError(rig.path, problems)
    for block in devices.values():
        if block.medium in ("can", "spi"):
            bus = rig.buses[block.bus]
            block.bitrate, block.data_bitrate = float(bus.bitrate), float(bus.data_bitrate)


def _other_bitrates(rig, devices):
    """Yield a RigProblem for each device with another bitrate than its bus."""
    for device in devices:
        bus = rig.buses.get(device.bus)
        if bus is not None and "bitrate" in device.parameters and device.bitrate != bus.bitrate:
            yield RigProblem(
                "TW103",
                f"[bus.{device.bus}] has {bus.bitrate / 1e3:g} kbit/s, but {device.path} is set to "
                f"{device.bitrate / 1e3:g} kbit/s",
                f"connect it to a separate bus, or set the device to {bus.bitrate / 1e3:g} kbit/s and write "
                f'[device."{device.path}"] '
                f"bitrate = {bus.bitrate}",
            )


def _without_fd(rig, devices):
    """Yield a RigProblem for each device whose frames need CAN FD on a bus without it."""
    for device in devices:
        bus = rig.buses.get(device.bus)
        longest = max((length for length, _ in device.traffic()), default=0) if device.medium == "can" else 0
        if bus is not None and longest > CLASSIC_BYTES and not bus.fd:
            yield RigProblem(
                "TW103",
                f"[bus.{device.bus}] carries classic CAN, but {device.path} exchanges frames of {longest} bytes",
                "write fd = true, and the data_bitrate that is set in its devices",
            )


def _unmapped(rig, names):
    """Yield a RigProblem for each bus of the diagram without an interface. names : names of the rig's buses"""
    for name in sorted(names - rig.buses.keys()):
        near = suggestion(name, rig.buses.keys() - names)
        yield RigProblem(
            "TW104",
            f"no interface for bus {name!r}" + (f"; {near}" if near else ""),
            f'add [bus.{name}] with interface = "socketcan" and channel = "can0"',
        )


def _unknown_path(path, diagram, devices):
    """Return the RigProblem of a path without a device."""
    if path in diagram.blocks:
        kind = type(diagram.blocks[path]).__name__
        return RigProblem(
            "TW103",
            f'[device."{path}"] is a {kind} and not a device',
            f"a rig changes hardware parameters only; for one run, --set {path}.PARAMETER=VALUE changes any block",
        )
    return RigProblem(
        "TW103",
        f'[device."{path}"]: {diagram.name} has no such device',
        suggestion(path, devices)
        or _unquoted(path, devices)
        or f"its devices are {', '.join(sorted(devices)) or 'none'}",
    )


def _unquoted(path, devices):
    """Return the hint for [device.left.knee], a table within a table in TOML, "" for another path."""
    inside = next((device for device in devices if device.startswith(f"{path}/")), "")
    return inside and f'quote the whole path: [device."{inside}"]'


def _changed(device, values, source):
    """Set the values of a device together; return a RigProblem for each invalid one. source : path of the rig file"""
    problems = [problem for name, value in values.items() if (problem := _put(device, name, value, source))]
    if problems or not values:
        return problems
    try:
        device.reconfigure()
    except DiagramError as error:
        entries = ", ".join(f"{name} = {value!r}" for name, value in values.items())
        hint = device.parameters[next(iter(values))].description if len(values) == 1 else ""
        return [RigProblem("TW102", f'[device."{device.path}"] {entries}: {error.diagnostics[0].message}', hint)]
    return []


def _put(device, name, value, source):
    """Set one value, without the rules of the device; return the RigProblem of an invalid one, else None."""
    entry = f'[device."{device.path}"] {name}'
    if name not in device.hardware:
        known = f"{type(device).__name__} has {', '.join(device.hardware) or 'none'}"
        if name in device.parameters:
            return RigProblem("TW102", f"{entry} is not a hardware parameter", f"set it in the diagram; {known}")
        return RigProblem("TW102", f"{entry}: no such parameter", suggestion(name, device.hardware) or known)
    try:
        device.put(name, value, source)
    except DiagramError as error:
        message = error.diagnostics[0].message.removeprefix(f"{name}: ")
        return RigProblem("TW102", f"{entry} = {value!r}: {message}", device.parameters[name].description)
    return None
